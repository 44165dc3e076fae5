"""Read path files (JSON), check them, and make their curves.

Every number is kept as it is written: the curves get it as a double, correctly rounded to SI, and as an exact
fraction in the file's unit, from which turning points can be certified.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from fractions import Fraction
from typing import Final

import numpy as np

from ph_post.errors import InputError
from ph_post.files.check import checked, loads, one_line, place, quoted
from ph_post.files.pathcurves import (
    JOIN,
    AnySegment,
    FilePlace,
    Frame,
    LineRecord,
    PathRecord,
    build_curve,
    hull,
)
from ph_post.files.storage import SourceText, read_source
from ph_post.geometry.piecewise import PiecewiseCurve
from ph_post.types import Array, Curve, Path, Segment
from ph_post.units import LENGTHS, MINUTE

MAX_FEED = 1e3
"""Highest feed taken [m/s]; beyond it a unit has been mistaken, and squares leave a double's range."""

_FIRST_POINT: Final = {"arc": "start", "ph": "start", "polynomial": "coefficients"}


def read_path(source: str | os.PathLike[str]) -> Path:
    """Read a path file; ``-`` is standard input.

    Parameters
    ----------
    source : str or path
        A JSON file in the format ``ph-post-path``, or ``-``.

    Returns
    -------
    Path
        SI units; `digest` is the SHA-256 of the file's bytes.

    Raises
    ------
    InputError
        One line naming file, segment, key, what was expected and what was found.
    """
    return path_of(read_source(source))


def path_of(text: SourceText) -> Path:
    """Make the path of a path file's text; see :func:`read_path`."""
    begin = text.text.lstrip("\ufeff \t\r\n")
    if begin and begin[0] not in "{[" and not text.name.lower().endswith(".json"):
        expected = "blocks, such as G1 X10, or a path in braces"
        what = "neither a part program nor a path file"
        raise InputError(text.name, what, expected=expected, got=quoted(begin.splitlines()[0]))
    record = checked(loads(text.text, text.name), PathRecord, text.name)
    frame = Frame(file=text.name, axes=_axes(record, text.name), units=record.units, unit=LENGTHS[record.units])
    feed = _feed(record.feed, FilePlace(frame, ("feed",)))
    places = [FilePlace(frame, ("segments", number)) for number in range(len(record.segments))]
    # what leaves a double's range is met by the checks, not by a warning
    with np.errstate(all="ignore"):
        curves = [build_curve(item, here) for item, here in zip(record.segments, places, strict=True)]
        _check_joints(curves, record, frame)
    return Path(
        name=one_line(record.name or text.stem, text.name, ("name",)),
        source=one_line(record.source, text.name, ("source",)),
        axes=frame.axes,
        feed=feed,
        closed=record.closed,
        segments=tuple(map(_segment, record.segments, curves, places)),
        digest=text.digest,
    )


def _axes(record: PathRecord, file: str) -> tuple[str, ...]:
    axes = tuple(record.axes)
    where = place(file, ("axes",))
    if len(set(axes)) < len(axes):
        raise InputError(where, "an axis is given twice", expected="each axis once", got=", ".join(axes))
    if len(axes) not in (2, 3):
        raise InputError(where, "wrong count", expected="two or three of X, Y, Z", got=str(len(axes)))
    return axes


def _feed(value: Fraction, here: FilePlace) -> float:
    """Convert a feed [unit/min] to m/s."""
    per_second = here.frame.unit / Fraction(MINUTE)
    speed = float(value * per_second)
    if not 0 < speed <= MAX_FEED:
        most = MAX_FEED / float(per_second)
        raise here.refuse(
            "the feed is out of range",
            f"> 0 and at most {most:g} {here.frame.units}/min",
            f"{float(value):.12g}",
        )
    return speed


def _segment(record: AnySegment, curve: Curve, here: FilePlace) -> Segment:
    if record.rapid and not isinstance(record, LineRecord):
        raise here.at("rapid").refuse("only a line can be rapid", "a segment of type line, or no rapid", _tag(record))
    if record.rapid and record.feed is not None:
        raise here.at("feed").refuse("a rapid has no feed of its own", "feed or rapid, not both")
    feed = None if record.feed is None else _feed(record.feed, here.at("feed"))
    return Segment(curve=curve, feed=feed, rapid=record.rapid)


def _check_joints(curves: Sequence[PiecewiseCurve], record: PathRecord, frame: Frame) -> None:
    """Refuse a gap between consecutive segments, or at the seam of a closed path."""
    ends = np.stack([hull(curve)[[0, -1]] for curve in curves])
    first, last = ends[:, 0], ends[:, 1]
    follows = np.roll(first, -1, axis=0)
    # the doubles of the two points may each be off by half a unit in the last place
    slack = JOIN + 4.0 * np.finfo(np.float64).eps * np.abs(ends).max()
    gaps = np.linalg.norm(follows - last, axis=1)
    joints = len(curves) if record.closed else len(curves) - 1
    for before in np.flatnonzero(gaps[:joints] > slack)[:1].tolist():
        after = (before + 1) % len(curves)
        raise _gap(before, after, record, frame, last[before], follows[before])


def _gap(before: int, after: int, record: PathRecord, frame: Frame, end: Array, start: Array) -> InputError:
    key = _FIRST_POINT.get(_tag(record.segments[after]), "points")
    keys = ("segments", after, key) if key != "points" else ("segments", after, key, 0)
    unit = float(frame.unit)
    gap = f"gap of {np.linalg.norm(end - start) / unit:.6g} {record.units}"
    what = f"{gap} between the path's end and its start" if after == 0 else f"{gap} after segments[{before}]"
    return FilePlace(frame, keys).refuse(what, f"a start at {_shown(end / unit)}", _shown(start / unit))


def _tag(record: AnySegment) -> str:
    return str(record.__struct_config__.tag)


def _shown(point: Array) -> str:
    return f"[{', '.join(f'{value:.10g}' for value in point)}]"
