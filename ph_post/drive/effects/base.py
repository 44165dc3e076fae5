"""The definition of an effect, its values in SI units, and the literature that effects share.

An effect is one definition that the machine file, the simulator and whoever fits it to a measurement share:
its parameters in the units of the shop, with their bounds, and what it does to a :class:`Plant`.

To add one: make an :class:`Effect` and register it, under its own name, as entry point of the group
``ph_post.effects``. Its `apply` is a pure function of plant and values and adds to what it finds, so that
effects combine in the order of the file. Where two of a kind cannot both hold on one axis it says `once`.

What can be said in the constants of a plant (friction, viscous coefficients, loads, delays, cogging, a gap
that differs from place to place, what is read of a table, ...) runs compiled, whoever wrote the effect. Any
other force is a Python function that `apply` adds to the `forces` of the plant::

    def drag(plant: Plant, values: Values) -> Plant:
        size, speed_of_size = values["size"], values["speed"]

        def force(t: float, position: float, speed: float, direction: float) -> float:
            return size * (speed / speed_of_size) ** 3

        return replace(plant, forces=(*plant.forces, force))

Its unit is that of all forces on a plant, metres of following error. It is continuous in time, position and
speed: dry friction, which can hold an axis, belongs in the constants. An axis that has one runs in the slow
engine (:mod:`ph_post.simulate.slow`), a thousand times as long and more; the others are as fast as ever.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, Literal

import msgspec

from ph_post.consistency import consistent_value
from ph_post.drive.plant import Plant
from ph_post.errors import InputError
from ph_post.types import EVERY_LOOP, Axis, Feedback
from ph_post.units import DEGREE, HERTZ, MM, MM_PER_MIN, MS

Values = Mapping[str, float]
"""Values of an effect in SI units by :attr:`Parameter.gives`; of a choice, its place among the choices."""

ANY = msgspec.Meta()
POSITIVE = msgspec.Meta(gt=0)
NOT_NEGATIVE = msgspec.Meta(ge=0)

Kind = Literal["command", "force", "state", "reading", "across axes"]


class Unit(msgspec.Struct, frozen=True, kw_only=True):
    """A unit of the shop.

    `scale` is what one of it is in SI, None on an axis whose constants do not tell; `needs` says which
    constants of the axis it wants.
    """

    symbol: str
    scale: Callable[[Axis], float | None]
    needs: str = ""


class Parameter(msgspec.Struct, frozen=True, kw_only=True):
    """One key of an effect in the machine file.

    Parameters
    ----------
    name : str
        The key, with the unit as its ending.
    gives : str
        The value it gives to `apply`. Keys that give the same value are two ways of saying one thing, of
        which one is needed, and which must agree.
    meaning : str
    unit : Unit, optional
        None for a choice.
    choices : tuple of str
        The words it may have, in place of a number.
    bounds : msgspec.Meta
        Its `gt`, `ge`, `lt` and `le`, in the unit of the parameter.
    default : float or str, optional
        What it is where the file does not have it; None where the file must.
    """

    name: str
    gives: str
    meaning: str
    unit: Unit | None = None
    choices: tuple[str, ...] = ()
    bounds: msgspec.Meta = ANY
    default: float | str | None = None


class EffectFault(msgspec.Struct, frozen=True, kw_only=True):
    """Values that do not go together: which of them is wrong (its `gives`), and why."""

    gives: str
    what: str
    expected: str


def no_fault(axis: Axis, values: Values) -> EffectFault | None:  # noqa: ARG001
    """Find nothing wrong with values that are each within their bounds."""
    return None


class Effect(msgspec.Struct, frozen=True, kw_only=True):
    """A physical effect.

    Parameters
    ----------
    name : str
    kind : {"command", "force", "state", "reading", "across axes"}
        Where it acts: on what is commanded, as a force on the table, on the state of the drive, on what is
        read, or from one axis on another.
    summary : str
        One line about it.
    source : str
        Literature or standard.
    parameters : tuple of Parameter
    apply : callable
        Plant and values to plant.
    fault : callable, optional
        What bounds cannot say; axis and values to the first fault, or None.
    once : bool
        Whether a second one on the same axis would contradict the first.
    feedbacks : frozenset of str
        Loops that feel it.
    """

    name: str
    kind: Kind
    summary: str
    source: str
    parameters: tuple[Parameter, ...]
    apply: Callable[[Plant, Values], Plant]
    fault: Callable[[Axis, Values], EffectFault | None] = no_fault
    once: bool = False
    feedbacks: frozenset[Feedback] = EVERY_LOOP

    def ways(self) -> dict[str, tuple[Parameter, ...]]:
        """Parameters by the value they give."""
        found: dict[str, tuple[Parameter, ...]] = {}
        for parameter in self.parameters:
            found[parameter.gives] = (*found.get(parameter.gives, ()), parameter)
        return found


def constant(symbol: str, size: float) -> Unit:
    """Make a unit that needs nothing of the axis."""
    return Unit(symbol=symbol, scale=lambda _axis: size)


def per_stiffness(symbol: str, size: float) -> Unit:
    """Make the unit of a force, of size [N]: in the units of the plant it is divided by K."""

    def scale(axis: Axis) -> float | None:
        stiffness = axis.servo.stiffness
        return None if stiffness is None else size / stiffness

    return Unit(symbol=symbol, scale=scale, needs=STIFFNESS)


STIFFNESS = "servo_stiffness_n_per_mm, or all of J, B, k_p, k_a, k_t, N and r"

ONE = constant("", 1.0)
SECOND = constant("s", 1.0)
MILLISECOND = constant("ms", MS)
MILLIMETRE = constant("mm", MM)
MM_PER_S = constant("mm/s", MM)
FEED = constant("mm/min", MM_PER_MIN)
HZ = constant("Hz", HERTZ)
RADIAN = constant("rad", 1.0)
DEGREES = constant("°", DEGREE)
NEWTON = per_stiffness("N", 1.0)
N_S_PER_MM = per_stiffness("N s/mm", 1.0 / MM)


FRICTION: Final = (
    "B. Armstrong-Hélouvry, P. Dupont, C. Canudas de Wit: A survey of models, analysis tools and "
    "compensation methods for the control of machines with friction, Automatica 30 (1994), "
    "doi:10.1016/0005-1098(94)90209-7"
)

FEED_DRIVES: Final = (
    "Y. Altintas, A. Verl, C. Brecher, L. Uriarte, G. Pritschow: Machine tool feed drives, "
    "CIRP Annals 60 (2011), doi:10.1016/j.cirp.2011.05.010"
)

TEST_CODE: Final = "ISO 230-1: Test code for machine tools, part 1: Geometric accuracy, 2012"

POSITIONING: Final = "ISO 230-2: Test code for machine tools, part 2: Positioning accuracy, 2014"

THERMAL: Final = "ISO 230-3: Test code for machine tools, part 3: Determination of thermal effects, 2020"

CUTTING: Final = (
    "Y. Altintas: Manufacturing Automation: Metal Cutting Mechanics, Machine Tool Vibrations, "
    "and CNC Design, 2nd ed., Cambridge University Press 2012"
)


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
        found = ((one.name, _in_si(one, parameters, axis, given, where)) for one in parameters)
        value = consistent_value(found, lambda key: f"{where}.{key}")
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


def _in_si(
    parameter: Parameter, ways: Sequence[Parameter], axis: Axis, given: Mapping[str, Any], where: str
) -> float | None:
    """Return a value in SI units; where its unit needs what the axis lacks, name the keys that need nothing."""
    number = given.get(parameter.name, parameter.default)
    if number is None:
        return None
    if parameter.unit is None:
        return float(parameter.choices.index(number))
    scale = parameter.unit.scale(axis)
    if scale is None:
        what = f"{parameter.unit.symbol} cannot be converted on this axis"
        others = [one.name for one in ways if one.unit is not None and one.unit.scale(axis) is not None]
        expected = "; or ".join([parameter.unit.needs, *(f"{name} in its place" for name in others)])
        raise InputError(f"{where}.{parameter.name}", what, expected=expected, got=f"{number:g}")
    return float(number) * scale
