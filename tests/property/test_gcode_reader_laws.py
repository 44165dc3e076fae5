"""Whatever bytes come, they are kept or refused in one line; what is understood is what LinuxCNC does."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from support.amount import examples
from support.canon import assert_agrees, needs_rs274, number_lines, run_rs274
from support.random_programs import decimal, programs, thousandths

from ph_post.errors import InputError
from ph_post.gcode.read import read_program

relaxed = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
WORDS = b"""
G1 G2 X Y1.5 I5 R F100 ( ) ; % / #1 [ ] = O100 sub endsub call <a> M2 M98 *71 @1 ^2 $H G91 G20 G5 G5.2 G5.3 P1
Q1 J2 - . 99999999999999999999 ,R1 ABS[ G92 G41 G40 G81 G80 A5 E3 G18 K0 G93 G28 T1 M6 G0 X0 Y0 Z0 G4 G53
"""
fragments = st.sampled_from([*WORDS.split(), *4 * [b"\n", b" "], b"\r\n", b"\r", b"\t", b"\0", b"\xff"])


def law(data):
    """Every byte is kept and every place lies in the program, or one line tells why not."""
    try:
        program = read_program(data, "a.ngc")
        line = "a.ngc:"
    except InputError as refusal:
        program, line = None, str(refusal)
    assert line.splitlines() == [line]
    assert line.startswith("a.ngc:")
    if program is None:
        return
    assert b"".join(program.text(block) for block in range(program.blocks)) == data
    words, motions = program.words, program.motions
    assert (np.diff(words.start) > 0).all()
    assert (words.end > words.start).all()
    assert (words.start >= program.lines[words.block]).all()
    assert (words.end <= program.lines[words.block + 1]).all()
    assert (np.diff(motions.block) > 0).all()
    assert program.state.max(initial=0) < len(program.modal)
    assert [one.block for one in program.breaks] == sorted(one.block for one in program.breaks)
    for chain in range(len(program.breaks) - 1):
        rows = np.flatnonzero(motions.chain == chain)
        low, high = program.breaks[chain].motion, program.breaks[chain + 1].motion
        assert rows.tolist() == list(range(low, high))


@given(st.binary(max_size=200))
@relaxed
def test_any_bytes_are_kept_or_refused(data):
    law(data)


@given(st.lists(fragments, max_size=40).map(b"".join))
@settings(relaxed, max_examples=examples(1000))
def test_any_words_are_kept_or_refused(data):
    law(data)


@given(programs(), st.data())
@relaxed
def test_a_program_with_a_piece_missing_or_doubled_is_kept_or_refused(text, data):
    raw = text.encode()
    place = data.draw(st.integers(0, len(raw)))
    length = data.draw(st.integers(0, 20))
    law(raw[:place] + raw[place : place + length] * data.draw(st.sampled_from([0, 2])) + raw[place + length :])


@needs_rs274
@given(programs())
@settings(relaxed, max_examples=examples(150))
def test_motions_are_those_of_linuxcnc(text):
    numbered = number_lines(text)
    canon = run_rs274(numbered)
    assert canon.refusal == ""
    program = read_program(numbered.encode(), "a.ngc", strict=True)
    assert_agrees(program, canon)
    assert program.motions.block.size > 0


@given(st.lists(st.tuples(st.sampled_from("XYZ"), thousandths, st.booleans()), min_size=1, max_size=40))
@relaxed
def test_positions_are_those_of_exact_arithmetic(moves):
    place = {"X": Fraction(0), "Y": Fraction(0), "Z": Fraction(0)}
    lines, expected = ["G21 G90 G0 X0 Y0 Z0"], []
    for axis, value, absolute in moves:
        lines.append(f"{'G90' if absolute else 'G91'} G0 {axis}{decimal(value)}")
        place[axis] = value if absolute else place[axis] + value
        expected.append([float(place[a] / 1000) for a in "XYZ"])
    program = read_program("\n".join(lines).encode(), "a.ngc")
    np.testing.assert_allclose(program.motions.end[1:], expected, rtol=0, atol=1e-15 * len(moves))
    exact = [Fraction(int(d), 10 ** int(p)) for d, p in zip(program.words.digits, program.words.decimals, strict=True)]
    axis_words = [e for e, letter in zip(exact, program.words.letter, strict=True) if chr(letter) in "XYZ"]
    assert axis_words[3:] == [value for _, value, _ in moves]


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
@given(programs())
@settings(relaxed, max_examples=examples(30))
def test_line_ends_change_nothing(end, text):
    assume("\n" in text)
    plain = read_program(text.encode(), "a.ngc")
    other = read_program(text.encode().replace(b"\n", end), "a.ngc")
    assert other.blocks == plain.blocks
    for name in ("block", "kind", "start", "end", "center", "angle", "feed", "chain"):
        np.testing.assert_array_equal(getattr(other.motions, name), getattr(plain.motions, name))
