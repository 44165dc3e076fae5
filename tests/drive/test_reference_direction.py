"""The side from which the zero of an axis was taken, and gravity that keeps a gap closed."""

import re
from fractions import Fraction

import pytest
from msgspec.structs import replace

from ph_post.drive.axes import has_backlash, lasting_offset, side_offsets
from ph_post.drive.machinefile import machine_of, read_machine
from ph_post.files.storage import shipped, source_of

GAP = Fraction(12, 100000)
"""Lost motion of the router's X [m], as its file says it."""


def table_behind(motor, direction):
    """Return where an ideal play leaves the table that a motor pushes in a direction."""
    return motor - direction * GAP / 2


def read_with(name, lines):
    """A shipped machine with lines more in its [axes.Z]."""
    text = shipped("machines", name).read_text(encoding="utf-8")
    return machine_of(source_of(re.sub(r"(?m)^(\[axes\.Z\].*)$", rf"\1\n{lines}", text), "test.toml", "test"))


def test_a_file_that_does_not_say_it_takes_the_middle_but_for_z():
    axes = read_machine("router").axes
    assert {name: axis.reference_direction for name, axis in axes.items()} == {"X": "both", "Y": "both", "Z": "-"}
    assert all(axis.gravity_side is None for axis in axes.values())


@pytest.mark.parametrize("said", ["+", "-", "both"])
def test_a_file_says_it(said):
    assert read_with("router", f'reference_direction = "{said}"').axes["Z"].reference_direction == said


@pytest.mark.parametrize(("said", "touched"), [("-", [-1]), ("+", [1]), ("both", [-1, 1])])
def test_the_offsets_are_what_brings_an_ideal_play_to_where_its_zero_was_taken(said, touched):
    """The zero is where the table stood while the motor read 0, the mean of both where both sides were touched."""
    axis = replace(read_machine("router").axes["X"], reference_direction=said)
    zero = sum(table_behind(Fraction(0), direction) for direction in touched) / len(touched)
    wanted = tuple(zero - table_behind(Fraction(0), direction) for direction in (-1, 1))
    assert side_offsets(axis) == pytest.approx(tuple(map(float, wanted)), abs=1e-18)
    assert (lasting_offset(axis, -1), lasting_offset(axis, 1)) == side_offsets(axis)
    assert lasting_offset(axis, 0) == 0.0


@pytest.mark.parametrize("said", ["+", "-", "both"])
def test_an_axis_with_a_scale_on_its_table_has_no_lasting_offset(said):
    axis = replace(read_machine("mill").axes["X"], reference_direction=said)
    assert side_offsets(axis) == (0.0, 0.0)
    assert axis.reference_side == 0


@pytest.mark.parametrize("side", ["+", "-"])
@pytest.mark.parametrize("name", ["router", "mill"])
def test_gravity_leaves_no_backlash(name, side):
    axis = read_with(name, f'gravity_side = "{side}"').axes["Z"]
    assert axis.gravity_side == side
    assert axis.gap.lost_motion == 0.0
    assert not has_backlash(axis)
    assert side_offsets(axis) == (0.0, 0.0)
    assert has_backlash(read_machine(name).axes["Z"])
