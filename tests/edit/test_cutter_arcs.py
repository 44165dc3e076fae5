"""Crossings on arcs of contours with cutter compensation, beside LinuxCNC's own path of the cutter for many radii."""

from __future__ import annotations

import random
import re

import numpy as np
import pytest
from support.canon import needs_rs274
from support.canon_player import canon_moves
from support.corpus import stepper
from support.corpus_judge import GAP, _sampled, table_of
from support.cutter_outlines import FANUC, round_outline
from support.ideal_play import distances
from support.reference_player import BEGINS

from ph_post.api.compensation import compensated, undo
from ph_post.api.options import CompensateOptions
from ph_post.dialects.reading import read_as
from ph_post.files.storage import SourceBytes
from ph_post.progress import no_progress
from ph_post.units import MM
from ph_post.verify.verify import verify

NOTE = re.compile(rb"cutter compensation holds for radii up to ([\d.]+) mm", re.IGNORECASE)


def changed(text):
    source = SourceBytes(name="a.ngc", stem="a", data=text.encode())
    return compensated(source, stepper("linuxcnc"), CompensateOptions(), "program", no_progress)


def errors(text, made, radius):
    """Largest error and mean square [mm] of the table while a cutter of a radius cuts, plain and compensated."""
    text, made = (re.sub(r"G(4[12]) D1 ", rf"G\1.1 D{2.0 * radius:.5f} ", one) for one in (text, made))
    runs = [[canon_moves(one, begin, "") for begin in BEGINS] for one in (text, made)]
    assert all(moves is not None for run in runs for moves in run), (text, made)
    path, cuts = _sampled(runs[0])
    found = []
    for moves in runs:
        motor, cutting = _sampled(moves)
        low = cutting & (motor[:, 2] < -1.0 + 1e-6)
        away = [distances(table_of(motor, side, "XY")[low], path[cuts]) for side in (-1.0, 1.0)]
        found.append((max(one.max() for one in away), max(float(np.sqrt((one**2).mean())) for one in away)))
    return found


@needs_rs274
@pytest.mark.parametrize("seed", [9, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (0, 1, 2, 11))])
def test_the_table_follows_cutters_of_every_radius_round_arcs(seed):
    """Up to the radius that the head names, which is that of the contour's smallest inner arc."""
    text, least = round_outline(random.Random(seed))
    made = changed(text).program()
    largest = float(NOTE.search(made)[1])
    assert largest == pytest.approx(least, abs=0.011)
    assert made.count(b" crossing ") >= 2
    for part in (0.0, 0.35, 0.99):
        plain, left = errors(text, made.decode(), part * largest)
        assert left[0] < 0.2 * GAP
        assert left[1] < 0.1 * plain[1]
    assert undo(SourceBytes(name="a.ngc", stem="a", data=made)) == text.encode()


@needs_rs274
@pytest.mark.parametrize("seed", [7, pytest.param(10, marks=pytest.mark.slow)])
def test_where_the_smallest_inner_arc_is_one_of_the_turns_all_is_left(seed):
    """A cutter that just fits would go round nothing there."""
    text, _ = round_outline(random.Random(seed))
    result = changed(text)
    assert any("left as it is: an axis turns in it" in one for one in result.warnings)
    assert text.partition("F200\n")[2].partition("G0 Z5")[0].encode() in result.program()


LED = """G21 G90 G17 G64 P0.01
G0 X0 Y-30 Z5
G1 Z-1 F200
G1 X10 Y-20 F600
X20 Y-30
X30 Y-20 Z-2
X0 Y-30 Z-1
G0 Z5
G0 X60 Y8
G1 Z-1 F200
G41 D1 G1 X-30 F400
G3 X-22 Y0 I8 J0
G1 X50
G3 X58 Y8 I0 J8
G40 G1 X30
G0 Z5
M2
"""
"""Line that is cut from arc to arc, with a corner before and behind them in which an axis turns for some radii."""


@needs_rs274
@pytest.mark.parametrize("radius", [3.5, *(pytest.param(radius, marks=pytest.mark.slow) for radius in (0.0, 2.0))])
def test_a_contour_between_arcs_is_followed_though_axes_turn_in_the_corners_before_and_behind_them(radius):
    result = changed(LED)
    assert any(one.startswith("cutter compensation holds for") for one in result.warnings)
    made = result.program().decode()
    inside = made.partition("G41 D1")[2].partition("G40")[0]
    assert "X30" not in inside
    away = []
    for text in (LED, made):
        own = re.sub(r"G41 D1 ", f"G41.1 D{2.0 * radius:.5f} ", re.sub(r"\([^)]*\)", "", text))
        motor, cuts = _sampled([canon_moves(own, begin, "") for begin in BEGINS])
        on = cuts & (np.abs(motor[:, 1] - radius) < GAP) & (motor[:, 0] > -21.9) & (motor[:, 0] < 50.0)
        assert on.sum() > 1000
        away.append(max(np.abs(table_of(motor, side, "XY")[on, 1] - radius).max() for side in (-1.0, 1.0)))
    assert away[1] < 0.1 * away[0]


HALF = FANUC.replace("X40.\nY0.", "G02 X40. Y30. R20.\nG01 Y0.")


def test_a_chord_with_no_room_for_the_cutter_is_a_failure():
    """The chord of an arc of 20 mm that is written, and the same crossing on a tenth of it."""
    source = SourceBytes(name="a.nc", stem="a", data=HALF.encode())
    made = compensated(source, stepper("fanuc"), CompensateOptions(), "program", no_progress).program().decode()
    chord = re.search(r"G02 X(19.[0-9]+) Y50.02.*\nG1 X(20.[0-9]+) Y49.97.*\nG2 X40.025 Y29.975 I(\S+)", made)
    assert float(chord[2]) - float(chord[1]) > 0.5
    steep = chord[0].replace(f"X{chord[1]}", "X19.975").replace(f"X{chord[2]}", "X20.025").replace(chord[3], "0.")
    damaged = made.replace(chord[0], steep)
    verdicts = [
        verify(
            read_as("fanuc", HALF.encode(), "a.nc"),
            read_as("fanuc", text.encode(), "a.nc"),
            tolerance=0.005 * MM,
            machine=stepper("fanuc"),
        )
        for text in (made, damaged)
    ]
    assert verdicts[0].ok
    assert any("room for the cutter" in failure.what for failure in verdicts[1].failures)
