"""Joints: corners, smooth joints, the seam, and jumps of the curvature."""

import math

import numpy as np
import pytest

from ph_post.geometry.curves import Arc, Bezier, Line
from ph_post.geometry.joints import SHARP_CORNER_RAD, find_joints, joint_angles
from ph_post.geometry.nurbs import Nurbs
from ph_post.geometry.track import Track

EPS = np.finfo(float).eps
SLOT = [
    Line([[0, -1], [4, -1]]),
    Arc([4, -1], [4, 1], [4, 0], "ccw"),
    Line([[4, 1], [0, 1]]),
    Arc([0, 1], [0, -1], [0, 0], "ccw"),
]


def test_a_slot_is_smooth_with_jumps_of_curvature():
    joints = find_joints(Track.from_curves(SLOT, closed=True))
    assert joints.before.tolist() == [0, 1, 2, 3]
    assert joints.after.tolist() == [1, 2, 3, 0]
    assert joints.s == pytest.approx(np.array([4, 4 + math.pi, 8 + math.pi, 8 + 2 * math.pi]), rel=4 * EPS)
    assert joints.angle == pytest.approx(0, abs=4 * EPS)
    assert joints.sharp.size == 0
    assert joints.curvature_jump == pytest.approx(np.array([[0, 1], [0, 1], [0, -1], [0, -1]]), abs=4 * EPS)
    assert joints.tangent_jump == pytest.approx(0, abs=4 * EPS)


def test_an_open_path_has_no_seam():
    joints = find_joints(Track.from_curves(SLOT))
    assert joints.before.tolist() == [0, 1, 2]
    assert find_joints(Track.from_curves(SLOT[:1])).angle.size == 0


def test_the_seam_of_a_single_piece():
    circle = Track.from_curves([Arc([1, 0], [1, 0], [0, 0], "cw")], closed=True)
    joints = find_joints(circle)
    assert (joints.before.tolist(), joints.after.tolist()) == ([0], [0])
    assert joints.angle == pytest.approx(0, abs=4 * EPS)
    assert joints.s.tolist() == [circle.length]


@pytest.mark.parametrize("angle", [1e-9, 1e-4, 0.3, math.pi / 2, 3.0, math.pi - 1e-9, math.pi])
@pytest.mark.parametrize("dim", [2, 3])
def test_angles_small_and_large(angle, dim):
    corner, zero = [1.0, 0.0, 0.0][:dim], [0.0, 0.0, 0.0][:dim]
    end = [1.0 + math.cos(angle), math.sin(angle), 0.0][:dim]
    track = Track.from_curves([Line([zero, corner]), Line([corner, end])])
    joints = find_joints(track)
    # The end is rounded at 1 and the difference carries that.
    assert joints.angle[0] == pytest.approx(angle, abs=4 * EPS)
    assert joint_angles(track).tolist() == joints.angle.tolist()
    assert joints.sharp.tolist() == ([0] if angle > SHARP_CORNER_RAD else [])


def test_knots_inside_a_spline_are_joints():
    curve = Nurbs(2, [0, 0, 0, 1, 1, 2, 3, 3, 3], [[0, 0], [1, 0], [2, 0], [2, 1], [3, 3], [0, 0]])
    joints = find_joints(Track.from_curves([curve]))
    # a double knot at 1: a right angle; a simple one at 2: smooth
    assert joints.angle == pytest.approx(np.array([math.pi / 2, 0]), abs=8 * EPS)


def test_a_cusp_at_a_joint_turns_back():
    track = Track.from_curves([Bezier([[0, 0], [1, 1], [1, 0]]), Bezier([[1, 0], [1, 0], [1, 2]])])
    joints = find_joints(track)
    assert joints.angle == pytest.approx(math.pi, abs=4 * EPS)


def test_a_handle_of_no_length_has_an_infinite_jump():
    track = Track.from_curves([Line([[-1, -1], [0, 0]]), Bezier([[0, 0], [0, 0], [1, 1], [2, 0]])])
    joints = find_joints(track)
    assert joints.angle == pytest.approx(0, abs=4 * EPS)
    assert np.all(np.isinf(joints.curvature_jump))
