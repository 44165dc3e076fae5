"""Small corners between motions of a program, rounded as controllers do."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from ph_post.gcode.paths import ProgramPath, paths_of
from ph_post.gcode.read import read_program
from ph_post.geometry.joints import SHARP_CORNER_RAD, find_joints, find_stops
from ph_post.geometry.track import Track

MM = 1e-3
TOLERANCE = 1e-6


def corner(angle: float, *, mode: str = "", second: str = "F600", way: float = 10.0) -> ProgramPath:
    """A line along X, and an arc of 5 mm that begins with a direction `angle` to the left of it."""
    i, j = -5.0 * math.sin(angle), 5.0 * math.cos(angle)
    text = (
        f"G21 G90 G17 G94 {mode}\nG0 X-20 Y0\nG1 X{-way:.6f} Y0 F600\nG1 X0 Y0\n"
        f"G3 X{2.0 * i:.6f} Y{2.0 * j:.6f} I{i:.6f} J{j:.6f} {second}\nM2\n"
    )
    (path,) = paths_of(read_program(text.encode(), "corner.ngc"), TOLERANCE)
    return path


def distance(points: np.ndarray, angle: float) -> float:
    """Largest distance [m] of points from the line up to the origin and the circle behind it."""
    center = 5.0 * MM * np.array([-math.sin(angle), math.cos(angle)])
    line = np.where(points[:, 0] <= 0.0, np.abs(points[:, 1]), np.linalg.norm(points, axis=1))
    circle = np.abs(np.linalg.norm(points - center, axis=1) - 5.0 * MM)
    return float(np.minimum(line, circle).max())


@pytest.mark.parametrize("angle", [-0.09, -0.05, -0.008, 0.002, 0.008, 0.05, 0.09])
@pytest.mark.parametrize("second", ["F600", "F900"])
def test_small_corners_are_smooth_within_the_tolerance(angle: float, second: str) -> None:
    path = corner(angle, second=second)
    track = Track(path.path)
    joints = find_joints(track)
    assert joints.angle.max() < SHARP_CORNER_RAD
    assert all(stops.size == 0 for stops in find_stops(track)[:2])
    s = np.linspace(0.0, track.length, 200_001)
    points = track.derivatives(*track.locate(s))[0]
    assert distance(points, angle) <= TOLERANCE
    feeds = {round(one.feed * 60.0 / MM) for one in path.path.segments if one.feed is not None}
    assert feeds == {600, int(second[1:])}


@pytest.mark.parametrize("angle", [0.002, 0.05])
def test_the_end_of_a_motion_is_where_the_bend_is_nearest_to_it(angle: float) -> None:
    path = corner(angle)
    track = Track(path.path)

    def off(s: float) -> float:
        return float(np.linalg.norm(track.derivatives(*track.locate(np.array([s])))[0][0]))

    place = float(path.s[-2])
    nearest = minimize_scalar(off, bounds=(place - 0.1 * MM, place + 0.1 * MM), method="bounded")
    assert abs(place - nearest.x) < 2e-6
    motion, share = path.to_motions(np.array([place, place - 1e-5, place + 1e-5]))
    assert motion.tolist() == [path.motion[-2], path.motion[-2], path.motion[-1]]
    assert share[0] == 1.0
    assert path.s[-1] == pytest.approx(track.length, abs=1e-15)


@pytest.mark.parametrize(("angle", "mode"), [(0.2, ""), (-0.2, ""), (0.05, "G61"), (0.05, "G61.1")])
def test_corners_that_are_large_or_stopped_at_stay_sharp(angle: float, mode: str) -> None:
    track = Track(corner(angle, mode=mode).path)
    joints = find_joints(track)
    assert joints.angle.max() == pytest.approx(abs(angle), abs=1e-6)


def test_a_tangent_joint_stays_as_it_is() -> None:
    path = corner(0.0)
    kinds = [one.curve.kind for one in path.path.segments]
    assert kinds[-2:] == ["composite", "arc"]
    assert path.s[-2] == pytest.approx(20.0 * MM, abs=1e-12)


def test_a_bend_takes_no_more_than_its_part_of_a_short_motion() -> None:
    path = corner(0.01, way=0.05)
    assert (np.diff(path.s) > 0.0).all()
    assert path.s[-3] == pytest.approx(19.95 * MM, abs=1e-9)
