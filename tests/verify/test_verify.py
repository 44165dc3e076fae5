"""``verify`` as a function and as a command: what it says, and what it holds a program to."""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from support.compensated import bracket, headed, planes, relative
from support.corpus import stepper

from ph_post.api.compensation import compensate
from ph_post.cli.main import main
from ph_post.drive.machinefile import read_machine
from ph_post.files.storage import SourceBytes
from ph_post.gcode.read import read_program
from ph_post.units import MM
from ph_post.verify.polylines import first_unreached
from ph_post.verify.verdict import KEPT, Findings
from ph_post.verify.verify import verify

TOLERANCE = 0.005 * MM

CORNER = "G21 G90 G94\nG0 X0 Y0\nG1 X10 F600 (out)\nG3 X10 Y10 I0 J5 F500 (round)\nM2\n"
"""X turns inside the arc, at (15, 5)."""

CORNER_HUNK = (
    "{header}G21 G90 G94\nG0 X0.025 Y0\nG1 X10.025 F600 (out)\n(ph-post: +{added} -1 X turns)\n{change}"
    "(ph-post: +4 -0 X back)\nG4 P0.01\nG1 X10 F400\nG4 P0.01\nF500\nM2\n"
)
HUNK = "G3 X15.025 Y5 I0 J5 F500 (round)\nG4 P0.01\nG1 X14.975 F400\nG4 P0.01\nG3 X9.975 Y10 I-5 J0 F500\n"


def judged(original, compensated, machine=None, tolerance=TOLERANCE):
    programs = (read_program(original, "original"), read_program(compensated, "compensated"))
    return verify(*programs, tolerance=tolerance, machine=machine)


def corner(change=HUNK, original=CORNER):
    """A program whose only arc is divided, the change given."""
    text = CORNER_HUNK.replace("{added}", str(change.count("\n"))).replace("{change}", change)
    return headed(original, text, "(ph-post: offset X 0.025 mm)", stops=2, dips=0)


def kinds(verdict):
    return [failure.kind for failure in verdict.failures]


def test_the_same_bytes_need_no_header():
    data, _ = bracket()
    assert judged(data, data).ok


def test_programs_in_the_wrong_order_are_named_as_that():
    data, _ = bracket()
    (failure,) = judged(b"(ph-post 0.2.0 compensated this program)\n" + data, data).failures
    assert failure.kind == "undeclared"
    assert "name the original first" in failure.what


def test_other_bytes_need_one():
    data, _ = bracket()
    verdict = judged(data, data.replace(b"X20", b"X21"))
    (failure,) = verdict.failures
    assert (failure.kind, failure.original, failure.compensated) == ("undeclared", 12, 12)
    assert "G1 X20 F600" in failure.expected
    assert "G1 X21 F600" in failure.got


@pytest.mark.parametrize("homings", [1, 20, 60])
def test_axes_that_come_from_home_in_few_and_in_many_changes(homings):
    """Each homing brings six changes: their numbers take one byte up to 127 of them, and two beyond."""
    pocket = "G28\nG0 X5 Y5\nG1 Z-1\nX20\nY20\nX5\nY5\nX20\nG0 Z5\n"
    original = ("G21 G90 G94 G17 F600\nG0 X0 Y0 Z5\n" + homings * pocket + "M2\n").encode()
    written = compensate(SourceBytes(name="a", stem="a", data=original), stepper("linuxcnc")).program()
    assert (written.count(b"\n(ph-post: +") > 127) == (homings == 60)
    assert judged(original, written).ok
    # A move of Z alone in the last change, where nobody knows yet where it is.
    place = written.rindex(b"\n", 0, written.rindex(b" X approach")) + 1
    place = written.index(b"\n", place) + 1
    assert not judged(original, written[:place] + b"G1 Z4 F100\n" + written[place:]).ok


def test_an_arc_divided_where_its_axis_turns():
    assert kinds(judged(*corner())) == []


SPLINE = "G21 G90 G94\nG0 X0 Y0\nG1 X-5 F600\nG1 X0\nG5 I10 J0 P0 Q-10 X20 Y20\nG1 Y30\nM2\n"
"""Where Z is nobody knows. Half of the spline is at (13.75, 6.25), by de Casteljau's rule."""

HALVES = "G5 X13.75 Y6.25 I5 J0 P-3.75 Q-3.75\nG5 X20 Y20 I3.75 J3.75 P0 Q-5 F500\n"


@pytest.mark.parametrize(
    ("halves", "found"),
    [
        (HALVES, []),
        (HALVES.replace("F500", "F700"), ["feed"]),
        (HALVES.replace("J3.75", "J4.25"), ["path"]),
        ("G4 P0.01\nG5 I10 J0 P0 Q-10 X20 Y20 F600\n", []),
    ],
)
def test_splines_in_a_plane_whose_height_is_not_known(halves, found):
    change = f"(ph-post: +3 -1 feed)\n{halves}F600\n"
    compensated = SPLINE.replace("G5 I10 J0 P0 Q-10 X20 Y20\n", change)
    stops, dips = (1, 0) if "G4" in halves else (0, 1)
    assert kinds(judged(*headed(SPLINE, "{header}" + compensated, "", stops=stops, dips=dips))) == found


def test_splines_outside_hunks_are_the_same():
    change = "(ph-post: +1 -0 rest)\nG4 P0.01\n"
    for line in ("G5 I10 J0 P0 Q-10 X20 Y20\n", "G5 I10 J0 P0 Q-12 X20 Y20\n"):
        compensated = SPLINE.replace("G1 Y30", change + "G1 Y30")
        text = compensated.replace("G5 I10 J0 P0 Q-10 X20 Y20\n", line)
        verdict = judged(*headed(SPLINE, "{header}" + text, "", stops=1, dips=0))
        assert verdict.ok == (text == compensated)


def test_comments_of_replaced_lines_stay():
    assert kinds(judged(*corner(HUNK.replace(" (round)", "")))) == ["comment"]


def test_block_delete_of_replaced_lines_stays():
    assert "comment" in kinds(judged(*corner(HUNK.replace("G3 X9", "/G3 X9"))))


def test_commands_of_replaced_lines_stay_once_and_in_order():
    original = CORNER.replace("(round)", "M8 S200 (round)")
    fine = HUNK.replace("(round)", "M8 S200 (round)")
    assert kinds(judged(*corner(fine, original))) == []
    assert "command" in kinds(judged(*corner(fine.replace("M8 ", ""), original)))
    assert "command" in kinds(judged(*corner(fine.replace("I-5", "M8 I-5"), original)))


def test_failures_name_lines_from_one():
    original, compensated = bracket()
    verdict = judged(original, compensated.replace(b"Y10 (side)", b"Y11 (side)"))
    line = compensated.splitlines().index(b"Y10 (side)") + 1
    first = verdict.failures[0]
    assert (first.kind, first.original, first.compensated) == ("text", 13, line)
    assert first.sentence() == (
        f"text: original line 13, compensated line {line}: the line differs outside what is declared;"
        " expected 'Y10 (side)'; got 'Y11 (side)'"
    )


def test_a_deviation_is_told_in_millimetres():
    original, compensated = bracket()
    verdict = judged(original, compensated.replace(b"X16 F150\nX20", b"X16 Y0.02 F150\nX20 Y0"))
    (failure,) = [one for one in verdict.failures if one.kind == "path"]
    assert failure.got == "0.02 mm, in the order of travel"


def test_the_tolerance_is_an_upper_bound():
    """The header promises 1 µm: a larger tolerance does not loosen that, a smaller one tightens it."""
    original, compensated = bracket()
    bent = compensated.replace(b"X16 F150\nX20", b"X16 Y0.0012 F150\nX20 Y0")
    assert judged(original, bent).ok
    assert kinds(judged(original, bent, tolerance=0.001 * MM)) == ["path"]
    farther = compensated.replace(b"X16 F150\nX20", b"X16 Y0.002 F150\nX20 Y0")
    assert kinds(judged(original, farther, tolerance=0.1 * MM)) == ["path"]


MACHINE = """name = "bench"
[controller]
dialect = "linuxcnc"
servo_period_ms = 1.0
[axes.X]
feedback = "motor"
b = 0.0004
c = 0.02
lost_motion_mm = 0.05
max_velocity_mm_s = 100
max_acceleration_mm_s2 = 1000
max_jerk_mm_s3 = 50000
"""


def bench(tmp_path, **changes):
    """A machine for :func:`corner`; a jog of 0.05 mm reaches sqrt(1000 * 0.05) = 7.07 mm/s, 424 mm/min."""
    text = MACHINE
    for old, new in changes.values():
        assert old in text
        text = text.replace(old, new)
    file = tmp_path / "bench.toml"
    file.write_text(text)
    return read_machine(str(file))


def for_machine(machine, change=HUNK):
    original, compensated = corner(change)
    told = f"bench, sha256 {machine.digest[:16]}".encode()
    return original, compensated.replace(b"bench, sha256 0123456789abcdef", told).replace(
        b"G1 X10 F400", b"G1 X10 F290"
    )


def test_jogs_keep_the_limits_of_the_machine(tmp_path):
    machine = bench(tmp_path)
    assert kinds(judged(*for_machine(machine), machine)) == []
    assert kinds(judged(*for_machine(machine, HUNK.replace("F400", "F424")), machine)) == []
    assert kinds(judged(*for_machine(machine, HUNK.replace("F400", "F426")), machine)) == ["limits"]


def test_dwells_of_no_length_hold_moves_apart_where_no_joint_is_rounded(tmp_path):
    """Grbl waits for such a dwell until its moves are done; LinuxCNC may blend them."""
    for dialect, found in (("grbl", []), ("linuxcnc", ["jog"] * 4)):
        machine = bench(tmp_path, dialect=("linuxcnc", dialect))
        original, longer = for_machine(machine)
        compensated = longer.replace(b"P0.01", b"P0").replace(b"dwell 0.01 s", b"dwell 0 s")
        assert kinds(judged(original, compensated, machine)) == found
        assert "jog" in kinds(judged(original, longer.replace(b"P0.01", b"P0"), machine))


SLANTED = "G21 G90 G94\nG0 X0 Y0\nG1 X10 Y5 F600\nM2\n"


@pytest.mark.parametrize(
    ("back", "found"), [("X10 Y5", []), ("X10", ["return"]), ("X10 Y5.01", ["return"]), ("X10.01 Y5", ["return"])]
)
def test_axes_are_shifted_in_one_move_each_by_what_is_declared(back, found):
    text = (
        "{header}G21 G90 G94\nG0 X0.025 Y0.02\nG1 X10.025 Y5.02 F600\n(ph-post: +4 -0 X to 0, Y to 0)\n"
        f"G4 P0.01\nG1 {back} F200\nG4 P0.01\nF600\nM2\n"
    )
    declared = ("(ph-post: offset X 0.025 mm)\n(ph-post: offset Y 0.02 mm)",)
    verdict = judged(*headed(SLANTED, text, *declared, stops=1, dips=0))
    assert verdict.ok == (not found)
    assert set(found) <= set(kinds(verdict))


def test_the_last_decimals_turn_the_end_of_a_small_arc():
    """What is written has 9 of the 16 decimals of a program: the arc of 0.04 mm is the same to 1e-9 m."""
    original = (
        "G21 G90 G94\nG0 X2 Y1\nG1 X1.041240014362511 Y1.5503744693637969 F600\n"
        "G3 X1.0 Y1.5174285503286316 I-0.001422245084532571 J-0.040719246019114363\nG1 Y1.3\nM2\n"
    )
    shifts = {"X2 ": "X1.975 ", "X1.041240014362511": "X1.016240014", "X1.0 ": "X0.975 "}
    moved = "{header}" + original.replace("M2", "(ph-post: +4 -0 X to 0)\nG4 P0.01\nG1 X1 F200\nG4 P0.01\nF600\nM2")
    for old, new in shifts.items():
        moved = moved.replace(old, new)
    for text, same in ((moved, True), (moved.replace("X0.975 Y1.51742855", "X0.975 Y1.51743855"), False)):
        pair = headed(original, text, "(ph-post: offset X 0.025 mm)", stops=1, dips=0)
        assert judged(*pair).ok == same


def test_the_declaration_is_held_to_the_machine(tmp_path):
    machine = bench(tmp_path)
    original, compensated = for_machine(machine)
    other = bench(tmp_path, gap=("lost_motion_mm = 0.05", "lost_motion_mm = 0.06"))
    assert kinds(judged(original, compensated, other)) == ["machine", "machine"]
    scaled = read_machine("mill")
    assert "machine" in kinds(judged(original, compensated, scaled))


def test_many_failures_are_counted_and_not_all_kept():
    findings = Findings()
    for line in range(KEPT + 5):
        findings.add("text", "wrong", original=line)
    verdict = findings.verdict()
    assert (len(verdict.failures), verdict.found, verdict.ok) == (KEPT, KEPT + 5, False)


def written(tmp_path: Path, pair) -> list[str]:
    files = []
    for name, data in zip(("part.ngc", "part_compensated.ngc"), pair, strict=True):
        (tmp_path / name).write_bytes(data)
        files.append(str(tmp_path / name))
    return files


@pytest.mark.parametrize("maker", [bracket, relative, planes])
def test_the_command_says_that_it_holds(maker, tmp_path, capsys):
    assert main(["verify", *written(tmp_path, maker())]) == 0
    assert capsys.readouterr().out.startswith("ok: only the declared changes were made\nchecked: ")


def test_the_command_lists_failures(tmp_path, capsys):
    original, compensated = bracket()
    files = written(tmp_path, (original, compensated.replace(b"F600\nN20", b"F601\nN20")))
    assert main(["verify", *files]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("state: ")
    assert lines[-2].startswith("failed: ")


def test_the_command_shortens_long_lists(tmp_path, capsys):
    original, compensated = bracket()
    compensated = compensated.replace(b"\n", b" \n")
    assert main(["verify", *written(tmp_path, (original, compensated))]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[20].startswith("and ")
    assert lines[20].endswith(" more")


def test_the_command_as_json(tmp_path, capsys):
    original, compensated = bracket()
    files = written(tmp_path, (original, compensated.replace(b"Y10 (side)", b"Y11 (side)")))
    assert main(["verify", *files, "--json"]) == 1
    view = json.loads(capsys.readouterr().out)
    assert view["ok"] is False
    assert view["failures"][0].keys() == {"kind", "original", "compensated", "what", "expected", "got"}
    assert view["checked"]["jogs"] == 4


def test_bad_input_is_no_verdict(tmp_path, capsys):
    original, compensated = bracket()
    files = written(tmp_path, (original, compensated.replace(b"(side)", b"(side")))
    assert main(["verify", *files]) == 2
    assert "comment" in capsys.readouterr().err
    assert main(["verify", files[0], str(tmp_path / "nothing.ngc")]) == 2
    assert main(["verify", "-", "-"]) == 2


def test_following_is_decided_as_by_the_discrete_distance():
    """Against the discrete Fréchet distance of fine samples, by its recursion in full."""
    rng = np.random.default_rng(3)
    for _ in range(40):
        p, q = (rng.normal(size=(rng.integers(2, 6), 3)).cumsum(axis=0) for _ in range(2))
        fine = discrete(sampled(p), sampled(q))
        # Samples are 1/40 of a segment apart: the discrete distance is too large by no more than that.
        step = max(np.linalg.norm(np.diff(one, axis=0), axis=1).max() for one in (p, q)) / 40
        assert followed(p, q, 1.001 * fine)
        assert not followed(p, q, 0.999 * (fine - step))


def test_a_way_back_is_noticed_where_it_is_longer_than_the_bound():
    line = np.array([[0.0, 0, 0], [1, 0, 0]])
    back = np.array([[0.0, 0, 0], [0.5, 0, 0], [0.4, 0, 0], [1, 0, 0]])
    assert followed(line, back, 0.0501)
    assert not followed(line, back, 0.0499)


def followed(p, q, bound):
    ends = np.array([0, len(p)]), np.array([0, len(q)])
    return first_unreached(p, ends[0], q, ends[1], np.array([bound]))[0] < 0


def sampled(points):
    share = np.linspace(0.0, 1.0, 41)[1:, None]
    rows = [a + share * (b - a) for a, b in pairwise(points)]
    return np.concatenate([points[:1], *rows])


def discrete(p, q):
    """Discrete Fréchet distance (Eiter, Mannila 1994)."""
    apart = np.linalg.norm(p[:, None] - q[None], axis=2)
    best = np.full_like(apart, np.inf)
    for i in range(len(p)):
        for j in range(len(q)):
            before = [best[i - 1, j]] * (i > 0) + [best[i, j - 1]] * (j > 0)
            before += [best[i - 1, j - 1]] * (i > 0 and j > 0)
            best[i, j] = max(apart[i, j], min(before, default=0.0))
    return best[-1, -1]
