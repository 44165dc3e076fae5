"""What readings by hand say about a machine, all together, and the machine file with it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import Final

import msgspec
from msgspec.structs import replace

from ph_post.errors import InputError
from ph_post.files.storage import SourceText
from ph_post.identify.ballbar import BallBarResult, read_arcs
from ph_post.identify.dial import DialResult, read_dial
from ph_post.identify.handreadings import Sure, weighted_mean
from ph_post.identify.machinefile import axis_change, changed_machine
from ph_post.identify.testcut import CutResult, read_cut
from ph_post.quantities import measured_words
from ph_post.types import Axis, Machine
from ph_post.types.diagnosis import Estimate
from ph_post.types.readings import Readings
from ph_post.units import MICROMETRE, MM

_APART: Final = 4.0
"""Errors by which two ways to measure one lost motion may differ, beside :data:`_BESIDE`."""

_BESIDE: Final = 10.0 * MICROMETRE

_BESIDE_ANGLE: Final = 2e-4
"""Angle [rad] that a worn machine may have between one place and another."""

_PLAUSIBLE_SCALE: Final = 3e-3
"""Scale error of an axis that a worn screw or a stretched belt has at most: rolled screws are within 0.7 mm in a metre
(ISO 3408, class 10)."""

_MOST_RELATIVE: Final = 0.95
_DIGITS: Final = 4
"""Decimals of a lost motion in mm: a tenth of a micrometre."""


class AxisMeasurement(msgspec.Struct, frozen=True, kw_only=True):
    """Lost motion of one axis [m], by every way that it was measured and all together.

    `spread` [m] is the error with what the lost motion varies along the axis, None where it was not read at several
    places. `note` says why it is not written to
    the machine file, empty where it is.
    """

    axis: str
    lost_motion: Sure
    spread: float | None
    sources: Mapping[str, Sure]
    note: str = ""


class Measurement(msgspec.Struct, frozen=True, kw_only=True):
    """What readings by hand say; `machine` has the lost motions and their uncertainties.

    `squareness` [rad] by pair of axes, what their angle lacks of 90°; `scale` by axis, the excess of the way made
    over the way commanded; `mismatch` by pair, the first axis' scale error less the second's. `warnings` name what
    readings say that hardly a machine does.
    """

    readings: str
    axes: Mapping[str, AxisMeasurement]
    squareness: Mapping[tuple[str, str], Sure]
    scale: Mapping[str, Sure]
    mismatch: Mapping[tuple[str, str], Sure]
    dial: Mapping[str, DialResult]
    cut: CutResult | None
    ball_bar: tuple[BallBarResult, ...]
    machine: Machine
    warnings: tuple[str, ...] = ()


def measure_machine(readings: Readings, machine: Machine) -> Measurement:
    """Work out what readings say of a machine.

    Raises
    ------
    InputError
        Where there are none, they belong to another machine, or contradict each other.
    """
    _check_axes(readings, machine)
    dial = read_dial(readings.dial, readings.swing)
    cut = (
        None if readings.cut is None else read_cut(readings.cut, {axis: one.lost_motion for axis, one in dial.items()})
    )
    planes = dict.fromkeys(trace.plane for trace in readings.ball_bar)
    bars = tuple(read_arcs([trace for trace in readings.ball_bar if trace.plane == plane]) for plane in planes)
    if not dial and cut is None and not bars:
        raise InputError(readings.name, "no readings", expected="numbers between the brackets of at least one row")
    sources: dict[str, dict[str, Sure]] = {}
    for axis, one in dial.items():
        sources.setdefault(axis, {})["dial indicator"] = one.lost_motion
    for axis, lost in {} if cut is None else cut.lost_motion.items():
        sources.setdefault(axis, {})["test cut"] = lost
    for bar in bars:
        for axis, found in zip(bar.plane, bar.lost_motion, strict=True):
            if found is not None:
                sources.setdefault(axis, {})[f"ball bar in {''.join(bar.plane)}"] = found
    axes = {
        axis: _axis(machine.axes[axis], sources[axis], dial.get(axis), readings.name)
        for axis in machine.axes
        if axis in sources
    }
    changed = {axis: _changed(machine.axes[axis], one) for axis, one in axes.items() if not one.note}
    square, mismatch = _pairs(cut, bars, readings.name)
    scale = {} if cut is None else cut.scale
    return Measurement(
        readings=readings.name,
        axes=axes,
        squareness=square,
        scale=scale,
        mismatch=mismatch,
        dial=dial,
        cut=cut,
        ball_bar=bars,
        machine=replace(machine, axes={**machine.axes, **changed}),
        warnings=tuple(_implausible(scale, mismatch)),
    )


def _implausible(scale: Mapping[str, Sure], mismatch: Mapping[tuple[str, str], Sure]) -> Iterator[str]:
    """Yield a warning for each scale that is farther off than screws and belts are."""
    off = [(f"the scale of {axis} is", one) for axis, one in scale.items()]
    off += [(f"the scales of {' and '.join(pair)} differ by", one) for pair, one in mismatch.items()]
    for what, one in off:
        if abs(one.value) > _PLAUSIBLE_SCALE + 2.0 * one.error:
            limit = f"more than {_PLAUSIBLE_SCALE / MM:g} mm/m, which no screw or belt is off"
            causes = "look whether steps per mm are right, and whether a width is that of another shape"
            yield f"{what} {slope_words(one)}: {limit}; {causes}"


def _check_axes(readings: Readings, machine: Machine) -> None:
    """Refuse readings of axes that the machine lacks, and of a dial that cannot show what is asked."""
    used = [(row.where, row.axis) for row in readings.dial]
    if readings.cut is not None:
        used += [(readings.cut.where, axis) for axis in "XY"]
    used += [(trace.name, axis) for trace in readings.ball_bar for axis in trace.plane]
    for where, name in used:
        if name not in machine.axes:
            raise InputError(where, "the machine has no such axis", expected=" or ".join(machine.axes), got=name)
    for row in readings.dial:
        if machine.axes[row.axis].loop.encloses_backlash:
            what = f"a dial does not show the backlash of {row.axis}: its scale on the table hides it"
            expected = "lost_motion_mm by hand: drive off, the part of a turn of the screw before the table moves"
            raise InputError(row.where, what, expected=expected)


def _axis(axis: Axis, sources: Mapping[str, Sure], dial: DialResult | None, name: str) -> AxisMeasurement:
    """Put together what was measured of one axis, where it agrees."""
    for (one, first), (other, second) in combinations(sources.items(), 2):
        if first.differs(second, _APART, _BESIDE):
            what = f"the lost motion of {axis.name} by {one} and by {other} contradict each other"
            expected = "the same within their errors, or one of them left out"
            got = f"{_words(first)} and {_words(second)}"
            raise InputError(name, what, expected=expected, got=got)
    found = weighted_mean(list(sources.values()))
    along = None if dial is None else dial.along
    note = ""
    if axis.loop.encloses_backlash:
        note = "the scale on the table keeps the backlash away from it, so that the machine file stays as it is"
    return AxisMeasurement(
        axis=axis.name,
        lost_motion=found,
        spread=None if along is None else math.hypot(found.error, along),
        sources=dict(sources),
        note=note,
    )


def _words(one: Sure) -> str:
    return measured_words(one.value / MM, one.error / MM, "mm", "+-")


def _changed(axis: Axis, found: AxisMeasurement) -> Axis:
    """Return the axis with the lost motion and its relative uncertainty, rounded as a file has them.

    Where nobody looked at several places, the uncertainty of the file is not made smaller.
    """
    lost = round(max(0.0, found.lost_motion.value) / MM, _DIGITS) * MM
    if lost == 0.0:
        return replace(axis, gap=axis.gap.with_lost_motion(0.0))
    spread = found.lost_motion.error if found.spread is None else found.spread
    relative = min(_MOST_RELATIVE, math.ceil(100.0 * spread / lost) / 100.0)
    if found.spread is None:
        relative = max(relative, axis.uncertainty.backlash)
    uncertainty = replace(axis.uncertainty, backlash=relative)
    return replace(axis, gap=axis.gap.with_lost_motion(lost), uncertainty=uncertainty)


def _pairs(
    cut: CutResult | None, bars: tuple[BallBarResult, ...], name: str
) -> tuple[dict[tuple[str, str], Sure], dict[tuple[str, str], Sure]]:
    """Return squareness and scale mismatch by pair of axes; what two ways measured alike is averaged."""
    square: dict[tuple[str, str], list[Sure]] = {}
    mismatch: dict[tuple[str, str], list[Sure]] = {}
    results = [] if cut is None else [(("X", "Y"), cut.squareness, cut.mismatch)]
    for pair, angle, scale in (*results, *((bar.plane, bar.squareness, bar.mismatch) for bar in bars)):
        ordered = (min(pair), max(pair))
        sign = 1.0 if pair == ordered else -1.0
        if angle is not None:
            square.setdefault(ordered, []).append(angle)
        if scale is not None:
            mismatch.setdefault(ordered, []).append(replace(scale, value=sign * scale.value))
    for what, found in (("squareness", square), ("scales", mismatch)):
        for pair, (first, *others) in found.items():
            if any(first.differs(other, _APART, _BESIDE_ANGLE) for other in others):
                expected = "the same within their errors, or one of them left out"
                got = " and ".join(slope_words(one) for one in (first, *others))
                where = f"the {what} of {' and '.join(pair)} by test cut and by ball bar contradict each other"
                raise InputError(name, where, expected=expected, got=got)
    means = [{pair: weighted_mean(group) for pair, group in one.items()} for one in (square, mismatch)]
    return means[0], means[1]


def measured_machine(original: SourceText, found: Measurement, machine: Machine) -> str:
    """Return a machine file with the lost motions that were measured, and with what else was, as comments.

    Parameters
    ----------
    original : SourceText
        The machine file of `machine`.
    found : Measurement
    machine : Machine

    Raises
    ------
    InputError
        Where the result cannot stand in a file.
    """
    changes = (
        axis_change(
            machine.axes[axis],
            found.machine.axes[axis],
            original,
            parameters={
                "lost_motion": Estimate(
                    value=found.machine.axes[axis].gap.lost_motion / MM, stderr=one.lost_motion.error / MM, unit="mm"
                )
            },
            above=list(_above(axis, one, found)),
            effects={},
        )
        for axis, one in found.axes.items()
    )
    return changed_machine(original, changes, found.machine)


def _above(axis: str, one: AxisMeasurement, found: Measurement) -> Iterator[str]:
    """Yield the comment lines that stand above a measured lost motion."""
    yield f"measured by {' and '.join(one.sources)}, {' '.join(found.readings.split())}; +- holds it in 68 of 100 cases"
    if one.spread is not None and one.spread > 1.5 * one.lost_motion.error:
        yield f"along the axis it differs by {one.spread / MICROMETRE:.2g} um: that is in the uncertainty"
    if axis in found.scale:
        yield f"scale: {slope_words(found.scale[axis])} further than commanded"
    for pair, angle in found.squareness.items():
        if axis == pair[1]:
            yield f"squareness to {pair[0]}: {slope_words(angle)}"


def sure_words(one: Sure, size: float, unit: str) -> str:
    """Write a value with its sign and its error, both to the last digit of the error.

    Examples
    --------
    >>> sure_words(Sure(value=2e-4, error=1e-4), MM, "mm/m")
    '+0.2 +- 0.1 mm/m'
    """
    words = measured_words(one.value / size, one.error / size, unit, "+-")
    return words if words.startswith("-") else f"+{words}"


def slope_words(one: Sure) -> str:
    """Return a scale error, or what an angle lacks of 90°, in words.

    Examples
    --------
    >>> slope_words(Sure(value=-2e-4, error=1e-4))
    '-0.2 +- 0.1 mm/m'
    """
    return sure_words(one, MM, "mm/m")
