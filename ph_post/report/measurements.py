"""Measurements by hand as lines for people and as a plain object for JSON."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

from ph_post.api.hand_measurements import HandMeasurement
from ph_post.identify.ballbar import BallBarResult
from ph_post.identify.dial import NEAR, DialResult
from ph_post.identify.handreadings import Sure
from ph_post.identify.measurement import AxisMeasurement, slope_words, sure_words
from ph_post.quantities import measured_words
from ph_post.report.tables import format_table
from ph_post.units import DEGREE, MICROMETRE, MM, MS

MANY: Final = 50
"""Readings of a place which nobody takes."""


def measurement_lines(found: HandMeasurement) -> Iterator[str]:
    """Yield what readings say: lost motions first, then what else they show. +- holds the truth in 68 of 100 cases."""
    for axis, measured in found.axes.items():
        yield from _axis_lines(axis, measured, found)
    for pair, angle in found.squareness.items():
        degrees = sure_words(angle, DEGREE, "degrees")
        yield f"squareness of {' and '.join(pair)}: {slope_words(angle)} ({degrees}) short of a right angle"
    for axis, one in found.scale.items():
        yield f"scale of {axis}: {slope_words(one)} further than commanded{_worth(one)}"
    for pair, one in found.mismatch.items():
        if not set(pair) <= set(found.scale):
            yield f"scale of {pair[0]} less that of {pair[1]}: {slope_words(one)}"
    if found.cut is not None and found.cut.tool is not None:
        yield f"cutter as it cut: {_length(found.cut.tool)}"
    for bar in found.ball_bar:
        yield from _bar_lines(bar)


def _axis_lines(axis: str, one: AxisMeasurement, found: HandMeasurement) -> Iterator[str]:
    apart = "" if len(one.sources) == 1 else "; " + ", ".join(f"{way} {_length(n)}" for way, n in one.sources.items())
    by = f" by {next(iter(one.sources))}" if len(one.sources) == 1 else ""
    yield f"{axis}: lost motion {_length(one.lost_motion)}{by}{apart}"
    if axis in found.dial:
        yield from _dial_lines(found.dial[axis])
    if one.note:
        yield f"   {one.note}"
        return
    written = found.machine.axes[axis]
    lost = written.gap.lost_motion
    if lost == 0.0:
        yield "   no lost motion that these readings show: 0 in the machine file"
    else:
        share = f"backlash_uncertainty {written.uncertainty.backlash:g}"
        if one.spread is None:
            share += " (not read at several places along the axis: no less than before)"
        yield f"   in the machine file: lost_motion_mm {lost / MM:g}, {share}"


def _dial_lines(dial: DialResult) -> Iterator[str]:
    """Yield the lost motion by place, and how readings scatter."""
    places: dict[float | None, list[float]] = {}
    for row in dial.rows:
        places.setdefault(row.place, []).append(row.lost_motion)
    if len(places) > 1:
        each = (
            f"{_mean(values) / MM:.4f} at {'some place' if place is None else f'{place / MM:g}'}"
            for place, values in places.items()
        )
        yield f"   along the axis {', '.join(each)} mm"
    yield f"   readings scatter by {dial.scatter / MICROMETRE:.2g} µm, the standard error of each"
    goal = f"   for a lost motion within {NEAR / MICROMETRE:g} µm in 90 of 100 cases"
    if dial.repeats is None:
        yield f"{goal} take an indicator with finer lines"
    elif dial.repeats > MANY:
        yield f"{goal} readings have to agree better: look how the indicator is held, and take those again that differ"
    elif dial.repeats:
        yield f"{goal} read each place {dial.repeats} times: calibrate --without-log --repeats {dial.repeats}"


def _mean(values: list[float]) -> float:
    return sum(values) / len(values)


def _worth(one: Sure) -> str:
    return ": correct it in the controller" if abs(one.value) > 2.0 * one.error else ""


def _length(one: Sure) -> str:
    return measured_words(one.value / MM, one.error / MM, "mm", "+-")


def _bar_lines(bar: BallBarResult) -> Iterator[str]:
    """Yield the results of arcs beside the names of ball-bar reports."""
    yield f"ball bar in {''.join(bar.plane)}, radius {bar.radius / MM:.4f} mm"
    header = ("here", "in ball-bar reports", "value")
    yield from (f"   {line}" for line in format_table(header, list(_bar_rows(bar))).splitlines())


def _bar_rows(bar: BallBarResult) -> Iterator[tuple[str, str, str]]:
    first, second = bar.plane
    for axis, one in zip(bar.plane, bar.lost_motion, strict=True):
        if one is not None:
            yield f"lost motion of {axis}", f"backlash {axis}, reversal error", _micrometres(one)
    if bar.squareness is not None:
        yield "squareness", f"squareness {first}{second}", _parts(bar.squareness)
    if bar.mismatch is not None:
        yield f"scale of {first} less {second}", "scaling mismatch", _parts(bar.mismatch)
    if bar.scale is not None:
        yield "scale, mean of both", "scaling error", _parts(bar.scale)
    if bar.servo is not None:
        late = sure_words(bar.servo, bar.feed * MS, "ms") if bar.feed else _micrometres(bar.servo)
        yield f"lag of {first} less {second}", "servo mismatch", late
    for turn, deviation in bar.deviation:
        way = "counterclockwise" if turn > 0 else "clockwise"
        yield f"off the circle, {way}", "circular deviation G (ISO 230-4)", f"{deviation / MICROMETRE:.1f} µm"
    yield "what is left", "noise, straightness, cyclic error", f"{bar.scatter / MICROMETRE:.2g} µm rms"


def _micrometres(one: Sure) -> str:
    return sure_words(one, MICROMETRE, "µm")


def _parts(one: Sure) -> str:
    return sure_words(one, MICROMETRE, "µm/m")


def measurement_view(found: HandMeasurement) -> dict[str, Any]:
    """Return what readings say as a plain object: lengths in mm, angles in rad, scales as parts of one."""
    return {
        "axes": {
            axis: {
                "lost_motion": _view(one.lost_motion, MM),
                "written": None if one.note else _short(found.machine.axes[axis].gap.lost_motion / MM),
                "backlash_uncertainty": None if one.note else found.machine.axes[axis].uncertainty.backlash,
                "sources": {way: _view(number, MM) for way, number in one.sources.items()},
                "note": one.note,
                "repeats": found.dial[axis].repeats if axis in found.dial else None,
            }
            for axis, one in found.axes.items()
        },
        "squareness": {"".join(pair): _view(one, 1.0) for pair, one in found.squareness.items()},
        "scale": {axis: _view(one, 1.0) for axis, one in found.scale.items()},
        "scale_mismatch": {"".join(pair): _view(one, 1.0) for pair, one in found.mismatch.items()},
        "ball_bar": [
            {
                "plane": "".join(bar.plane),
                "radius": _short(bar.radius / MM),
                "lost_motion": {a: _view(n, MM) for a, n in zip(bar.plane, bar.lost_motion, strict=True)},
                "squareness": _view(bar.squareness, 1.0),
                "scaling_mismatch": _view(bar.mismatch, 1.0),
                "scaling_error": _view(bar.scale, 1.0),
                "servo_mismatch": _view(bar.servo, MM),
                "circular_deviation": {
                    "ccw" if turn > 0 else "cw": _short(deviation / MM) for turn, deviation in bar.deviation
                },
                "residual": _short(bar.scatter / MM),
            }
            for bar in found.ball_bar
        ],
        "warnings": list(found.warnings),
    }


def _view(one: Sure | None, unit: float) -> dict[str, float] | None:
    return None if one is None else {"value": _short(one.value / unit), "stderr": _short(one.error / unit)}


def _short(value: float) -> float:
    """Return a number with the digits that anybody needs."""
    return float(f"{value:.6g}")
