"""A long path divided where its motion rests, so that each part can be planned and proven by itself.

Nothing that a plan does at a window reaches across a rest.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from msgspec.structs import replace

from ph_post.gcode.paths.record import SAME_PLACE, ProgramPath
from ph_post.geometry.composite import Composite
from ph_post.geometry.joints import find_stops
from ph_post.geometry.track import Track
from ph_post.types import Array, IntArray, Segment


def divide(path: ProgramPath, track: Track, places: Array, most: int) -> tuple[ProgramPath, ...]:
    """Divide a path at sharp corners and ends of rapids, as soon as a part holds enough.

    Parameters
    ----------
    path : ProgramPath
    track : Track
        Of its path.
    places : Array, shape (n,)
        Arc lengths [m] of what is counted.
    most : int
        A part ends at the first rest behind so many of them.

    Returns
    -------
    tuple of ProgramPath
        One after the other; they are all of the path.
    """
    cuts = _chosen(_rests(path, track), np.sort(places), most)
    return tuple(_part(path, track, first, last) for first, last in pairwise([0, *cuts, len(track.pieces)]))


def _rests(path: ProgramPath, track: Track) -> tuple[IntArray, Array]:
    """Pieces before which the motion rests, at the end of a motion, and where that is."""
    corners, _, rapids = find_stops(track)
    s = np.unique(np.concatenate([corners, rapids]))
    piece = np.searchsorted(track.starts, s)
    segment = track.segment[piece]
    apart = track.segment[piece - 1] != segment
    curves = [isinstance(one.curve, Composite) for one in track.path.segments]
    row = np.clip(np.searchsorted(path.s, s - SAME_PLACE), 0, path.s.size - 1)
    good = (apart | np.array(curves, dtype=np.bool_)[segment]) & (np.abs(path.s[row] - s) <= SAME_PLACE)
    return piece[good], s[good]


def _chosen(rests: tuple[IntArray, Array], places: Array, most: int) -> list[int]:
    cuts: list[int] = []
    held = 0
    for piece, count in zip(rests[0].tolist(), np.searchsorted(places, rests[1]).tolist(), strict=True):
        if count - held >= most:
            cuts.append(piece)
            held = count
    return cuts


def _part(path: ProgramPath, track: Track, first: int, last: int) -> ProgramPath:
    """Cut out the pieces from `first` to before `last`."""
    if (first, last) == (0, len(track.pieces)):
        return path
    low, high = np.searchsorted(path.s, track.starts[[first, last]] - SAME_PLACE).tolist()
    segments = tuple(
        _within(track, number, first, last)
        for number in range(int(track.segment[first]), int(track.segment[last - 1]) + 1)
    )
    return replace(
        path, path=replace(path.path, segments=segments), motion=path.motion[low:high],
        s=path.s[low : high + 1] - path.s[low],
        cubics={row - low: curve for row, curve in path.cubics.items() if low <= row < high},
    )  # fmt: skip


def _within(track: Track, number: int, first: int, last: int) -> Segment:
    """Return what of a segment lies between two pieces."""
    segment = track.path.segments[number]
    low, high = np.searchsorted(track.segment, [number, number + 1]).tolist()
    if first <= low and high <= last:
        return segment
    return replace(segment, curve=Composite(track.pieces[max(low, first) : min(high, last)]))
