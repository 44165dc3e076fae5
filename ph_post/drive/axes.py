"""Axes of a machine as a compensation needs them: one backlash per axis, and a drive for every moved axis.

Inside a loop a gap is crossed where the axis turns back, so that place's gap counts. Behind a loop half the
gap is an offset that stays the same between two reversals: there the mean over the reversals counts.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from msgspec.structs import replace

from ph_post.drive.effects.active import active_effects, plant_of
from ph_post.drive.plant import base_plant, gap_at
from ph_post.errors import InputError
from ph_post.types import Array, Axis, Machine, Scenario, TurningPoint


def backlash_varies(axis: Axis) -> bool:
    """Return whether the gap of an axis changes along its travel."""
    return bool(axis.effects) and plant_of(axis, Scenario()).widening is not None


def has_backlash(axis: Axis) -> bool:
    """Return whether an axis has a gap anywhere that opens: gravity may keep it closed."""
    return axis.gravity_side is None and (axis.gap.lost_motion > 0.0 or backlash_varies(axis))


def backlash_uncertainties(machine: Machine, names: Iterable[str]) -> dict[str, float]:
    """Return the relative uncertainty of the backlash of each of some axes that has any, in the machine's order."""
    wanted = set(names)
    axes = {name: axis for name, axis in machine.axes.items() if name in wanted}
    return {name: axis.uncertainty.backlash for name, axis in axes.items() if has_backlash(axis)}


def side_offsets(axis: Axis) -> tuple[float, float]:
    """Lasting offsets of an axis' command while it moves to minus and while it moves to plus.

    Behind its loop the table is half the gap late, to either side of the middle. Positions are referred to the
    side in which the zero was taken, f (-1, 0 for the middle, 1), and the command is exact there without an offset:
    (d - f) g/2 in direction d.

    Parameters
    ----------
    axis : Axis
        With one gap, see :func:`axis_at` and :func:`sized_machine`.

    Returns
    -------
    minus, plus : float
        [m]. Both are 0 where a scale on the table, or gravity, leaves no lasting offset.

    Examples
    --------
    >>> from ph_post.drive.machinefile import read_machine
    >>> machine = read_machine("stepper")
    >>> [[round(1e3 * one, 6) for one in side_offsets(machine.axes[name])] for name in ("X", "Z")]
    [[-0.03, 0.03], [0.0, 0.03]]
    """
    if axis.loop.encloses_backlash or axis.gravity_side is not None:
        return 0.0, 0.0
    half, side = 0.5 * axis.gap.lost_motion, axis.reference_side
    return (-1 - side) * half + 0.0, (1 - side) * half


def lasting_offset(axis: Axis, direction: int) -> float:
    """Return which of :func:`side_offsets` [m] a direction of motion (1, -1) has; 0 for an axis that rests."""
    return side_offsets(axis)[direction > 0] if direction else 0.0


def gaps_of(axis: Axis, places: Array) -> Array:
    """Return the gap [m] at places of the table [m]."""
    return gap_at(plant_of(axis, Scenario()), places)


def axis_at(axis: Axis, place: float) -> Axis:
    """Return an axis whose gap is everywhere what it is at a place of the table [m]."""
    return with_gap(axis, float(gaps_of(axis, np.array([place]))[0])) if backlash_varies(axis) else axis


def with_gap(axis: Axis, lost_motion: float) -> Axis:
    """Return an axis with another gap [m], the same everywhere."""
    gap = replace(axis.gap, lost_motion=lost_motion)
    if gap.motor_angle is not None and gap.gear_ratio is not None and gap.travel_per_rad is not None:
        gap = replace(gap, motor_angle=lost_motion * gap.gear_ratio / gap.travel_per_rad)
    plain = base_plant(axis, Scenario())
    widening = {
        one.effect.name for one in active_effects(axis) if one.effect.apply(plain, one.values).widening is not None
    }
    return replace(axis, gap=gap, effects=tuple(one for one in axis.effects if one.name not in widening))


def gravity_notes(machine: Machine, axes: Iterable[str]) -> tuple[str, ...]:
    """Say which of some axes gravity holds, a sentence each.

    Examples
    --------
    >>> from ph_post.drive.machinefile import read_machine
    >>> gravity_notes(read_machine("stepper"), "XYZ")
    ()
    """
    return tuple(
        f"axis {name}: gravity holds it on one side of its backlash: it needs no compensation"
        for name in axes
        if machine.axes[name].gravity_side is not None
    )


def referred_to_middle(machine: Machine) -> Machine:
    """Return a machine of which every zero is that of the middle of the gap, wherever it was taken."""
    axes = {name: replace(axis, reference_direction="both") for name, axis in machine.axes.items()}
    return replace(machine, axes=axes)


def refuse_cascades(machine: Machine, axes: Iterable[str]) -> None:
    """Refuse a machine of which one of some axes has a cascade: what needs settled orbits over β and C.

    Raises
    ------
    InputError
    """
    for name in axes:
        if name in machine.axes and machine.axes[name].servo.cascade is not None:
            raise InputError(
                f"{machine.name}: axes.{name}.control.structure",
                "no table of β and C holds for a cascade, which remembers the reversals before",
                expected='"single" (convert, simulate and compare take this file, and need no table)',
                got='"cascade"',
            )


def sized_machine(machine: Machine, points: Sequence[TurningPoint]) -> Machine:
    """Return a machine to size lasting offsets by: one gap for each axis that is not closed over the table.

    It is the mean over the axis' turning points. Axes with their gap inside the loop stay as they are, see
    :func:`axis_at`.
    """
    axes = dict(machine.axes)
    for name, axis in machine.axes.items():
        places = np.array([point.position for point in points if point.axis == name])
        if not axis.loop.encloses_backlash and backlash_varies(axis):
            gap = float(np.mean(gaps_of(axis, places))) if places.size else axis.gap.lost_motion
            axes[name] = with_gap(axis, gap)
    return machine if axes == dict(machine.axes) else replace(machine, axes=axes)


def check_axes(axes: Sequence[str], what: str, drives: Machine, machine: str) -> None:
    """Refuse a machine that lacks an axis which `what` moves.

    Parameters
    ----------
    axes : sequence of str
        Axes that are moved.
    what : str
        What moves them, in a word.
    drives : Machine
    machine : str
        Name of the machine, or of its file.

    Raises
    ------
    InputError
    """
    for axis in axes:
        if axis not in drives.axes:
            raise InputError(
                machine,
                f"the {what} moves axis {axis}, which has no drive",
                expected=f"[axes.{axis}]",
                got=", ".join(f"[axes.{name}]" for name in drives.axes),
            )
