"""Lost motion, squareness and scale from the widths of a test cut, by linear least squares.

With P the width of the cutter's path, t the cutter's diameter as it really is, L the plays, ε the scale errors
and α the angle that the axes lack of 90°, to first order::

    circle at φ    P (1 + ε_x cos²φ + ε_y sin²φ + α sinφ cosφ) - t, less the play: at 0° L_x, at 90° L_y;
                   at 45° more by (L_x - L_y)/√2 counterclockwise, and less clockwise; at 135° the other way
    square         P (1 + ε) - t, less L where its edges are reached from inside, more by it from outside
    groove         t

A cutter is pushed aside otherwise where it climbs: the clockwise circle has a diameter of its own.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import msgspec
import numpy as np

from ph_post.errors import InputError
from ph_post.files.check import counted
from ph_post.identify.handreadings import LinearFit, Sure, fit_rows, resolution
from ph_post.types.readings import CutWidths
from ph_post.units import INCH, MM

_NAMES: Final = ("lost_x", "lost_y", "square", "scale_x", "scale_y", "tool", "climb")
_PLAUSIBLE: Final = 0.1
"""Part of a width by which it may be off its size."""

_APART: Final = 0.3 * MM
"""Most that readings of one width may differ [m]."""

_OFF: Final = 8.0
"""Errors of one reading by which the mean of a width may be off what the others say, beside 20 µm."""

_BESIDE: Final = 0.02 * MM
_WRONG_SIGN: Final = 4.0


class CutResult(msgspec.Struct, frozen=True, kw_only=True):
    """What a test cut says: lost motions [m] by axis, squareness [rad], scale errors by axis; None: does not show.

    `mismatch` is the scale error of X less that of Y. `tool` [m] is the cutter's diameter as it cut. `scatter` is
    the standard error of one width [m].
    """

    lost_motion: Mapping[str, Sure]
    squareness: Sure | None
    scale: Mapping[str, Sure]
    mismatch: Sure | None
    tool: Sure | None
    scatter: float


def read_cut(cut: CutWidths, known: Mapping[str, Sure] | None = None) -> CutResult:
    """Return what the widths of a test cut say.

    Parameters
    ----------
    cut : CutWidths
    known : mapping, optional
        Lost motions [m] by axis that others have measured, which make scale and squareness surer.

    Raises
    ------
    InputError
        Where widths are in another unit, contradict each other or are too few.
    """
    for (shape, name), values in cut.widths.items():
        _check_width(cut, shape, name, values)
    kinds = [key for key, values in cut.widths.items() for _ in values]
    right = np.array([value for values in cut.widths.values() for value in values])
    rows = np.array([_row(shape, name, cut) for shape, name in kinds])
    offset = np.array([0.0 if shape == "slot" else cut.size + cut.tool for shape, _ in kinds])
    grain = resolution(right.tolist())
    fit = fit_rows(_NAMES, rows, right - offset, grain)
    if fit.freedom < 1:
        what = "the widths are too few to say how far they are off"
        raise InputError(cut.where, what, expected="each width more than once", got=counted(right.size, "reading"))
    _check_agreement(cut, fit, kinds, rows, right - offset)
    alone = {axis: fit.get({f"lost_{axis.lower()}": 1.0}) for axis in "XY"}
    lost = {axis: one for axis, one in alone.items() if one is not None}
    for axis, one in lost.items():
        if one.value < -max(_WRONG_SIGN * one.error, _BESIDE):
            what = f"the lost motion of {axis} comes out below 0: square_inside and square_outside are swapped"
            raise InputError(cut.where, what, expected="square_outside wider", got=f"{one.value / MM:.3g} mm")
    surer = _with_known(fit, rows, right - offset, known or {}, grain)
    scales = {axis: surer.get({f"scale_{axis.lower()}": 1.0}) for axis in "XY"}
    result = CutResult(
        lost_motion=lost,
        squareness=surer.get({"square": 1.0}),
        scale={axis: one for axis, one in scales.items() if one is not None},
        mismatch=surer.get({"scale_x": 1.0, "scale_y": -1.0}),
        tool=surer.get({"tool": 1.0}),
        scatter=fit.scatter,
    )
    if not (result.lost_motion or result.scale or result.squareness or result.mismatch):
        what = "of these widths alone nothing follows: backlash, scale and tool change them alike"
        expected = "those of both squares, or d45 and d135 of both circles"
        raise InputError(cut.where, what, expected=expected, got=", ".join(f"{one}.{name}" for one, name in cut.widths))
    return result


def _with_known(
    fit: LinearFit, rows: np.ndarray, right: np.ndarray, known: Mapping[str, Sure], grain: float
) -> LinearFit:
    """Fit again, with a row for every lost motion that is known, as heavy as it is sure."""
    added, values = [], []
    for axis, one in known.items():
        weight = fit.scatter / max(one.error, 1e-9)
        added.append([weight * (name == f"lost_{axis.lower()}") for name in _NAMES])
        values.append(weight * one.value)
    if not added:
        return fit
    return fit_rows(_NAMES, np.vstack([rows, added]), np.concatenate([right, values]), grain)


def _row(shape: str, name: str, cut: CutWidths) -> list[float]:
    """Return by how much each parameter makes a width larger."""
    path = cut.size + cut.tool
    if shape == "slot":
        return [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    if shape.startswith("square"):
        sign = 1.0 if shape == "square_outside" else -1.0
        x = name == "x"
        return [sign * x, sign * (not x), 0.0, path * x, path * (not x), -1.0, 0.0]
    angle = math.radians(float(name.removeprefix("d")))
    cos, sin = math.cos(angle), math.sin(angle)
    climb = float(shape == "circle_cw")
    if name in ("d0", "d90"):
        plays = [-float(name == "d0"), -float(name == "d90")]
    else:
        turn = (-1.0 if climb else 1.0) * math.copysign(math.sqrt(0.5), cos)
        plays = [turn, -turn]
    return [*plays, path * sin * cos, path * cos * cos, path * sin * sin, -1.0, climb]


def _check_width(cut: CutWidths, shape: str, name: str, values: Sequence[float]) -> None:
    """Refuse a width in another unit, and readings that differ by more than calipers do."""
    wanted, where = cut.tool if shape == "slot" else cut.size, f"{cut.where}.{shape}.{name}"
    expected = f"about {wanted / MM:g} mm"
    for value in values:
        share = value / wanted
        if abs(share - 1.0) > _PLAUSIBLE:
            what = "is not the width of this shape"
            if abs(share * INCH / MM - 1.0) < _PLAUSIBLE:
                what, expected = "the calipers count inches", 'unit = "inch"'
            raise InputError(where, what, expected=expected, got=f"{value / MM:.6g} mm")
    if max(values) - min(values) > _APART:
        listed = ", ".join(f"{one / MM:.6g}" for one in values)
        raise InputError(
            where, "readings contradict each other", expected=f"within {_APART / MM:g} mm", got=f"{listed} mm"
        )


def _check_agreement(
    cut: CutWidths, fit: LinearFit, kinds: Sequence[tuple[str, str]], rows: np.ndarray, right: np.ndarray
) -> None:
    """Refuse widths that no lost motion, squareness and scale make, by more than repeated readings scatter."""
    groups = list(_groups(fit.left, kinds))
    freedom = sum(left.size - 1 for _, left in groups)
    if freedom == 0:
        return
    repeats = math.sqrt(sum(float(np.sum((left - np.mean(left)) ** 2)) for _, left in groups) / freedom)
    key, worst = max(groups, key=lambda group: abs(float(np.mean(group[1]))))
    off = float(np.mean(worst))
    if abs(off) > _OFF * repeats / math.sqrt(worst.size) + _BESIDE:
        shape, name = key
        others = np.array([kind != key for kind in kinds])
        without = fit_rows(_NAMES, rows[others], right[others])
        beside = float(np.mean(right[~others] - rows[~others] @ without.values))
        what = "contradicts the other widths: swapped with another, or not this shape's"
        width = float(np.mean(cut.widths[key]))
        expected = f"about {(width - beside) / MM:.5g} mm"
        raise InputError(f"{cut.where}.{shape}.{name}", what, expected=expected, got=f"{width / MM:.5g} mm")


def _groups(left: np.ndarray, kinds: Sequence[tuple[str, str]]) -> Iterator[tuple[tuple[str, str], np.ndarray]]:
    for key in dict.fromkeys(kinds):
        yield key, np.array([one for one, kind in zip(left, kinds, strict=True) if kind == key])
