"""Where lasting offsets change: reversals across blocks, in arcs and splines, through rests and rapids."""

from __future__ import annotations

import re

import numpy as np
import pytest
from msgspec.structs import replace
from support.editing import ENOUGH, compensate

from ph_post.dialects.registry import find_dialect
from ph_post.drive.machinefile import read_machine
from ph_post.edit.crossing_ground import APPROACH
from ph_post.edit.crossings import ERROR
from ph_post.edit.edits import SYNCHRONISED, EditOptions, Edits, OffsetShift, dwell_time
from ph_post.edit.offset_edits import plan_offsets
from ph_post.edit.preconditions import written_offsets
from ph_post.errors import InputError
from ph_post.gcode.read import read_program
from ph_post.types import EffectSetting, Machine

MM = 1e-3
STEPPER = read_machine("stepper")
HALF = {"X": 0.03 * MM, "Y": 0.04 * MM, "Z": 0.015 * MM}


def plan(text: str, *, dialect: str = "linuxcnc", machine: Machine = STEPPER, **how: float) -> Edits:
    options = EditOptions(**{"max_slowdown": ENOUGH, **how})
    return plan_offsets(read_program(text.encode(), "part.ngc"), machine, find_dialect(dialect), options)


def of_axis(edits: Edits, axis: str) -> list[tuple[int, float, float]]:
    """Changes of an axis: the motion, the share, what is added for good [halves of the lost motion].

    A crossing counts at the middle of its chord.
    """
    found = []
    for stop in edits.stops:
        shifts = [shift for shift in stop.shifts if shift.axis == axis]
        if shifts:
            found.append((stop.motion, stop.share, round(_lasting(edits, shifts) / HALF[axis], 9)))
    for crossing in edits.crossings:
        if crossing.axis == axis:
            lines = [part for part in crossing.parts if part.line]
            chord = lines[len(lines) // 2]
            found.append((chord.motion, 0.5 * (chord.low + chord.high), 2.0 * crossing.sign))
    return sorted(found)


def _lasting(edits: Edits, shifts: list[OffsetShift]) -> float:
    """What of an axis' shifts at a place stays.

    Where the last comes from beyond the gap that is the first offset, whatever leads out there.
    """
    axis, travel = shifts[-1].axis, shifts[-1].travel
    if abs(travel) != pytest.approx(edits.pulse.get(axis, 0.0), rel=1e-9):
        return sum(shift.travel for shift in shifts)
    side = float(np.sign(travel))
    return side * edits.amplitude[axis] if edits.one_sided.get(axis, side) == side else 0.0


def signs(edits: Edits, axis: str) -> list[int]:
    return np.rint(edits.offset[:, "XYZ".index(axis)] / HALF[axis]).astype(int).tolist()


START = "G21 G90 G17 F600\nG0 X0 Y0\n"


def test_a_corner_that_turns_back() -> None:
    edits = plan(START + "G1 X10\nX4\nM2\n")
    assert of_axis(edits, "X") == [(0, 1.0, 1.0), (1, 1.0, -2.0), (2, 1.0, 1.0)]
    assert signs(edits, "X") == [1, -1, 0]
    assert edits.amplitude == {"X": pytest.approx(HALF["X"], rel=1e-12)}


def test_behind_a_rapid_the_axis_comes_from_beyond_its_gap() -> None:
    # Where its side is not known: the rapid ends two lost motions before the place, and one move takes up the backlash.
    edits = plan(START + "G1 X10\nM2\n")
    first = edits.stops[0]
    assert (first.motion, first.share, first.pause) == (0, 1.0, 0.0)
    assert [shift.travel / HALF["X"] for shift in first.shifts] == pytest.approx([2.0 * APPROACH])
    assert edits.pulse["X"] == pytest.approx(2.0 * APPROACH * HALF["X"])
    text = compensate((START + "G1 X10\nM2\n").encode(), STEPPER).text.decode()
    assert re.search(r"\n\(ph-post: \+\d -1 X approach\)\nG0 X-0\.09 Y0\nG1 X0\.03 F", text)


def test_a_rapid_to_where_the_axes_are_does_not_hide_the_cut_behind_it() -> None:
    # A cut that began at once would begin with the lag of the move that takes up the backlash.
    texts = (f"G21 G90 G94 G64 P0.01\nG0 X0 Y0 Z5\n{again}G1 Z-1 F300\nX20 F1200\nM2\n" for again in ("", "G0 X0 Y0\n"))
    once, twice = (plan(text, machine=read_machine("router")).stops[0].shifts for text in texts)
    assert [(one.axis, one.pause) for one in once] == [(one.axis, one.pause) for one in twice]
    assert once[-1].pause > 0.05


def test_no_move_of_one_axis_is_followed_by_a_dwell_where_motors_do_not_lag() -> None:
    edits = plan(START + "G1 X10\nX4\nG3 X8 Y4 I0 J4\nG1 X0\nM2\n")
    *inside, last = edits.stops
    assert [stop.motion for stop in inside] == [0, 1, 2, 3]
    assert {stop.pause for stop in inside} == {0.0}
    assert {shift.pause for stop in inside for shift in stop.shifts} == {0.0}
    # Behind the last cut the path rests anyway: its end is not rounded off by the way back to no offset.
    # A controller that follows the path exactly waits for its moves at a dwell of no length.
    assert (last.motion, last.share, dwell_time(last.pause)) == (4, 1.0, 0.0)
    assert [(shift.axis, shift.pause) for shift in last.shifts] == [("X", SYNCHRONISED), ("Y", SYNCHRONISED)]
    assert last.moves == [last.shifts]


def test_a_rest_behind_the_last_cut_is_not_needed_behind_a_rapid() -> None:
    edits = plan(START + "Z5\nG1 Z0\nX10\nX4\nG0 Z5\nM2\n")
    assert [(stop.motion, stop.pause) for stop in edits.stops][-1] == (5, 0.0)
    assert {shift.pause for stop in edits.stops for shift in stop.shifts} == {0.0}


def test_z_carries_its_whole_backlash_on_one_side() -> None:
    # Its zero is taken downwards: nothing on the way down, all of it on the way up.
    edits = plan("G21 G90 G17 F600\nG0 X0 Y0 Z5\nG1 Z-1\nX5 Z-0.5\nX9 Z-1\nG0 Z5\nM2\n")
    assert edits.one_sided == {"Z": 1}
    assert edits.amplitude["Z"] == pytest.approx(2.0 * HALF["Z"])
    found = of_axis(edits, "Z")
    assert found[0] == (1, 1.0, 2.0)
    assert [size for _, _, size in found] == [2.0, -2.0]
    assert signs(edits, "Z")[:2] == [0, 2]
    assert signs(edits, "Z")[3:] == [0, 0]


def test_an_arc_turns_at_its_quadrants() -> None:
    edits = plan(START + "G3 X0 Y0 I-10 J0\nM2\n")
    assert of_axis(edits, "X") == [
        (0, 1.0, -1.0),
        (1, pytest.approx(0.5), 2.0),
        (1, 1.0, -1.0),
    ]
    shares = [share for _, share, _ in of_axis(edits, "Y")]
    assert shares == [1.0, pytest.approx(0.25), pytest.approx(0.75), 1.0]


def test_an_arc_of_several_turns() -> None:
    edits = plan(START + "Z5\nG1 Z0\nG2 X0 Y0 Z-3 I10 J0 P3\nG0 Z5\nX0\nM2\n")
    shares = [share for motion, share, _ in of_axis(edits, "X") if motion == 3]
    assert shares == [pytest.approx(n / 6) for n in range(1, 6)]


def test_the_reversal_of_an_arc_begun_just_before_its_quadrant_is_at_the_joint() -> None:
    # Ends of arcs are rounded: here the quadrant lies 1 µm behind the arc's start, X gets 25 fm on.
    edits = plan(START + "G1 X20\nG3 X0 Y20.001 I-20 J0.001\nM2\n")
    assert [(motion, share) for motion, share, _ in of_axis(edits, "X")][1] == (1, 1.0)


def test_a_spline_turns_where_its_derivative_vanishes() -> None:
    # X = 3 u (1 - u)² 20 + 3 u² (1 - u) 20 = 60 u (1 - u): extreme in the middle.
    edits = plan(START + "G5 X0 Y30 I20 J10 P20 Q-10\nM2\n")
    assert of_axis(edits, "X") == [(0, 1.0, 1.0), (1, pytest.approx(0.5), -2.0), (1, 1.0, 1.0)]


def test_a_rest_is_left_at_its_first_corner() -> None:
    edits = plan(START + "G1 X10\nY3\nY9\nX0\nM2\n")
    assert not [stop for stop in edits.stops if stop.motion not in (0, 4)]
    (crossing,) = edits.crossings
    assert (crossing.axis, crossing.sign, crossing.error) == ("X", -1, pytest.approx(0.0, abs=1e-12))
    # On the straight edge behind the corner, on which X rests.
    assert [(part.motion, part.low, part.line) for part in crossing.parts] == [(2, 0.0, True)]
    assert signs(edits, "X") == [1, 1, -1, -1, 0]


def test_a_rest_between_smooth_joints_and_a_corner_is_left_at_the_corner() -> None:
    edits = plan(START + "G1 X8\nG3 X10 Y2 R2\nG1 Y9\nX0\nM2\n")
    (crossing,) = edits.crossings
    assert [(part.motion, part.high, part.line) for part in crossing.parts] == [(3, 1.0, True)]
    assert of_axis(edits, "X")[1][2] == -2.0


def test_a_rest_is_left_behind_a_rapid_before_the_tool_goes_down() -> None:
    edits = plan("G21 G90 G17 F600\nG0 X-5 Y0 Z5\nX0\nG1 Z-1\nX-4\nG0 Z5\nX-5 Y0\nM2\n")
    # The rapid to X0 takes X up on its way.
    assert of_axis(edits, "X") == [(1, 1.0, -2.0)]
    assert signs(edits, "X") == [0, -1, -1, -1, -1, 0]


def test_a_rapid_carries_the_change_itself() -> None:
    edits = plan(START + "G1 X10\nG0 X4\nG1 X2\nG0 X9\nX0\nM2\n")
    assert of_axis(edits, "X") == [(0, 1.0, 1.0)]
    assert signs(edits, "X") == [1, 1, -1, -1, 1, 0]


def test_behind_a_rapid_that_moves_another_axis_the_shift_is_a_move_of_its_own() -> None:
    edits = plan(START + "Z5\nG1 X10\nG0 Z6\nG1 X2\nM2\n")
    assert of_axis(edits, "X")[1] == (3, 1.0, -2.0)


def test_planes_and_helices() -> None:
    edits = plan("G21 G90 G18 F600\nG0 X0 Y0 Z0\nG2 X0 Z0 Y2 I10 K0\nM2\n")
    # Z begins downwards, the side of its zero, and comes from above as its side is not known.
    assert of_axis(edits, "Z") == [(0, 1.0, 0.0), (1, pytest.approx(0.25), 2.0), (1, pytest.approx(0.75), -2.0)]
    (approach,) = [shift for shift in edits.stops[0].shifts if shift.axis == "Z"]
    assert approach.travel / HALF["Z"] == pytest.approx(-2.0 * APPROACH)
    assert [share for _, share, _ in of_axis(edits, "X")] == [1.0, pytest.approx(0.5), 1.0]
    assert of_axis(edits, "Y") == [(0, 1.0, 1.0), (1, 1.0, -1.0)]


def test_small_excursions_are_not_followed() -> None:
    wiggle = START + "G1 X10\nX9.996\nX20\nX19.99\nX30\nM2\n"
    assert [motion for motion, _, _ in of_axis(plan(wiggle), "X")] == [0, 3, 4, 5]
    assert [motion for motion, _, _ in of_axis(plan(wiggle, tolerance=0.02 * MM), "X")] == [0, 5]


def test_the_reversal_is_at_the_extreme_not_where_the_dead_band_is_left() -> None:
    edits = plan(START + "G1 X10\nX9.998\nX9.996\nX9.99\nX0\nM2\n")
    assert of_axis(edits, "X")[1][:2] == (1, 1.0)


def test_at_the_beginning_of_a_chain_a_change_waits_for_the_first_rapid() -> None:
    edits = plan(START + "G92 X0 Y0\nG0 Y5\nG0 Y6\nG1 X5\nM2\n")
    assert of_axis(edits, "X")[0] == (1, 1.0, 1.0)
    # The rapid does not name X: one move takes it beyond its gap, and one back through it onto its side.
    out, back = edits.stops[0].shifts
    assert (out.axis, back.axis) == ("X", "X")
    assert back.travel / HALF["X"] == pytest.approx(2.0 * APPROACH)
    assert (out.travel + back.travel) / HALF["X"] == pytest.approx(1.0)


def test_an_axis_that_carries_no_offset_is_not_declared() -> None:
    # Where Y begins is not known, and behind its rapid nothing is cut.
    edits = plan("G21 G90 G17 F600\nG0 X0\nG1 X10\nX4 Y5\nG0 Y1\nM2\n")
    assert list(edits.amplitude) == ["X"]


def test_an_axis_that_rests_while_others_cut_is_on_its_side_before_a_rapid_takes_it_away() -> None:
    # As a printer's X does, which homes, and draws its first line along Y.
    edits = plan("G21 G90 G17 F600\nG1 X10 Y5\nX4\nG0 Y1\nM2\n")
    assert signs(edits, "Y") == [-1, -1, 0]
    assert of_axis(edits, "Y")[0] == (0, 1.0, -1.0)


def test_a_tool_change_separates() -> None:
    edits = plan(START + "G1 X10\nM6 T1\nG0 X0\nG1 X5\nG0 X0\nM2\n")
    assert signs(edits, "X") == [1, 0, 1, 1, 0]
    assert of_axis(edits, "X") == [(0, 1.0, 1.0), (1, 1.0, -1.0), (2, 1.0, 1.0)]


@pytest.mark.parametrize(
    ("motion", "why"),
    [
        ("G2 X5 Y5 Z-2 I5 J0\nG0 Z5\nM6 T2\n", ""),
        ("M6 T1\nG0 X0 Y0\nG2 X10 Z-2 I5 J0", "begins where Z is not known"),
        ("M6 T1\nG0 X0 Y0\nG2 X10 I5 J0", ""),
    ],
)
def test_motions_that_cannot_be_divided(motion: str, why: str) -> None:
    edits = plan(f"{START}Z2\n{motion}\nM2\n")
    told = [said for said in edits.warnings if "not compensated" in said]
    assert [why in said for said in told] == ([True] if why else [])


def test_a_dip_in_the_middle_of_a_feed_costs_its_ramps() -> None:
    saw = START + "".join(f"G1 X{10 * (n % 2)}\n" for n in range(1, 40)) + "M2\n"
    circles = START + "G3 X0 Y0 I-1 J0\n" * 20 + "M2\n"
    # In the corners of the saw the machine stops anyway; on small circles it slows down for each of 79 crossings.
    assert len(plan(saw, max_slowdown=0.08).stops) == len(plan(saw).stops) == 40
    found = {allowed: plan(circles, max_slowdown=allowed) for allowed in (ENOUGH, 0.01, 0.006)}
    assert [len(edits.crossings) for edits in found.values()] == [79, 79, 40]
    errors = [max(one.error for one in edits.crossings) for edits in found.values()]
    assert errors[0] < 2e-3 * MM < errors[1] < 4.0 * ERROR
    # In still less time one axis of the two is compensated, that with more backlash; the other is named.
    assert {one.axis for one in found[0.006].crossings} == {"Y"}
    assert "axis X not compensated" in found[0.006].warnings[0]
    assert "--max-slowdown" in found[0.006].warnings[0]
    # On circles of half that size the ramps are too long for either.
    told = plan(circles.replace("I-1", "I-0.5"), max_slowdown=0.001)
    assert not told.crossings
    assert not told.stops
    assert not told.offset.any()
    assert "--max-slowdown" in told.warnings[0]


def test_the_dead_band_is_raised_before_an_axis_is_given_up() -> None:
    # Many excursions of 10 µm, below half the lost motion, and one large one.
    small = "".join(f"G1 X{20 + n * 1}\nX{20 + n * 1 - 0.01}\n" for n in range(60))
    text = START + small + "G1 X-40\nM2\n"
    edits = plan(text, max_slowdown=0.01)
    assert 3 <= len(edits.stops) < 10
    assert any("are ignored" in said and "--max-slowdown" in said for said in edits.warnings)
    assert len(plan(text).stops) > 100


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("G21 G90\nG0 X0\nG95 G1 X10 F0.1\nX0\nM2\n", "feed"),
        ("G21 G90 F600\nG10 L2 P1 R30\nG0 X0 Y0\nG1 X10\nX0\nM2\n", "turns the work system"),
        ("N1 G21 G90 F600*1\nN2 G0 X0*2\nN3 G1 X10*3\nN4 X0*4\nM2\n", "checksum"),
    ],
)
def test_what_is_left_alone_is_named(text: str, why: str) -> None:
    edits = plan(text, dialect="grbl")
    assert not edits.stops
    assert not edits.offset.any()
    assert any(why in said for said in edits.warnings)


def test_what_is_never_written_takes_no_time() -> None:
    """Z is zeroed on its way down, and only cuts there: nothing is added, so that nothing of the time is reckoned."""
    sizes = {"X": 0.0, "Y": 0.0, "Z": 0.05 * MM}
    axes = {
        name: replace(axis, gap=axis.gap.with_lost_motion(sizes[name]), reference_direction="-")
        for name, axis in STEPPER.axes.items()
    }
    cuts = "".join(f"T{n} M6\nG0 X0 Y{n}\nG0 Z0.1\nG1 Z-1\nX5\nG0 Z0.1\n" for n in range(1, 6))
    edits = plan(f"G21 G90 G17 F600\nG0 Z9\n{cuts}M2\n", machine=replace(STEPPER, axes=axes))
    assert edits.empty
    assert edits.slowdown == 0.0


def test_cuts_in_other_units_are_named_and_have_no_offset() -> None:
    edits = plan("G21 G90 F600\nG0 X0 Y0\nG1 X10\nX0\nG20\nX1\nX0\nG21\nX9\nX0\nM2\n", dialect="grbl")
    assert [bool(any(row)) for row in edits.offset] == [True, True, False, False, False, True, False]
    assert any(
        said == "not compensated in lines 6 to 7: its units are not those of most of the program"
        for said in edits.warnings
    )


def test_steps_from_an_unknown_place_are_named() -> None:
    edits = plan("G21 G91 F600\nG0 X5\nG1 X10\nX-4\nG90 X3\nM2\n")
    assert not edits.stops
    assert edits.warnings == (
        "axis X not compensated at 3 motions, the first in line 2: they begin where its position is not known",
    )


def test_steps_alone_need_no_place() -> None:
    edits = plan("G21 G91 F600\nG0 X5\nG1 X10\nX-4\nM2\n")
    assert (1, "X") in [(stop.motion, stop.shifts[0].axis) for stop in edits.stops]
    assert not [one for one in edits.warnings if "not compensated" in one]


def test_amplitudes_are_on_the_grid_of_the_program_s_unit() -> None:
    inch = plan("G20 G90 F10\nG0 X0\nG1 X1\nX0\nM2\n", dialect="grbl")
    assert inch.amplitude["X"] / 25.4e-3 == pytest.approx(0.00118, abs=1e-12)


def test_too_few_decimals_are_refused() -> None:
    coarse = find_dialect("grbl")
    program = read_program((START + "G1 X5\nX0\nM2\n").encode(), "part.ngc")
    # half of 0.06 mm is three whole steps of 0.01 mm, and none of 0.1 mm
    fair = replace(coarse, numbers=replace(coarse.numbers, decimals=2))
    half = 0.5 * STEPPER.axes["X"].gap.lost_motion
    assert written_offsets(STEPPER.axes["X"], fair, 1e-3) == pytest.approx((-half, half))
    assert written_offsets(STEPPER.axes["Z"], fair, 1e-3) == pytest.approx((0.0, STEPPER.axes["Z"].gap.lost_motion))
    coarse = replace(coarse, numbers=replace(coarse.numbers, decimals=1))
    with pytest.raises(InputError, match="decimals of grbl are too few for an offset of axis X"):
        plan_offsets(program, STEPPER, coarse, EditOptions())


def test_double_compensation_is_warned_of() -> None:
    linuxcnc = plan(START + "G1 X5\nX0\nM2\n")
    assert any("BACKLASH" in said for said in linuxcnc.warnings)
    assert any("friction" in said for said in linuxcnc.warnings)
    marlin = plan("M425 F1\n" + START + "G1 X5\nX0\nM2\n", dialect="grbl")
    assert any("M425" in said for said in marlin.warnings) or not marlin.stops


def test_axes_inside_their_loop_carry_nothing() -> None:
    edits = plan(START + "G1 X10\nX4\nM2\n", machine=read_machine("paper"))
    assert (edits.stops, edits.amplitude, edits.warnings) == ((), {}, ())
    assert not edits.offset.any()


def test_an_approach_is_so_slow_that_friction_stops_the_table() -> None:
    """A table that nothing pushes any more flies v²/2a: behind a stop at once that has to stay within its backlash."""
    machine, brakes = read_machine("router"), 0.05
    text = "G21 G90 G17 G94 G64 P0.005\nG0 X10 Y0\nG1 Z-1 F300\nG3 X10 Y0 I-10 J0 F900\nG0 Z5\nM2\n"
    axis = machine.axes["X"]
    error = {"following_error_mm": axis.servo.b * brakes / MM}
    axis = replace(axis, effects=(EffectSetting(name="coulomb_friction", parameters=error),))
    flights = {}
    for name, one in (("free", machine), ("known", replace(machine, axes={**machine.axes, "X": axis}))):
        stops = [stop for stop in plan(text, machine=one).stops if stop.approach]
        speeds = [shift.velocity for stop in stops for shift in stop.shifts if shift.axis == "X"]
        assert speeds
        flights[name] = max(speeds) ** 2 / (2.0 * brakes)
    assert flights["free"] > axis.gap.lost_motion
    assert flights["known"] < 0.06 * axis.gap.lost_motion


def test_a_shift_of_its_own_is_no_slower_than_a_motor_can_be_where_the_path_is_exact() -> None:
    """At 30 mm/min it would take 0.12 s; where corners are rounded the cut beside it would become faster.

    There it is rounded within 4 µm.
    """
    text = START + "G1 X10 F30\nX0\nX10\nM2\n"
    for dialect, fastest in (("grbl", np.sqrt(0.25 * 60e-6)), ("linuxcnc", np.sqrt(0.25 * 4e-6))):
        stops = plan(text, dialect=dialect, machine=replace(STEPPER, dialect=dialect)).stops
        inside = [shift.velocity for stop in stops if not stop.approach for shift in stop.shifts if shift.whole]
        assert len(inside) == 2
        assert inside == pytest.approx([fastest, fastest])


def test_a_motor_crosses_behind_a_corner_while_the_path_leaves_it_slowly() -> None:
    """At 10 mm/min its way is 5 µm meanwhile, for which the table waits; at 30 mm/min it would be too much.

    Where there is time for a stop nothing waits.
    """
    for feed, allowed, count in ((10, 1e-4, 40), (30, 1e-4, 0), (10, ENOUGH, 0)):
        text = START + f"G1 X0.2 F{feed}\n" + "X0\nX0.2\n" * 20 + "M2\n"
        edits = plan(text, dialect="grbl", machine=replace(STEPPER, dialect="grbl"), max_slowdown=allowed)
        assert len([one for one in edits.crossings if one.behind]) == count
        assert all(one.length < 6e-6 for one in edits.crossings)
