"""Paths of programs: what their motions are as curves, and where on them each place is."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import pytest
from support.tape import Tape

from ph_post.analysis.certification import certify
from ph_post.analysis.turning_points import find_turning_points
from ph_post.edit.window_plans import divide
from ph_post.errors import InputError
from ph_post.gcode.paths import ProgramPath, chains_without_feed, main_path, paths_of
from ph_post.gcode.read import read_program
from ph_post.geometry.track import Track
from ph_post.types import Array

MM = 1e-3


def path_of(tape: Tape) -> ProgramPath:
    (path,) = paths_of(tape.program())
    return path


def reversals(path: ProgramPath) -> list[tuple[str, str, int, float]]:
    """Axis, sense, motion and share of every turning point."""
    points = find_turning_points(Track(path.path))
    motion, share = path.to_motions(np.array([point.s for point in points]))
    return [(p.axis, p.sense, int(m), round(float(u), 6)) for p, m, u in zip(points, motion, share, strict=True)]


def place(path: ProgramPath, s: Any) -> Array:
    track = Track(path.path)
    piece, u = track.locate(np.asarray(s, dtype=np.float64))
    return np.asarray(track.derivatives(piece, u)[0]) / MM


def kinds(path: ProgramPath) -> list[str]:
    return [segment.curve.kind for segment in path.path.segments]  # type: ignore[attr-defined]


def test_arcs_are_exact() -> None:
    path = path_of(Tape((10, 0, 0)).arc((0, 10, 0), (0, 0), 90).arc((0, 10, 0), (0, 0), -360))
    assert kinds(path) == ["arc", "arc"]
    assert path.s == pytest.approx(np.array([0.0, 5.0 * np.pi, 25.0 * np.pi]) * MM, rel=1e-14)
    # the second goes round the other way, so both axes turn in the corner between them
    assert reversals(path) == [
        ("X", "min", 0, 1.0),
        ("Y", "max", 0, 1.0),
        ("X", "max", 1, 0.25),
        ("Y", "min", 1, 0.5),
        ("X", "min", 1, 0.75),
    ]


def test_two_turns_are_two_circles() -> None:
    path = path_of(Tape((5, 0, 0)).arc((0, 5, 0), (0, 0), 360 + 90))
    assert kinds(path) == ["arc", "arc"]
    assert path.s[-1] == pytest.approx(5.0 * MM * 2.5 * np.pi, rel=1e-14)
    assert path.motion.tolist() == [0]
    assert place(path, path.to_path(np.array([0]), np.array([0.2]))) == pytest.approx(np.array([[0.0, 5.0]]), abs=1e-12)


def test_an_arc_in_the_zx_plane_turns_from_z_to_x() -> None:
    # G18 G3 from Z 10 to X 10 about the origin: the first axis of the plane is Z
    path = path_of(Tape((0, 7, 10)).arc((10, 7, 0), (0, 0), 90, plane=18))
    assert path.path.axes == ("X", "Z")
    assert place(path, [0.5 * path.s[-1]]) == pytest.approx(np.full((1, 2), 10.0 / np.sqrt(2.0)), abs=1e-12)


@pytest.mark.parametrize("plane", [17, 18, 19])
def test_a_helix_in_any_plane(plane: int) -> None:
    first, second, third = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}[plane]
    end = np.zeros(3)
    end[[second, third]] = 20.0, 6.0
    start = np.zeros(3)
    start[first] = 20.0
    path = path_of(Tape(start).arc(end, (0.0, 0.0), 90.0, plane=plane))
    length = np.hypot(20.0 * np.pi / 2.0, 6.0)
    assert path.s[-1] == pytest.approx(length * MM, rel=2e-9)
    share = np.linspace(0.0, 1.0, 41)
    exact = np.zeros((41, 3))
    exact[:, first], exact[:, second] = 20.0 * np.cos(share * np.pi / 2), 20.0 * np.sin(share * np.pi / 2)
    exact[:, third] = 6.0 * share
    assert np.abs(place(path, share * path.s[-1]) - exact).max() < 1e-6


def test_radii_that_disagree_by_the_rounding_still_make_an_arc() -> None:
    path = path_of(Tape((10.0004, 0, 0)).arc((0, 10, 0), (0, 0), 90))
    assert kinds(path) == ["arc"]
    assert place(path, [0.0, path.s[-1]]) == pytest.approx(np.array([[10.0004, 0.0], [0.0, 10.0]]), abs=1e-9)
    middle = np.linalg.norm(place(path, [0.5 * path.s[-1]]))
    assert middle == pytest.approx(10.0, abs=5e-4)


def test_a_nearly_full_turn_with_radii_that_disagree_stays_near_its_circle() -> None:
    # The chord is so short that no centre suits both ends: the radius changes along the way.
    angle = np.degrees(2.0 * np.pi - 1e-4)
    end = (10.0005 * np.cos(1e-4), -10.0005 * np.sin(1e-4), 0.0)
    path = path_of(Tape((10, 0, 0)).arc(end, (0, 0), angle))
    radius = np.linalg.norm(place(path, np.linspace(0.0, path.s[-1], 101)), axis=1)
    assert radius.min() > 10.0 - 1e-6
    assert radius.max() < 10.0005 + 1e-6


def test_splines_are_exact() -> None:
    net = [(0, 0, 0), (1, 5, 0), (4, 5, 0), (5, 0, 0)]
    path = path_of(Tape((0, 0, 0)).cubic(net).nurbs(3, [(5, 0, 0), (7, -3, 0), (9, 0, 0)], [1.0, 2.0, 1.0]))
    assert kinds(path) == ["bezier", "nurbs"]
    # the cubic's Y is symmetric; the conic's shoulder is (P0 + 2 · 2 P1 + P2) / (2 + 2 · 2)
    found = {(axis, motion): share for axis, _, motion, share in reversals(path)}
    assert found["Y", 0] == 0.5
    shoulder = place(path, path.to_path(np.array([1]), np.array([found["Y", 1]])))
    assert shoulder == pytest.approx(np.array([[7.0, -2.0]]), abs=1e-9)


def test_the_share_of_a_cubic_is_its_parameter() -> None:
    # along a line, but unevenly: x = 3 · 4 u (1 - u)² + 3 · 5 u² (1 - u) + 9 u³
    path = path_of(Tape((0, 0, 0)).cubic([(0, 0, 0), (4, 0, 0), (5, 0, 0), (9, 0, 0)]))
    u = np.linspace(0.0, 1.0, 11)
    x = 12.0 * u * (1 - u) ** 2 + 15.0 * u**2 * (1 - u) + 9.0 * u**3
    motion = np.zeros(11, dtype=np.int64)
    assert path.to_path(motion, u) == pytest.approx(x * MM, abs=1e-12)
    assert path.to_motions(x * MM)[1] == pytest.approx(u, abs=1e-9)


def test_reversals_across_blocks_lines_rapids_and_planes() -> None:
    tape = (
        Tape((0, 0, 5))
        .rapid((0, 0, 1))
        .line((0, 0, 0))
        .line((10, 5, 0))
        .line((20, 5, 0))  # Y stands still …
        .line((30, 0, 0))  # … and moves back
        .rapid((30, 0, 5))
        .rapid((20, 0, 5))  # X turned at 30, across a rapid that does not move it
        .arc((20, 10, 5), (0, 5), 180.0, plane=19)  # G19 about Y 5, Z 5 …
    )
    tape.rows[-1]["center"] = (5e-3, 5e-3)
    found = reversals(path_of(tape))
    assert ("Z", "min", 1, 1.0) not in found
    assert ("Y", "max", 3, 1.0) in found
    assert ("X", "max", 5, 1.0) in found
    assert ("Z", "max", 7, 0.5) in found or ("Z", "min", 7, 0.5) in found
    assert [one[0] for one in found].count("X") == 1


def test_z_turns_where_it_stood_still_in_between() -> None:
    tape = Tape((0, 0, 5)).line((0, 0, 0)).line((10, 5, 0)).rapid((10, 5, 5))
    assert ("Z", "min", 1, 1.0) in reversals(path_of(tape))


def test_a_sampled_curve_reverses_between_its_moves() -> None:
    t = np.linspace(0.0, np.pi, 101)
    points = np.stack([10.0 * t, 5.0 * np.sin(t), 0.0 * t], axis=1)
    ((axis, sense, motion, share),) = reversals(path_of(Tape(points[0]).lines(points[1:])))
    assert (axis, sense) == ("Y", "max")
    # the middle of the curve is a vertex, and may count to either side within what is fitted
    assert motion + share == pytest.approx(50.0, abs=0.05)


def test_feeds_are_by_segment_and_do_not_break_the_curve() -> None:
    t = np.linspace(0.0, 1.0, 41)
    points = np.stack([10.0 * np.sin(t), 10.0 * np.cos(t), 0.0 * t], axis=1)
    tape = Tape(points[0])
    for k, point in enumerate(points[1:]):
        tape.line(point, feed=600.0 if k < 20 else 1200.0)
    path = path_of(tape)
    feeds = [segment.feed for segment in path.path.segments]
    assert sorted(set(feeds)) == pytest.approx([0.01, 0.02])
    assert place(path, path.to_path(np.array([20]), np.array([0.0]))) == pytest.approx(points[20:21, :2], abs=2e-3)


def test_inverse_time_becomes_feed() -> None:
    tape = Tape((10, 0, 0)).line((20, 0, 0), duration=2.0).arc((30, 10, 0), (20, 10), 90.0, duration=0.5)
    feeds = [segment.feed for segment in path_of(tape).path.segments]
    assert feeds == pytest.approx([5.0 * MM, 10.0 * np.pi * MM])


def test_rapids_are_rapid_segments() -> None:
    path = path_of(Tape((0, 0, 5)).rapid((5, 5, 5)).line((5, 5, 0)).rapid((0, 0, 5)))
    assert [segment.rapid for segment in path.path.segments] == [True, False, True]


def test_the_path_begins_where_the_axes_are_known() -> None:
    tape = Tape((np.nan, np.nan, np.nan)).rapid((None, None, 5))
    tape.rows[-1]["end"] = np.array([np.nan, np.nan, 5e-3])
    tape.place = np.array([np.nan, np.nan, 5e-3])
    tape.rapid((1, 2, 5)).line((1, 2, 0)).line((9, 2, 0))
    path = path_of(tape)
    assert path.motion.tolist() == [2, 3]
    assert path.path.axes == ("X", "Z")
    assert path.warnings == ()


def test_cuts_from_an_unknown_place_are_named() -> None:
    tape = Tape((np.nan, 0, 0))
    tape.line((5, 5, 0)).line((9, 2, 0))
    path = path_of(tape)
    assert path.motion.tolist() == [1]
    assert path.warnings == ("line 1: where the axes are is not known yet: left out of the path",)


@pytest.mark.parametrize("end", ["G0 Z5", "G0 X0 Y0 Z5", "G0 Z5\nG0 X0 Y0"])
def test_an_axis_that_is_named_at_the_end_alone_leaves_the_path_before(end: str) -> None:
    """A plotter that lifts its pen by another word; where Z stands while it draws nobody knows, and need not."""
    text = "G21 G90\nG1 X0 Y0 F600\nG1 X10\nG1 Y5\nG1 X-4\nG1 Y0\n" + end + "\nM2\n"
    (path,) = paths_of(read_program(text.encode(), "drawing.nc"))
    assert path.motion.tolist() == [1, 2, 3, 4]
    assert path.s[-1] / 1e-3 == pytest.approx(10.0 + 5.0 + 14.0 + 5.0)
    assert set(path.path.axes) == {"X", "Y"}
    assert path.warnings == ("line 2: where the axes are is not known yet: left out of the path",)


def test_cuts_behind_an_axis_that_is_named_late_are_named() -> None:
    text = "G21 G90\nG0 X0 Y0\nG1 X10 F600\nG1 Y5\nG1 X-4\nG1 Y0\nG0 Z5\nG1 X9\nG1 X3\nM2\n"
    (path,) = paths_of(read_program(text.encode(), "drawing.nc"))
    assert path.motion.tolist() == [1, 2, 3, 4]
    assert path.warnings == ("lines 7 to 9: all axes are placed there alone: left out of the path",)


def test_an_unknown_feed_leaves_the_chain_out() -> None:
    tape = Tape((0, 0, 0)).line((5, 5, 0), feed=np.nan)
    assert paths_of(tape.program()) == ()
    (word,) = chains_without_feed(tape.program())
    assert word.startswith("tape.ngc:1: from here on the feed is not known")
    with pytest.raises(InputError, match=r"tape\.ngc: no path"):
        main_path(tape.program())


def test_the_longest_chain_is_the_main_path() -> None:
    tape = Tape((0, 0, 0)).line((5, 5, 0)).new_chain().line((50, 5, 0)).rapid((0, 0, 0))
    path, words = main_path(tape.program())
    assert path.motion.tolist() == [1, 2]
    assert len(words) == 1
    assert words[0].startswith("line 1: a path of its own, 7.07107 mm")


def test_a_program_without_cuts_has_no_path() -> None:
    assert paths_of(Tape((0, 0, 0)).rapid((5, 5, 0)).program()) == ()


def test_moves_that_go_nowhere_are_seen_through() -> None:
    tape = Tape((0, 0, 0)).line((5, 0, 0)).line((5, 0, 0)).line((5, 5, 0))
    path = path_of(tape)
    assert path.motion.tolist() == [0, 2]
    assert path.to_path(np.array([1]), np.array([0.5])) == pytest.approx([5.0 * MM])


def test_places_go_there_and_back() -> None:
    t = np.linspace(0.0, 6.0, 301)
    points = np.stack([10.0 * t, 5.0 * np.sin(t), np.cos(t)], axis=1)
    tape = Tape((0, 0, 10)).rapid(points[0]).lines(points[1:]).arc((60.0, 10.0, 1.0), (60.0, 5.0), 180.0)
    tape.rows[-1]["center"] = (60e-3, 0.5 * (points[-1, 1] + 10.0) * MM)
    path = path_of(tape)
    s = np.linspace(0.0, path.s[-1], 1001)
    motion, share = path.to_motions(s)
    assert path.to_path(motion, share) == pytest.approx(s, abs=1e-9)
    assert (np.diff(motion + share) >= 0.0).all()
    # and where that is on the moves as written is where it is on the path, but for the chords' sagitta
    motions = tape.motions()
    straight = motions.kind[motion] == 1
    written = motions.start[motion] + share[:, None] * (motions.end - motions.start)[motion]
    assert np.abs(place(path, s)[straight] - written[straight] / MM).max() < 3e-3


def test_a_fitted_path_can_be_certified() -> None:
    t = np.linspace(0.0, 6.0, 61)
    points = np.stack([10.0 * t, 5.0 * np.sin(t), 0.0 * t], axis=1)
    track = Track(path_of(Tape(points[0]).lines(points[1:])).path)
    assert certify(track).ok


def test_one_axis_alone_gets_a_second() -> None:
    assert path_of(Tape((0, 0, 0)).line((0, 0, -5)).line((0, 0, 5))).path.axes == ("X", "Z")


def test_many_lines_are_one_segment() -> None:
    rng = np.random.default_rng(7)
    points = np.round(rng.uniform(0.0, 50.0, (500, 3)), 3)
    path = path_of(Tape(points[0]).lines(points[1:]))
    assert len(path.path.segments) == 1
    turns = np.diff(np.sign(np.diff(points, axis=0)), axis=0) != 0.0
    assert len(find_turning_points(Track(path.path))) == turns.sum()


def test_the_digest_is_the_programs() -> None:
    program = msgspec.structs.replace(Tape((0, 0, 0)).line((5, 5, 0)).program(), digest="abc")
    assert paths_of(program)[0].path.digest == "abc"


def test_parts_of_a_path_are_the_path() -> None:
    tape = Tape((0, 0, 0))
    for k in range(6):
        tape.line((40, 20 * k, 0)).arc((40, 20 * k + 10, 0), (40, 20 * k + 5), 180)
        tape.rows[-1]["center"] = (40e-3, (20 * k + 5) * 1e-3)
        tape.line((0, 20 * k + 10, 0)).rapid((0, 20 * k + 20, 0))
    path = path_of(tape)
    track = Track(path.path)
    counted = np.array([point.s for point in find_turning_points(track) if point.kind == "smooth"])
    parts = divide(path, track, counted, 2)
    assert len(parts) >= 3
    assert np.concatenate([part.motion for part in parts]).tolist() == path.motion.tolist()
    assert sum(part.s[-1] for part in parts) == pytest.approx(path.s[-1], rel=1e-12)
    begin = 0.0
    for part in parts:
        s = np.linspace(0.0, part.s[-1], 50)
        assert place(part, s) == pytest.approx(place(path, begin + s), abs=1e-9)
        motion, share = part.to_motions(s[1:-1])
        whole, there = path.to_motions(begin + s[1:-1])
        assert (motion.tolist(), share) == (whole.tolist(), pytest.approx(there, abs=1e-9))
        begin += float(part.s[-1])


def test_a_path_without_a_rest_stays_whole() -> None:
    path = path_of(Tape((10, 0, 0)).arc((10, 0, 0), (0, 0), 360).arc((10, 0, 0), (0, 0), 360))
    track = Track(path.path)
    assert divide(path, track, np.linspace(0.0, track.length, 20), 1) == (path,)


def test_parts_end_inside_runs_of_lines() -> None:
    rng = np.random.default_rng(3)
    points = np.round(rng.uniform(0.0, 50.0, (40, 3)), 3)
    path = path_of(Tape(points[0]).lines(points[1:]))
    track = Track(path.path)
    parts = divide(path, track, path.s[1:], 5)
    assert len(parts) > 3
    for part in parts:
        first, last = place(part, [0.0, part.s[-1]])
        assert first == pytest.approx(points[part.motion[0]], abs=1e-9)
        assert last == pytest.approx(points[part.motion[-1] + 1], abs=1e-9)


def test_a_rapid_that_is_just_long_enough_across_is_a_piece() -> None:
    """Along each axis alone it is shorter than what counts as no way at all: the program was refused for it."""
    text = "G21 G90\nG1 X10 Y0 Z0 F600\nG0 X10.0000008 Y0.0000008\nG1 X10 Y10\n"
    (path,) = paths_of(read_program(text.encode(), "part"))
    assert [segment.rapid for segment in path.path.segments].count(True) == 1


def test_a_corner_behind_a_move_of_nanometres_where_the_feed_changes_is_not_bent() -> None:
    """4 nm of path have room for a bend of 1 nm, whose halves would be points."""
    text = "G21 G90\nG0 X70 Y40\nG1 F300 X74.300638 Y40.6168\nG1 Y40.616804\nG1 F600 X74.232938 Y43.592239\nM2\n"
    (path,) = paths_of(read_program(text.encode(), "part.ngc"))
    first, last = np.hypot(4.300638, 0.6168), np.hypot(0.0677, 2.975435)
    assert path.s[-1] == pytest.approx((first + last) * MM, abs=1e-8)
