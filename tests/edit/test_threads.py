"""Threads (G33): the table of a play operator, and the synchronised calls of LinuxCNC's own interpreter."""

from __future__ import annotations

import re
from functools import cache

import numpy as np
import pytest
from support.canon import needs_rs274
from support.corpus import stepper
from support.corpus_judge import GAP
from support.interpreted import interpret

from ph_post.api.compensation import compensated, undo
from ph_post.api.options import CompensateOptions
from ph_post.dialects.reading import read_as
from ph_post.files.storage import SourceBytes
from ph_post.progress import no_progress
from ph_post.units import MM
from ph_post.verify.verify import verify

HEAD = "G21 G18 G90 G64 P0.005\nS400 M3\nF200\nG0 X20 Z5\nX14\nG1 Z-10\nG0 X20\nZ5\n"
STRAIGHT = HEAD + "".join(f"X{x}\nG33 Z-20 K1.25\nG0 X20\nZ5\n" for x in (9.9, 9.8, 9.7)) + "M2\n"
INTERNAL = (
    "G21 G18 G90 G64 P0.005\nS400 M3\nF200\nG0 X4 Z5\nX8\nG1 Z-10\nG0 X4\nZ5\n"
    + "".join(f"X{x}\nG33 Z-20 K1.25\nG0 X4\nZ5\n" for x in (9.1, 9.2, 9.3))
    + "M2\n"
)
STEEP = HEAD + "".join(f"X{x}\nG33 Z-20 K1.25\nX{x + 1:g} Z-20.3 K4\nG0 X20\nZ5\n" for x in (9.9, 9.8, 9.7)) + "M2\n"
"""It leaves the work nearly across, in the thread itself: what X is late lies along the way."""

OUT = HEAD + "".join(f"X{x}\nG33 Z-20 K1.25\nX10.8 Z-20.3 K4\nG0 Z5\n" for x in (9.9, 9.8, 9.7)) + "G0 X20\nM2\n"
"""It comes out of the work in the thread itself, and goes back from there."""

PIPE = HEAD + "".join(f"X{x}\nG33 X{x + 0.625} Z-15 K1.25\nG0 X20\nZ5\n" for x in (9.9, 9.8, 9.7)) + "M2\n"
SLANTED = HEAD + "".join(f"X{x}\nG33 Z-20 K1.25\nX{x + 1:g} Z-21 K1.5\nG0 X20\nZ5\n" for x in (9.9, 9.8, 9.7)) + "M2\n"
BACK = HEAD + "X9.9\nG33 Z-20 K1.25\nG0 X20\nX9.8\nG33 Z5 K1.25\nG0 X20\nM2\n"
"""Two passes in opposite ways."""

PASSES = {"straight": STRAIGHT, "internal": INTERNAL, "steep": STEEP, "out": OUT, "pipe": PIPE, "back": BACK}


@cache
def changed(text, dialect="linuxcnc"):
    source = SourceBytes(name="a.ngc", stem="a", data=text.encode())
    return compensated(source, stepper(dialect), CompensateOptions(), "program", no_progress)


def moves(text):
    """The moves of a metric program in absolute places: mode, and the ends (X, Z) [mm]."""
    at, mode, found = [np.nan, np.nan], 0, []
    for line in text.splitlines():
        bare = re.sub(r"\([^)]*\)", "", line).upper()
        words = re.findall(r"([A-Z])\s*([-+]?\d*\.?\d+)", bare)
        codes = [float(number) for letter, number in words if letter == "G"]
        if 4.0 in codes:
            continue
        mode = next((int(code) for code in codes if code in (0.0, 1.0, 33.0)), mode)
        place = {letter: float(number) for letter, number in words if letter in "XZ"}
        if place:
            end = [place.get("X", at[0]), place.get("Z", at[1])]
            found.append((mode, at, end))
            at = end
    return found


def tables(text, sides):
    """Ends of the table in each thread move, X and Z from begin to end [mm], where the axes begin on some sides."""
    half, behind, found = 0.5 * GAP, None, []
    for mode, start, end in moves(text):
        if behind is None or np.isnan(behind).any():
            behind = [one - side * half for one, side in zip(end, sides, strict=True)]
            continue
        # An axis goes one way along a line: it stands until a side of the backlash comes to it.
        ahead = np.array(start) + np.linspace(0.0, 1.0, 401)[:, None] * np.subtract(end, start)
        way = np.clip(behind, ahead - half, ahead + half)
        behind = way[-1]
        if mode == 33:
            found.append(way - [0.0, half])
    return found


def runs(text):
    """Threads of a program: lists of consecutive thread moves, as their ends."""
    found, inside = [], False
    for mode, start, end in moves(text):
        if mode == 33:
            if not inside:
                found.append([start])
            found[-1].append(end)
        inside = mode == 33
    return [np.array(one) for one in found]


def calls(text):
    """Synchronised calls of LinuxCNC's interpreter: leads and ends, and how often it begins anew."""
    found, begun, synchronised = [], [], False
    for call in interpret(text).calls:
        if call.startswith("START_SPEED_FEED_SYNC("):
            synchronised = True
            begun.append(re.findall(r"-?\d+\.\d+", call)[0])
        elif call.startswith("STOP_SPEED_FEED_SYNCH"):
            synchronised = False
        elif synchronised and call.startswith("STRAIGHT_FEED"):
            found.append([float(one) for one in re.findall(r"-?\d+\.\d+", call)[:3]])
    return begun, np.array(found)


@pytest.mark.parametrize("name", PASSES)
def test_each_pass_is_shifted_as_a_whole(name):
    """And Z alike in all that go one way: the turn of the spindle at a place would be another else."""
    text = PASSES[name]
    made = changed(text).program().decode()
    assert "note threads keep their turn of the spindle" in made
    old, new = runs(text), runs(made)
    assert [len(one) for one in old] == [len(one) for one in new]
    ways = {}
    for one, other in zip(old, new, strict=True):
        shift = other - one
        assert np.ptp(shift, axis=0).max() < 1e-9
        ways.setdefault(np.sign(one[-1, 1] - one[0, 1]), []).append(shift[0, 1])
    assert all(np.ptp(shifts) < 1e-9 for shifts in ways.values())
    assert undo(SourceBytes(name="a.ngc", stem="a", data=made.encode())) == text.encode()
    programs = (read_as("linuxcnc", data, "a.ngc") for data in (text.encode(), made.encode()))
    assert verify(*programs, tolerance=0.005 * MM, machine=stepper("linuxcnc")).ok


@pytest.mark.parametrize("name", PASSES)
def test_the_table_cuts_the_long_move_where_the_program_has_it(name):
    text = PASSES[name]
    made = changed(text).program().decode()
    nominal = [(start, end) for mode, start, end in moves(text) if mode == 33]
    length = [np.hypot(*(np.subtract(end, start))) for start, end in nominal]
    longest = [size > 0.5 * max(length) for size in length]
    for sides in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        for program, most in ((text, None), (made, 1e-6)):
            worst = 0.0
            for (start, end), way, long in zip(nominal, tables(program, sides), longest, strict=True):
                if long:
                    ideal = np.linspace(start, end, len(way))
                    # Z takes up its own backlash on the first of its way, in the air.
                    worst = max(worst, np.abs(way - ideal)[int(0.02 * len(way)) :].max())
            if most is None:
                assert worst > 0.4 * GAP
            else:
                assert worst < most


@needs_rs274
@pytest.mark.parametrize("name", PASSES)
def test_linuxcnc_synchronises_the_same_moves(name):
    """With the same leads, begun as often, and with ends that differ by one shift a pass."""
    text = PASSES[name].encode()
    made = changed(PASSES[name]).program()
    (leads, old), (other_leads, new) = calls(text), calls(made)
    assert leads == other_leads
    assert len(old) == len(new) == sum(len(one) - 1 for one in runs(PASSES[name]))
    each = len(old) // len(runs(PASSES[name]))
    for first in range(0, len(old), each):
        assert np.ptp((new - old)[first : first + each], axis=0).max() < 2e-4


def test_x_comes_out_before_the_tool_goes_back():
    """In the thread itself it came out late by its backlash: it goes the rest before the rapid along the work."""
    made = changed(OUT)
    lines = [line for line in made.program().decode().splitlines() if not line.startswith("(")]
    back = [k for k, line in enumerate(lines) if re.match(r"G0 Z5", line)]
    assert len(back) == 3
    assert any("X turns in the thread in lines" in word for word in made.warnings)
    for place in back:
        behind = next(k for k in range(place - 1, -1, -1) if lines[k].startswith("X10."))
        shifted = [float(found) for line in lines[behind:place] for found in re.findall(r"X([\d.]+)", line)]
        assert max(shifted) == pytest.approx(10.8 + 0.5 * GAP)


def test_a_slanted_way_out_is_left_and_named():
    """X would be late on it by its whole backlash in place of half: the largest error would grow."""
    made = changed(SLANTED)
    assert "G33" in made.program().decode()
    assert [one.tolist() for one in runs(made.program().decode())] == [one.tolist() for one in runs(SLANTED)]
    assert any("thread, left as it is: X turns in it" in word for word in made.warnings)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (r"G33 Z-20 K1.25", "G33 Z-20.03 K1.25"),
        (r"G33 Z-20 K1.25", "G33 Z-20 K1.5"),
        (r"(X9.8\d*\n)G33 Z-20 K1.25", r"\1G1 Z4.97\nG33 Z-20 K1.25"),
        (r"X10.8\d* Z-20.3 K4", "X10.7 Z-20.3 K4"),
    ],
)
def test_the_check_sees_a_damaged_thread(old, new):
    made = changed(STEEP).program().decode()
    damaged = re.sub(old, new, made, count=1)
    assert damaged != made
    programs = (read_as("linuxcnc", data, "a.ngc") for data in (STEEP.encode(), damaged.encode()))
    assert not verify(*programs, tolerance=0.005 * MM, machine=stepper("linuxcnc")).ok


def test_other_controllers_pass_threads_through():
    text = STRAIGHT.replace(" G64 P0.005", "")
    made = changed(text, "grbl")
    assert any("motion tied to the spindle: G33: passed through" in word for word in made.warnings)
    assert made.program().decode().count("G33 Z-20 K1.25") == 3


def test_half_a_thread_is_none():
    """A line under G33 that is not understood may be tied to the one before it: none of them is changed."""
    text = STEEP.replace("Z-20.3 K4", "Z-20.3 A5 K4", 1)
    made = changed(text)
    assert any("motion tied to the spindle" in word for word in made.warnings)
    assert [one.tolist() for one in runs(made.program().decode())] == [one.tolist() for one in runs(text)]
