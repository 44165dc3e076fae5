"""The effects that act on an axis, and its plant with them applied."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Final

import msgspec
from msgspec.structs import replace

from ph_post.drive.effects.base import Effect, effect_values
from ph_post.drive.effects.registry import find_effect, is_effect
from ph_post.drive.plant import Plant, base_plant, friction_brakes, scale_profile
from ph_post.types import Axis, EffectSetting, Scenario

FRICTION: Final = ("coulomb_plus", "coulomb_minus", "static", "viscous_plus", "viscous_minus")
"""What of a plant is friction: forces by the direction or the speed of the motion."""


class ActiveEffect(msgspec.Struct, frozen=True, kw_only=True):
    """An effect that acts on an axis, and its values in SI units."""

    effect: Effect
    values: Mapping[str, float]


def active_effects(axis: Axis) -> tuple[ActiveEffect, ...]:
    """Effects of an axis that act, in the order of the file.

    Raises
    ------
    InputError
        Where values are missing or contradict each other; a machine file has been checked for that.
    """
    where = f"axis {axis.name}: effects"
    return tuple(
        ActiveEffect(effect=effect, values=effect_values(effect, axis, setting.parameters, f"{where}[{number}]"))
        for number, setting in enumerate(axis.effects)
        if (effect := _felt(axis, setting)) is not None
    )


def ignored_effects(axis: Axis) -> tuple[str, ...]:
    """Names of an axis' effects that change nothing: reserved ones, and those its loop does not feel.

    Callers that simulate report these names.
    """
    return tuple(setting.name for setting in axis.effects if _felt(axis, setting) is None)


def unmoved_axes(axis: Axis, axes: Collection[str]) -> tuple[str, ...]:
    """Names of the axes whose position an axis is read with, and which are not among those that move.

    They count as standing at 0; callers that simulate report their names.
    """
    others = [name for name, _ in plant_of(axis, Scenario()).reading.others]
    return tuple(name for name in dict.fromkeys(others) if name not in axes)


def _felt(axis: Axis, setting: EffectSetting) -> Effect | None:
    if not is_effect(setting.name):
        return None
    effect = find_effect(setting.name)
    return effect if axis.feedback in effect.feedbacks else None


def plant_of(axis: Axis, scenario: Scenario) -> Plant:
    """Return an axis as a scenario has it, with its effects applied in the order of the file.

    A scenario's factor of the gap is one of all that the gap is at any place, that of friction one of all that
    resists by the direction or the speed of the motion, beyond c. Where gravity holds the axis, the gap is closed at
    all places. A table that runs on does so where motors brake harder than its friction.
    """
    plant = base_plant(axis, scenario)
    for one in active_effects(axis):
        plant = one.effect.apply(plant, one.values)
    if scenario.friction != 1.0:
        plant = replace(plant, **{name: scenario.friction * getattr(plant, name) for name in FRICTION})
    if axis.gravity_side:
        return replace(plant, gap=0.0, widening=None)
    if scenario.runs_on is not None and not axis.loop.encloses_backlash:
        brakes = friction_brakes(plant)
        runs_on = max(1.0, scenario.runs_on) * brakes < axis.limits.acceleration
        plant = replace(plant, slows=scenario.runs_on * brakes if runs_on else math.inf)
    factor = scenario.gap_factor(axis.uncertainty.backlash)
    if plant.widening is None or factor == 1.0:
        return plant
    return replace(plant, widening=scale_profile(plant.widening, factor))
