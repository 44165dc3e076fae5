"""Programs for a dial and a test cut: they stay in their room, touch gently, and say at each stop what to do."""

from __future__ import annotations

import re

import numpy as np
import pytest
from msgspec.structs import replace
from support.canon import needs_rs274, run_rs274
from support.hand_machine import HandMachine, course

import ph_post as ph
from ph_post.dialects.reading import read_as
from ph_post.dialects.registry import dialect_names
from ph_post.testprograms.gauges import GENTLE, gauge_kit
from ph_post.testprograms.sheet import readings_template, sheet
from ph_post.types.diagnosis import Experiment

MM = 1e-3
STEPPER = ph.read_machine("stepper")
CENTRE, TRAVEL = (150.0 * MM, 80.0 * MM, -40.0 * MM), (120.0 * MM, 140.0 * MM, 30.0 * MM)
KIT = gauge_kit(STEPPER, axes=("X", "Y", "Z"), centre=CENTRE, travel=TRAVEL, tool=6.0 * MM)


def named(name: str) -> Experiment:
    return next(one for one in KIT.programs if one.name == name)


@pytest.mark.parametrize("axis", "XYZ")
def test_a_dial_program_moves_one_axis_inside_its_room(axis: str) -> None:
    column = "XYZ".index(axis)
    run = course(named(f"dial_{axis.lower()}").program)
    places = run.places[1:]
    low, high = (CENTRE[column] / MM + side * TRAVEL[column] / MM / 2.0 for side in (-1.0, 1.0))
    assert places[:, column].min() == pytest.approx(low)
    assert places[:, column].max() == pytest.approx(high)
    others = [k for k in range(3) if k != column]
    assert not places[:, others].any()
    assert places[0, column] == places[-1, column] == pytest.approx(CENTRE[column] / MM)


def test_while_the_indicator_touches_the_table_moves_by_the_swing_and_gently() -> None:
    text = named("dial_x").program
    run = course(text)
    touching = False
    for (place, words), (after, _) in zip(run.stops, run.stops[1:], strict=False):
        touching = (touching or "set the indicator" in words) and "take the indicator away" not in words
        if touching:
            way = run.places[place : after + 1, 0]
            assert np.ptp(way) <= 1.0 + 1e-9
    assert run.stops[0][1].startswith("take the indicator away")
    assert run.stops[-1][1] == "take the indicator away"
    feeds = {float(found) for found in re.findall(r"F([\d.]+)", re.sub(r"\([^)]*\)", "", text))}
    assert {60.0, 600.0} <= feeds
    assert GENTLE * 60.0 / MM >= 600.0


def test_every_place_is_read_from_both_sides_and_beyond() -> None:
    run = course(named("dial_y").program)
    read = [(run.places[place, 1], words) for place, words in run.stops if "reading" in words]
    assert len(read) == 6 * 5
    for row in range(6):
        at = [place for place, _ in read[5 * row : 5 * row + 5]]
        assert at == pytest.approx([at[0], at[0] + 0.5, at[0], at[0], at[0]])
    # A table with play shows that the axis really comes from the side that the words say.
    table = HandMachine(play={"Y": 0.1}).table(run.places)[:, 1]
    for place, words in run.stops:
        if "from minus" in words or "beyond" in words:
            assert table[place] - run.places[place, 1] == pytest.approx(-0.05)
        elif "from plus" in words:
            assert table[place] - run.places[place, 1] == pytest.approx(0.05)


def test_the_test_cut_stays_in_its_room_and_above_its_depth() -> None:
    run = course(named("test_cut").program)
    places = run.places[1:]
    for column in range(2):
        reach = np.abs(places[1:, column] - CENTRE[column] / MM)
        assert reach.max() <= TRAVEL[column] / MM / 2.0 + 1e-9
    assert places[:, 2].min() == -2.0
    assert places[:, 2].max() == 5.0
    assert not places[0, :2].any()  # up before it moves aside
    moved = np.abs(np.diff(places[:, :2], axis=0)).max(axis=1) > 0.0
    sinking = np.diff(places[:, 2]) < 0.0
    assert not (moved & sinking).any()


def test_between_two_shapes_the_cutter_is_above_the_work_and_leaves_each_shape() -> None:
    assert KIT.cut is not None
    places = course(named("test_cut").program).places[1:] * MM
    low = places[places[:, 2] < 0.0]
    for x, y in KIT.cut.centres.values():
        away = np.abs(low[:, :2] - [x, y]).max(axis=1)
        round_it = np.hypot(*(low[:, :2] - [x, y]).T)
        assert away.min() >= 0.5 * (KIT.cut.size + KIT.cut.tool) * np.sqrt(0.5) - 1e-6
        assert round_it.min() >= 0.5 * (KIT.cut.size + KIT.cut.tool) - 1e-6


@pytest.mark.parametrize("name", dialect_names())
def test_every_dialect_has_the_programs_and_its_reader_takes_them(name: str) -> None:
    machine = replace(STEPPER, dialect=name)
    kit = gauge_kit(machine, tool=6.0 * MM)
    for one in kit.programs:
        program = read_as(name, one.program.encode(), one.name)
        assert len(program.motions.block) > 20
        stops = len(re.findall(r"\bM0\b", one.program))
        assert stops == (0 if name == "klipper" else 37 - 36 * (one.name == "test_cut"))
    text = sheet(machine, "stepper", "kit", kit)
    assert ("waits 20 s" in text) == (name == "klipper")


@needs_rs274
@pytest.mark.parametrize("one", KIT.programs, ids=lambda one: one.name)
def test_linuxcnc_reads_them(one: Experiment) -> None:
    machine = replace(STEPPER, dialect="linuxcnc")
    kit = gauge_kit(machine, axes=("X", "Y", "Z"), centre=CENTRE, travel=TRAVEL, tool=6.0 * MM)
    text = next(other.program for other in kit.programs if other.name == one.name)
    canon = run_rs274(text)
    assert canon.refusal == ""
    assert sum(name == "PROGRAM_STOP" for _, name, _ in canon.calls) == len(course(text).stops)


def test_an_axis_with_a_scale_gets_words_and_no_program() -> None:
    mixed = replace(STEPPER, axes={**STEPPER.axes, "X": ph.read_machine("mill").axes["X"]})
    kit = gauge_kit(mixed)
    assert [one.name for one in kit.programs] == ["dial_y"]
    assert "- X: the scale on the table hides the backlash" in sheet(mixed, "mixed.toml", "kit", kit)
    assert 'axis = "X"' not in readings_template(kit)


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"swing": 3.0 * MM}, "--swing: the swing is out of range; expected 0.05 to 2 mm; got 3 mm"),
        ({"repeats": 0}, "--repeats: out of range; expected 1 to 20; got 0"),
        (
            {"feeds": (0.1, 0.01)},
            "--feeds: no feeds for a dial indicator; expected one or two from 1 to 1200 mm/min: the indicator is"
            " touched gently; got 600, 6000",
        ),
        (
            {"travel": (2.5 * MM,)},
            "--travel: the travel of X is too small for three places; expected at least 3 mm, or a smaller --swing;"
            " got 2.5 mm",
        ),
        (
            {"tool": 6.0 * MM, "size": 50.0 * MM},
            "--size: the test cut leaves the travel; expected up to 34 mm; got 50 mm",
        ),
        (
            {"tool": 6.0 * MM, "travel": (40.0 * MM,)},
            "--travel: the travel of X and Y is too small for the test cut; expected at least 52 mm; got 40 mm",
        ),
        ({"tool": 60.0 * MM}, "--tool: the cutter's diameter is out of range; expected 1 to 25 mm; got 60 mm"),
        ({"tool": 6.0 * MM, "axes": ("X",)}, "--axes: the test cut needs X and Y; expected X,Y; got X"),
        ({"size": 30.0 * MM}, "--size and --depth are those of the test cut, which needs --tool"),
    ],
)
def test_what_cannot_be_had_is_refused(how: dict, words: str) -> None:
    with pytest.raises(ph.InputError) as refusal:
        gauge_kit(STEPPER, **how)
    assert str(refusal.value) == words
