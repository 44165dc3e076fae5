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
    count = len(track.pieces)
    before = np.arange(count if track.closed else count - 1)
    after = (before + 1) % count
    (first, last), (first_bend, last_bend) = track.tangents(), track.end_curvatures()
    t0, t1 = last[before], first[after]
    jump = t1 - t0
    # Half the angle has the sine |t1 - t0| / 2 and the cosine |t1 + t0| / 2: accurate at 0 and at π.
    angle = 2.0 * np.arctan2(np.linalg.norm(jump, axis=1), np.linalg.norm(t1 + t0, axis=1))
    bent, bend = last_bend[before], first_bend[after]
    infinite = ~(np.isfinite(bent) & np.isfinite(bend))
    curvature_jump = np.where(infinite, np.inf, np.where(infinite, 0.0, bend) - np.where(infinite, 0.0, bent))
    return Joints(
        before=before,
        after=after,
        s=track.starts[before + 1],
        angle=angle,
        tangent_jump=jump,
        curvature_jump=curvature_jump,
    )
