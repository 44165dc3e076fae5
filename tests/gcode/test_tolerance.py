"""Lines that are passed through: named, kept to the byte, and nothing that they may have changed is relied on."""

import random
import re

import numpy as np
import pytest
from support.amount import examples
from support.canon import needs_rs274, number_lines, run_rs274

from ph_post.dialects.reading import read_as
from ph_post.errors import InputError
from ph_post.gcode.read import read_program

HEAD = "G21 G90 G17 G94 F600\nG0 X0 Y0 Z0\nG1 X1\n"
ROUNDING = 0.6e-7


def read(body, **options):
    return read_program((HEAD + body).encode(), "a.ngc", **options)


def places(program, which="start"):
    """Where the last motion begins, or ends [mm]."""
    return getattr(program.motions, which)[-1] * 1e3


@pytest.mark.parametrize(
    ("line", "what"),
    [
        ("# a comment", "text: # a comment"),
        ("#G1 X20", "text: #G1 X20"),
        ("  #=====", "text: #====="),
        ("# 1. face the part", "text: # 1. face the part"),
        ("# abs value", "text: # abs value"),
        ("N5 # five", "text: # five"),
        (")", "closing parenthesis of no comment: )"),
        ("(a (b) c F5)", "closing parenthesis of no comment: c F5)"),
        ("& ;", "unknown character: & ;"),
        ("second part", "letter without a number: second part"),
        ("that was it!", "letter without a number: that was it!"),
    ],
)
def test_what_no_controller_can_obey_is_named_and_seen_through(line, what):
    program = read(f"{line}\nG1 X2\nM2\n")
    assert [(note.first, note.what) for note in program.notes] == [(3, what)]
    assert program.motions.chain.tolist() == [0, 0, 0]
    np.testing.assert_array_equal(places(program), [1, 0, 0])
    with pytest.raises(InputError, match=r"^a\.ngc:4:"):
        read(f"{line}\nG1 X2\nM2\n", strict=True)


@pytest.mark.parametrize(
    ("line", "what"),
    [
        ("G28 X Y", "letter without a number: X Y"),
        ("G1 X5 # there", "text: # there"),
        ("G1 X5 )", "closing parenthesis of no comment: )"),
        ("G1 X5 (a (b) c)", "letter without a number: c)"),
        ("(open", "comment that does not end: (open"),
        ("G1 X[1+2", "expression that is not whole: X[1+2"),
        ("G1 X1e-3", "exponent: e-3"),
        ("G1 X1.2.3", "number without a letter: .3"),
        ("G1 X1*", "checksum that is none: *"),
        ("G1 X1 X2", "the same letter twice on a line: X2"),
        ("G0 G1 X1", "two words of one modal group on a line: G1"),
        ("G1 X1 F-5", "negative feed: F-5"),
        ("G2 X5", "arc without centre or radius: G2"),
        ("G2 X5 Y1 I2", "radii of the arc differ: G2"),
        ("G2 X5 R1", "radius too small to reach the arc's end: G2"),
        ("G4", "dwell without a time: G4"),
        ("HOME_ALL", "letter without a number: HOME_ALL"),
        ("X Y", "letter without a number: X Y"),
        ("part 2", "letter without a number: part 2"),
    ],
)
def test_what_may_be_obeyed_is_named_and_its_place_forgotten(line, what):
    program = read(f"{line}\nG21 G90 G1 F600 X2\nM2\n")
    assert [(note.first, note.what) for note in program.notes] == [(3, what)]
    assert [(one.kind, one.block) for one in program.breaks[1:-1]] == [("not understood", 3)]
    assert np.isnan(places(program)).all()
    np.testing.assert_array_equal(places(program, "end"), [2, np.nan, np.nan])
    with pytest.raises(InputError, match=r"^a\.ngc:4:"):
        read(f"{line}\nG21 G90 G1 F600 X2\nM2\n", strict=True)


def test_parameters_are_no_text():
    whats = [note.what for note in read("#1=5\n#<a>=5\n#[1]=2\n##2=3\n#abs[-1]=5\n").notes]
    assert whats == ["parameter: #1=5"]


def test_a_byte_order_mark_is_named_and_hides_nothing():
    program = read_program(b"\xef\xbb\xbfG20 G1 X1 F1\nX2\n", "a")
    assert [(note.first, note.what) for note in program.notes] == [(0, "byte order mark: ?G20 G1 X1 F1")]
    assert program.motions.end[:, 0].tolist() == pytest.approx([0.0254, 0.0508])


def test_text_behind_a_percent_sign_and_another_program_are_named():
    program = read_program(b"% O7\nG0 X0 F100\nG1 X1\nM30\n%\nO2\nG0 X5\nM30\n%\n", "a")
    assert [(one.first, one.last, one.what) for one in program.notes] == [
        (0, 0, "text behind a percent sign: O7"),
        (5, 8, "behind the program's end: O2"),
    ]
    assert program.motions.block.tolist() == [1, 2]


@pytest.mark.parametrize("text", ["% led on", "%(led on)", "%%"])
def test_a_percent_sign_with_text_behind_it_ends_no_program(text):
    """LinuxCNC refuses such a line, and senders for Grbl take it for themselves; where axes are then nobody knows."""
    program = read_program(f"%\nG21 G90 G0 X1\n{text}\nG1 X2 F100\nG0 X3\n %\t\nG0 X4\n".encode(), "a")
    assert program.motions.block.tolist() == [1, 3, 4]
    assert np.isnan(program.motions.start[1]).all()
    assert program.motions.chain.tolist() == [0, 1, 1]
    assert [(one.first, one.what[:19]) for one in program.notes] == [
        (2, "text behind a perce"),
        (6, "behind the program'"),
    ]


@pytest.mark.parametrize(
    ("body", "lines"), [("G1 X5\nX6\nG0 X0\nG1 X2\nF100\nX3\n", [1]), ("G1 X1 F0\nX2 F5\nX3 F0\n", [1, 3])]
)
def test_a_lack_of_feed_is_said_where_it_begins_and_the_feed_not_known(body, lines):
    program = read_program(f"G21 G90 G0 X0\n{body}M2\n".encode(), "a")
    assert [note.first for note in program.notes] == lines
    assert program.motions.chain.max() == 0
    fed = re.findall(r"F[1-9]", body)
    assert np.isfinite(program.motions.feed[program.motions.kind == 1]).sum() == len(fed)


def test_a_cut_under_g93_without_its_f_has_no_time():
    motions = read("G93 G1 X5 F2\nX6\nX7 F2\n").motions
    assert motions.duration[-3:].tolist() == [30.0, 0.0, 30.0]
    assert np.isnan(motions.feed[-3:]).all()


def test_a_program_that_breaks_off_is_named():
    assert [note.what for note in read_program(b"%\nG0 X1\n", "a").notes] == [
        "the program breaks off: the end of the file"
    ]


VALID = (
    *("G1 X5", "G91", "G20", "G0 Y3 Z1", "G2 X2 I0.5", "G92 X3", "G92 Y1 Z1", "G28 X0", "G30 Z1", "F300", "G18"),
    *("T1 M6", "G54", "G55", "G10 L2 P1 X3", "G10 L20 P1 Y3", "G10 L20 P0 X7", "G10 L1 P1 Z3", "G43 H3", "G49"),
    *("G43.1 X1", "G52 Y5", "G53 G0 Z5", "G90.1", "G1 X3 A5", "G0 A90", "S500 M3", "G92.1", "G91 G1 X1", "G91 G28 Z0"),
)
BROKEN = ("{} &", "{} )", "{} (open", "{} , 5", "{} Q", "& {}", "{} # so", "{} X1 X2")
FOLLOWS = (
    *("G1 X2", "G1 Y4", "G0 X1 Y1 Z1", "G1 Z2", "X3 Y3", "G91 G1 X1 Y1", "G90 G1 X2", "G1 X1 A3", "G28 Y1", "G43 H2"),
    *("G2 X4 Y3 I1", "G2 I1", "G91 G2 X2 I1", "G10 L2 P1 Y1", "G10 L20 P1 X1", "G0 A1", "G52 X1", "G92 Z1"),
)


def ends_of(canon):
    """Ends [m] of the last call of each line, with NaN where it is none of X, Y and Z."""
    found = {}
    for move in canon.moves:
        numbers = np.array(move.numbers)
        if move.kind == 2:
            order = {17: (0, 1, 5), 18: (1, 5, 0), 19: (5, 0, 1)}[move.plane]
            end = numbers[list(order)]
        else:
            end = numbers[:3]
        found[move.line] = end * move.units
    return found


def assert_true(program, canon, but):
    """What the reader knows of places is what LinuxCNC makes of them.

    Where an axis moves by increments alone in a chain, it may be away by the same everywhere.
    """
    ends, away = ends_of(canon), {}
    for row, block in enumerate(program.motions.block.tolist()):
        text = program.text(block).decode()
        if block == but:
            continue
        for axis, letter in enumerate("XYZ"):
            end = program.motions.end[row, axis]
            if np.isnan(end):
                continue
            off = end - ends[block][axis]
            if letter in text and program.modal_after(block).absolute:
                assert abs(off) < 26 * ROUNDING, (block, text)
            key = (int(program.motions.chain[row]), axis)
            assert abs(away.setdefault(key, off) - off) < 60 * ROUNDING, (block, text)


@needs_rs274
@pytest.mark.parametrize("seed", range(examples(40)))
def test_what_is_known_behind_a_line_is_true_whether_it_was_obeyed_or_not(seed):
    rng = random.Random(seed)
    line, form = rng.choice(VALID), rng.choice(BROKEN)
    begin = [*HEAD.splitlines(), *rng.sample(FOLLOWS, 3)]
    behind = [*rng.choices(FOLLOWS, k=8), "M2"]
    lines = [*begin, form.format(line), *behind]
    program = read_program("\n".join(lines).encode(), "a.ngc")
    assert program.data == "\n".join(lines).encode()
    assert len(begin) in {note.first for note in program.notes}
    for middle in (line, ""):
        canon = run_rs274(number_lines("\n".join([*begin, middle, *behind])))
        if not canon.refusal:
            assert_true(program, canon, len(begin))


@needs_rs274
@pytest.mark.parametrize("seed", range(examples(40)))
def test_places_are_those_of_linuxcnc_behind_everything_that_moves_or_names_them(seed):
    rng = random.Random(1000 + seed)
    lines = [*HEAD.splitlines(), *rng.choices((*VALID, *FOLLOWS), k=16), "M2"]
    canon = run_rs274(number_lines("\n".join(lines)))
    program = read_program("\n".join(lines).encode(), "a.ngc")
    if not canon.refusal:
        assert_true(program, canon, -1)
        assert program.motions.block.size > 2


def test_whatever_bytes_a_line_has_it_is_read_and_kept():
    rng = random.Random(7)
    whole = (
        HEAD + "G2 X2 Y0 I0.5 (arc)\n#1=[2+3]\no1 call\nG91 G1 X1 ; so\nG28 X0\nG5 X1 Y1 I1 J1 P1 Q1\nM2\n"
    ).encode()
    for _ in range(400):
        data = bytearray(whole)
        for _ in range(rng.randrange(1, 6)):
            data[rng.randrange(len(data))] = rng.choice(b"GXYZMNIJRFO0123456789.-+ ()[]#;%/*=<>$@,&\n\xef")
        program = read_program(bytes(data), "a.ngc")
        assert program.data == bytes(data)
        assert set(np.flatnonzero(np.isinf(program.motions.end).any(axis=1))) == set()
        try:
            assert read_program(bytes(data), "a.ngc", strict=True).notes == ()
        except InputError:
            assert any(note.what.partition(":")[0] != "behind the program's end" for note in program.notes)


def test_a_word_at_which_a_sender_waits_ends_no_program():
    """bCNC takes `%wait` for itself; the controller gets what stands behind it, from the same place."""
    program = read_program(b"G21 G90\nG1 X10 Y0 F100\n%wait\nM0\n  %WAIT (rest)\nG3 X0 Y10 I-10 J0\nM2\n", "a.nc")
    assert [(note.first, note.what) for note in program.notes] == [
        (2, "word of a sender, which waits there: %wait"),
        (4, "word of a sender, which waits there: %WAIT (rest)"),
    ]
    assert program.motions.block.tolist() == [1, 5]
    assert program.motions.chain.tolist() == [0, 0]
    assert program.breaks[-1].block == 6
    other = read_program(b"G1 X1 F100\n%waiting\nG1 X2\n", "a.nc").motions
    assert np.isnan(other.start[:, 0]).tolist() == [True, True]


@pytest.mark.parametrize(
    ("dialect", "known"), [("linuxcnc", True), ("fanuc", True), ("grbl", False), ("marlin", False)]
)
def test_a_skip_loses_the_axes_that_it_names(dialect, known):
    """Plasma tables find the sheet by G31 (Mach3); Marlin's G31 puts a probe away, and Grbl has none."""
    text = b"G21 G90\nG0 X5. Y6. Z7.\nG31 Z-10. F100.\nG1 Y8. F200.\nG92 Z0.\nG0 Z5.\nM2\n"
    program = read_as(dialect, text, "a.nc")
    behind = program.motions.start[program.motions.block == 3][0]
    assert np.isnan(behind).tolist() == ([False, False, True] if known else [True, True, True])
    assert ("probe" in [one.kind for one in program.breaks]) == known
    assert any("G31" in note.what for note in program.notes) == (not known)
    assert program.motions.end[program.motions.block == 5][0, 2] == pytest.approx(0.005)


def test_a_few_zero_bytes_spoil_their_lines_alone():
    """As a sender leaves them that lost a line; LinuxCNC ends the line there, Grbl reads on."""
    rows = "".join(f"G1 X{n % 2 * 10} Y{n}\n" for n in range(100))
    body = f"{rows}\0\0G1 X5 Y5\n{rows}M2\n"
    program = read(body)
    assert [(note.first, note.what) for note in program.notes] == [(103, "unknown character: ??G1 X5 Y5")]
    behind = int(np.searchsorted(program.motions.block, 103))
    assert np.isnan(program.motions.start[behind, :2]).all()
    np.testing.assert_array_equal(places(program, "end"), [10, 99, np.nan])
    for text, strict in ((body, True), ("\0G1 X5\n", False), (body.replace("Y", "\0"), False)):
        with pytest.raises(InputError, match="not a part program; expected text; got a zero byte"):
            read(text, strict=strict)
    with pytest.raises(InputError, match="expected text as UTF-8 or ASCII; got UTF-16"):
        read_program((HEAD + rows).encode("utf-16"), "a.ngc")


def test_what_a_note_shows_steers_no_terminal():
    program = read("G1 X5 ) \x1b[2J\nM2\n")
    assert [note.what for note in program.notes] == ["closing parenthesis of no comment: ) ?[2J"]


def spindle_lines(*lines):
    """Return what is not understood of lines between two moves, by LinuxCNC's reader and Grbl's."""
    text = HEAD + "".join(f"{line}\n" for line in lines) + "X5\nM2\n"
    return [[note.what for note in read_as(name, text.encode(), "a.ngc").notes] for name in ("linuxcnc", "grbl")]


@pytest.mark.parametrize("line", ["M3 $0 S1", "M5 $0", "m3$0s1.5", "N5 M5 $-1 (off)", "M5 $ 0 ;off", "S20 $-1"])
def test_the_first_spindle_and_all_of_them_are_what_is_meant_without_a_number(line):
    """A plasma's screen writes M3 $0 S1 for its torch, behind which no place is lost; Grbl refuses it."""
    linuxcnc, grbl = spindle_lines(line)
    assert not linuxcnc
    assert len(grbl) == 1
    program = read_as("linuxcnc", f"{HEAD}{line}\nG91 X4\nM2\n".encode(), "a.ngc")
    np.testing.assert_allclose(places(program, "end"), [5.0, 0.0, 0.0])


@needs_rs274
def test_linuxcnc_moves_on_behind_a_spindle_s_number():
    canon = run_rs274(f"{HEAD}M3 $0 S1\nX4 Y1\nM5 $-1\nX7\nM2\n")
    assert not canon.refusal
    assert canon.moves[-1].numbers[:3] == [7.0, 1.0, 0.0]


@pytest.mark.parametrize("line", ["M3 $1 S1", "M3 $0 X9", "M5 $-2", "M5 $0.5", "M5 $0 $1", "M62 P0 $0", "M5 $#1"])
def test_other_spindles_and_words_beside_them_stay_named(line):
    linuxcnc, _ = spindle_lines(line)
    assert len(linuxcnc) == 1
