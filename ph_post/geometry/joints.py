"""Where pieces meet: corners, and jumps of the curvature.

A joint is where one piece ends and the next begins; the seam of a closed path is the last one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import msgspec
import numpy as np

from ph_post.types import Array, IntArray

if TYPE_CHECKING:
    from ph_post.geometry.track import Track

SHARP_CORNER_RAD: Final = 1e-3
"""Angle above which a joint is a sharp corner, where the motion stops [rad].

Segments that should be tangent come from files with six or so digits: end points rounded to 1e-6 mm turn a
short chord of 1 mm by 1e-6 rad, and arcs fitted by CAD programs meet to about 1e-4 rad. Running through an
angle of 1e-3 rad at 100 mm/s asks for a velocity step of 0.1 mm/s, less than stopping is worth.
"""


class Joints(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Joints in the order of the path, the seam of a closed one last.

    `before`, `after` (n,) are piece numbers, `s` (n,) [m] their place (the seam's is the path's length),
    `angle` (n,) [rad] the angle between the tangents. `tangent_jump` (n, dim) and `curvature_jump` (n, dim)
    [1/m] are what dr/ds and d²r/ds² gain, infinite where the curvature is on either side.
    """

    before: IntArray
    after: IntArray
    s: Array
    angle: Array
    tangent_jump: Array
    curvature_jump: Array

    @property
    def sharp(self) -> IntArray:
        """Numbers of the joints that are sharp corners."""
        return np.flatnonzero(self.angle > SHARP_CORNER_RAD)


def find_joints(track: Track) -> Joints:
    """Compare every piece's end with the beginning of the next."""
    before, after = _neighbours(track)
    (first, last), (first_bend, last_bend) = track.tangents(), track.end_curvatures()
    bent, bend = last_bend[before], first_bend[after]
    infinite = ~(np.isfinite(bent) & np.isfinite(bend))
    curvature_jump = np.where(infinite, np.inf, np.where(infinite, 0.0, bend) - np.where(infinite, 0.0, bent))
    return Joints(
        before=before,
        after=after,
        s=track.starts[before + 1],
        angle=_angle(last[before], first[after]),
        tangent_jump=first[after] - last[before],
        curvature_jump=curvature_jump,
    )


def joint_angles(track: Track) -> Array:
    """Angles between the tangents [rad], the joints' only property that is wanted often."""
    before, after = _neighbours(track)
    first, last = track.tangents()
    return _angle(last[before], first[after])


def _neighbours(track: Track) -> tuple[IntArray, IntArray]:
    count = len(track.pieces)
    before = np.arange(count if track.closed else count - 1)
    return before, (before + 1) % count


def _angle(t0: Array, t1: Array) -> Array:
    """Half the angle has the sine |t1 - t0| / 2 and the cosine |t1 + t0| / 2: accurate at 0 and at π."""
    difference, total = t1 - t0, t1 + t0
    sine, cosine = (np.sqrt(np.einsum("nk,nk->n", v, v)) for v in (difference, total))
    angle: Array = 2.0 * np.arctan2(sine, cosine)
    return angle


def find_stops(track: Track) -> tuple[Array, Array, Array]:
    """Arc lengths [m] inside the path at which the motion has to stop.

    Returns
    -------
    corners, cusps, rapids : Array
        Sharp corners; joints at which the curvature is infinite; ends of rapid segments. Cusps inside pieces
        are turning points and known from there.
    """
    joints = find_joints(track)
    inside = joints.after != 0 if track.closed else np.ones(joints.s.size, dtype=bool)
    sharp = joints.angle > SHARP_CORNER_RAD
    infinite = ~np.all(np.isfinite(joints.curvature_jump), axis=1)
    rapid = np.array([segment.rapid for segment in track.path.segments])[track.segment]
    change = track.segment[joints.before] != track.segment[joints.after]
    ends = change & (rapid[joints.before] | rapid[joints.after])
    return joints.s[inside & sharp], joints.s[inside & infinite & ~sharp], joints.s[inside & ends & ~sharp]
