"""The command line as other programs see it: streams, exit status, JSON keys, whole files or none."""

import importlib.util
import json
import math
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from support.front_door import run

import ph_post as ph
from ph_post.cli.main import COMMANDS, cli, main
from ph_post.quantities import micrometres
from ph_post.units import MM

ROOT = Path(__file__).resolve().parents[2]
CIRCLE = str(ROOT / "paths" / "circle.json")
OVAL = str(ROOT / "paths" / "oval.json")
POCKET = str(ROOT / "paths" / "pocket.json")
SUPPRESS = ("--strategy", "suppress")
QUICK = ("--effort", "0.01")


def strict_json(text: str) -> dict:
    def refuse(name: str) -> None:
        raise AssertionError(f"{name} in JSON")

    return json.loads(text, parse_constant=refuse)


def test_inspect_circle_shows_the_papers_lag_and_duration(capsys):
    # PAPER_NOTES §1: lag 0.005000674 s and duration 0.11874297 s, settled.
    status, out, err = run(capsys, "inspect", CIRCLE, "-m", "paper", "--json")
    assert (status, err) == (0, "")
    points = strict_json(out)["turning_points"]
    assert len(points) == 4
    for point in (point for point in points if point["axis"] == "X"):
        assert point["backlash"]["lag"] == pytest.approx(0.00500067, abs=5e-9)
        assert point["backlash"]["duration"] == pytest.approx(0.11874297, abs=5e-9)
        assert point["backlash"]["standstill_travel"] == pytest.approx(130.8996939 * 0.11874297, rel=1e-7)


def test_inspect_circle_geometry(capsys):
    _, out, _ = run(capsys, "inspect", CIRCLE, "--json")
    points = strict_json(out)["turning_points"]
    assert [(point["axis"], point["sense"]) for point in points] == [
        ("X", "max"),
        ("Y", "max"),
        ("X", "min"),
        ("Y", "min"),
    ]
    for quarter, point in enumerate(points):
        assert point["kind"] == "smooth"
        assert point["segment"] == 0
        assert point["xi"] == pytest.approx(quarter / 4, abs=1e-15)
        assert point["s"] == pytest.approx(quarter * 125 * math.pi, abs=1e-9)
        assert point["radius"] == pytest.approx(250, rel=1e-14)
        assert point["curvature"] == pytest.approx(1 / 250, rel=1e-14)
        assert point["backlash"] is None
        assert point["window"]["limited_by"] == "neighbour"
        assert point["window"]["estimate"] is None
        assert point["window"]["half_length"] == pytest.approx(62.5 * math.pi, rel=1e-9)


def test_inspect_prints_a_line_a_turning_point(capsys):
    status, out, _ = run(capsys, "inspect", CIRCLE, "-m", "paper")
    assert status == 0
    assert "4 reversals on 1570.796 mm" in out
    assert sum(line.split()[:1] == [str(number)] for line in out.splitlines() for number in range(4)) == 4
    assert "118.743" in out


def test_certify_says_that_none_is_missing(capsys):
    status, out, _ = run(capsys, "inspect", OVAL, "--certify", "--json")
    assert status == 0
    view = strict_json(out)
    assert view["certificate"]["ok"] is True
    assert view["certificate"]["count"] == len(view["turning_points"]) == 4


def test_convert_writes_program_and_table_whole(capsys, tmp_path):
    program, table = tmp_path / "oval.ngc", tmp_path / "oval.csv"
    status, out, err = run(capsys, "convert", OVAL, "-m", "mill", *SUPPRESS, "-o", str(program), "--table", str(table))
    assert (status, out) == (0, "")
    written = [line for line in err.splitlines() if line.startswith("wrote ")]
    assert written == [f"wrote {table}", f"wrote {program}"]
    results = [line.partition(": backlash error ") for line in err.splitlines()[-2:]]
    assert [name for name, *_ in results] == ["table", "program"]
    assert program.read_text().rstrip().endswith("M2")
    rows = np.genfromtxt(table, delimiter=",", names=True)
    assert rows.dtype.names == ("t", "segment", "xi", "s", "X", "Y", "feed", "window")
    assert np.all(rows["feed"] >= 0)
    assert rows["feed"][0] == rows["feed"][-1] == 0


def test_convert_json_has_the_contracts_keys(capsys):
    status, out, _ = run(capsys, "convert", OVAL, "-m", "mill", *SUPPRESS, "--json")
    assert status == 0
    view = strict_json(out)
    assert {"windows", "cycle_time", "error"} <= view.keys()
    assert (view["carrier"], view["program"], view["table_error"]) == ("table", None, None)
    assert all(view["error"][when].keys() == {"max", "rms"} for when in ("before", "after"))
    assert 0 < view["error"]["after"]["max"] < view["error"]["before"]["max"]
    assert view["cycle_time"]["after"] > view["cycle_time"]["before"] > 0
    dips = [window for window in view["windows"] if window["profile"] is not None]
    assert len(dips) >= 3
    assert all(window["strategy"] == "suppress" and 0 <= window["profile"]["ratio"] < 1 for window in dips)


def test_auto_is_the_default_and_tells_what_it_chose(capsys, tmp_path):
    table, program = tmp_path / "oval.npz", tmp_path / "oval.ngc"
    both = ("--table", str(table), "-o", str(program))
    status, out, err = run(capsys, "convert", OVAL, "-m", "router", *QUICK, *both, "--json")
    assert status == 0
    view = strict_json(out)
    assert (view["strategy"], view["carrier"], view["program"]["strategy"]) == ("auto", "table", "auto")
    # Each window is crossed by the whole gap, down at a maximum and up at a minimum.
    gap = {"X": 0.120, "Y": 0.080}
    for window in view["windows"]:
        assert window["strategy"] != "auto"
        travel = sum(crossing["travel"] for crossing in window["crossings"])
        assert travel == pytest.approx(gap[window["axis"]] * (-1 if window["sense"] == "max" else 1))
    assert view["error"]["after"]["max"] < view["error"]["before"]["max"]
    climb = [warning for warning in view["warnings"] if "climb milling" in warning]
    assert len(climb) == 1
    assert "axes X, Y" in climb[0]
    assert climb[0] in err


@pytest.mark.slow
def test_what_a_table_would_reach_is_told_of_a_program_alone(capsys, tmp_path):
    program = ("-o", str(tmp_path / "oval.ngc"))
    _, out, err = run(capsys, "convert", OVAL, "-m", "mill", *SUPPRESS, *program, "--json")
    view = strict_json(out)
    assert view["carrier"] == "program"
    assert view["offsets"] == {"X": 0.0, "Y": 0.0}
    reached, after = view["table_error"]["max"], view["error"]["after"]["max"]
    sizes = micrometres(after * MM), micrometres(reached * MM)
    would = "of this program is {} µm; an interpolator table would reach {} µm".format(*sizes)
    assert (would in err) is (reached < after)
    _, out, _ = run(capsys, "convert", OVAL, "-m", "mill", *SUPPRESS, "--json")
    assert strict_json(out)["error"]["after"]["max"] == pytest.approx(reached, rel=1e-12)


def test_offsets_are_what_the_rows_add_to_the_path(capsys, tmp_path):
    table = tmp_path / "oval.csv"
    arguments = ("convert", OVAL, "-m", "mill", *SUPPRESS, "--no-simulation", "--table", str(table), "--json")
    declared = strict_json(run(capsys, *arguments)[1])["offsets"]
    largest = np.abs(added_to_the_path(table)).max(axis=0)
    assert [declared[axis] for axis in "XY"] == pytest.approx(largest, abs=1e-6)


def test_a_described_profile_is_had_without_naming_its_strategy(capsys):
    described = ("--ratio", "0.4", "--no-simulation", "--json")
    _, out, _ = run(capsys, "convert", OVAL, "-m", "mill", *described)
    assert strict_json(out)["strategy"] == "suppress"
    status, _, err = run(capsys, "convert", OVAL, "-m", "mill", "--strategy", "auto", *described)
    assert (status, err.count("\n")) == (2, 1)
    assert "strategy auto does not take it" in err


def test_the_help_page_tells_every_strategy(capsys):
    from ph_post.compensate.strategies.registry import find_strategy, strategy_names

    _, out, _ = run(capsys, "convert", "--help")
    # A line may be broken behind a hyphen.
    text = " ".join(out.split()).replace("--allow- retrograde", "--allow-retrograde")
    assert all(f"{name}: {find_strategy(name).summary}" in text for name in strategy_names())


def test_a_search_says_how_far_it_is():
    from ph_post.analysis.path_analysis import analyse
    from ph_post.compensate.options import PlanOptions
    from ph_post.compensate.plan import make_plan
    from ph_post.drive.machinefile import read_machine
    from ph_post.files.path import read_path

    told = []
    analysis = analyse(read_path(OVAL), read_machine("router"), 5e-6)
    make_plan(analysis, PlanOptions(strategy="auto", effort=0.01), told.append)
    searches = [text for text in told if text.startswith("searching")]
    # Reversals that are alike share a search: opposite ends of an oval are.
    assert set(searches) == {"searching the best for turning points: 1 of at most 4"}
    races = [text for text in told if text.startswith("racing")]
    assert races == [f"racing plan {n}" for n in range(1, len(races) + 1)] != []
    assert "proving the plan against the plain program" in told


def test_convert_simulates_only_where_that_is_asked_for(capsys):
    _, out, _ = run(capsys, "convert", OVAL, "-m", "mill", *SUPPRESS, "--json", "--no-simulation")
    view = strict_json(out)
    assert view["error"] == {"before": None, "after": None}
    assert view["error_gap"] == {"before": None, "after": None, "after_worst": None}
    assert view["reversals"]["all"] == 4


@pytest.mark.slow
def test_a_program_beside_a_table_is_said_not_to_lead(capsys, tmp_path):
    program, table = str(tmp_path / "oval.ngc"), str(tmp_path / "oval.csv")
    both = (*SUPPRESS, "-o", program, "--table", table)
    for more, said in (((), True), (("--no-inverse-dynamics",), False), (("--feed-only",), False)):
        status, _, err = run(capsys, "convert", OVAL, "-m", "mill", *both, *more)
        assert status == 0
        assert ("cannot carry the inverse dynamics" in err) is said
    _, _, err = run(capsys, "convert", OVAL, "-m", "mill", *SUPPRESS, "-o", program)
    assert "inverse dynamics" not in err


@pytest.mark.parametrize("strategy", ["none", "linear", "suppress", "dwell"])
@pytest.mark.parametrize("machine", ["mill", "router", "stepper"])
@pytest.mark.thinned(8)
def test_tables_keep_the_limits_with_all_that_is_added(capsys, tmp_path, strategy, machine):
    from ph_post.compensate.violations import check_command
    from ph_post.drive.machinefile import read_machine
    from ph_post.files.table import read_table

    table = tmp_path / "oval.npz"
    status, _, _ = run(capsys, "convert", OVAL, "-m", machine, "--strategy", strategy, "--table", str(table))
    assert status == 0
    assert check_command(read_table(table), read_machine(machine)) == ()


@pytest.mark.slow
def test_tables_lead_the_path_but_for_the_baselines(capsys, tmp_path):
    # In steady motion along a line at V a lead is c V: at most 0.030 s of 20 mm/s here.
    table = tmp_path / "oval.csv"
    for strategy, leads in (("none", False), ("linear", False), ("suppress", True)):
        arguments = ("convert", OVAL, "-m", "mill", "--strategy", strategy, "--table", str(table))
        assert run(capsys, *arguments)[0] == 0
        added = np.abs(added_to_the_path(table)).max()
        assert bool(added > 0.2) is leads
        assert added < 0.030 * 20 * 1.1


def added_to_the_path(table):
    """What the rows of a table of the oval have beside the points of the path [mm], shape (n, 2)."""
    from ph_post.files.path import read_path
    from ph_post.geometry.track import Track

    rows = np.genfromtxt(table, delimiter=",", names=True)
    track = Track(read_path(OVAL))
    places = track.derivatives(*track.locate(np.clip(rows["s"] / 1000, 0.0, track.length)))[0] * 1000
    return np.column_stack([rows["X"], rows["Y"]]) - places


def test_convert_to_standard_output_is_the_program_alone(capsys):
    status, out, _ = run(capsys, "convert", OVAL, "-m", "mill", *SUPPRESS)
    assert status == 0
    assert out.rstrip().endswith("M2")
    assert "ph-post" in out.splitlines()[0] + out.splitlines()[1]


@pytest.mark.slow
def test_convert_is_deterministic(capsys):
    for strategy in (SUPPRESS, QUICK):
        arguments = ("convert", POCKET, "-m", "stepper", "--dialect", "grbl", *strategy)
        assert len({run(capsys, *arguments)[1] for _ in range(2)}) == 1


@pytest.mark.parametrize("ratio", [0.25, 0.6, 1.0])
def test_given_ratio_is_kept(capsys, ratio):
    arguments = ("convert", CIRCLE, "-m", "paper", "--start", "moving", "--ratio", str(ratio), "--json")
    _, out, _ = run(capsys, *arguments)
    ratios = [window["profile"]["ratio"] for window in strict_json(out)["windows"] if window["profile"]]
    assert ratios == pytest.approx([ratio] * 4, abs=1e-12)


def test_moving_holds_the_feed_from_end_to_end(capsys):
    # The paper's case: constant feed outside the windows, each traversed in (n+1)/(n+f) of its time.
    ratio, degree, t_star = 0.25, 10, 0.5
    f = (256 * ratio - 193) / 63
    arguments = ("--start", "moving", "--ratio", str(ratio), "--t-star", str(t_star), "--json")
    _, out, _ = run(capsys, "convert", CIRCLE, "-m", "paper", *arguments)
    time_ = strict_json(out)["cycle_time"]
    assert time_["before"] == pytest.approx(12.0, rel=1e-9)
    saved = 2 * t_star * (1 - (degree + f) / (degree + 1))
    assert time_["after"] == pytest.approx(12.0 + 4 * saved, rel=1e-9)


@pytest.mark.slow
def test_standard_input_and_output(capsys, monkeypatch, tmp_path):
    command = [sys.executable, "-m", "ph_post", "convert", "-", "-m", "mill", *SUPPRESS, "--table", "-"]
    text = Path(OVAL).read_text()
    done = subprocess.run(command, input=text, capture_output=True, text=True, check=True, cwd=tmp_path)
    assert done.stdout.startswith("t,segment,xi,s,X,Y,feed,window\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("convert",), "ph-post: Missing argument 'IN'; see ph-post convert --help"),
        (("convert", CIRCLE), "ph-post: Missing option '-m' / '--machine'; see ph-post convert --help"),
        (("nonsense",), "ph-post: No such command 'nonsense'; see ph-post --help"),
        (
            ("inspect", CIRCLE, "--tolerance", "0"),
            "ph-post: --tolerance: out of range; expected a finite number >= 1e-08; got 0",
        ),
        (
            ("convert", CIRCLE, "-m", "paper", "-o", "-", "--table", "-"),
            "ph-post: standard output can take one product; got -o and --table; see ph-post convert --help",
        ),
        (
            ("convert", CIRCLE, "-m", "paper", "--coefficients", "1,1,x"),
            "ph-post: Invalid value for '--coefficients': expected numbers separated by commas; got '1,1,x'; "
            "see ph-post convert --help",
        ),
    ],
)
def test_bad_usage_is_one_line_and_exit_2(capsys, arguments, line):
    status, out, err = run(capsys, *arguments)
    assert (status, out) == (2, "")
    assert err == line + "\n"


@pytest.mark.parametrize(
    ("option", "value", "given"),
    [
        ("max_slowdown", "-1", -1),
        ("tolerance", "nan", math.nan),
        ("effort", "1e9", 1e9),
        ("degree", "3", 3),
        ("degree", "1" + 20 * "0", 10**20),
        ("start", "late", "late"),
        ("part_side", "up", "up"),
        ("strategy", "best", "best"),
    ],
)
def test_a_bad_option_is_refused_in_the_same_words_by_python(capsys, option, value, given):
    status, out, err = run(capsys, "convert", OVAL, "-m", "mill", f"--{option.replace('_', '-')}={value}")
    assert (status, out, err.count("\n")) == (2, "", 1)
    with pytest.raises(ph.InputError) as refusal:
        ph.compensate(OVAL, "mill", **{option: given})
    said = err.removeprefix("ph-post: ").rstrip().replace("got 1e9", "got 1000000000.0")
    assert str(refusal.value).replace(">= 1e-11", ">= 1e-08") == said  # a tolerance is in metres here, in mm there


def test_a_machine_that_is_none_is_refused(capsys):
    with pytest.raises(ph.InputError, match="a plan needs a machine"):
        ph.compensate(OVAL, None, strategy="suppress")


def test_what_is_no_archive_is_no_interruption(capsys, tmp_path):
    for data, got in ((b"", "an empty file"), (b"\x80\x03}q\x00.", "other bytes"), (b"PK", "")):
        table = tmp_path / "table.npz"
        table.write_bytes(data)
        status, out, err = run(capsys, "simulate", table, "--path", OVAL, "-m", "mill")
        assert (status, out, err.count("\n")) == (2, "", 1)
        assert f"{table}: not an interpolator table; got {got}" in err
        assert "pickle" not in err


def test_without_a_command_it_prints_its_help_page_as_click_does(capsys):
    main(["--help"])
    page = capsys.readouterr().out
    assert main([]) == CliRunner().invoke(cli, []).exit_code
    streams = capsys.readouterr()
    assert streams.out + streams.err == page


def test_missing_drive_names_the_axis(capsys, tmp_path):
    status, out, err = run(capsys, "convert", str(ROOT / "paths" / "spatial.json"), "-m", "paper")
    assert (status, out) == (2, "")
    assert err.count("\n") == 1
    assert "axis Z, which has no drive" in err


def test_unwritable_output_touches_nothing(capsys, tmp_path):
    table = tmp_path / "oval.csv"
    table.write_text("precious")
    both = ("-o", str(tmp_path / "no" / "such" / "folder" / "oval.ngc"), "--table", str(table))
    status, out, err = run(capsys, "convert", OVAL, "-m", "mill", *SUPPRESS, *both)
    assert (status, out) == (2, "")
    assert err.count("\n") == 1
    assert table.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [table]


def test_demo_writes_programs_page_and_picture(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, out, err = run(capsys, "demo")
    assert (status, out) == (0, "")
    folder = tmp_path / "ph_post_demo"
    names = {"pocket.ngc", "pocket_compensated.ngc", "pocket.html", "pocket.png"}
    assert {path.name for path in folder.iterdir()} == names
    original = (ROOT / "samples" / "programs" / "pocket_grbl.ngc").read_bytes()
    assert (folder / "pocket.ngc").read_bytes() == original
    assert ph.undo(folder / "pocket_compensated.ngc") == original
    assert (folder / "pocket.png").read_bytes().startswith(b"\x89PNG")
    # The figures of the README: 0.03 and 0.04 mm off at once, and what is left of it, in a time that grows by 1 %.
    last = err.splitlines()[-1]
    assert last.startswith("backlash error 50 → 1.7 µm max (10 if the backlash is 20 % off), 35 → 0.2 µm rms; ")
    assert last.endswith("; 14.8 → 14.9 s; X, Y, Z compensated, 11 of 11 reversals")
    said = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    assert "from 50 to 1.7 µm, its rms from 35 to 0.2 µm" in said
    assert "14.9 s in place of 14.8 s" in said
    status, out, _ = run(capsys, "demo", "--json")
    assert strict_json(out)["reversals"] == {"compensated": 11, "all": 11}


def test_paper_numbers_all_agree(capsys):
    status, out, _ = run(capsys, "paper", "--json")
    assert status == 0
    numbers = strict_json(out)["numbers"]
    assert all(number["agrees"] for number in numbers)
    assert len(numbers) >= 14


@pytest.mark.slow
def test_paper_draws_its_figures(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr("ph_post.report.paper_figures.RATIOS", np.array([-0.5, 0.0, 1.0]))
    status, _, _ = run(capsys, "paper", "--figures", str(tmp_path / "figures"))
    assert status == 0
    pictures = {path.name: path.read_bytes() for path in (tmp_path / "figures").iterdir()}
    assert set(pictures) == {f"figure{number}.png" for number in (1, 2, 5, 6, 7, 8, 9, 10, 11)}
    assert all(picture.startswith(b"\x89PNG") for picture in pictures.values())


def test_paper_takes_plot_for_figures(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr("ph_post.report.paper_figures.paper_pictures", lambda _stage: {"figure1.png": b"drawn"})
    status, _, _ = run(capsys, "paper", "--plot", str(tmp_path))
    assert status == 0
    assert (tmp_path / "figure1.png").read_bytes() == b"drawn"


def test_every_command_has_help_with_examples_or_a_sentence(capsys):
    for name in COMMANDS:
        status, out, _ = run(capsys, name, "--help")
        assert status == 0
        assert "Usage: ph-post " + name in out
        assert len(out) > 300


def test_help_page_imports_nothing_slow():
    # The page has 0.2 s; numpy alone would take half of it, and sympy or matplotlib all.
    code = (
        "import sys; from ph_post.cli.main import main; main(['--help']); "
        "slow = ('numpy', 'scipy', 'sympy', 'matplotlib', 'msgspec'); "
        "print([name for name in slow if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.slow
def test_a_program_is_compensated_without_what_logs_need():
    # scipy.signal and scipy.stats take longer to load than a short program to compensate.
    words = ["convert", str(ROOT / "samples" / "programs" / "pocket_grbl.ngc"), "-m", "stepper", "-o", "-"]
    code = (
        f"import sys; from ph_post.cli.main import main; assert main({words!r}) == 0; "
        "slow = ('scipy.signal', 'scipy.stats', 'sympy', 'matplotlib'); "
        "print([name for name in slow if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_progress_speaks_only_after_a_second(capsys):
    from ph_post.cli.progress import ProgressPrinter

    with ProgressPrinter(patience=0.05) as progress:
        progress("counting")
        time.sleep(0.2)
    assert "ph-post: counting" in capsys.readouterr().err
    with ProgressPrinter(patience=5.0) as progress:
        progress("counting")
    assert capsys.readouterr().err == ""


def test_a_stage_that_goes_on_is_named_again(capsys, monkeypatch):
    from ph_post.cli import progress as module

    monkeypatch.setattr(module, "REMINDER", 3.0)
    begin = time.monotonic()
    with module.ProgressPrinter(patience=0.02) as progress:
        progress("searching")
        time.sleep(1.0)
    ticks = (time.monotonic() - begin) / 0.02
    told = capsys.readouterr().err.count("ph-post: searching")
    assert 2 <= told <= 1 + ticks / 3


def test_module_runs_like_the_script():
    assert importlib.util.find_spec("ph_post.__main__") is not None
    done = subprocess.run([sys.executable, "-m", "ph_post", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("ph-post, version ")


@pytest.mark.parametrize("threads", [None, "2"])
def test_a_command_has_one_thread_for_its_matrices_where_nobody_says_otherwise(threads):
    """The answer does not depend on how many processors there are, and none of them waits for another."""
    code = (
        "import os, sys; from ph_post.cli.main import console_main; console_main(); assert 'numpy' not in sys.modules"
    )
    code += "; print(os.environ['OPENBLAS_NUM_THREADS'])"
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    if threads is not None:
        environment["OPENBLAS_NUM_THREADS"] = threads
    command = [sys.executable, "-c", code, "--version"]
    found = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert found.stdout.splitlines()[-1] == (threads or "1")


def test_a_name_does_not_steer_the_terminal(tmp_path, capsys):
    place = tmp_path / "a\x1b[2J\x07\nb.ngc"
    status, out, err = run(capsys, "convert", str(place), "-m", "router")
    assert (status, out) == (2, "")
    assert err == f"ph-post: {tmp_path}/a?[2J? b.ngc: no such file\n"
