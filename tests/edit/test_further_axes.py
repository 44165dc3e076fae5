"""Programs with axes beside X, Y and Z: what of X, Y and Z is compensated there, judged by a table with play."""

import math
import re

import pytest
from support.corpus import compensated, stepper

import ph_post as ph
from ph_post.dialects.registry import find_dialect
from ph_post.edit.edits import EditOptions
from ph_post.edit.offset_edits import plan_offsets
from ph_post.edit.undo import undo
from ph_post.gcode.read import read_program, reread
from ph_post.verify.verify import verify

MACHINE = stepper()
HEAD = "G21\nG90\nG0 X0 Y0 Z5\n"
CUTS = (
    "G0 A0\nG1 Z-1 F300\nG1 X50 A90 F600\nG1 X0 A180.5\nG1 Y8 A170\nG1 X50 B9\nG1 X0 A0\n"
    "G1 Y0 C5\nG1 X50\nG1 A-5\nG1 X0\n"
    "G0 Z5\nG0 A90 X-5 Y20\nG1 Z-1\nG1 X5 W3\nG1 X-5\nG0 Z5\nM2\n"
)
WORD = re.compile(r"([A-Z])([-+]?[\d.]+)")


def run(text, play):
    """Places (X, Y, A, B, C, W) of a table with play behind each cut, by a reader and a play of its own."""
    at, table, mode, found = {}, {}, "G0", []
    for line in text.splitlines():
        words = dict(WORD.findall(re.split(r"[(;]", line)[0]))
        mode = f"G{int(words['G'])}" if words.get("G") in ("0", "1") else mode
        for letter in "XYZABCW":
            if letter not in words:
                continue
            at[letter] = float(words[letter])
            half = play.get(letter, 0.0) / 2
            table[letter] = min(max(table.get(letter, at[letter]), at[letter] - half), at[letter] + half)
        if mode == "G1" and set(words) & set("XYZABCW"):
            found.append(tuple(table.get(letter, math.nan) for letter in "XYABCW"))
    return found


def near(places, place, tolerance):
    return any(
        all(math.isnan(b) or abs(a - b) <= tolerance for a, b in zip(other, place, strict=True)) for other in places
    )


@pytest.mark.parametrize("dialect", ["linuxcnc", "grbl", "grblhal", "marlin"])
def test_reversals_beside_further_axes_are_compensated_and_their_words_stay(dialect):
    play = {name: axis.gap.lost_motion * 1e3 for name, axis in MACHINE.axes.items() if name != "Z"}
    before = (HEAD + ("G61\n" if dialect == "linuxcnc" else "") + CUTS).encode()
    program = read_program(before, "a.ngc", language=find_dialect(dialect).language)
    after = compensated(program, MACHINE, find_dialect(dialect))
    text = after.decode()
    assert re.findall(r"[ABCW][-\d.]+", re.sub(r"\(.*?\)|;.*", "", text)) == re.findall(r"[ABCW][-\d.]+", CUTS)
    wanted = run(before.decode(), {})
    plain, ours = run(before.decode(), play), run(text, play)
    assert not all(near(plain, place, 0.02) for place in wanted)
    assert all(near(ours, place, 2e-3) for place in wanted)
    checked = verify(program, reread(program, after), tolerance=5e-6, machine=MACHINE)
    assert checked.failures == ()
    assert undo(after, "b.ngc") == before
    assert compensated(reread(program, after), MACHINE, find_dialect(dialect)) == after


@pytest.mark.parametrize(("old", "new"), [("A90 F600", "A91 F600"), ("G1 A-5\n", ""), ("G1 X0 A0\n", "G1 X0\nG1 A0\n")])
def test_the_checker_sees_a_word_of_a_further_axis_that_was_changed(old, new):
    program = read_program((HEAD + "G61\n" + CUTS).encode(), "a.ngc")
    after = compensated(program, MACHINE, find_dialect("linuxcnc")).decode()
    shifted = re.sub(r"X-?[\d.]+ A0\n", lambda found: found[0].replace(" A0", "\nG1 A0"), after)
    broken = after.replace(old, new) if old in after else shifted
    assert broken != after
    assert not verify(program, read_program(broken.encode(), "b.ngc"), tolerance=5e-6, machine=MACHINE).ok


def test_an_arc_that_turns_an_axis_is_kept_whole_and_named():
    text = f"{HEAD}G61\nG1 Z-1 F300\nG3 X0 Y0 I-20 A360 F600\nG1 X50\nG0 Z5\nM2\n".encode()
    program = read_program(text, "a.ngc")
    after = compensated(program, MACHINE, find_dialect("linuxcnc"))
    assert after.count(b"A360") == after.count(b"G3") == 1


def test_stops_in_lines_that_turn_an_axis_are_not_reckoned_as_crossings_on_the_fly(tmp_path):
    radius, feed, turns = 5.0, 20.0, 5
    round_ = [
        f"G1 X{radius * math.cos(n * math.pi / 180) - radius:.4f} Y{radius * math.sin(n * math.pi / 180):.4f} A{n}\n"
        for n in range(1, 360 * turns + 1)
    ]
    text = f"{HEAD}G64 P0.01\nG1 Z-1 F300\nF{60 * feed:g}\n{''.join(round_)}G0 Z5\nM2\n"
    program, machine = read_program(text.encode(), "a.ngc"), stepper("linuxcnc")
    # The circles, the way down, and up again at the machine's speed.
    lasts = 2 * math.pi * radius * turns / feed + 6.0 / 5.0 + 6.0 / (machine.axes["Z"].limits.velocity * 1e3)
    push = max(axis.limits.acceleration for axis in machine.axes.values()) * 1e3
    for allowed in (10.0, 0.2, 0.1):
        edits = plan_offsets(program, machine, find_dialect("linuxcnc"), EditOptions(max_slowdown=allowed))
        assert not edits.crossings
        # From the feed to rest and back takes so much longer, be the brakes those of the fastest axis.
        whole = [one for one in edits.stops if any(shift.whole for shift in one.shifts)]
        assert edits.slowdown * lasts >= len(whole) * feed / push
    file = tmp_path / "a.ngc"
    file.write_text(text)
    found = ph.compensate(file, machine)
    assert found.after.time <= 1.101 * found.before.time
    assert sum(row.compensated for row in found.axis_reversals) >= 4
