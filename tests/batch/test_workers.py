"""Real processes: of this computer, and of a scheduler that stands alone; killed, stopped, and of another version."""

import contextlib
import csv
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from distributed import system
from support.pipelines import heeding_interrupts

from ph_post.batch import workers as module
from ph_post.batch.workers import Bundling, LostJobError, WorkersError, open_workers
from ph_post.cli.main import main
from ph_post.simulate.assess import run_scenarios

ROOT = Path(__file__).parents[2]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
PART = "G21 G90\nG0 X0 Y0\nG1 X{0} F600\nY{0}\nX0\nY0\nG1 X5\nG3 X15 I5\nG1 X0\nM2\n"
FEW = ("-m", "router", "--no-simulation")
PATIENCE = 120.0
SCHEDULER = "from distributed.cli.dask_scheduler import main; main()"
WORKER = "from distributed.cli.dask_worker import main; main()"


def fill(folder, good, bad=1):
    folder.mkdir()
    for number in range(good):
        (folder / f"part{number:02}.ngc").write_text(PART.format(10 + number))
    for number in range(bad):
        (folder / f"bad{number}.json").write_text("{")
    return folder


def rows_of(out):
    with (out / "report.csv").open(newline="") as file:
        return {row["file"]: row for row in csv.DictReader(file)}


def wait_for(found):
    begin = time.monotonic()
    while time.monotonic() < begin + PATIENCE:
        if value := found():
            return value
        time.sleep(0.02)
    raise AssertionError("it did not happen")


def require_as_converted(folder, out, names):
    for name in names:
        assert main(["convert", str(folder / name), *FEW, "-o", str(out.parent / "one.ngc")]) == 0
        assert (out / name).read_bytes() == (out.parent / "one.ngc").read_bytes()


class Cluster:
    """A scheduler and workers, each a process of its own."""

    def __init__(self, folder, count, scheduler=SCHEDULER, worker=WORKER):
        self._folder, self._started, self._worker = folder, [], worker
        with socket.socket() as one:
            one.bind(("127.0.0.1", 0))
            self.address = f"tcp://127.0.0.1:{one.getsockname()[1]}"
        port = self.address.rpartition(":")[2]
        self.scheduler = self._start(scheduler, "--host", "127.0.0.1", "--port", port, "--no-dashboard", "--no-show")
        self.workers = [self.add() for _ in range(count)]

    def add(self):
        alone = ("--no-dashboard", "--nthreads", "1", "--no-nanny", "--local-directory", str(self._folder))
        return self._start(self._worker, self.address, *alone)

    def _start(self, script, *arguments):
        command = [sys.executable, "-c", script, *arguments]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": ENVIRONMENT, "cwd": self._folder}
        self._started.append(subprocess.Popen(command, **quiet))
        return self._started[-1]

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for one in reversed(self._started):
            one.kill()
            one.wait()


@pytest.fixture
def start_batch():
    """Start batches in sessions of their own, of which nothing is left behind the test."""
    started = []

    def start(folder, out, *more):
        command = [sys.executable, "-m", "ph_post", "batch", str(folder), *FEW, "-o", str(out), *more]
        said = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
        with heeding_interrupts():
            started.append(subprocess.Popen(command, **said, env=ENVIRONMENT, start_new_session=True))
        return started[-1]

    yield start
    for one in started:
        if one.poll() is None:
            os.killpg(one.pid, signal.SIGKILL)
            one.communicate()


@pytest.mark.slow
def test_two_local_workers(tmp_path, capsys):
    folder, out = fill(tmp_path / "in", 4), tmp_path / "out"
    with socket.socket() as other:  # where Dask's own page would be: another batch may run
        with contextlib.suppress(OSError):
            other.bind(("127.0.0.1", 8787))
            other.listen()
        run_beside(folder, out, capsys)


def run_beside(folder, out, capsys):
    assert main(["batch", str(folder), *FEW, "-o", str(out), "--workers", "2"]) == 1
    assert "5 results: 4 compensated, 1 refused" in capsys.readouterr().err
    require_as_converted(folder, out, ["part00.ngc", "part03.ngc"])
    before = (out / "report.csv").read_bytes()
    assert main(["batch", str(folder), *FEW, "-o", str(out), "--workers", "2"]) == 1
    assert "5 of an earlier run" in capsys.readouterr().err
    assert (out / "report.csv").read_bytes() == before


@pytest.mark.slow
def test_a_scheduler_and_two_workers_of_which_one_is_killed(start_batch, tmp_path):
    folder, out = fill(tmp_path / "in", 18, bad=2), tmp_path / "out"
    with Cluster(tmp_path, 2) as cluster:
        run = start_batch(folder, out, "--scheduler", cluster.address)
        wait_for(lambda: (out / "part00.ngc").exists() or len(list(out.glob("*.ngc"))) >= 3)
        cluster.workers[0].kill()
        said = run.communicate(timeout=PATIENCE)[1]
        assert run.returncode == 1, said
        assert "20 results: 18 compensated, 2 refused" in said
        assert "Traceback" not in said, said
        rows = rows_of(out)
        assert sorted(rows) == sorted(one.name for one in folder.iterdir())
        require_as_converted(folder, out, ["part00.ngc", "part09.ngc", "part17.ngc"])
        times = {one: one.stat().st_mtime_ns for one in out.glob("*.ngc")}
        again = start_batch(folder, out, "--scheduler", cluster.address)
        assert "20 of an earlier run" in again.communicate(timeout=PATIENCE)[1]
        assert {one: one.stat().st_mtime_ns for one in out.glob("*.ngc")} == times


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "times", "word"),
    [(signal.SIGTERM, 1, "starting workers"), (signal.SIGINT, 3, "preparing the workers")],
    ids=["SIGTERM while workers start", "Ctrl-C again and again"],
)
def test_a_batch_that_is_stopped_says_no_more_than_that(start_batch, tmp_path, number, times, word):
    # Dask, which was broken off while it started or ended its processes, wrote 30 lines of its own.
    folder, out = fill(tmp_path / "in", 4, bad=0), tmp_path / "out"
    run = start_batch(folder, out, "--workers", "2")
    said = ""
    while word not in said:
        line = run.stderr.readline()
        assert line, said
        said += line
    for _ in range(times):
        os.kill(run.pid, number)
        time.sleep(0.3)
    said += run.communicate(timeout=PATIENCE)[1]
    assert run.returncode in (130, -signal.SIGINT), said
    assert "Traceback" not in said
    assert said.splitlines()[-1] == "ph-post: interrupted; nothing more was written"
    assert not out.exists()


@pytest.mark.slow
def test_ctrl_c_stops_at_once_and_a_second_run_goes_on(start_batch, tmp_path):
    folder, out = fill(tmp_path / "in", 60, bad=0), tmp_path / "out"
    run = start_batch(folder, out, "--workers", "1")
    wait_for(lambda: (out / "report.csv").exists() and len(rows_of(out)) >= 2)  # a row follows its program
    os.killpg(run.pid, signal.SIGINT)
    said = run.communicate(timeout=PATIENCE)[1]
    assert run.returncode == 130, said
    assert "Traceback" not in said, said
    assert said.splitlines()[-1] == "ph-post: interrupted; nothing more was written"
    done = rows_of(out)
    assert 2 <= len(done) < 60
    times = {name: (out / name).stat().st_mtime_ns for name in done}
    run = start_batch(folder, out, "--workers", "1")
    said = run.communicate(timeout=PATIENCE)[1]
    assert f"60 results: 60 compensated; {len(done)} of an earlier run" in said
    assert {name: (out / name).stat().st_mtime_ns for name in done} == times
    assert len(rows_of(out)) == 60


@pytest.mark.slow
def test_a_scheduler_that_goes_away_is_one_line(start_batch, tmp_path):
    folder, out = fill(tmp_path / "in", 60, bad=0), tmp_path / "out"
    with Cluster(tmp_path, 1) as cluster:
        run = start_batch(folder, out, "--scheduler", cluster.address)
        wait_for(lambda: len(list(out.glob("*.ngc"))) >= 1)
        cluster.scheduler.kill()
        said = run.communicate(timeout=PATIENCE)[1]
    assert run.returncode == 2, said
    assert "Traceback" not in said, said
    assert said.splitlines()[-1].startswith(f"ph-post: {cluster.address}: the scheduler is not there any more")
    assert rows_of(out)


@pytest.mark.slow
def test_a_scheduler_of_another_version_is_one_line(tmp_path, capsys):
    folder, out = fill(tmp_path / "in", 1, bad=0), tmp_path / "out"
    other = (
        "import distributed.versions as v; plain = v._version_cached;"
        "v._version_cached = lambda name: '2020.1.0' if name == 'distributed' else plain(name);" + SCHEDULER
    )
    with Cluster(tmp_path, 0, other) as cluster:
        assert main(["batch", str(folder), *FEW, "-o", str(out), "--scheduler", cluster.address]) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith(
        f"ph-post: --scheduler {cluster.address}: the scheduler has another version of Dask; expected"
    )
    assert said.endswith("got 2020.1.0")
    assert not out.exists()


@pytest.mark.slow
def test_a_worker_of_another_version_is_one_line(tmp_path, capsys):
    folder, out = fill(tmp_path / "in", 1, bad=0), tmp_path / "out"
    other = f"from ph_post.batch import work; work.package_version = lambda: '0.0.1'; {WORKER}"
    with Cluster(tmp_path, 1, worker=other) as cluster:
        assert main(["batch", str(folder), *FEW, "-o", str(out), "--scheduler", cluster.address]) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith(f"ph-post: a worker of {cluster.address} has ph-post 0.0.1; expected ")
    assert not out.exists()


@pytest.mark.parametrize(("address", "words"), [("nonsense", "missing port"), ("tcp://127.0.0.1:1", "no answer in")])
def test_a_scheduler_that_is_not_there_is_one_line(tmp_path, capsys, monkeypatch, address, words):
    monkeypatch.setattr(module, "PATIENCE", 0.3)
    folder, out = fill(tmp_path / "in", 1, bad=0), tmp_path / "out"
    assert main(["batch", str(folder), *FEW, "-o", str(out), "--scheduler", address]) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith(f"ph-post: --scheduler {address}: no Dask scheduler answers; expected the address")
    assert words in said
    assert not out.exists()


@pytest.mark.slow
@pytest.mark.parametrize("bundling", [None, Bundling(90, len)], ids=["one by one", "in bundles"])
def test_a_job_that_ends_its_worker_is_given_up_and_the_others_are_not(bundling):
    # A worker that ends while it starts is not started anew: Dask takes it for one that cannot.
    deadly = "__import__('time').sleep(2.0) or __import__('os')._exit(1)"
    jobs = [("deadly", deadly), *((number, f"{number} + 1") for number in range(8))]
    with open_workers(1) as workers:
        found = dict(workers.run(eval, jobs, bundling=bundling))
        assert isinstance(found.pop("deadly"), LostJobError)
        assert found == {number: number + 1 for number in range(8)}
        with pytest.raises(WorkersError, match="same ph-post everywhere"):
            list(workers.run(_raises, [("one", 1)]))


@pytest.mark.slow
def test_a_batch_ends_where_no_worker_is_left(monkeypatch):
    monkeypatch.setattr(module, "ALONE", 1.0)
    said = []
    with open_workers(1) as workers:
        workers.wait(said.append)
        assert list(workers.run(eval, [(0, "1")], said.append)) == [(0, 1)]
        workers._client.cluster.scale(0)
        wait_for(lambda: not workers._client.ncores())  # which may take its time, in which it works on
        with pytest.raises(WorkersError, match="this computer has lost its workers; the same command goes on"):
            list(workers.run(eval, [(1, "2")], said.append))
    assert "waiting for a worker of this computer" in said


@pytest.mark.slow
def test_a_job_that_takes_more_memory_than_its_share_is_given_up(monkeypatch):
    monkeypatch.setattr(system, "MEMORY_LIMIT", 600_000_000)
    with open_workers(1) as workers:
        found = dict(workers.run(list, [("small", range(3)), ("large", range(300_000_000))]))
    assert found["small"] == [0, 1, 2]
    assert isinstance(found["large"], LostJobError)


@pytest.mark.slow
def test_what_a_worker_has_no_time_for_is_handed_out_again():
    jobs = [(number, 0.7) for number in range(7)]
    with open_workers(1) as workers:
        found = list(workers.run(time.sleep, jobs, bundling=Bundling(96, lambda _: 1)))
    assert sorted(found) == [(number, None) for number in range(7)]


def bundles(sizes, places=1):
    jobs = [(number, b"." * size) for number, size in enumerate(sizes)]
    waiting = module._Waiting(jobs, Bundling(len(jobs), len))
    while waiting.more:
        yield [name for name, _ in waiting.take(places)]


def test_small_jobs_go_in_bundles_and_large_ones_alone():
    sizes = [*[2 * module.BUNDLE_BYTES] * 2, *[module.BUNDLE_BYTES // 2] * 4, *[10] * 200]
    found = list(bundles(sizes))
    assert [name for bundle in found for name in bundle] == list(range(len(sizes)))
    assert found[:4] == [[0], [1], [2, 3], [4, 5]]
    assert [len(bundle) for bundle in found[4:10]] == [module.BUNDLE_JOBS] * 6
    assert found[-2:] == [[205], []]


def test_few_jobs_are_shared_out_among_the_workers():
    assert [len(bundle) for bundle in bundles([10] * 12, places=6)] == [1] * 12 + [0]


def test_a_bundle_ends_with_its_time(monkeypatch):
    assert module._work_through(abs, [-1, -2]) == [1, 2]
    monkeypatch.setattr(module, "BUNDLE_TIME", 0.0)
    assert module._work_through(abs, [-1, -2]) == [1]


def test_a_job_in_a_worker_works_on_one_thread(monkeypatch):
    monkeypatch.setattr("ph_post.bounds.processors", lambda: 4)
    assert _at_once(0) == 4
    assert module._work_through(_at_once, [0]) == [1]
    assert _at_once(0) == 4


def _at_once(_job):
    """Measure nine scenarios, and return of how many the measurements overlapped."""
    running, most = set(), [0]

    def measure(one):
        running.add(one)
        time.sleep(0.03)
        most[0] = max(most[0], len(running))
        running.discard(one)

    run_scenarios(measure, range(9))
    return most[0]


def _raises(_job):
    raise ImportError("no such package")
