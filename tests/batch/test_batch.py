"""Every program of a folder through `convert`: bytes, rows, what is refused, and what a second run does."""

import contextlib
import csv
import io
import json
import os
import shlex
import time
from pathlib import Path

import pytest

import ph_post as ph
from ph_post.batch import run as engine
from ph_post.batch.rows import COLUMNS, BatchRow, csv_text, read_rows
from ph_post.batch.work import BatchJob, BatchOutcome, OtherVersionError, convert_job
from ph_post.batch.workers import LostJobError
from ph_post.cli.main import main
from ph_post.files.storage import SourceBytes

PART = "G21 G90\nG0 X0 Y0\nG1 X10 F600\nY10\nX0\nY0\nM2\n"
FEW = ("--no-simulation",)


class Here:
    """Workers without processes; a job whose name is in `deadly` kills all that take it."""

    deadly: tuple[str, ...] = ()
    stop_after = 10**6
    count = 1

    def __init__(self):
        self.done = []

    def wait(self, _progress):
        """They are here."""

    def on_each(self, *_):
        """Nothing has to be compiled."""

    def run(self, function, jobs, progress=None, bundling=None):
        for number, (name, job) in enumerate(jobs):
            if number == self.stop_after:
                raise KeyboardInterrupt
            self.done.append(job.file)
            yield name, LostJobError("4 workers died of it") if job.file in self.deadly else function(job)


def quick(job):
    """Stand in for the conversion, where what is made of a program does not matter."""
    data = job.source.data
    if data.startswith(b"{") or data == b"G1 X\n":
        return BatchOutcome(row=BatchRow(file=job.file, machine=job.label, status="refused", reason="bad"))
    changed = data if b"G1" not in data else data + b"(ph-post 9 compensated this program)\n"
    status = "unchanged" if changed == data else "compensated"
    return BatchOutcome(row=BatchRow(file=job.file, machine=job.label, status=status), program=changed)


@pytest.fixture
def here(real, monkeypatch):
    monkeypatch.setattr(engine, "convert_job", quick)
    return real


@pytest.fixture
def real(monkeypatch):
    workers = Here()
    monkeypatch.setattr(engine, "open_workers", lambda count, scheduler: contextlib.nullcontext(workers))
    return workers


@pytest.fixture
def folder(tmp_path):
    programs = tmp_path / "in"
    (programs / "deep").mkdir(parents=True)
    (programs / "part.ngc").write_text(PART)
    (programs / "deep" / "other.NC").write_text(PART.replace("10", "20"))
    (programs / "bad.json").write_text('{"format":')
    (programs / "notes.md").write_text("no program")
    (programs / ".hidden.ngc").write_text(PART)
    return programs


def rows_of(out):
    with (out / "report.csv").open(newline="") as file:
        return {(row["file"], row["machine"]): row for row in csv.DictReader(file)}


def batch(folder, out, *more, machine="router"):
    return main(["batch", str(folder), "-m", machine, "-o", str(out), *FEW, *more])


def test_every_program_is_what_convert_writes_and_has_its_row(real, folder, tmp_path, capsys):
    out = tmp_path / "out"
    assert batch(folder, out, "--json") == 1
    said = capsys.readouterr()
    view = json.loads(said.out)
    assert (view["programs"], view["compensated"], view["refused"], view["kept"]) == (3, 2, 1, 0)
    assert "bad.json for router: refused: " in said.err
    assert "3 results: 2 compensated, 1 refused" in said.err
    rows = rows_of(out)
    assert list(rows) == [(name, "router") for name in ("bad.json", "deep/other.NC", "part.ngc")]
    for name in ("deep/other.NC", "part.ngc"):
        assert main(["convert", str(folder / name), "-m", "router", "-o", str(tmp_path / "one.ngc"), *FEW]) == 0
        assert (out / name).read_bytes() == (tmp_path / "one.ngc").read_bytes()
        row = rows[name, "router"]
        assert (row["status"], row["reversals"], row["compensated"], row["compensated_share"]) == (
            *("compensated", "2", "2", "1.0"),
        )
        assert float(row["seconds"]) > 0.0
        assert row["error_before_mm"] == ""
    refused = rows["bad.json", "router"]
    assert refused["status"] == "refused"
    assert refused["reason"].startswith(str(folder / "bad.json"))
    assert sorted(one.name for one in out.iterdir() if one.is_file()) == [
        *("part.ngc", "report.csv", "report.html", "report.parquet"),
    ]


def test_the_row_has_the_numbers_of_convert(real, tmp_path, capsys):
    programs = tmp_path / "in"
    programs.mkdir()
    (programs / "part.ngc").write_text(PART)
    assert main(["batch", str(programs), "-m", "stepper", "-o", str(tmp_path / "out")]) == 0
    capsys.readouterr()
    assert main(["convert", str(programs / "part.ngc"), "-m", "stepper", "--json"]) == 0
    view = json.loads(capsys.readouterr().out)
    (row,) = rows_of(tmp_path / "out").values()
    expected = {
        "error_before_mm": view["error"]["before"]["max"],
        "error_after_mm": view["error"]["after"]["max"],
        "error_gap_before_mm": view["error_gap"]["before"]["max"],
        "error_gap_after_mm": view["error_gap"]["after"]["max"],
        "error_gap_worst_mm": view["error_gap"]["after_worst"]["max"],
        "rms_gap_before_mm": view["error_gap"]["before"]["rms"],
        "rms_gap_after_mm": view["error_gap"]["after"]["rms"],
        "time_before_s": view["cycle_time"]["before"],
        "time_after_s": view["cycle_time"]["after"],
    }
    assert {name: float(row[name]) for name in expected} == pytest.approx(expected, abs=6e-4, rel=1e-9)
    assert float(row["error_gap_before_mm"]) == pytest.approx(expected["error_gap_before_mm"], abs=1e-6)
    assert row["warnings"].split(" | ") == [" ".join(word.split()) for word in view["warnings"]]
    assert (row["not_compensated"] or None) == view["not_compensated"]


def test_parquet_holds_what_the_csv_holds(here, folder, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    assert batch(folder, tmp_path / "out") == 1
    table = parquet.read_table(tmp_path / "out" / "report.parquet").to_pydict()
    rows = list(rows_of(tmp_path / "out").values())
    assert list(table) == list(rows[0])
    for name, cells in table.items():
        numbers = [row[name] for row in rows]
        if isinstance(cells[0], float):
            numbers = [float(cell or "nan") for cell in numbers]
        assert cells == pytest.approx(numbers, nan_ok=True) if isinstance(cells[0], float) else cells == numbers


def test_a_second_run_does_nothing(here, folder, tmp_path, capsys):
    out = tmp_path / "out"
    batch(folder, out)
    before = {file: (file.read_bytes(), file.stat().st_mtime_ns) for file in out.rglob("*") if file.is_file()}
    done = len(here.done)
    capsys.readouterr()
    assert batch(folder, out) == 1
    assert len(here.done) == done
    said = capsys.readouterr().err
    assert "3 results: 2 compensated, 1 refused; 3 of an earlier run" in said
    assert said.endswith(f"; why is in {out / 'report.csv'}, exit status 1\n")
    assert len(before) == 5
    assert {file: (file.read_bytes(), file.stat().st_mtime_ns) for file in before} == before


@pytest.mark.parametrize(
    ("change", "again"),
    [
        (lambda folder, out: (folder / "part.ngc").write_text(PART + "\n"), ["part.ngc"]),
        (lambda folder, out: (out / "part.ngc").unlink(), ["part.ngc"]),
        (
            lambda folder, out: (out / "part.ngc").write_text(PART + "(ph-post 9 compensated this program)"),
            ["part.ngc"],
        ),
        (lambda folder, out: (folder / "new.ngc").write_text(PART), ["new.ngc"]),
        (lambda folder, out: (folder / "bad.json").unlink(), []),
    ],
    ids=["program", "output missing", "output changed", "a new one", "one less"],
)
def test_what_has_changed_is_done_again(here, folder, tmp_path, change, again):
    out = tmp_path / "out"
    batch(folder, out)
    here.done.clear()
    change(folder, out)
    batch(folder, out)
    assert here.done == again
    assert {name for name, _ in rows_of(out)} == {
        file.relative_to(folder).as_posix()
        for file in folder.rglob("*.*")
        if file.suffix in (".ngc", ".NC", ".json") and not file.name.startswith(".")
    }


def test_other_options_and_another_machine_are_other_work(here, folder, tmp_path):
    out = tmp_path / "out"
    batch(folder, out)
    more = ["--max-slowdown", "0.3"]
    here.done.clear()
    assert batch(folder, out, *more) == 1
    assert len(here.done) == 3
    text = Path("samples/machines/router.toml").read_text()
    (tmp_path / "router.toml").write_text(text + "\n")
    here.done.clear()
    batch(folder, out, *more, machine=str(tmp_path / "router.toml"))
    assert len(here.done) == 3


def test_another_version_does_all_again(here, folder, tmp_path, monkeypatch):
    batch(folder, tmp_path / "out")
    here.done.clear()
    monkeypatch.setattr(engine, "package_version", lambda: "9.9")
    batch(folder, tmp_path / "out")
    assert len(here.done) == 3


def test_a_stopped_batch_goes_on_where_it_stopped(here, folder, tmp_path, capsys):
    out = tmp_path / "out"
    here.stop_after = 1
    assert batch(folder, out) == 130
    assert len(rows_of(out)) == 1
    assert "interrupted" in capsys.readouterr().err
    # As if it had been killed while it wrote a row.
    with (out / "report.csv").open("a") as file:
        file.write('part.ngc,router,compensated,"cut')
    here.stop_after = 10
    assert batch(folder, out) == 1
    assert sorted(here.done) == ["bad.json", "deep/other.NC", "part.ngc"]
    assert len(rows_of(out)) == 3


def test_what_no_worker_survives_is_one_row_and_is_tried_again(here, folder, tmp_path, capsys):
    out = tmp_path / "out"
    here.deadly = ("part.ngc",)
    assert batch(folder, out) == 1
    assert rows_of(out)["part.ngc", "router"]["status"] == "failed"
    assert "part.ngc for router: failed: 4 workers died" in capsys.readouterr().err
    assert not (out / "part.ngc").exists()
    here.deadly = ()
    here.done.clear()
    batch(folder, out)
    assert here.done == ["part.ngc"]


def test_several_machines_have_a_folder_each(here, folder, tmp_path):
    out = tmp_path / "out"
    assert main(["batch", str(folder), "-m", "router", "-m", "stepper", "-o", str(out), *FEW]) == 1
    assert {machine for _, machine in rows_of(out)} == {"router", "stepper"}
    assert all((out / name / "part.ngc").exists() for name in ("router", "stepper"))
    here.done.clear()
    assert main(["batch", str(folder), "-m", "router", "stepper", "-o", str(out), *FEW]) == 1
    assert here.done == []


def test_paths_get_the_ending_of_the_dialect_and_options_of_their_own(real, tmp_path):
    programs = tmp_path / "in"
    programs.mkdir()
    (programs / "line.json").write_text(
        '{"format":"ph-post-path","version":1,"name":"line","units":"mm","axes":["X","Y"],"feed":600,"closed":false,'
        '"segments":[{"type":"line","points":[[0,0],[10,0]]}]}'
    )
    (programs / "part.ngc").write_text(PART)
    assert batch(programs, tmp_path / "out", "--feed", "300", machine="stepper") == 0
    assert "F300" in (tmp_path / "out" / "line.ngc").read_text()
    assert "F300" not in (tmp_path / "out" / "part.ngc").read_text()


def test_two_files_that_would_be_one_are_refused(here, folder, tmp_path):
    (folder / "part.json").write_text("{}")
    batch(folder, tmp_path / "out")
    rows = rows_of(tmp_path / "out")
    assert [rows[name, "router"]["status"] for name in ("part.json", "part.ngc")] == ["refused", "refused"]
    assert "part.json and part.ngc would be one file" in rows["part.ngc", "router"]["reason"]
    assert not (tmp_path / "out" / "part.ngc").exists()


def test_what_somebody_else_wrote_stays(here, folder, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "part.ngc").write_text("G0 X1 (mine)\n")
    batch(folder, out)
    assert "not written by ph-post" in rows_of(out)["part.ngc", "router"]["reason"]
    assert (out / "part.ngc").read_text() == "G0 X1 (mine)\n"
    batch(folder, out, "--force")
    assert "ph-post" in (out / "part.ngc").read_text()


def test_an_output_of_an_earlier_run_is_named_where_its_program_is_refused_now(here, folder, tmp_path):
    out = tmp_path / "out"
    (folder / "part.ngc").write_text("G21 G90\nG0 X0 Y0\nM2\n")
    batch(folder, out)
    assert rows_of(out)["part.ngc", "router"]["status"] == "unchanged"
    (folder / "part.ngc").write_text("G1 X\n")
    batch(folder, out, "--strict")
    assert "part.ngc is of an earlier run" in rows_of(out)["part.ngc", "router"]["reason"]
    (folder / "part.ngc").write_text(PART)
    batch(folder, out, "--strict")
    assert rows_of(out)["part.ngc", "router"]["status"] == "compensated"


def test_what_a_program_that_is_written_out_reads_counts_too(real, tmp_path, capsys):
    programs, tools, out = tmp_path / "in", tmp_path / "tool.tbl", tmp_path / "out"
    programs.mkdir()
    (programs / "cut.ngc").write_text("G21 G90 G40\nT1 M6\nG0 X0 Y0\nG41 G1 X10 F600\nY10\nX0\nY0\nG40 X-9\nM2\n")
    (programs / "call.ngc").write_text("G21 G90\nG0 X0 Y0\nG1 X10 F600\no<side> call\nX0\nY0\nM2\n")
    side = programs / "side.ngc"
    side.write_text("o<side> sub\nG1 Y10\no<side> endsub\n")
    tools.write_text("T1 P1 D4\n")
    how = ("--expand", "--tool-table", str(tools), "--subprograms", str(programs))
    assert batch(programs, out, *how, machine="mill") == 0
    before = {name: (out / name).read_bytes() for name in ("cut.ngc", "call.ngc")}
    assert batch(programs, out, *how, machine="mill") == 0
    assert "3 of an earlier run" in capsys.readouterr().err
    tools.write_text("T1 P1 D6\n")
    side.write_text("o<side> sub\nG1 Y12\no<side> endsub\n")
    assert batch(programs, out, *how, machine="mill") == 0
    assert "of an earlier run" not in capsys.readouterr().err
    for name, old in before.items():
        assert main(["convert", str(programs / name), "-m", "mill", *how, "-o", str(tmp_path / "one"), *FEW]) == 0
        assert old != (out / name).read_bytes() == (tmp_path / "one").read_bytes()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("'' -m router -o out", "ph-post: '': no such folder; expected a folder of programs"),
        ("in -m router -o ''", "ph-post: -o: no folder; expected the name of a folder; got ''"),
        ("in -m router -o out --expand --tool-table none.tbl", "ph-post: none.tbl: no such file"),
        ("in -m router -o out --expand --subprograms none", "ph-post: none: no such folder; expected a folder of sub"),
        ("nowhere -m router -o out", "ph-post: nowhere: no such folder; expected a folder of programs"),
        ("in/part.ngc -m router -o out", "ph-post: in/part.ngc: is no folder; expected a folder; ph-post convert"),
        ("empty -m router -o out", "ph-post: empty: no programs; expected files that end in .cnc"),
        ("in -m router -o in", "ph-post: in: the outputs would overwrite the inputs; expected another folder"),
        ("in -m router -o .", "ph-post: in/part.ngc: an output would overwrite an input"),
        ("in -m router -o in/part.ngc", "in/part.ngc: cannot be written; expected a folder; got a file of that name"),
        ("in -m router -o mine", "mine/report.csv: is there already, and no report of ph-post batch"),
        ("in -m nothing -o out", "ph-post: nothing: no such file, and none of the shipped machines"),
        ("in -m router -m router -o out", "ph-post: -m router: two machines have this name"),
        ("in -o out", "ph-post: Missing option '-m' / '--machine'"),
        ("in -m router -o -", "ph-post: -o: no folder; expected the name of a folder; got '-'"),
        ("in -m router -o out --workers 0", "ph-post: Invalid value for '--workers'"),
        ("in -m router -o out --workers 2 --scheduler a", "ph-post: --workers is for processes of this computer"),
        ("in -m router -o out --ratio 0.3 --strategy nothing", "nothing"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(folder, tmp_path, monkeypatch, capsys, arguments, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "report.csv").write_text("part,price\nbolt,3\n")
    if arguments.endswith("-o ."):
        (folder / "in").mkdir()
        (folder / "in" / "part.ngc").write_text(PART)
    before = {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*")}
    assert main(["batch", *shlex.split(arguments)]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert words in said.err
    assert len(said.err.splitlines()) == 1
    assert {file: file.stat().st_mtime_ns for file in tmp_path.rglob("*")} == before


def test_the_folder_of_the_outputs_may_stand_among_the_programs(here, folder):
    assert batch(folder, folder / "out") == 1
    here.done.clear()
    assert batch(folder, folder / "out") == 1
    assert here.done == []
    assert len(rows_of(folder / "out")) == 3


def test_names_that_are_no_text_have_a_row(here, tmp_path):
    programs = tmp_path / "in"
    programs.mkdir()
    Path(os.fsdecode(bytes(programs) + b'/b\xe4d, "q".ngc')).write_text(PART)
    assert batch(programs, tmp_path / "out") == 0
    assert [name for name, _ in rows_of(tmp_path / "out")] == [r'b\xe4d, "q".ngc']
    assert any(os.fsencode(one.name) == b'b\xe4d, "q".ngc' for one in (tmp_path / "out").iterdir())


ALIKE = (
    b"a b",
    b"a  b",
    b"a\nb",
    b"a\\nb",
    b"a\tb",
    b"b\xe4d",
    b"b\xe5d",
    "b\xe4d".encode(),
    "b\x85".encode(),
    b"b\x85",
)


def test_names_that_look_alike_have_a_row_each(here, tmp_path, capsys):
    # Of "a b.ngc" and "a  b.ngc" one row was kept, and both were done again in each run.
    programs, out = tmp_path / "in", tmp_path / "out"
    programs.mkdir()
    for name in ALIKE:
        Path(os.fsdecode(bytes(programs) + b"/" + name + b".ngc")).write_text(PART)
    assert batch(programs, out) == 0
    assert f"{len(ALIKE)} results: {len(ALIKE)} compensated\n" in capsys.readouterr().err
    rows = rows_of(out)
    assert len(rows) == len({row["output"] for row in rows.values()}) == len(ALIKE)
    assert len((out / "report.csv").read_text().splitlines()) == len(ALIKE) + 1
    here.done.clear()
    assert batch(programs, out) == 0
    assert here.done == []


@pytest.mark.parametrize("sign", ["=", "+", "-", "@", "\uff1d", "'="])
def test_no_spreadsheet_takes_a_name_for_a_formula(here, tmp_path, sign):
    programs, out = tmp_path / "in", tmp_path / "out"
    programs.mkdir()
    names = [f"{sign}cmd|' -c calc'!A0.ngc", f"{sign}1.json", f"a;{sign}1.ngc"]
    for name in names:
        (programs / name).write_text(PART if name.endswith("ngc") else "{}")
    assert batch(programs, out) == 1
    with (out / "report.csv").open(newline="") as file:
        cells = [cell for row in csv.reader(file) for cell in row]
    assert not [one for cell in cells for one in cell.split(";") if one.startswith(tuple("=+-@\uff1d"))]
    assert sorted(row.file for row in read_rows(out / "report.csv")) == sorted(names)
    here.done.clear()
    batch(programs, out)
    assert here.done == []


def test_rows_survive_their_file(tmp_path):
    row = BatchRow(
        file='a,"b".ngc',
        machine="mill",
        status="compensated",
        error_gap_before=12.345e-6,
        time_before=1.25,
        reversals=3,
        compensated=2,
        axes=("X", "Y"),
        warnings=("one; two", "three"),
        key="sha256:0",
    )
    bare = BatchRow(file="b.ngc", machine="mill", status="refused", reason="=1+1")
    file = tmp_path / "report.csv"
    file.write_text(csv_text([row, bare], head=True))
    found = read_rows(file)
    assert found[1] == bare
    assert csv_text(found, head=True) == csv_text([row, bare], head=True)
    assert found[0].share == pytest.approx(2 / 3)
    head = next(csv.reader(io.StringIO(file.read_text())))
    assert head == list(COLUMNS.values())


def test_a_worker_of_another_version_refuses():
    source = SourceBytes(name="part.ngc", stem="part", data=PART.encode())
    job = BatchJob(
        file="part.ngc",
        label="router",
        source=source,
        machine=ph.read_machine("router"),
        options=engine.CompensateOptions(),
        version="0.0.1",
    )
    with pytest.raises(OtherVersionError, match=r"expected 0\.0\.1"):
        convert_job(job)


def test_the_function_gives_rows_in_si_units(here, folder, tmp_path):
    result = ph.batch(folder, ["router"], tmp_path / "out", simulation=False)
    assert [row.status for row in result.rows] == ["refused", "compensated", "compensated"]
    assert not result.ok
    assert result.counts["compensated"] == 2
    with pytest.raises(ph.InputError, match="interval-table"):
        ph.batch(folder, "router", tmp_path / "out", interval_table="table.json")


def test_what_it_says_on_the_way_is_little(monkeypatch):
    said = []
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    clock = engine._Clock(10_000, said.append)
    for _ in range(5000):
        now[0] += 1.0
        clock.step(2)
    assert len(said) < 320
    assert said[-1].startswith("49")
    assert said[-1].endswith("of 10000 done by 2 workers, at most about 85 min to go")
