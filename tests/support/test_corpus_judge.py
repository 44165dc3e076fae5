"""The judge of the corpus, on programs whose places are plain to see."""

import numpy as np
import pytest

from .canon import needs_rs274
from .corpus_judge import Judged, compare, played_places


def test_motors_that_were_let_go_stand_where_nobody_knows():
    places, cuts = played_places("marlin", b"G92 X0 Y0\nG1 X1 Y0 F900\nM18\nG1 X3 Y2\nG1 X3 Y4\n")
    assert places[0].tolist() == [0.0, 0.0, 0.0]
    drawn = places[np.flatnonzero(cuts)]
    assert drawn[drawn[:, 1] == 0.0][:, 0].max() == 1.0
    # What leads from where they were pushed to is no cut, and what is behind it is one again.
    assert drawn[drawn[:, 1] > 0.0][:, 0].tolist() == [3.0] * int((drawn[:, 1] > 0.0).sum())


def test_a_small_circle_of_a_long_program_is_sampled_as_finely_as_it_needs():
    lines = "".join(f"G1 X{x}\nG1 X0\n" for x in [9000] * 20)
    places, cuts = played_places("grbl", f"G21 G90 F900\nG0 X0 Y0\nG1 X1\n{lines}G3 X0 Y0 I0 J0.2\nM2\n".encode())
    arc = places[cuts & (places[:, 1] > 1e-9)]
    assert np.linalg.norm(np.diff(arc, axis=0), axis=1).max() < 0.051


def drawn_on_grbl(text):
    places, cuts = played_places("grbl", text.encode())
    return places[cuts]


def test_nothing_is_cut_behind_an_arc_that_grbl_refuses():
    """Its gcode.c, "Arc definition error": 0.005 mm and a thousandth of the radius, and 0.5 mm, are the most."""
    head, behind = "G21 G90 F600\nG0 X10 Y0\nG1 Y0.1\nY0\n", "G1 X-30\nM2\n"
    for arc, taken in (
        ("G3 X-10.009 Y0 I-10", True),
        ("G3 X-10.011 Y0 I-10", False),
        ("G2 X-10 Y0 R10", True),
        ("G2 X-10 Y0 R9.99", False),
        ("G3 X9.004 Y0 I-0.5", True),
        ("G3 X9.006 Y0 I-0.5", False),
    ):
        assert (drawn_on_grbl(f"{head}{arc}\n{behind}")[:, 0].min() == -30.0) == taken, arc


def test_what_is_compensated_may_not_be_refused_where_the_original_is_not():
    plain = b"G21 G90 F600\nG0 X10 Y0\nG1 Y1\nY0\nG3 X10 Y0 I-10\nM2\n"
    broken = plain.replace(b"G3 X10 ", b"G3 X10.1 ")
    assert compare(Judged("compensated"), "grbl", plain, broken).outcome == "refused"
    assert compare(Judged("compensated"), "grbl", plain, plain).outcome == "compensated"


@pytest.mark.parametrize("dialect", ["grbl", "linuxcnc"])
def test_where_the_spindle_stands_nothing_is_cut(dialect):
    """A tool that is let down onto the part by hand, as pcb-gcode has it: the order in a line comes before its move."""
    text = "G21 G90\nM3 (M5)\nM5\nG0 X1 Y1 Z9\nG1 Z0 F60\nG0 Z9\nM3 G1 Y2 F60\nX4 M5\nG1 Z3\nM3\nG1 Y7\nM5\nM2\n"
    places, cuts = played_places(dialect, text.encode())
    x, y = places[:, :2].round(9).T
    assert not cuts[y == 1.0].any()
    assert not cuts[(y == 2.0) & (x > 1.0)].any()
    assert cuts[((y > 1.0) & (x == 1.0)) | (y > 2.0)].all()
    assert {1.0, 2.0, 7.0} <= {*y.tolist()}


def test_a_drilling_cycle_ends_above_its_hole():
    text = "G21 G90 F600\nG0 X0 Y0 Z3\nG98 G81 X5 Z-10 R1\nY9\nG80\nG0 X0 Y0\nG1 Z-1\nX4\nM2\n"
    drawn = drawn_on_grbl(text)
    holes = drawn[drawn[:, 2] < -1.0]
    assert np.unique(holes[:, :2], axis=0).tolist() == [[5.0, 0.0], [5.0, 9.0]]
    assert drawn[:, 2].min() == -10.0
    # It comes down to the cut behind them, and not up.
    assert (np.diff(drawn[(drawn[:, 0] == 0.0)][:, 2]) < 0.0).all()


def test_axes_of_a_tilted_plane_may_be_none_of_the_machine():
    """A head that swivels leaves the table where it is: a way along the plane's X takes X and Z along then."""
    lines = ["L X+0 Y+0 Z+9 FMAX", "L Z-1 F300", "L X+9", "L X+0", "END PGM A MM"]
    upright = [
        "CYCL DEF 19.1 A+0 B+0",
        "PLANE SPATIAL SPA0 SPB0.0 SPC-0 MOVE DIST50 F200 TABLE ROT",
        "PLANE RESET STAY",
    ]
    tilted = ["CYCL DEF 19.1 A-90", "PLANE SPATIAL SPA0 SPB+0.5 SPC0 STAY", "PLANE AXIAL B0 STAY", "M128"]
    for plane in upright + tilted:
        text = "\n".join(["BEGIN PGM A MM", plane, *lines])
        assert (played_places("heidenhain", text.encode()) is not None) == (plane in upright), plane


def test_what_the_tests_cannot_read_is_not_played():
    text = b"G21 G90 F600\nG0 X0 Y0\nG1 Z<?=z?> F50\nG1 X9\nM2\n"
    found = compare(Judged("compensated"), "grbl", text, text)
    assert found.outcome == "compensated"
    assert found.rms is None


@needs_rs274
def test_a_program_of_linuxcnc_that_names_no_end_is_run_to_its_end():
    """P of an arc is how often its axes pass the end: twice from X1 to Y1 are five quarters of a turn."""
    places, cuts = played_places("linuxcnc", b"G21 G90 F60\nG0 X0 Y0\nG1 X1\nG3 X0 Y1 I-1 P2\n")
    ways = np.linalg.norm(np.diff(places[cuts], axis=0), axis=1)
    assert ways.sum() == pytest.approx(1.0 + 2.5 * np.pi, abs=0.1)
