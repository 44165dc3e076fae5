"""Axes beside X, Y and Z with backlash of their own, judged by a reader and a table with play of the tests' own."""

import math
import random
import re

import msgspec
import pytest
from support.corpus import stepper

import ph_post as ph
from ph_post.api.compensated_program import ProgramRequest
from ph_post.api.further_axes import shifted_job
from ph_post.api.inputs import program_in
from ph_post.compensate.options import PlanOptions
from ph_post.dialects.reading import read_as
from ph_post.drive.machinefile import machine_of
from ph_post.edit.edits import EditOptions
from ph_post.errors import InputError
from ph_post.files.storage import SourceBytes, SourceText
from ph_post.gcode.read import read_program
from ph_post.verify.shifted import verify_shifted

XYZ = "".join(
    f'[axes.{name}]\nfeedback = "none"\nb = 0\nc = 0\nlost_motion_mm = {{{name.lower()}}}\nmax_velocity_mm_s = 80\n'
    "max_acceleration_mm_s2 = 800\nmax_jerk_mm_s3 = 20000\n"
    for name in "XYZ"
)
TURNING = (
    '[axes.{name}]\nfeedback = "{loop}"\nlost_motion_deg = {lost}\nreference_direction = "{side}"\n'
    "max_velocity_deg_s = 60\nmax_acceleration_deg_s2 = 600\n"
)
SLIDING = TURNING.replace("deg", "mm")


def machine(axes="A", dialect="linuxcnc", lost=0.05, side="both", loop="none", x=0.0):
    text = f'name = "four"\n[controller]\ndialect = "{dialect}"\nservo_period_ms = 1.0\n' + XYZ.format(x=x, y=x, z=0)
    for name in axes:
        part = TURNING if name in "ABC" else SLIDING
        text += part.format(name=name, lost=lost, side=side, loop=loop)
    return machine_of(SourceText(name="four.toml", stem="four", text=text, digest="5" * 64))


def places(text, play=None, side=0):
    """Places (X, Y, Z, A, B, U) of the table at the end of each line at feed; `play` by axis, `side` of its zero."""
    play = play or {}
    at, table, mode, absolute, found = dict.fromkeys("XYZABU", 0.0), {}, "0", True, []
    for line in text.decode().splitlines():
        words = re.findall(r"([A-Z])\s*([-+]?[\d.]+)", re.split(r"[(;%]", line)[0])
        if any(letter == "O" for letter, _ in words):
            continue
        for letter, number in words:
            if letter == "G" and float(number) in (0, 1, 2, 3):
                mode = number.lstrip("0") or "0"
            if letter == "G" and float(number) in (90, 91):
                absolute = float(number) == 90
        moves = [(letter, float(number)) for letter, number in words if letter in at]
        if any(letter in ("M", "G") and float(number) in (28, 92) for letter, number in words):
            continue
        begin = dict(table)
        for letter, number in moves:
            at[letter] = number if absolute else at[letter] + number
            half = 0.5 * play.get(letter, 0.0)
            # Where it was before its first move nobody knows: here as far on one side as it can be.
            was = table.get(letter, at[letter] + (half if letter not in begin else 0.0))
            table[letter] = min(max(was, at[letter] - half), at[letter] + half)
        if mode != "0" and moves:
            off = {letter: side * 0.5 * play.get(letter, 0.0) for letter in at}
            found.append(tuple(table.get(letter, 0.0) + off[letter] for letter in "XYZABU"))
    return found


def comes_past(ours, wanted, tolerance=2e-4):
    """Return whether places come in the order of those wanted, and which is the first that does not."""
    rest = iter(ours)
    for place in wanted:
        if not any(all(math.isclose(a, b, abs_tol=tolerance) for a, b in zip(one, place, strict=True)) for one in rest):
            return place
    return None


HEAD = "G21\nG90\nG0 X0 Y0 Z5\n"
INDEXED = (
    "G0 A0\nG1 Z-1 F300\nG1 X20\nG0 Z5\nG0 A90\nG1 Z-1\nG1 X0\nG0 Z5\nG0 A45\nG1 Z-1\nG1 X20\nG1 A30\nG1 A60\nG1 X0\n"
    "G0 Z5\nG0 A60 X5\nG1 Z-1\nG1 X7\nG0 Z5\nG0 A10 X0\nG1 Z-1\nG1 X9\nG0 Z5\nG0 A0\n"
)
CONTINUOUS = (
    "G0 A0\nG1 Z-1 F300\nG1 X20 A90 F600\nG1 X40 A180.5\nG1 X60 A90\nG1 X61 A90\nG1 X62 A60\n"
    "G1 X70\nG1 Y5\nG1 X60 A100\nG1 X50 A30\nG0 Z5\nG0 A-20\nG1 Z-1\nG1 X30 A0\nG1 X0 A-30\nG0 Z5\n"
)
MIXED = "G0 A5\nG1 Z-1 F300\nG91\nG1 X20 A90 F600\nG1 X20 A-45\nG1 A-10\nG1 X5\nG1 X-10 A20\nG90\nG0 Z5\nG0 A0\n"


def compensated(text, how, **options):
    program = read_program(text.encode(), "a.ngc")
    return ph.compensate(program, how, **options)


@pytest.mark.parametrize("dialect", ["linuxcnc", "grbl", "grblhal", "marlin", "fanuc"])
@pytest.mark.parametrize("name", ["indexed", "continuous", "mixed"])
def test_the_table_is_in_place_at_every_cut(dialect, name):
    text = HEAD + {"indexed": INDEXED, "continuous": CONTINUOUS, "mixed": MIXED}[name] + "M30\n"
    text = re.sub(r"([XYZA]-?\d+)(?![\d.])", r"\1.", text) if dialect == "fanuc" else text
    how = machine(dialect=dialect)
    if dialect == "fanuc":
        text = text.replace("A180.5", "A170.5")
    result = compensated(text, how)
    wanted = places(text.encode())
    assert comes_past(places(text.encode(), {"A": 0.05}), wanted) is not None
    assert comes_past(places(result.program(), {"A": 0.05}), wanted) is None
    assert ph.undo(read_program(result.program(), "b.ngc")) == text.encode()
    row = next(one for one in result.axis_reversals if one.axis == "A")
    assert row.compensated == row.all > 0
    again = ph.compensate(read_program(result.program(), "b.ngc"), how)
    assert again.program() == result.program()
    assert again.already_compensated
    assert ph.verify(read_program(text.encode(), "a"), read_program(result.program(), "b"), how).ok


@pytest.mark.parametrize("side", ["+", "-"])
def test_an_axis_whose_zero_was_taken_from_one_side_is_exact_there(side):
    text = HEAD + CONTINUOUS + "M2\n"
    result = compensated(text, machine(side=side))
    other = "+" if side == "-" else "-"
    assert f"offset A {other}0.05 deg".encode() in result.program()
    sign = 1 if side == "+" else -1
    assert comes_past(places(result.program(), {"A": 0.05}, sign), places(text.encode())) is None


def test_slides_and_several_axes_are_compensated_each_by_itself():
    text = (
        f"{HEAD}G0 A0 U0 B0\nG1 Z-1 F300\nG1 U5\nG1 U2\nG0 A90 B20\nG1 X5\nG0 A45 B30\nG1 X9\n"
        "G1 U3 X20\nG1 U1 X9\nG0 U0\nM2\n"
    )
    result = compensated(text, machine("ABU"))
    assert comes_past(places(result.program(), dict.fromkeys("ABU", 0.05)), places(text.encode())) is None
    assert b"offset U 0.025 mm" in result.program()
    assert [(one.axis, one.compensated, one.all) for one in result.axis_reversals] == [
        ("A", 1, 1),
        ("B", 0, 0),
        ("U", 3, 3),
    ]


def test_x_and_y_are_compensated_beside_it():
    text = "G61\n" + HEAD + CONTINUOUS + INDEXED + "M2\n"
    how = machine(x=0.04)
    result = compensated(text, how)
    play = {"A": 0.05, "X": 0.04, "Y": 0.04}
    assert comes_past(places(result.program(), play), places(text.encode()), 2e-3) is None
    assert result.axes == ("X", "A")
    assert ph.verify(read_program(text.encode(), "a"), read_program(result.program(), "b"), how).ok
    assert ph.undo(read_program(result.program(), "b.ngc")) == text.encode()
    assert ph.compensate(read_program(result.program(), "b.ngc"), how).program() == result.program()


def test_lines_are_those_of_the_original_where_x_and_y_are_left_beside_it():
    cuts = "G0 A0\nG1 Z-1 F300\nG1 X20 A9 F600\nG1 X5 A3\nG2 X5 Y0 I-3 J3 A9\nG1 X9\nG1 X0\nG0 Z5\nM2\n"
    text = "G61\n" + HEAD + cuts
    result = compensated(text, machine(x=0.04))
    left = [one for one in result.warnings if "moves A too" in one]
    assert left
    assert all("line 9 moves A too" in one for one in left)
    assert text.splitlines()[8].startswith("G2")


def test_all_places_may_be_come_to_from_one_side():
    text = HEAD + INDEXED.replace("G1 A30\nG1 A60\n", "") + "M2\n"
    result = compensated(text, machine(), position_from="-")
    for play in (0.04, 0.05, 0.06):
        shifted = [(*one[:3], one[3] + 0.5 * (play - 0.05), *one[4:]) for one in places(result.program(), {"A": play})]
        assert comes_past(shifted, places(text.encode())) is None


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("G1 X5 A9 F600\nG1 X9 A0\n", "G95 before"),
        ("G41 D1\nG1 X5 A9 F600\nG1 X9 A0\nG40\n", ""),
        ("M10\nG1 X5 A9 F600\nG1 X9 A0\n", "it is clamped"),
    ],
)
def test_what_cannot_be_compensated_stays_as_it_is(text, why):
    text = HEAD + ("G95\n" if "G95" in why else "") + "G0 A5\nG1 Z-1 F300\n" + text + "M2\n"
    result = compensated(text, machine())
    assert b"A9 F600" in result.program()
    row = [one for one in result.axis_reversals if one.axis == "A"]
    assert not row or row[0].compensated == 0
    assert not why or any("axis A not compensated" in one for one in result.warnings)


def test_a_move_back_by_less_than_a_tenth_of_its_backlash_is_no_reversal():
    text = HEAD + CONTINUOUS.replace("G1 X61 A90\n", "G1 X60.5 A89.999\nG1 X61 A90\n") + "M2\n"
    result = compensated(text, machine())
    assert b"G1 X60.5 A89.974\nG1 X61 A89.975\n" in result.program()
    assert comes_past(places(result.program(), {"A": 0.05}), places(text.encode()), 2e-3) is None


@pytest.mark.parametrize("seed", range(8))
def test_random_programs_are_in_place_at_every_cut(seed):
    draw = random.Random(seed)
    lines, absolute = ["G21", "G90", "G0 X0 Y0 Z5", "G0 A0"], True
    for _ in range(40):
        if draw.random() < 0.1:
            absolute = not absolute
            lines.append(draw.choice(["M8", "(comment)", "G4 P0.1"]) + f"\nG{90 if absolute else 91}")
        axes = [name for name in "XYZA" if draw.random() < 0.4]
        ways = [draw.uniform(-20, 20) if name in "XYZ" else draw.choice([1, 45]) * draw.uniform(-2, 2) for name in axes]
        words = [f"{name}{way:.3f}" for name, way in zip(axes, ways, strict=True)]
        lines += [" ".join([draw.choice(["G0", "G1 F600"]), *words])] if words else []
    text = "\n".join([*lines, "G90", "G0 A0", "M2", ""])
    side = draw.choice(["both", "+", "-"])
    how = machine(side=side)
    request = ProgramRequest(plan=PlanOptions(strategy="auto"), edit=EditOptions(max_slowdown=10.0))
    found = shifted_job(read_program(text.encode(), "a.ngc"), how, request)
    assert not any("not compensated" in one for one in found.warnings)
    (row,) = found.with_reversals(())
    assert row.compensated == row.all > 5
    ours = places(found.job.data, {"A": 0.05}, {"both": 0, "+": 1, "-": -1}[side])
    assert comes_past(ours, places(text.encode()), 0.0051) is None  # it may turn back by a tenth of the backlash


def test_moves_of_its_own_keep_within_the_time_allowed():
    text = HEAD + "G0 A5\nG1 Z-1 F6000\n" + "G1 X2 A9\nG1 X1 A5\n" * 9 + "G0 Z5\nM2\n"
    result = compensated(text, machine(), max_slowdown=0.01)
    assert b"crossing A" not in result.program()
    assert "--max-slowdown" in result.not_compensated
    assert b"crossing A" in compensated(text, machine(), max_slowdown=10.0).program()


def test_its_crossings_take_their_time_at_the_feed_in_force_beside_that_of_the_original():
    """F counts degrees a minute where the axis moves alone: 6 of them take half a second for its backlash."""
    text = HEAD + "G0 A5\nG1 Z-1 F6000\nG61\nG1 X2 A9 F6\n" + "G1 X4 A5\nG1 X2 A9\n" * 9 + "G0 Z5\nM2\n"
    plain = compensated(text, machine("B"))
    for x in (0.0, 0.05):
        result = compensated(text, machine(x=x), max_slowdown=0.06)
        assert result.program().count(b"crossing A") == 18
        assert result.before.time == pytest.approx(plain.before.time, abs=0.01)
        assert result.after.time > plain.before.time + 9.0
    short = text.replace("X4", "X2.1")
    assert b"crossing A" in compensated(short, machine(), max_slowdown=0.5).program()
    assert b"crossing A" not in compensated(short, machine(), max_slowdown=0.1).program()


def test_a_program_whose_time_is_not_known_has_no_time_to_spare():
    text = "o100 sub\nG1 X5 A9 F100\nG1 X4 A3\no100 endsub\nG0 A0\nG1 Z-1 F300\no100 call\nG1 X9 A5\nG0 Z5\nM2\n"
    result = compensated(text, machine())
    assert b"crossing A" not in result.program()
    assert ph.undo(read_program(result.program(), "b.ngc")) == text.encode()


def test_places_that_are_not_known_have_no_error():
    text = f"{HEAD}G1 Z-1 F300\nG91\nG1 X5 A5\nG1 X5 A-3\nG90\nG1 X5 A9\nG1 X7 A3\nM2\n"
    result = compensated(text, machine())
    assert result.program() == text.encode()
    assert any("from where its place is not known" in one for one in result.warnings)
    (found,) = result.shifted.errors
    assert math.degrees(found.before.max) == pytest.approx(0.025)
    assert found.after == found.before


def test_facts_may_go_on_in_a_second_line_and_comments_of_the_program_stay_its_own():
    text = f"(  indented)\n{HEAD}{CONTINUOUS}M2\n"
    how = machine(dialect="grbl")
    how = msgspec.structs.replace(how, name="the old mill with a rotary table in the corner by the window")
    result = compensated(text, how)
    assert b"\n(  indented)\n" in result.program()
    assert result.axes == ("A",)


@pytest.mark.parametrize("dialect", ["grbl", "linuxcnc"])
@pytest.mark.parametrize("name", ["m" * 40, "m" * 65, "m" * 200, "the old mill " * 12])
def test_a_program_for_a_machine_with_a_long_name_is_known_again(dialect, name):
    how = msgspec.structs.replace(machine(dialect=dialect), name=name.strip())
    after = compensated(HEAD + CONTINUOUS + "M2\n", how).program()
    again = ph.compensate(read_program(after, "b.ngc"), how)
    assert again.already_compensated
    assert again.program() == after


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_program_without_an_end_of_its_last_line_comes_back(end):
    text = (HEAD + CONTINUOUS.replace("G0 Z5\n", "", 1) + "G1 X5 A-40").replace("\n", end)
    result = compensated(text, machine())
    assert f"G1 X5 A-40.025{end}".encode() in result.program()
    assert ph.undo(read_program(result.program(), "b.ngc")) == text.encode()


def test_an_axis_inside_its_loop_is_left_alone_and_named():
    text = HEAD + CONTINUOUS + "M2\n"
    result = compensated(text, machine(loop="load"))
    assert result.program() == text.encode()
    assert any("axis A not compensated: its backlash is inside the loop" in one for one in result.warnings)


def test_a_backlash_of_few_steps_is_left_alone_and_named():
    text = HEAD + CONTINUOUS + "M2\n"
    result = compensated(text, machine(lost=0.0003))
    assert result.program() == text.encode()
    assert any("decimals of linuxcnc are too few" in one for one in result.warnings)


@pytest.mark.parametrize(
    ("dialect", "text"),
    [
        ("siemens", "G71 G90 G94\nG0 X0 Y0 Z5\nG0 A90\nG1 X5 F600\nG1 X0 A0\nM30\n"),
        ("heidenhain", "0 BEGIN PGM T MM\n1 L A+90 FMAX\n2 L X+5 F600\n3 L X+0 A+0\n4 END PGM T MM\n"),
        ("fanuc", "G21 G90\nG0 X0. Y0.\nG1 X5. U3. F600.\nM30\n"),
    ],
)
def test_what_a_language_has_no_axes_for_is_passed_through_and_named(dialect, text):
    how = machine("U" if dialect == "fanuc" else "A", dialect=dialect)
    program = program_in(SourceBytes(name="a", stem="a", data=text.encode()), dialect)
    result = ph.compensate(program, how)
    assert result.program() == text.encode()
    assert any(f"{dialect} programs are passed through where it moves" in one for one in result.warnings)


def test_where_a_control_may_turn_either_way_nothing_is_guessed():
    text = HEAD + "G0 A0.\nG1 Z-1. F300\nG1 X20. A200. F600\nG1 X0. A0.\nM30\n"
    result = compensated(text, machine(dialect="fanuc"))
    assert b"A200." in result.program()
    assert any("either way round" in one for one in result.warnings)


def test_words_that_count_in_increments_are_shifted_in_degrees():
    text = (
        "G21\nG90\nG0 X0 Y0 Z5000\nG0 A0\nG1 Z-1000 F300\nX10000\nG0 Z5000\nA90000\nG1 X0\nG0 A45000\nG1 X9000\nM30\n"
    )
    result = compensated(text, machine(dialect="fanuc"))
    row = next(one for one in result.axis_reversals if one.axis == "A")
    assert row.compensated == row.all == 1
    counted = re.sub(
        r"([XYZA]-?\d+)(?![\d.])", lambda word: f"{word[1][0]}{int(word[1][1:]) / 1000:.3f}", result.program().decode()
    )
    plain = re.sub(r"([XYZA]-?\d+)(?![\d.])", lambda word: f"{word[1][0]}{int(word[1][1:]) / 1000:.3f}", text)
    assert comes_past(places(counted.encode(), {"A": 0.05}), places(plain.encode())) is None
    for wrong in ("A90.02", "A90025", "A90.25"):
        broken = result.program().replace(b"A90.025", wrong.encode())
        program = read_as("fanuc", text.encode(), "a.nc")
        verdict = verify_shifted(program, read_as("fanuc", broken, "b.nc"), machine(dialect="fanuc"))
        assert verdict.ok == (wrong == "A90025")


def shortest(text, tie):
    """Places of an axis A that rolls over and goes the shortest way; half a turn goes the way of `tie`."""
    at, found = 0.0, []
    for word in re.findall(r"A([-+]?[\d.]+)", re.sub(r"\(.*?\)", "", text)):
        way = (float(word) - at) % 360.0
        at += way - 360.0 if way > 180.0 + 1e-9 or (tie < 0 and abs(way - 180.0) < 1e-9) else way
        found.append(at)
    return found


@pytest.mark.parametrize("side", ["both", "+", "-"])
@pytest.mark.parametrize("back", [180.0, 179.999, 179.98, 179.95, 179.949, 179.9])
def test_near_half_a_turn_it_goes_the_way_round_that_it_went(back, side):
    """With the offset of its last move it would have been a little more than half a turn, and gone the other way."""
    cut = "G1 Z-1. F300.\nX{}.\nG0 Z5.\n"
    turns = [
        f"G0 A{place:.3f}\n" + cut.format(n % 2) for n, place in enumerate((0.0, 40.0, 40.0 - back, 30.0, 30.0 + back))
    ]
    text = HEAD.replace("0 Y0 Z5", "0. Y0. Z5.") + "".join(turns) + "M30\n"
    made = compensated(text, machine(dialect="fanuc", side=side)).program().decode()
    assert made != text
    for tie in (1, -1):
        ways = iter(shortest(made, tie))
        assert all(any(abs(one - place) < 0.11 for one in ways) for place in shortest(text, tie))
    assert (
        comes_past(places(made.encode(), {"A": 0.05}, {"both": 0, "+": 1, "-": -1}[side]), places(text.encode()))
        is None
    )


@pytest.mark.parametrize(
    ("dialect", "setting"), [("linuxcnc", "WRAPPED_ROTARY"), ("fanuc", "parameter 1008"), ("grblhal", "")]
)
def test_where_a_sign_may_say_which_way_round_it_turns_that_is_said_or_the_axis_left(dialect, setting):
    """A90 and A-0.025 would be nearly whole turns there, to another place; -0 is no place but a way round."""
    text = HEAD + "G0 A10.\nG1 Z-1. F300\nX20. A90.\nX0. A0.\nG0 Z5.\nM30\n"
    warned = [one for one in compensated(text, machine(dialect=dialect)).warnings if "axis A" in one]
    assert len(warned) == bool(setting)
    assert not warned or setting in warned[0]
    for zero in ("A-0.", "A-.0"):
        result = compensated(text.replace("A0.", zero), machine(dialect=dialect))
        assert result.program() == text.replace("A0.", zero).encode()
        assert f"axis A not compensated: {zero} says by its sign which way round it turns" in result.warnings
    # A place beyond a whole turn says that the axis is no such one: the sign is what rounding has left.
    turned = text.replace("A90.", "A450.").replace("A0.", "A-0.")
    assert b"A450.025" in compensated(turned, machine(dialect="linuxcnc")).program()


@pytest.mark.parametrize(("old", "new"), [("A90.025", "A90.02"), ("G0 A-0.075", "G0 A-0.02"), ("M2\n", "G1 A7\nM2\n")])
def test_the_checker_sees_what_was_changed(old, new):
    text = HEAD + CONTINUOUS + "M2\n"
    after = compensated(text, machine()).program().decode()
    assert old in after
    broken = after.replace(old, new, 1).encode()
    assert not ph.verify(read_program(text.encode(), "a"), read_program(broken, "b"), machine()).ok


def test_what_is_beside_a_subprogram_is_compensated():
    text = f"{HEAD}G0 A0\nG1 Z-1 F300\nG1 X5 A10 F100\nG1 X9 A5\nM98 P7\nG90\nG1 X9 A5 F100\nG1 X5 A9\nG0 Z5\nM2\n"
    after = compensated(text, machine()).program().decode()
    assert "G1 X9 A4.975\n" in after
    # What the subprogram left behind is not known.
    assert after[after.index("A to 0)\n") :].split("(")[0] == "A to 0)\nG1 A5\n" + text[text.index("M98") :]


def test_the_checker_sees_a_mode_that_is_changed_behind_a_move_of_its_own_under_inverse_time():
    text = f"{HEAD}G0 A0\nG1 Z-1 F300\nG93\nG1 X5 A10 F100\nG1 X9 A5 F60\nG92 A0\nG1 X5 A9 F60\nG1 X9 A2 F30\nM2\n"
    after = compensated(text, machine()).program()
    original = read_program(text.encode(), "a")
    assert ph.verify(original, read_program(after, "b"), machine()).ok
    at = after.rindex(b"G1 A")
    broken = after[:at] + b"G18 " + after[at:]
    assert not verify_shifted(original, read_program(broken, "b"), machine()).ok


def test_a_program_for_another_machine_is_refused_in_one_line():
    after = compensated(HEAD + CONTINUOUS + "M2\n", machine()).program()
    with pytest.raises(InputError, match="compensated before"):
        ph.compensate(read_program(after, "b.ngc"), machine(dialect="grbl"))
    assert stepper().further == {}


def test_no_line_comes_out_longer_than_linuxcnc_reads():
    """It reads 253 characters with the end: an axis that would make a line longer is left and named."""
    named = 0
    for size in range(244, 253):
        line = f"G1 X20 A20 F600 ({'c' * (size - 18)})"
        text = f"G21 G90 G64 P0.01\nG0 X0 Y0 Z5 A0\nG0 A10\nG1 Z-1 F200\n{line}\nG1 A15\nG1 X0\nG0 Z5\nM2\n"
        result = ph.compensate(read_program(text.encode(), "a.ngc"), machine())
        made = result.program()
        assert max(len(one) for one in made.splitlines(keepends=True)) <= 253
        named += any("axes A not compensated: a line would be too long for linuxcnc" in one for one in result.warnings)
    assert 1 <= named <= 6
