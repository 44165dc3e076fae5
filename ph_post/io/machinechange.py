"""What of a machine file changes where one machine becomes another, in the keys that its person chose."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from msgspec.structs import replace

from ph_post.diagnose.record import Estimate
from ph_post.io.machineedit import AxisChange, EffectChange
from ph_post.io.source import Source
from ph_post.types import Axis, EffectSetting
from ph_post.units import MM

SAME: Final = 1e-6
"""Relative difference of numbers that are the same: seven digits are written."""

_OTHERWISE: Final = {
    "backlash_motor_rad": "lost_motion_mm",
    "J": "b",
    "inertia_kg_m2": "b",
    "B": "c",
    "damping_kg_m2_s": "c",
    "k_p": "servo_stiffness_n_per_mm",
    "position_gain_v_per_m": "servo_stiffness_n_per_mm",
}
"""Keys that give in another way what a diagnosis calls by the usual one."""


def same(one: Any, other: Any) -> bool:
    """Whether two values are the same but for digits that are not written.

    Examples
    --------
    >>> same({"force_n": 20.0}, {"force_n": 20.00000001}), same([1.0], [1.1])
    (True, False)
    """
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(same(value, other[key]) for key, value in one.items())
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(same(*pair) for pair in zip(one, other, strict=True))
    if isinstance(one, int | float) and isinstance(other, int | float):
        return math.isclose(one, other, rel_tol=SAME)
    return bool(one == other)


def axis_change(
    before: Axis,
    after: Axis,
    original: Source,
    *,
    parameters: Mapping[str, Estimate],
    above: Sequence[str],
    effects: Mapping[str, EffectChange],
) -> AxisChange | None:
    """Return what makes one axis into another, None where it is nothing.

    Parameters
    ----------
    before, after : Axis
    original : Source
        The machine file of `before`.
    parameters : mapping of str to Estimate
        Standard errors to stand behind the numbers.
    above : sequence of str
        Lines to stand above the first number that changes.
    effects : mapping of str to EffectChange
        Comments of effects that are new or change, by the effect's name.
    """
    keys = axis_keys(before, after, _given(original, before.name))
    changed = effect_changes(before.effects, after.effects, effects)
    if not keys and not changed:
        return None
    comments = {
        key: words
        for key, value in keys.items()
        if isinstance(value, float) and (words := error_words(key, value, parameters))
    }
    return AxisChange(axis=before.name, keys=keys, comments=comments, above=tuple(above), effects=changed)


def axis_keys(before: Axis, after: Axis, given: Mapping[str, Any]) -> dict[str, float | str | None]:
    """Return the keys of ``[axes.AXIS]`` that make one axis into another, in the way the file gives them.

    Parameters
    ----------
    before, after : Axis
    given : mapping
        The keys of the file, with their values.
    """
    keys: dict[str, float | str | None] = {}
    for one, other, ways in _quantities(before, after, given):
        if not same(one, other):
            known = {key: value for key, value in ways.items() if key in given}
            keys |= known or dict(list(ways.items())[:1])
    stiffer = _ratio(after.servo.stiffness, before.servo.stiffness)
    if not same(stiffer, 1.0):  # J and B keep b and c where k_p changes
        for key in ("J", "inertia_kg_m2", "B", "damping_kg_m2_s"):
            if key in given:
                number = keys.get(key, given[key])
                keys[key] = float(number if isinstance(number, int | float) else given[key]) * stiffer
    return keys


def effect_changes(
    before: Sequence[EffectSetting], after: Sequence[EffectSetting], describe: Mapping[str, EffectChange]
) -> tuple[EffectChange, ...]:
    """Return the changes that make one list of effects into another, in its order, with comments by name.

    What is to stand behind another effect than before is taken out and added anew.
    """
    changes: list[tuple[int | None, EffectSetting | None]] = []
    reached = 0
    for place, setting in enumerate(before):
        if reached == len(after) or after[reached].name != setting.name:
            changes.append((place, None))
            continue
        if not same(dict(setting.parameters), dict(after[reached].parameters)):
            changes.append((place, after[reached]))
        reached += 1
    changes += [(None, setting) for setting in after[reached:]]
    plain = EffectChange(place=None, setting=None)
    return tuple(
        replace(plain if setting is None else describe.get(setting.name, plain), place=place, setting=setting)
        for place, setting in changes
    )


def error_words(key: str, value: float, parameters: Mapping[str, Estimate]) -> str:
    """Return the standard error of a key in words, nothing where none is known.

    A parameter is known by its name or by its value; a key that gives it in another unit has it in per cent.

    Examples
    --------
    >>> error_words("force_n", 20.4, {"force": Estimate(value=20.4, stderr=0.1, unit="N")})
    '+- 0.1 N'
    """
    keys = (key, _OTHERWISE.get(key, key))
    found = [one for name, one in parameters.items() for way in keys if f"{way}_".startswith(f"{name}_")]
    found += [one for one in parameters.values() if math.isclose(one.value, value, rel_tol=1e-4)]
    if not found or found[0].stderr is None:
        return ""
    estimate = found[0]
    if math.isclose(estimate.value, value, rel_tol=1e-4):
        return f"+- {estimate.stderr:.2g} {estimate.unit}".rstrip()
    return f"+- {100.0 * found[0].stderr / abs(estimate.value):.2g} %" if estimate.value else ""


def _given(original: Source, axis: str) -> dict[str, Any]:
    """Return the keys of an axis as they stand in the file, those of its control table with a dot."""
    table: dict[str, Any] = tomllib.loads(original.text)["axes"][axis]
    below = {f"control.{key}": value for key, value in table.get("control", {}).items()}
    return {key: value for key, value in table.items() if key not in ("control", "effects")} | below


def _quantities(
    before: Axis, after: Axis, given: Mapping[str, Any]
) -> Iterator[tuple[Any, Any, dict[str, float | str | None]]]:
    """Yield what may change: before, after, and the keys that it may stand under, the usual one first."""
    servo, gap, limits = after.servo, after.gap, before.gap
    angle = None
    if gap.travel_per_rad is not None and gap.gear_ratio is not None:
        angle = gap.lost_motion * gap.gear_ratio / gap.travel_per_rad
    yield limits.lost_motion, gap.lost_motion, {
        "lost_motion_mm": gap.lost_motion / MM, "backlash_motor_rad": angle,
    }  # fmt: skip
    b, c = _ratio(servo.b, before.servo.b), _ratio(servo.c, before.servo.c)
    stiffer = _ratio(servo.stiffness, before.servo.stiffness)
    yield before.servo.b, servo.b, {"b": servo.b, **_scaled(given, b, "J", "inertia_kg_m2")}
    yield before.servo.c, servo.c, {"c": servo.c, **_scaled(given, c, "B", "damping_kg_m2_s")}
    yield before.servo.stiffness, servo.stiffness, {
        "servo_stiffness_n_per_mm": None if servo.stiffness is None else servo.stiffness * MM,
        **_scaled(given, stiffer, "k_p", "position_gain_v_per_m"),
    }  # fmt: skip
    for key, one, other in (
        ("control.ki_over_kp_per_s", before.servo.ki_over_kp, servo.ki_over_kp),
        ("control.kd_over_kp_s", before.servo.kd_over_kp, servo.kd_over_kp),
        ("inertia_fraction", before.gap.inertia_fraction, gap.inertia_fraction),
        ("pickup", before.gap.pickup, gap.pickup),
        ("initial_flank", before.gap.initial_flank, gap.initial_flank),
        ("backlash_uncertainty", before.uncertainty.backlash, after.uncertainty.backlash),
        ("beta_uncertainty", before.uncertainty.beta, after.uncertainty.beta),
        ("gain_uncertainty", before.uncertainty.gain, after.uncertainty.gain),
    ):
        yield one, other, {key: other}
    tau = None if gap.beta is None else 1.0 / gap.beta
    yield before.gap.beta, gap.beta, {"motor_time_constant_s": tau}


def _scaled(given: Mapping[str, Any], ratio: float, *keys: str) -> dict[str, float | str | None]:
    return {key: given[key] * ratio for key in keys if key in given}


def _ratio(one: float | None, other: float | None) -> float:
    """Return the factor from `other` to `one`; 1 where there is none, as what it scales is not given then."""
    return one / other if one and other else 1.0
