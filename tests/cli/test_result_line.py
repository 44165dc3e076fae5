"""The line that commands end with, and the one before it of what is not compensated."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from msgspec.structs import replace
from support.front_door import once

import ph_post as ph
from ph_post.api.outcomes import left_words, passed_through
from ph_post.api.results import AxisReversals
from ph_post.cli.main import main
from ph_post.compensate.plan_warnings import passing_warnings
from ph_post.dialects.reading import read_as
from ph_post.dialects.registry import find_dialect
from ph_post.gcode.read import read_program
from ph_post.report.result_line import ResultSummary, result_lines
from ph_post.simulate.contour import ContourError

POCKET = """G21 G17 G90 G91.1 G94 G61
G0 X5 Y4 Z1
G1 Z-1 F200
G1 X35 F900
G3 X36 Y5 I0 J1
G1 Y19
G3 X35 Y20 I-1 J0
G1 X5
G3 X4 Y19 I0 J-1
G1 Y5
G3 X5 Y4 I1 J0
G0 Z2
M2
"""
LINE = re.compile(
    r"backlash error (?P<before>\S+) → (?P<after>\S+) µm max"
    r"( \((?P<worst>\S+) if the backlash is (?P<spread>\S+) % off\))?, (?P<rms>\S+) → (?P<rms_after>\S+) µm rms; "
    r"(?P<time>\S+) → (?P<time_after>\S+) s; (?P<axes>no axis|[XYZ, ]+) compensated, "
    r"(?P<done>\d+) of (?P<all>\d+) reversals?"
)


@pytest.fixture
def part(tmp_path: Path) -> Path:
    file = tmp_path / "part.ngc"
    file.write_text(POCKET)
    return file


def ended(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[list[str], str]:
    """Lines on standard error, and what stands on standard output."""
    assert main([*words]) == 0
    out, err = capsys.readouterr()
    return [line for line in err.splitlines() if line], out


@pytest.mark.parametrize("command", ["convert", "report"])
@pytest.mark.parametrize("allowed", ["0.01", "10"])
def test_the_last_line_has_the_numbers_of_the_object(
    part: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str, allowed: str
) -> None:
    words = (command, str(part), "-m", "stepper", "--max-slowdown", allowed, "--json", "-o", str(tmp_path / "out"))
    said, out = ended(capsys, *words)
    view = json.loads(out)
    found = LINE.fullmatch(said[-1])
    assert found is not None, said[-1]
    gap = view["error_gap"]
    for name, size in (
        ("before", gap["before"]["max"]),
        ("after", gap["after"]["max"]),
        ("worst", gap["after_worst"]["max"]),
        ("rms", gap["before"]["rms"]),
        ("rms_after", gap["after"]["rms"]),
    ):
        told = found[name]
        assert told == "<0.1" or float(told) == pytest.approx(1e3 * size, rel=0.05, abs=0.051)
    assert found["axes"] == (", ".join(view["axes"]) or "no axis")
    assert (int(found["done"]), int(found["all"])) == (view["reversals"]["compensated"], view["reversals"]["all"])
    assert float(found["time_after"]) == pytest.approx(view["cycle_time"]["after"], rel=5e-3)
    missed = view["reversals"]["compensated"] < view["reversals"]["all"]
    assert said[-2].startswith("NOT COMPENSATED: ") is missed
    assert (view["not_compensated"] is not None) is missed
    if missed:
        assert said[-2] == f"NOT COMPENSATED: {view['not_compensated']}"
        assert "--max-slowdown" in said[-2]


def test_a_path_ends_with_the_same_line(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    words = ("convert", "circle", "-m", "stepper", "--effort", "0.01", "--json", "-o", str(tmp_path / "circle.nc"))
    said, out = ended(capsys, *words)
    view, found = json.loads(out), LINE.fullmatch(said[-1])
    assert found is not None, said[-1]
    # The rest with which a closed path begins and ends is no reversal.
    assert view["reversals"] == {"compensated": 3, "all": 3}
    assert view["not_compensated"] is None
    assert float(found["before"]) == pytest.approx(1e3 * view["error_gap"]["before"]["max"], rel=0.05)


def test_what_was_not_simulated_is_said_in_words(part: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said, out = ended(capsys, "convert", str(part), "-m", "stepper", "--no-simulation", "--json")
    assert said[-1].startswith("backlash error not simulated; ")
    assert json.loads(out)["error_gap"] == {"before": None, "after": None, "after_worst": None}


def test_what_is_passed_through_is_not_compensated(part: Path, capsys: pytest.CaptureFixture[str]) -> None:
    part.write_text(POCKET.replace("G0 Z2\n", "G0 Z2\nG98 G81 X10 Y10 Z-1 R1 F100\nG80\n"))
    said, _ = ended(capsys, "convert", str(part), "-m", "stepper", "--max-slowdown", "10")
    assert said[-2].startswith("NOT COMPENSATED: ")
    assert "passed through unchanged (line 13: " in said[-2]
    assert said[-2].endswith("; --expand writes it out as plain moves)")
    said, _ = ended(capsys, "convert", str(part), "-m", "stepper", "--max-slowdown", "10", "--expand")
    assert not any("NOT COMPENSATED" in line for line in said[-2:])


ROUNDED = {
    "siemens": "N1 G17 G71 G90\nN2 G0 X0 Y0 Z10\nN3 G1 Z-1 F200\nN4 X30 F800\nN5 Y30 RND=5\nN6 X-30\nN7 Y-30\nN8 X30\n"
    "N9 Y0\nN10 G0 Z50\nN11 M30\n",
    "heidenhain": "BEGIN PGM T MM\nL X+0 Y+0 Z+10 R0 FMAX\nL Z-1 F200\nL X+30 F800\nRND R5\nL Y+30\nL X-30\nL Y+0\n"
    "L X+0\nL Z+50 FMAX M2\nEND PGM T MM\n",
}


@pytest.mark.parametrize("dialect", ["siemens", "heidenhain"])
def test_cuts_without_a_known_error_are_named(capsys: pytest.CaptureFixture[str], tmp_path: Path, dialect: str) -> None:
    """Behind a corner that is passed through the error of the rest was said to be less than 0.1 µm."""
    part = tmp_path / f"part{'.mpf' if dialect == 'siemens' else '.h'}"
    part.write_text(ROUNDED[dialect])
    words = ("convert", str(part), "-m", "stepper", "--dialect", dialect, "-o", str(tmp_path / "out.txt"), "--json")
    said, out = ended(capsys, *words)
    assert said[-2].endswith("; --expand writes it out as plain moves)")
    assert json.loads(out)["error_unknown"] == "lines 7 to 9"
    assert "; without lines 7 to 9, where nobody knows where an axis is, or on which side of its backlash; " in said[-1]
    assert "no axis with backlash reverses" not in said[-1]
    said, out = ended(capsys, *words, "--expand")
    assert json.loads(out)["error_unknown"] is None
    assert "without" not in said[-1]


@pytest.mark.parametrize(
    ("dialect", "text", "way"),
    [
        ("linuxcnc", "G41 D1\nG1 X20\nG40 X30\n", "--expand --tool-table FILE works out cutter compensation"),
        ("fanuc", "M98 P100\n", "--expand writes it out as plain moves"),
        ("siemens", "LAB: G1 X20\nX30\nREPEAT LAB P2\n", "--expand writes it out as plain moves"),
        ("fanuc", "G1 X20. F600 ,R5.\nY20.\n", "--expand writes it out as plain moves"),
        ("fanuc", "G68 X0. Y0. R45.\nG1 X20. F600.\nG69\n", "--expand writes it out as plain moves"),
        (
            "linuxcnc",
            "M300 (a macro of the shop's own)\n",
            'dialect = "linuxcnc+m300" in the machine file says that M300 moves nothing',
        ),
        (
            "klipper",
            "START\n" + "G1 X1 Y1 F600\nG1 X2\nFAN_UP S=1\n" * 5,
            'dialect = "klipper+fan_up" in the machine file says that FAN_UP moves nothing',
        ),
    ],
)
def test_what_would_have_it_compensated_is_said(dialect: str, text: str, way: str) -> None:
    program = read_program(
        f"G21 G90 G17\nG0 X0 Y0\n{text}M30\n".encode(), "part.nc", language=find_dialect(dialect).language
    )
    (said,) = passed_through(program, dialect)
    assert said.endswith(f"{way})")
    assert "; --expand" not in passed_through(program, dialect, expand=True)[0]


@pytest.mark.parametrize("frame", ["G101 X0.", "G268 X0. Y0. Z0.", "G254", "G12.1", "G7.1 C50."])
def test_nothing_is_advised_for_frames_that_are_not_written_out(frame: str) -> None:
    text = f"G21 G90 G17\nG0 X0 Y0\n{frame}\nG1 X20. F600.\nM30\n".encode()
    (said,) = passed_through(read_as("fanuc", text, "part.nc"), "fanuc")
    assert "--expand" not in said


def test_less_feed_that_helps_is_said_where_nothing_else_does() -> None:
    row, slower = AxisReversals(axis="Y", compensated=0, all=2, cut=2), passing_warnings([1.0, 0.55])
    assert "nothing that was tried makes the part better than less feed does" in left_words([row], slower, ())
    assert "nothing that was tried makes the part better in the time" in left_words([row], (), ())
    # Of --strategy none and of a dip where the backlash is outside of the loop it advised more time.
    assert left_words([row], (), (), "suppress").endswith("strategy suppress does not compensate them here; auto may")


def test_a_program_that_is_compensated_already_ends_with_its_line(
    part: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    once, twice = tmp_path / "once.ngc", tmp_path / "twice.ngc"
    first, _ = ended(capsys, "convert", str(part), "-m", "stepper", "--max-slowdown", "0.005", "-o", str(once))
    again, _ = ended(capsys, "convert", str(once), "-m", "stepper", "--max-slowdown", "0.005", "-o", str(twice))
    assert "NOT COMPENSATED" in first[-2]
    assert first[-2:] == again[-2:]


def test_all_reversals_may_be_required(part: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out.ngc"
    words = ["convert", str(part), "-m", "stepper", "-o", str(out), "--require-all", "--max-slowdown"]
    assert main([*words, "0.005"]) == 1
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith("ph-post: --require-all: not compensated: ")
    assert not out.exists()
    with pytest.raises(ph.PhPostError, match="--require-all: not compensated"):
        ph.compensate(part, "stepper", max_slowdown=0.005, require_all=True)
    assert main([*words, "10"]) == 0
    assert out.exists()
    assert main([word for word in words if word != "--require-all"] + ["0.005"]) == 0


def test_all_reversals_of_a_path_may_be_required(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "oval.ngc"
    words = ["convert", "circle", "-m", "stepper", "-o", str(out), "--effort", "0.01"]
    assert main([*words, "--require-all", "--strategy", "none"]) == 1
    assert not out.exists()
    assert main([*words, "--require-all"]) == 0
    assert out.exists()
    capsys.readouterr()


@pytest.mark.parametrize("command", ["filter", "slicer"])
def test_pipelines_end_with_the_line_of_convert(
    part: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    words = ("-m", "stepper", "--max-slowdown", "0.01", "--dialect", "linuxcnc")
    expected, _ = ended(capsys, "convert", str(part), *words, "-o", str(tmp_path / "out.ngc"))
    said, _ = ended(capsys, command, str(part), *words)
    assert expected[-2].startswith("NOT COMPENSATED: ")
    assert said[-2:] == expected[-2:]


@pytest.mark.parametrize("allowed", [0.001, 10.0])
def test_python_says_the_same(part: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], allowed: float) -> None:
    words = ("-m", "stepper", "--max-slowdown", str(allowed), "-o", str(tmp_path / "out.ngc"), "--json")
    view = json.loads(ended(capsys, "convert", str(part), *words)[1])
    result = ph.compensate(part, "stepper", max_slowdown=allowed)
    assert (result.not_compensated or None) == view["not_compensated"]
    assert bool(result.not_compensated) is (allowed < 1.0)


def test_a_quiet_filter_says_nothing(part: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert ended(capsys, "filter", str(part), "-m", "stepper", "--quiet")[0] == []


ALONE = re.compile(
    r"backlash error (?P<max>\S+) µm max( \(\S+ if the backlash is \S+ % off\))?, (?P<rms>\S+) µm rms; "
    r"(?P<time>\S+) s; no axis compensated, 0 of (?P<all>\d+) reversals"
)


def test_simulate_judges_the_plain_program_by_itself(capsys: pytest.CaptureFixture[str]) -> None:
    _, out = ended(capsys, "simulate", "circle", "-m", "stepper")
    *_, left, last = out.splitlines()
    found = ALONE.fullmatch(last)
    assert found is not None, last
    assert left.startswith("NOT COMPENSATED: X at ")
    assert "convert" in left
    view = json.loads(ended(capsys, "simulate", "circle", "-m", "stepper", "--json")[1])
    assert view["result_line"] == last
    assert left.endswith(view["not_compensated"])
    assert float(found["max"]) == pytest.approx(1e3 * view["error_gap"]["max"], rel=0.05)
    assert view["reversals"] == {"compensated": 0, "all": int(found["all"])}


@pytest.mark.slow
def test_simulate_and_compare_tell_of_a_strategy_beside_the_plain_program(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    once(monkeypatch, "compare")
    words = ("circle", "-m", "stepper", "--effort", "0.01")
    _, out = ended(capsys, "simulate", *words, "--strategy", "auto")
    last = out.splitlines()[-1]
    assert LINE.fullmatch(last) is not None, last
    _, out = ended(capsys, "compare", *words)
    assert out.splitlines()[-1] == f"auto: {last}"
    view = json.loads(ended(capsys, "compare", *words, "--json")[1])["result"]
    assert (view["strategy"], view["result_line"]) == ("auto", last)


def test_a_compensated_program_is_not_taken_for_the_part(
    part: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out.ngc"
    ended(capsys, "convert", str(part), "-m", "stepper", "-o", str(out))
    plain, compensated = (ended(capsys, "simulate", str(name), "-m", "stepper") for name in (part, out))
    # The path that the part should have is the original's.
    assert compensated[1].splitlines()[-2:] == plain[1].splitlines()[-2:]
    assert any("this is the path of its original" in line for line in compensated[0])
    text = out.read_text()
    assert "F200" in text
    out.write_text(text.replace("F200", "F150"))
    said, _ = ended(capsys, "simulate", str(out), "-m", "stepper")
    assert any("changed since then" in line for line in said)


def test_diff_and_json_have_the_line(part: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out.ngc"
    said, text = ended(capsys, "convert", str(part), "-m", "stepper", "-o", str(out), "--json")
    assert json.loads(text)["result_line"] == said[-1]
    assert main(["diff", str(part), str(out), "-m", "stepper", "--json"]) == 1
    line = json.loads(capsys.readouterr().out)["result_line"]
    assert line.split("; ")[:2] == said[-1].split("; ")[:2]


def test_an_axis_with_an_offset_is_compensated_where_nobody_knows_that_it_reversed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # Behind a line that is not understood X moves on with its offset: beside `no axis compensated` stood its offset.
    program, machine = tmp_path / "part.mpf", tmp_path / "mill.toml"
    program.write_text(
        "G17 G90 G94 G71\nG0 X0 Y0 Z50\nG0 X-10 Y20\nG0 Z2\nG1 Z-3 F200\nG1 X20 F600\nG2 X40 Y40 CR=20\n"
        "G3 X60 Y60 I20 J0\nG1 X80 RND=5\nG1 Y20\nG2 X40 Y20 I-20 J0\nG1 X20\nCYCLE81(10,0,2,-5)\nG0 Z50\nM30\n"
    )
    drive = ("--position-gain", "2m/min/mm", "--feedforward", "90%", "--lost-motion", "0.03", "--dialect", "siemens")
    assert main(["machine", "new", str(machine), "--yes", "--loop", "motor", *drive]) == 0
    capsys.readouterr()
    said, text = ended(capsys, "convert", str(program), "-m", str(machine), "-o", str(tmp_path / "out.mpf"), "--json")
    view = json.loads(text)
    assert list(view["offsets"]) == view["axes"] == ["X"]
    assert said[-1].endswith("; X compensated, 0 of 4 reversals")


def test_where_lag_is_led_the_error_by_all_causes_is_said_too() -> None:
    # A machine with friction and lag: alone, backlash adds next to nothing to what is off by ten times as much.
    plain, led = (ContourError(max=high, rms=low) for high, low in ((61.6e-6, 44.7e-6), (6.3e-6, 0.8e-6)))
    gap = (ContourError(max=0.4e-6, rms=0.04e-6), ContourError(max=6.6e-6, rms=1e-6))
    summary = ResultSummary(
        time=(12.67, 13.83), error=(plain, led), error_gap=gap, axes=("X",), leads="friction and lag"
    )
    (line,) = result_lines(summary)
    assert line.endswith("; error with friction and lag 62 → 6.3 µm max, 45 → 0.8 µm rms")
    (without,) = result_lines(replace(summary, leads=""))
    assert line == without.replace("error by all causes", "error with friction and lag")
    (lag,) = result_lines(replace(summary, leads="lag"))
    assert lag.endswith("; error with lag 62 → 6.3 µm max, 45 → 0.8 µm rms")
    small = (ContourError(max=60e-6, rms=44e-6), gap[1])
    assert result_lines(replace(summary, error_gap=small)) == result_lines(replace(summary, leads="", error_gap=small))
    (alone,) = result_lines(replace(summary, alone=True))
    assert alone.endswith("; error with friction and lag 6.3 µm max, 0.8 µm rms")
    (worst,) = result_lines(replace(summary, error_worst=ContourError(max=14.8e-6, rms=1e-6)))
    assert worst.endswith(" 62 → 6.3 µm max (15 in the worst case of the machine file), 45 → 0.8 µm rms")
    assert result_lines(replace(summary, error_worst=ContourError(max=6.6e-6, rms=1e-6))) == [line]


def test_where_backlash_adds_more_than_before_the_error_by_all_causes_is_said() -> None:
    # A drive overshoots where it stops, and its backlash hid some of that: of a better part `21 → 24 µm` stood alone.
    summary = ResultSummary(
        time=(19.1, 19.3),
        error=(ContourError(max=29.6e-6, rms=11.4e-6), ContourError(max=23.4e-6, rms=3.9e-6)),
        error_gap=(ContourError(max=20.7e-6, rms=10.8e-6), ContourError(max=24.1e-6, rms=4.2e-6)),
    )
    (line,) = result_lines(summary)
    assert line.startswith("backlash error 21 → 24 µm max")
    assert line.endswith("; error by all causes 30 → 23 µm max, 11 → 3.9 µm rms")
    (less,) = result_lines(replace(summary, error_gap=summary.error_gap[::-1]))
    assert "all causes" not in less


def test_a_cause_that_a_program_has_thousands_of_names_twenty_places(
    part: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drilled = "".join(f"G98 G81 X{hole} Y10 Z-1 R1 F100\nG80\nG0 Z3\n" for hole in range(25))
    part.write_text(POCKET.replace("G0 Z2\n", "G0 Z2\n" + drilled))
    said, _ = ended(capsys, "convert", str(part), "-m", "stepper", "--max-slowdown", "10")
    drills = [line for line in said if "canned cycle: " in line and line.startswith("warning: ")]
    assert len(drills) == 20
    assert sum("canned cycle in 5 more places: passed through unchanged" in line for line in said) == 1


@pytest.mark.parametrize(("causes", "each"), [(25, 2), (70, 1)])
def test_many_causes_share_sixty_places(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], causes: int, each: int
) -> None:
    part = tmp_path / "part.mpf"
    odd = "".join(f"SYG{number}=1\nG90\n" for _ in range(3) for number in range(causes))
    part.write_text("G71 G90 G94\nG0 X0 Y0 Z5\n" + odd + "G1 Z-1 F100\nX10\nX0\nM30\n")
    said, _ = ended(capsys, "convert", str(part), "-m", "mill", "--dialect", "siemens", "--no-simulation")
    named = [one[1] for line in said if (one := re.match(r"warning: \S+part\.mpf:\d+[^:]*: (SYG\d+)=1: ", line))]
    assert len(named) == min(60, each * causes)
    assert all(named.count(one) == each for one in named)
    more = [int(one[1]) for line in said if (one := re.search(r"(\d+) more places?[^:]*: passed through", line))]
    assert len(named) + sum(more) == 3 * causes
    assert any("of 10 other causes: passed" in line for line in said) == (causes == 70)


def test_the_stretch_that_is_named_is_one_that_the_advice_helps() -> None:
    text = "G21 G90\nG500\nG0 X0 Y0 Z5\nG81 X1 Y1 Z-1 R1 F100\nG80\nM101\nG90\nM102\nG90\nM103\nG90\nM2\n"
    (said,) = passed_through(read_program(text.encode(), "part.ngc"), "linuxcnc")
    assert "(line 4: canned cycle: G81; --expand writes it out as plain moves;" in said
    assert said.endswith("says that M101, M102 and M103 move nothing)")


def test_each_axis_has_its_own_reason() -> None:
    rows = [AxisReversals(axis=name, compensated=0, all=2, cut=2) for name in "XY"]
    warnings = [
        f"axis {name} not compensated in line 3: its crossings would cost {price} s; --max-slowdown 3 would allow them"
        for name, price in (("X", 6.1), ("Y", 0.2))
    ]
    assert left_words(rows, warnings, ()) == (
        "X at 2 of 2 reversals, Y at 2 of 2 reversals: X's crossings would cost 6.1 s; --max-slowdown 3 would allow "
        "them; Y's crossings would cost 0.2 s; --max-slowdown 3 would allow them"
    )
    # What keeps another axis is no reason.
    assert left_words(rows[1:], warnings, ()) == (
        "Y at 2 of 2 reversals: its crossings would cost 0.2 s; --max-slowdown 3 would allow them"
    )


def test_what_moves_nothing_that_is_understood_is_said_without_the_file(
    part: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    part.write_text("o<sub> sub\nG1 X1 F100\no<sub> endsub\nM2\n")
    said, _ = ended(capsys, "convert", str(part), "-m", "mill")
    assert said[-1] == "backlash error not simulated: the program moves nothing that is understood"


def test_a_table_of_an_unknown_kind_is_refused_before_anything_is_planned(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["convert", "nowhere.json", "-m", "nowhere.toml", "--table", str(tmp_path / "t.xls")]) == 2
    assert "unknown kind of table; expected one of .csv, .npz, .parquet; got .xls" in capsys.readouterr().err


MEASURED = """name = "measured"
[controller]
dialect = "linuxcnc"
servo_period_ms = 1.0
[axes.X]
feedback = "none"
b = 0
c = 0
lost_motion_mm = 0.1
backlash_uncertainty = {x}
max_velocity_mm_s = 80
max_acceleration_mm_s2 = 800
max_jerk_mm_s3 = 20000
[axes.Y]
feedback = "none"
b = 0
c = 0
lost_motion_mm = 0.02
backlash_uncertainty = {y}
max_velocity_mm_s = 80
max_acceleration_mm_s2 = 800
max_jerk_mm_s3 = 20000
"""
SQUARE = "G21 G90 G61\nG0 X5 Y5\nG1 X35 F600\nG1 Y25\nG1 X5\nG1 Y5\nG1 X35\nM2\n"


@pytest.mark.parametrize(("x", "y", "words"), [(0.05, 0.2, "X 5 %, Y 20 %"), (0.05, 0.05, "5 %"), (0.1, 0, "X 10 %")])
def test_the_backlash_of_each_axis_is_off_by_what_its_own_measurement_leaves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], x: float, y: float, words: str
) -> None:
    (tmp_path / "measured.toml").write_text(MEASURED.format(x=x, y=y))
    (tmp_path / "part.ngc").write_text(SQUARE)
    arguments = ["convert", str(tmp_path / "part.ngc"), "-m", str(tmp_path / "measured.toml"), "--json"]
    assert main(arguments) == 0
    view = json.loads(capsys.readouterr().out)
    # The table is off by half of what the backlash of its axis is: across a side by its axis, in a corner by both.
    off = (1e3 * x * 0.1 / 2, 1e3 * y * 0.02 / 2)
    worst = 1e3 * view["error_gap"]["after_worst"]["max"]
    assert max(off) - 0.2 <= worst <= (off[0] ** 2 + off[1] ** 2) ** 0.5 + 0.6
    assert re.search(r"\([\d.]+ if the backlash is (.*) off\)", view["result_line"])[1] == words  # type: ignore[index]


def test_how_many_lines_are_passed_through_is_said_where_they_are_many() -> None:
    text = "G90\nG1 X0 Y0 F600\n" + "PARK\n" + "G1 X1 E1\nG1 X2 E2\n" * 60
    (said,) = passed_through(read_program(text.encode(), "a", language=find_dialect("klipper").language), "klipper")
    assert said.startswith("2 stretches of 121 lines passed through unchanged (line 3: ")
    assert "PARK moves nothing" not in said


def test_an_axis_with_an_offset_that_never_reverses_is_compensated(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Homed from above, and raised to the first layer, the nozzle of a print is a backlash too low."""
    part = tmp_path / "print.gcode"
    part.write_text(
        "G21\nG90\nM83\nG28\nG1 Z0.2 F1200\nG1 X50 Y50 F6000\nG1 X80 E1 F1500\nG1 X50 E1\nG1 X80 E1\nG1 Z5\nG28 X\n"
    )
    out = tmp_path / "out.gcode"
    said, _ = ended(capsys, "convert", str(part), "-m", "stepper", "--dialect", "marlin", "-o", str(out), "--json")
    offsets = re.findall(r"offset ([XYZ]) ", out.read_text())
    assert "Z" in offsets
    assert f"; {', '.join(offsets)} compensated" in said[-1]
