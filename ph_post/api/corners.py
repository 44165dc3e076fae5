"""Round the sharp corners of a path, and say what became of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from msgspec.structs import replace

from ph_post.files.check import counted
from ph_post.geometry.corner_rounding import CornerAt, round_sharp_corners
from ph_post.quantities import rounded_micrometres
from ph_post.types import Path
from ph_post.units import MM

NAMED: Final = 5
"""Places that a sentence names."""


def with_rounded_corners(path: Path, tolerance: float | None) -> Path:
    """Return a path with its sharp corners rounded, and with remarks on them; the path itself without a tolerance.

    Parameters
    ----------
    path : Path
    tolerance : float or None
        Largest distance between the path and the curves around its corners [m].

    Examples
    --------
    >>> from ph_post.api.inputs import read_path
    >>> with_rounded_corners(read_path("pocket"), 2e-5).remarks
    ('3 corners are rounded, within 20 µm',)
    """
    if tolerance is None:
        return path
    found = round_sharp_corners(path, tolerance)
    return replace(found.path, lines=None, remarks=(*path.remarks, *_remarks(found.corners, path.axes, tolerance)))


def _remarks(corners: Sequence[CornerAt], axes: Sequence[str], tolerance: float) -> Iterator[str]:
    if not corners:
        yield "--corner-tolerance: the path has no sharp corner between its ends"
        return
    done = [one for one in corners if one.deviation]
    if done:
        largest = max(one.deviation for one in done)
        within = tolerance if largest > 0.9 * tolerance else largest
        yield f"{counted(len(done), 'corner is', 'corners are')} rounded, within {rounded_micrometres(within)} µm"
    for why in dict.fromkeys(one.why for one in corners if one.why):
        these = [one for one in corners if one.why == why]
        places = ", ".join(_place(one, axes) for one in these[:NAMED])
        more = f" and {len(these) - NAMED} more" if len(these) > NAMED else ""
        count = counted(len(these), "corner", "corners")
        if these[0].deviation:
            least = rounded_micrometres(min(one.deviation for one in these))
            yield f"{count} rounded by less than asked for, {least} µm at least: {why} (at {places}{more})"
        else:
            yield f"{count} {'stays' if len(these) == 1 else 'stay'} sharp: {why} (at {places}{more})"


def _place(corner: CornerAt, axes: Sequence[str]) -> str:
    """Return the place of a corner, such as X10 Y20, in mm."""
    return " ".join(f"{name}{round(value / MM, 3):g}" for name, value in zip(axes, corner.place.tolist(), strict=True))
