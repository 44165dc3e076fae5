"""From the keys of an effect in the machine file to its values in SI units."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ph_post.agreement import agreed
from ph_post.drive.effects.base import Effect, Parameter
from ph_post.errors import InputError
from ph_post.types import Axis


def effect_values(effect: Effect, axis: Axis, given: Mapping[str, Any], where: str) -> dict[str, float]:
    """Return what `apply` takes, in SI units.

    Parameters
    ----------
    effect : Effect
    axis : Axis
        Whose constants the units of forces and torques need.
    given : mapping
        Numbers and choices by key, each of the right type and within its bounds.
    where : str
        Where the effect stands, for the refusal.

    Raises
    ------
    InputError
        Where a value is missing, given twice and differently, or at odds with another, or the axis lacks a
        constant that its unit needs.

    Examples
    --------
    >>> from ph_post.drive.effects.transport_delay import EFFECT
    >>> from ph_post.types import Gap, Limits, Servo
    >>> limits, gap = Limits(velocity=1.0, acceleration=1.0, jerk=1.0), Gap(lost_motion=0.0)
    >>> axis = Axis(name="X", feedback="load", servo=Servo(b=1.0, c=1.0), gap=gap, limits=limits)
    >>> effect_values(EFFECT, axis, {"delay_ms": 4}, "here")
    {'delay': 0.004, 'where': 0.0}
    """
    values: dict[str, float] = {}
    for gives, parameters in effect.ways().items():
        found = ((one.name, _in_si(one, axis, given, where)) for one in parameters)
        value = agreed(found, lambda key: f"{where}.{key}")
        if value is None:
            names = " or ".join(one.name for one in parameters)
            raise InputError(where, f'key "{parameters[0].name}" is missing', expected=names)
        values[gives] = value
    fault = effect.fault(axis, values)
    if fault is not None:
        ways = effect.ways()[fault.gives]
        told = next((one for one in ways if one.name in given), ways[0])
        got = given.get(told.name, told.default)
        raise InputError(f"{where}.{told.name}", fault.what, expected=fault.expected, got=f"{got}")
    return values


def _in_si(parameter: Parameter, axis: Axis, given: Mapping[str, Any], where: str) -> float | None:
    number = given.get(parameter.name, parameter.default)
    if number is None:
        return None
    if parameter.unit is None:
        return float(parameter.choices.index(number))
    scale = parameter.unit.scale(axis)
    if scale is None:
        what = f"{parameter.unit.symbol} cannot be converted on this axis"
        raise InputError(f"{where}.{parameter.name}", what, expected=parameter.unit.needs, got=f"{number:g}")
    return float(number) * scale
