"""The front door: what it returns, and that the command writes the same bytes and says the same lines."""

import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
from support.streams import without_progress

import ph_post as ph
from ph_post.cli.main import main
from ph_post.compensate.strategies.base import StrategyTraits, traits_of
from ph_post.dialects.reading import read_as
from ph_post.dialects.registry import find_dialect
from ph_post.units import MM_PER_MIN

ROOT = Path(__file__).resolve().parents[2]
SAMPLES = ROOT / "samples"
PART = "G21 G90\nG0 X0 Y0\nG3 X0 Y0 I10 J0 F800\nM2\n"
ARC = "G21 G90\nG0 X0 Y0\nG3 X5 Y5 I5 J0 F800\nM2\n"
QUICK = 0.01


def answer(capsys, *arguments):
    """Run the command line; status and the line on standard error."""
    capsys.readouterr()
    status = main([str(one) for one in arguments])
    return status, capsys.readouterr().err


@pytest.fixture
def part(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("part.ngc").write_text(PART)
    return Path("part.ngc")


def test_the_five_lines_of_the_interface(part):
    machine = ph.read_machine("router")
    result = ph.compensate(ph.read_program("part.ngc"), machine, max_slowdown=10.0, effort=QUICK)
    # Backlash is gone but for a few micrometres at the crossings; the lag of the servos stays.
    assert result.after.error.max < 0.2 * result.before.error.max
    assert result.after.error.rms < 0.25 * result.before.error.rms
    assert result.after.time > result.before.time > 0.0
    assert result.after.error_gap.max < 0.15 * result.before.error_gap.max
    assert result.after.error_gap.rms < 0.05 * result.before.error_gap.rms
    assert result.after.error_gap_worst.max >= result.after.error_gap.max
    assert all(isinstance(word, str) for word in result.warnings)
    result.write("part_compensated.ngc")
    result.write_table("part.csv")
    assert Path("part_compensated.ngc").read_bytes() == result.program()
    assert Path("part.csv").read_text().startswith("t,segment,xi")
    assert (result.reversals, result.axes) == ((3, 3), ("X", "Y"))
    assert ph.undo("part_compensated.ngc") == PART.encode()


def test_an_axis_that_is_brought_onto_its_side_behind_a_rapid_is_in_the_air(part):
    """Ideal axes lose nothing on a frame once they are on their sides: what is left is a rounded decimal."""
    part.write_text("G21 G90 G94\nG0 X0 Y0\nG1 X40 F600\nY20\nX0\nY0\nM2\n")
    result = ph.compensate(part, "stepper")
    assert b"(ph-post: +3 -1 X approach, Y approach)" in result.program()
    # Half the lost motion of Y, 0.04 mm, and 0.01 mm of X that are left 0.02 mm behind the beginning.
    assert result.before.error.max == pytest.approx(0.0404e-3, rel=0.03)
    assert result.after.error.max < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "machine", "words", "options"),
    [
        ("oval", "router", ("--effort", QUICK), {"effort": QUICK}),
        ("circle", "mill", ("--ratio", "0.3", "--feed", "900"), {"ratio": 0.3, "feed": 900 * MM_PER_MIN}),
    ],
)
@pytest.mark.thinned(4)
def test_paths_are_written_as_the_command_writes_them(tmp_path, monkeypatch, capsys, path, machine, words, options):
    monkeypatch.chdir(tmp_path)
    assert answer(capsys, "convert", path, "-m", machine, "-o", "a.ngc", *words)[0] == 0
    assert answer(capsys, "convert", path, "-m", machine, "--table", "a.csv", *words)[0] == 0
    result = ph.compensate(ph.read_path(path), ph.read_machine(machine), **options)
    result.write("b.ngc")
    result.write_table("b.csv")
    assert Path("b.ngc").read_bytes() == Path("a.ngc").read_bytes()
    assert Path("b.csv").read_bytes() == Path("a.csv").read_bytes()


@pytest.mark.parametrize(
    ("text", "machine"), [("G21 G90\nG0 X0 Y0\nG1 X10 Y5 F600\nX0 Y10\nX10 Y15\nM2\n", "mill"), (ARC, "router")]
)
@pytest.mark.thinned(4)
def test_programs_are_written_as_the_command_writes_them(tmp_path, monkeypatch, capsys, text, machine):
    monkeypatch.chdir(tmp_path)
    Path("part.ngc").write_text(text)
    words = ("--effort", QUICK, "--max-slowdown", "0.5")
    assert answer(capsys, "convert", "part.ngc", "-m", machine, "-o", "a.ngc", *words)[0] == 0
    assert answer(capsys, "convert", "part.ngc", "-m", machine, "--table", "a.csv", *words)[0] == 0
    result = ph.compensate(ph.read_program("part.ngc"), machine, effort=QUICK, max_slowdown=0.5)
    result.write("b.ngc")
    result.write_table("b.csv")
    assert Path("b.ngc").read_bytes() == Path("a.ngc").read_bytes()
    assert Path("b.csv").read_bytes() == Path("a.csv").read_bytes()


def bad_files(kind, count):
    return [file for file in sorted((ROOT / "tests" / "bad" / kind).iterdir()) if file.suffix != ".error"][:count]


@pytest.mark.parametrize(
    "file", [*bad_files("paths", 4), *bad_files("programs", 3), *bad_files("machines", 3)], ids=lambda file: file.name
)
def test_bad_input_is_refused_in_the_command_s_words(capsys, file):
    job, machine = ("oval", file) if file.parent.name == "machines" else (file, "mill")
    # Lines of programs that are not understood are passed through unless they are to be refused.
    program = file.parent.name == "programs"
    words = ["--strict"] if program else []
    status, line = answer(capsys, "convert", job, "-m", machine, *words, "-o", "nowhere.ngc")
    with pytest.raises(ph.InputError) as refused:
        ph.compensate(str(job), machine, strict=program)
    assert status == 2
    assert without_progress(line).splitlines()[0] == f"ph-post: {' '.join(str(refused.value).split())}"


def test_options_of_paths_are_refused_for_programs(part, capsys):
    with pytest.raises(ph.InputError, match=r"^--feed is for path files; a part program keeps its own$"):
        ph.compensate(part, "router", feed=0.01)
    _, line = answer(capsys, "convert", part, "-m", "router", "--feed", "600")
    assert line.startswith("ph-post: --feed is for path files; a part program keeps its own")


def test_a_program_is_read_in_the_machine_s_language(part):
    program = ph.read_program(part, dialect="fanuc")
    result = ph.compensate(program, "router", strategy="none")
    assert result.unchanged
    assert result.original.language == find_dialect("linuxcnc").language != program.language


@pytest.mark.parametrize("command", [("convert",), ("filter",)], ids=lambda words: words[0])
@pytest.mark.thinned(4)
def test_every_command_falls_back_to_feeds_where_the_dialect_writes_no_jogs(tmp_path, monkeypatch, capfd, command):
    """Jogs between two stops are blended away where a dwell does not stop the axes."""
    monkeypatch.chdir(tmp_path)
    dialect = "linuxcnc"
    from ph_post.api import path_compensation

    def refuse(jogs, dialect):
        if jogs:
            raise ph.InputError("--dialect", "cannot write jogs")

    monkeypatch.setattr(path_compensation, "check_jogs", refuse)
    # As for languages whose programs are not changed by lines, and cross at stops.
    monkeypatch.setattr(path_compensation, "crosses_on_the_fly", lambda *_: False)
    words = ("--effort", str(QUICK), "--max-slowdown", "0.5", "--strategy", "auto")
    Path("oval.json").write_bytes((ROOT / "paths" / "oval.json").read_bytes())
    status = main([*command, "oval.json", "-m", "stepper", "--dialect", dialect, *words])
    out, err = capfd.readouterr()
    assert status == 0
    assert "nothing is added to the path: cannot write jogs" in err
    assert "G4 " not in out


def test_a_compensated_program_says_so_and_keeps_its_errors(part):
    first = ph.compensate(part, "router", max_slowdown=10.0)
    part.write_bytes(first.program())
    again = ph.compensate(part, "router", max_slowdown=10.0)
    assert again.already_compensated
    assert again.program() == first.program()
    assert again.after.error == first.after.error
    assert again.after.error_gap == first.after.error_gap


def test_the_gap_of_a_program_is_that_of_its_path(part):
    """On a plain program the two models of the motion differ at its beginning and in its corners alone."""
    result = ph.compensate(part, "router", strategy="none", output="program")
    path = ph.compensate(part, "router", strategy="none", output="table")
    assert result.before.error_gap.max == pytest.approx(path.before.error_gap.max, rel=0.05)
    assert result.before.error_gap_worst.max == pytest.approx(path.before.error_gap_worst.max, rel=0.05)


def test_nothing_slow_is_loaded_before_it_is_used():
    script = "import sys, ph_post; print([name for name in ('numpy', 'scipy', 'msgspec') if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == "[]"


def test_every_public_name_is_there_and_functions_keep_their_names():
    assert len(ph.__all__) <= 30
    assert all(getattr(ph, name).__doc__ for name in ph.__all__)
    import ph_post.simulate.assess  # noqa: F401 - a room of the same name

    assert all(not hasattr(getattr(ph, name), "__path__") for name in ph.__all__)


def test_a_strategy_of_others_has_the_usual_traits():
    class Bare:
        name, summary, feedbacks = "bare", "", frozenset()

        def profiles(self, task):
            raise AssertionError

    assert traits_of(Bare()) == StrategyTraits()


def test_results_need_no_simulation_to_be_shown():
    result = ph.compensate("circle", "paper", strategy="suppress", output="table")
    assert repr(result.before).startswith("PlannedMotion(time=")
    assert msgspec.structs.asdict(result.options)["strategy"] == "suppress"


@pytest.mark.slow
def test_a_table_says_by_its_times_what_comes_before_the_path(part, tmp_path):
    """Rows at negative times stand at the start; read back, the table has the error that is claimed."""
    result = ph.compensate("oval", "router", output="table", max_slowdown=0.5, effort=QUICK)
    rows = result.table()
    before = rows.t < -1e-9
    assert before.any()
    assert not rows.s[before].any()
    assert abs(rows.t[~before][0]) < 1e-12
    assert rows.s[~before][1] > 0.0
    assert [word for word in result.warnings if "must be off the part until t = 0" in word]
    result.write_table(tmp_path / "oval.csv")
    read = ph.simulate(tmp_path / "oval.csv", "router", path="oval")
    assert read.error.max == pytest.approx(result.after.error.max, rel=1e-6)
    pushed = ph.compensate("oval", "mill", output="table", effort=QUICK)
    assert pushed.table().t[0] < 0.0
    assert [word for word in pushed.warnings if "must be off the part until t = 0" in word]
    assert not ph.compensate("oval", "mill", output="table", strategy="suppress", effort=QUICK).table().t[0]


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (
            lambda: ph.compensate("circle", "stepper", output="page"),
            "--output: unknown; expected table or program; got page",
        ),
        (
            lambda: ph.compensate("circle", "stepper", start="slow"),
            "--start: unknown; expected rest or moving; got slow",
        ),
        (
            lambda: ph.simulate("circle", "stepper", output="page"),
            "--output: unknown; expected table or program; got page",
        ),
        (
            lambda: ph.simulate("circle", "stepper", pickup="no"),
            "--pickup: unknown; expected standstill or momentum or contact; got no",
        ),
        (
            lambda: ph.simulate("circle", "stepper", initial_flank="?"),
            "--initial-flank: unknown; expected + or -; got ?",
        ),
        (lambda: ph.inspect("circle", feed=-1.0), "--feed: out of range; expected a finite number > 0; got -1.0"),
        (
            lambda: ph.verify("a", "a", tolerance=-1.0),
            "--tolerance: out of range; expected a finite number >= 1e-11; got -1.0",
        ),
        (
            lambda: ph.diff("a", "a", tolerance=-1.0),
            "--tolerance: out of range; expected a finite number >= 1e-11; got -1.0",
        ),
    ],
)
def test_what_the_library_is_given_is_refused_as_the_command_refuses_it(call, words):
    with pytest.raises(ph.InputError) as found:
        call()
    assert str(found.value) == words


def test_a_loop_that_nobody_knows_is_refused():
    log = ph.read_log(ROOT / "samples" / "logs" / "worn_router.csv")
    with pytest.raises(ph.InputError, match="--feedback: unknown; expected load or motor or none; got screw"):
        ph.identify(log, feedback={"X": "screw"})


@pytest.mark.parametrize(
    ("dialect", "begin", "said"),
    [
        ("linuxcnc", "", "neither G20 nor G21"),
        ("linuxcnc", "G21", ""),
        ("fanuc", "", "neither G20 nor G21"),
        ("fanuc", "G20", ""),
        ("siemens", "", "neither G70 nor G71"),
        ("siemens", "G710", ""),
        ("grbl", "", ""),
    ],
)
def test_units_that_nobody_says_are_said_to_be_taken_for_mm(part, dialect, begin, said):
    machine = msgspec.structs.replace(ph.read_machine("stepper"), dialect=dialect)
    text = PART.replace("G21", begin).replace("M2", "M30")
    text = "".join(f"{line}\n" for line in text.split("\n") if line).replace("I10", "I10.").replace("Y0", "Y0.")
    part.write_text(text)
    result = ph.compensate(read_as(dialect, part.read_bytes(), "part.ngc"), machine, max_slowdown=10.0)
    assert not result.unchanged
    found = [one for one in result.warnings if "taken for mm" in one]
    assert [said in one for one in found] == [True] * bool(said)
