"""Jobs that are too large: refused in one line before anything is sampled, and written where only the report is."""

import json
import time

import pytest

import ph_post as ph
from ph_post.bounds import MOST_SAMPLES
from ph_post.cli.main import main
from ph_post.errors import InputError, TooLargeError

PLAIN = "G21\nG90\nG0 X0 Y0\n"
PROMPT = 60.0
"""Seconds within which a refusal comes, however busy the machine is."""


@pytest.fixture
def job(tmp_path, monkeypatch):
    """Return a function that writes a file of the folder in which the test runs, and the file's name."""
    monkeypatch.chdir(tmp_path)

    def write(name, text):
        (tmp_path / name).write_text(text, encoding="utf-8")
        return name

    return write


def path_file(feed, segment):
    head = {"format": "ph-post-path", "version": 1, "units": "mm", "axes": ["X", "Y"], "feed": feed, "closed": False}
    return json.dumps({**head, "segments": [segment]})


CIRCLE = {"type": "arc", "start": [10, 0], "end": [10, 0], "center": [0, 0], "turn": "ccw"}
FAR = {"type": "line", "points": [[0, 0], [9e8, 0]]}

# 100 m at 1 mm/min take 100,000 min = 6e6 s; 62.83 mm at F 6.283e303 s a mm; 900 km at 1000 mm/min 5.4e7 s.
TOO_LARGE = {
    "slow.ngc --table t.csv": (PLAIN + "G1 X100000 F1\nX0\nM2\n", "got 1.2e+10 of 1 ms, 3.33e+03 h"),
    "feed.json --table t.csv": (path_file(1e-300, CIRCLE), "got 3.77e+306 of 1 ms, 1.05e+300 h"),
    "feed.json -o o.ngc": (path_file(1e-12, CIRCLE), "got 3.77e+18 of 1 ms, 1.05e+12 h"),
    "far.json -o o.ngc": (path_file(1000, FAR), "got 5.4e+10 of 1 ms, 1.5e+04 h"),
}


@pytest.mark.parametrize("case", TOO_LARGE)
def test_a_job_that_is_too_large_is_refused_in_one_line_before_it_is_planned(case, job, capsys, tmp_path):
    text, got = TOO_LARGE[case]
    name, *how = case.split()
    begin = time.monotonic()
    assert main(["convert", job(name, text), "-m", "mill", *how]) == 2
    assert time.monotonic() - begin < PROMPT
    line = capsys.readouterr().err.splitlines()[-1]
    assert "the motion is too long to be sampled; expected at most 10,000,000 servo periods (a higher feed" in line
    assert line.endswith(got)
    assert [one.name for one in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize("command", ["simulate", "compare", "report"])
def test_every_command_that_samples_a_path_refuses_it(command, job, capsys):
    more = ["-o", "page.html"] if command == "report" else []
    assert main([command, job("feed.json", path_file(1e-12, CIRCLE)), "-m", "mill", *more]) == 2
    assert capsys.readouterr().err.count("too long to be sampled") == 1


SLOW = PLAIN + "G1 X500 F2\nG1 X0\nM2\n"
"""1000 mm at 2 mm/min are 30,000 s."""


def test_a_program_too_long_to_be_simulated_is_written_and_its_numbers_are_null(job, capsys, tmp_path):
    name = job("slow.ngc", SLOW)
    status = main(["convert", name, "-m", "router", "--dialect", "linuxcnc", "-o", "o.ngc", "--json"])
    streams = capsys.readouterr()
    assert status == 0, streams.err
    view = json.loads(streams.out)
    assert view["error"] == {"before": None, "after": None}
    assert view["cycle_time"] == {"before": None, "after": None}
    assert view["verified"]
    assert "G1" in (tmp_path / "o.ngc").read_text(encoding="utf-8")
    why = (
        "the motion is too long to be sampled; expected at most 10,000,000 servo "
        "periods (a higher feed, shorter dwells or a longer controller.servo_period_ms would help); got 3e+07 of "
        "1 ms, 8.33 h, most of it in line 4"
    )
    assert view["not_simulated"] == why
    assert any(f"backlash error not simulated: {why}" in line for line in streams.err.splitlines())


@pytest.mark.parametrize("dialect", ["grbl", "marlin", "klipper"])
def test_of_a_long_program_on_an_exact_path_the_time_is_known_all_the_same(dialect, job, capsys, tmp_path):
    name = job("slow.ngc", SLOW)
    assert main(["convert", name, "-m", "router", "--dialect", dialect, "-o", "o.ngc", "--json"]) == 0
    streams = capsys.readouterr()
    view = json.loads(streams.out)
    assert view["error"] == {"before": None, "after": None}
    assert view["cycle_time"]["before"] == pytest.approx(30000.0, abs=0.01)
    assert "backlash error not simulated, as it runs longer than 60 min" in streams.err


def test_the_line_says_which_line_takes_the_time_and_the_plain_run_says_it_too(job, capsys):
    name = job("dwell.ngc", PLAIN + "G1 X10 F600\nG4 P1000000000\nX0\nM2\n")
    assert main(["convert", name, "-m", "router", "-o", "o.ngc"]) == 0
    lines = [one for one in capsys.readouterr().err.splitlines() if "backlash error not simulated" in one]
    assert len(lines) == 1
    assert "got 1e+12 of 1 ms, 2.78e+05 h, most of it in line 6; " in lines[0]


def test_a_picture_of_what_cannot_be_simulated_is_refused_before_anything_is_written(job, capsys, tmp_path):
    name = job("slow.ngc", PLAIN + "G1 X100 F0.3\nX0\nM2\n")
    assert main(["convert", name, "-m", "router", "-o", "o.ngc", "--plot", "o.png"]) == 2
    assert "too long to be sampled" in capsys.readouterr().err
    assert [one.name for one in tmp_path.iterdir()] == [name]


def test_where_the_simulation_fails_the_program_is_written_all_the_same(job, capsys, tmp_path, monkeypatch):
    def out_of_memory(*_args, **_how):
        raise MemoryError

    monkeypatch.setattr("ph_post.api.results.PlannedRun", out_of_memory)
    name = job("part.ngc", PLAIN + "G1 X10 F600\nX0\nM2\n")
    assert main(["convert", name, "-m", "router", "-o", "o.ngc", "--json"]) == 0
    streams = capsys.readouterr()
    assert json.loads(streams.out)["error"] == {"before": None, "after": None}
    assert "backlash error not simulated: it needs more memory than there is; " in streams.err
    assert (tmp_path / "o.ngc").exists()


def test_a_path_is_written_where_its_simulation_fails(job, capsys, tmp_path, monkeypatch):
    def unsolved(*_args):
        raise ph.PhPostError("it cannot be solved")

    monkeypatch.setattr("ph_post.api.results.assess", unsolved)
    name = job("part.json", path_file(1000, CIRCLE))
    assert main(["convert", name, "-m", "mill", "--strategy", "suppress", "-o", "o.ngc", "--json"]) == 0
    streams = capsys.readouterr()
    view = json.loads(streams.out)
    assert view["error"] == {"before": None, "after": None}
    assert view["not_simulated"] == "it cannot be solved"
    assert "backlash error not simulated: it cannot be solved" in streams.err
    assert (tmp_path / "o.ngc").exists()


def test_a_stretch_too_long_to_be_planned_is_left_alone_and_named(job, capsys, tmp_path):
    text = PLAIN + "G1 X5 F600\nG2 X5 Y0 I1000000 J0 F60\nM2\n"  # 6283 m at 1 mm/s
    name = job("huge.ngc", text)
    assert main(["convert", name, "-m", "mill", "-o", "o.ngc", "--json"]) == 0
    view = json.loads(capsys.readouterr().out)
    assert (tmp_path / "o.ngc").read_text(encoding="utf-8") == text
    assert view["unchanged"]
    (left,) = (one for one in view["warnings"] if "windows not compensated" in one)
    assert left.startswith("lines 4 to 5: windows not compensated: huge: the motion is too long to be sampled")
    assert view["not_simulated"].endswith("got 6.28e+09 of 1 ms, 1.75e+03 h, most of it in line 5")


def test_a_comparison_says_why_it_has_no_error(job, capsys):
    name = job("slow.ngc", PLAIN + "G1 X100 F0.3\nX0\nM2\n")
    assert main(["diff", name, name, "-m", "router"]) == 0
    assert "no error are predicted: slow.ngc: the motion is too long to be sampled" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ("--max-slowdown=-0.1", "ph-post: --max-slowdown: out of range; expected a finite number >= 0; got -0.1\n"),
        ("--max-slowdown=ten", "ph-post: --max-slowdown: out of range; expected a finite number >= 0; got ten\n"),
        ("--max-slowdown=nan", "ph-post: --max-slowdown: out of range; expected a finite number >= 0; got nan\n"),
        ("--max-slowdown=inf", "ph-post: --max-slowdown: out of range; expected a finite number >= 0; got inf\n"),
        ("--max-slowdown=", "ph-post: --max-slowdown: out of range; expected a finite number >= 0; got nothing\n"),
        ("--effort=1e9", "ph-post: --effort: out of range; expected a finite number > 0 and at most 1000; got 1e9\n"),
        ("--effort=nan", "ph-post: --effort: out of range; expected a finite number > 0 and at most 1000; got nan\n"),
        ("--feed=inf", "ph-post: --feed: out of range; expected a finite number > 0; got inf\n"),
        ("--block-time=0", "ph-post: --block-time: out of range; expected a finite number > 0; got 0\n"),
        ("--tolerance=1e-300", "ph-post: --tolerance: out of range; expected a finite number >= 1e-08; got 1e-300\n"),
        (
            "--coefficients=1,nan,1",
            "ph-post: Invalid value for '--coefficients': expected numbers separated by commas; got '1,nan,1'; "
            "see ph-post convert --help\n",
        ),
    ],
)
def test_numbers_that_are_none_are_refused_in_one_line(option, message, job, capsys, tmp_path):
    name = job("part.json", path_file(1000, CIRCLE))
    assert main(["convert", name, "-m", "mill", "-o", "o.ngc", option]) == 2
    assert capsys.readouterr().err == message
    assert not (tmp_path / "o.ngc").exists()


@pytest.mark.parametrize("value", [-0.1, float("nan"), float("inf"), "ten"])
def test_python_refuses_the_same(value):
    with pytest.raises(InputError) as refusal:
        ph.compensate("circle", "paper", max_slowdown=value)
    assert str(refusal.value) == f"--max-slowdown: out of range; expected a finite number >= 0; got {value}"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--chord-tolerance", "1e-15"), "about 1.19e+09"),
        (("--chord-tolerance", "1e-300"), "about 3.77e+151"),
    ],
)
def test_a_program_of_too_many_blocks_is_refused(options, message, job, capsys, tmp_path):
    del job
    how = ["--strategy", "suppress", "-o", "o.ngc", *options]
    assert main(["convert", "butterfly", "-m", "mill", *how]) == 2
    line = capsys.readouterr().err.splitlines()[-1]
    assert line == (
        "ph-post: butterfly: the program is too long to be written; expected at most 1,000,000 blocks "
        f"(a larger --chord-tolerance would help); got {message}"
    )
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("source", ["part.ngc", "part.json"])
def test_blocks_shorter_than_a_servo_period_are_refused(source, job, capsys):
    text = PLAIN + "G1 X10 F600\nX0\nM2\n" if source.endswith("ngc") else path_file(1000, CIRCLE)
    how = ["--strategy", "suppress", "-o", "o.ngc", "--block-time", "1e-9"]
    assert main(["convert", job(source, text), "-m", "mill", *how]) == 2
    line = "ph-post: --block-time: shorter than the servo period; expected >= 1 ms; got 1e-09"
    assert capsys.readouterr().err.splitlines()[-1] == line


def test_the_bound_is_where_it_is_said_to_be():
    from ph_post.bounds import check_samples

    check_samples("part", MOST_SAMPLES * 1e-3, 1e-3, "nothing")
    with pytest.raises(TooLargeError):
        check_samples("part", (MOST_SAMPLES + 1) * 1e-3, 1e-3, "nothing")
