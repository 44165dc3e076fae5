"""A batch: what is done already stays, the rest goes to workers, and each result is written as it comes."""

from __future__ import annotations

import contextlib
import hashlib
import os
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import msgspec

from ph_post.api.expansion import controller_files
from ph_post.api.inputs import Source
from ph_post.api.options import CompensateOptions
from ph_post.batch.folder import BatchPlan, BatchTask, plan_batch
from ph_post.batch.page import batch_page
from ph_post.batch.rows import BatchRow, Status, csv_text, one_line, parquet_content, read_rows, shown_name
from ph_post.batch.work import BatchJob, convert_job, warm_up
from ph_post.batch.workers import Bundling, LostJobError, Workers, open_workers
from ph_post.bounds import processors
from ph_post.compensate.strategies.registry import find_traits
from ph_post.dialects.declaration import is_written_here
from ph_post.errors import InputError, OptionsError, PhPostError
from ph_post.files.storage import PROGRAM_ENDINGS, SourceBytes, make_folder, read_raw, write_atomically
from ph_post.progress import Progress, no_progress
from ph_post.types import Machine
from ph_post.units import MINUTE
from ph_post.version import package_version

TABLE: Final = "report.csv"
PARQUET: Final = "report.parquet"
PAGE: Final = "report.html"

TOLD: Final = 5.0
"""Time between two words on how far the batch is [s]."""

SHOWN: Final = 15.0
"""Time between two pages of a batch that runs [s], and at least so many times as long as a page takes."""

HOUR: Final = 60.0 * MINUTE

Rows = dict[tuple[str, str], BatchRow]


class BatchResult(msgspec.Struct, frozen=True, kw_only=True):
    """What a batch has made: a row for each program and machine, and how many of them are from an earlier run."""

    rows: tuple[BatchRow, ...]
    kept: int = 0

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of rows by status."""
        found = Counter(row.status for row in self.rows)
        return {name: found[name] for name in ("compensated", "unchanged", "refused", "failed")}

    @property
    def ok(self) -> bool:
        """True where no program was refused or failed."""
        return all(row.status in ("compensated", "unchanged") for row in self.rows)


def batch(
    folder: Source,
    machines: Machine | Source | Sequence[Machine | Source],
    output: Source,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    simulation: bool = True,
    progress: Progress = no_progress,
    **options: Any,
) -> BatchResult:
    r"""Compensate every program of a folder for every machine, on many processes.

    Each program goes through :func:`ph_post.compensate`, and is written byte for byte as by that. Results are written
    as they come, with a report (``report.csv``, ``report.html``, and ``report.parquet`` where pyarrow is installed).
    What an earlier run has done, of the same program, machine, options and version, is not done again.

    Parameters
    ----------
    folder : str or path
        Part programs and path files, also in folders inside it.
    machines : Machine, str or path, or a sequence of them
    output : str or path
        Folder of the programs, which keep their names; of several machines in a folder for each.
    workers : int, optional
        Processes of this computer, by default one for each processor. A script that calls this has to stand below
        ``if __name__ == "__main__":``, as each process reads it.
    scheduler : str, optional
        Address of a Dask scheduler, in place of processes of this computer.
    simulation : bool
        Whether errors and times are found by simulation.
    progress : callable, optional
        Called with the name of every stage.
    **options
        As of :func:`ph_post.compensate`, but for `interval_table`; those for paths alone are left out for programs.

    Returns
    -------
    BatchResult
        A row for each program and machine. A program that is refused is a row too.

    Raises
    ------
    InputError
        Where the folder has no programs, outputs would overwrite inputs, no scheduler answers, or a machine or an
        option is bad.
    PhPostError
        Where the scheduler goes away, or its workers have another version of this package.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import ph_post as ph
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = pathlib.Path(folder, "part.ngc").write_text("G21 G90\nG0 X0 Y0\nG1 X10 F600\nY10\nX0\nY0\nM2\n")
    ...     result = ph.batch(folder, "router", f"{folder}/out", workers=1)
    >>> result.rows[0].file, result.rows[0].reversals, result.ok
    ('part.ngc', 2, True)
    """
    several = [machines] if isinstance(machines, Machine | str | os.PathLike) else list(machines)
    how = CompensateOptions(**options)
    request = BatchRequest(options=how, simulated=simulation, workers=workers, scheduler=scheduler)
    return run_batch(folder, several, output, request, progress)


class BatchRequest(msgspec.Struct, frozen=True, kw_only=True):
    """How the programs are to be converted, and by whom."""

    options: CompensateOptions
    simulated: bool = True
    workers: int | None = None
    scheduler: str | None = None


def run_batch(
    folder: Source,
    machines: Sequence[Machine | Source],
    place: Source,
    request: BatchRequest,
    progress: Progress = no_progress,
    told: Callable[[BatchRow], None] | None = None,
) -> BatchResult:
    """Compensate every program of a folder by a record of options; see :func:`batch`. `told` gets each new row."""
    if request.options.interval_table is not None:
        raise OptionsError("--interval-table is for one path; a batch solves for the intervals")
    if request.workers is not None and request.scheduler is not None:
        raise OptionsError("--workers is for processes of this computer, which --scheduler replaces; leave one out")
    if request.workers is not None and request.workers < 1:
        raise InputError("--workers", "out of range", expected="1 or more", got=str(request.workers))
    find_traits(request.options.chosen_strategy)
    if request.options.expand:
        controller_files(request.options)
    progress("looking at the folder")
    plan = plan_batch(folder, machines, place, request.options.dialect)
    run = _Run(plan, request, progress, told)
    try:
        run.begin()
        run.work()
    finally:
        run.finish()
    return BatchResult(rows=run.sorted_rows(), kept=run.kept)


class _Run:
    """One run of a batch."""

    def __init__(
        self, plan: BatchPlan, request: BatchRequest, progress: Progress, told: Callable[[BatchRow], None] | None
    ) -> None:
        self._plan, self._request, self._version = plan, request, package_version()
        self._progress, self._told = progress, told
        self._table = plan.place / TABLE
        self._rows: Rows = {}
        self._before: Rows = {}
        self._left: list[BatchTask] = []
        self._sent: dict[int, tuple[BatchTask, str]] = {}
        self._next_page = 0.0
        self._begun = False
        self._beside: dict[Path, str] = {}
        self.kept = 0

    def begin(self) -> None:
        """Find what is done already, and refuse what can be refused at once."""
        self._before = {(row.file, row.machine): row for row in self._earlier_rows()}
        self._progress("comparing with the report of the last run")
        read: tuple[str, SourceBytes | PhPostError] | None = None
        for task in self._plan.tasks:
            if read is None or read[0] != task.file:
                read = task.file, self._read(task.file)
            found = self._decide(task, read[1])
            if found is None:
                self._left.append(task)
                continue
            self._rows[_name(task)] = found
            if found is self._before.get(_name(task)):
                self.kept += 1
            elif self._told is not None:
                self._told(found)

    def _earlier_rows(self) -> list[BatchRow]:
        try:
            return read_rows(self._table)
        except InputError:
            if not self._request.options.force:
                raise
            return []

    def _read(self, name: str) -> SourceBytes | PhPostError:
        try:
            return read_raw(self._plan.folder / name)
        except PhPostError as error:
            return error

    def _size(self, task: BatchTask) -> int:
        try:
            return (self._plan.folder / task.file).stat().st_size
        except OSError:  # gone since: its own row says so
            return 0

    def _decide(self, task: BatchTask, source: SourceBytes | PhPostError) -> BatchRow | None:
        """Return the row of what is done already, or cannot be done; None where there is work."""
        if isinstance(source, PhPostError):
            return self._refused(task, str(source))
        if task.target in self._plan.clashes:
            names = self._plan.clashes[task.target]
            return self._refused(task, f"{names} would be one file; expected other names; got {task.target}")
        before, there = self._before.get(_name(task)), _bytes(task.target)
        mine = before is not None and there is not None and _hash(there) == before.digest
        known = before is not None and before.key == self._key(task, source)
        if before is not None and known and (before.status == "refused" or (mine and before.output == _shown(task))):
            return before
        fine = there in (None, b"", source.data) or mine or is_written_here(there or b"")
        if not (fine or self._request.options.force):
            wanted = "that file moved away, or --force"
            what = InputError(os.fspath(task.target), "is there already, and not written by ph-post", expected=wanted)
            return self._refused(task, str(what))
        return None

    def _refused(self, task: BatchTask, reason: str, status: Status = "refused") -> BatchRow:
        found = BatchRow(file=shown_name(task.file), machine=task.label, status=status, reason=one_line(reason))
        return self._with_older(task, found)

    def _with_older(self, task: BatchTask, row: BatchRow) -> BatchRow:
        """Name the output of an earlier run that a refused program has, and keep its hash: it may be replaced later."""
        before, there = self._before.get(_name(task)), _bytes(task.target)
        if before is None or there is None or _hash(there) != before.digest:
            return row
        reason = f"{row.reason}; {one_line(os.fspath(task.target))} is of an earlier run"
        return msgspec.structs.replace(row, reason=reason, digest=before.digest)

    def _key(self, task: BatchTask, source: SourceBytes) -> str:
        """Hash all that decides the output: program, machine, options and version."""
        facts = [
            self._version,
            self._plan.machines[task.label],
            self._request.options,
            self._request.simulated,
            hashlib.sha256(source.data).hexdigest(),
            *(self._read_beside(task) if self._request.options.expand else ()),
        ]
        return f"sha256:{hashlib.sha256(msgspec.json.encode(facts)).hexdigest()}"

    def _read_beside(self, task: BatchTask) -> Iterator[str]:
        """Hash what a program may read while it is written out: subprograms, parameters and tools."""
        options = self._request.options
        folders = ((self._plan.folder / task.file).parent, *map(Path, options.subprograms))
        files = [Path(file) for file in (options.parameters, options.tool_table) if file is not None]
        for place in (*folders, *files):
            if place not in self._beside:
                self._beside[place] = _digest_of(place)
            yield self._beside[place]

    def work(self) -> None:
        """Give what is left to workers, and write what comes back; nothing is written before they are there."""
        if not self._left:
            self._open_report()
            return
        self._left.sort(key=self._size, reverse=True)  # the longest first, or one worker ends long after the others
        with self._ready() as workers:
            self._open_report()
            clock = _Clock(len(self._left), self._progress)
            bundling = Bundling[BatchJob](len(self._left), lambda job: len(job.source.data))
            for number, outcome in workers.run(convert_job, self._jobs(), self._progress, bundling):
                task, key = self._sent.pop(number)
                if isinstance(outcome, LostJobError):
                    self._take(self._refused(task, str(outcome), "failed"))
                else:
                    self._take(self._written(task, key, outcome.row, outcome.program))
                clock.step(workers.count)
                self._show_now_and_then()

    @contextlib.contextmanager
    def _ready(self) -> Iterator[Workers]:
        """Start as many workers as there is work for, and have everything compiled once before they begin."""
        options, version = self._request.options, self._version
        machines, scheduler = _different(list(self._plan.machines.values())), self._request.scheduler
        self._progress("starting workers" if scheduler is None else f"connecting to {scheduler}")
        with open_workers(min(self._request.workers or processors(), len(self._left)), scheduler) as workers:
            workers.wait(self._progress)
            self._progress("preparing the workers: compiled code")
            for machine in machines:
                workers.on_each(warm_up, machine, options, version)
            yield workers

    def _open_report(self) -> None:
        """Begin the report with the rows that are known."""
        make_folder(os.fspath(self._plan.place))
        self._write_table()
        self._begun = True

    def _jobs(self) -> Iterator[tuple[int, BatchJob]]:
        """Make the jobs, one by one: the bytes of a program are read when a worker will soon be free."""
        for number, task in enumerate(self._left):
            source = self._read(task.file)
            if isinstance(source, PhPostError):
                self._take(self._refused(task, str(source)))
                continue
            self._sent[number] = task, self._key(task, source)
            yield (
                number,
                BatchJob(
                    file=shown_name(task.file),
                    label=task.label,
                    source=source,
                    machine=self._plan.machines[task.label],
                    options=self._request.options,
                    simulated=self._request.simulated,
                    version=self._version,
                ),
            )

    def _written(self, task: BatchTask, key: str, row: BatchRow, program: bytes | None) -> BatchRow:
        """Write a program to its place, and return its row."""
        row = msgspec.structs.replace(row, key=key, reason=one_line(row.reason))
        if program is None:
            return self._with_older(task, row)
        try:
            task.target.parent.mkdir(parents=True, exist_ok=True)
            write_atomically({os.fspath(task.target): program})
        except (OSError, PhPostError) as error:
            return self._refused(task, str(error), "failed")
        return msgspec.structs.replace(row, output=_shown(task), digest=_hash(program))

    def _take(self, row: BatchRow) -> None:
        """Add a row to the report on the disk, at once."""
        self._rows[row.file, row.machine] = row
        with self._table.open("a", encoding="utf-8", newline="") as file:
            file.write(csv_text([row], head=False))
        if self._told is not None:
            self._told(row)

    def _show_now_and_then(self) -> None:
        begin = time.monotonic()
        if begin >= self._next_page:
            self._write_page()
            took = time.monotonic() - begin
            self._next_page = begin + max(SHOWN, 20.0 * took)

    def sorted_rows(self) -> tuple[BatchRow, ...]:
        """Return all rows, by file and machine."""
        return tuple(self._rows[name] for name in sorted(self._rows))

    def _write_table(self) -> None:
        _write(self._table, csv_text(self.sorted_rows(), head=True).encode())

    def _write_page(self) -> None:
        missing = len(self._plan.tasks) - len(self._rows)
        _write(self._plan.place / PAGE, batch_page(self.sorted_rows(), missing).encode())

    def finish(self) -> None:
        """Write the whole report, also where the run was stopped."""
        if not self._begun:
            return
        self._write_table()
        self._write_page()
        if find_spec("pyarrow") is not None:
            file = self._plan.place / PARQUET
            _write(file, parquet_content(self.sorted_rows(), os.fspath(file)))
        else:  # what an earlier run wrote there is not true any more
            with contextlib.suppress(OSError):
                (self._plan.place / PARQUET).unlink(missing_ok=True)


def report_files(place: Source) -> list[str]:
    """Return the files of the report in a folder of outputs."""
    return [os.fspath(Path(place) / name) for name in (TABLE, PARQUET, PAGE) if Path(place, name).exists()]


class _Clock:
    """Says how far a batch is, and how long it will take."""

    def __init__(self, count: int, progress: Progress) -> None:
        self._count, self._done, self._progress = count, 0, progress
        self._begin = self._told = time.monotonic()

    def step(self, workers: int) -> None:
        """Count one more."""
        self._done += 1
        now = time.monotonic()
        if now - self._told >= max(TOLD, 0.02 * (now - self._begin)):
            self._told = now
            left = (now - self._begin) / self._done * (self._count - self._done)
            said = f"{self._done} of {self._count} done by {workers} worker{'s' if workers != 1 else ''}"
            self._progress(f"{said}, at most about {_duration(left)} to go")


def _duration(seconds: float) -> str:
    if seconds < 2.0 * MINUTE:
        return f"{seconds:.0f} s"
    return f"{seconds / MINUTE:.0f} min" if seconds < 2.0 * HOUR else f"{seconds / HOUR:.1f} h"


def _different(machines: Sequence[Machine]) -> list[Machine]:
    """Machines of which each has other loops: their code differs."""
    kinds = {frozenset((axis.feedback, bool(axis.effects)) for axis in one.axes.values()): one for one in machines}
    return list(kinds.values())


def _name(task: BatchTask) -> tuple[str, str]:
    return shown_name(task.file), task.label


def _shown(task: BatchTask) -> str:
    return shown_name(os.fspath(task.target))


def _bytes(file: Path) -> bytes | None:
    try:
        return file.read_bytes()
    except OSError:
        return None


def _write(file: Path, data: bytes) -> None:
    """Write a file of the report, unless it is there as it should be: where nothing is done, nothing changes."""
    if _bytes(file) != data:
        write_atomically({os.fspath(file): data})


def _digest_of(place: Path) -> str:
    """Hash the files of a folder that may be subprograms, or a file."""
    if place.is_dir():
        files = sorted(one for one in place.iterdir() if one.suffix.lower() in ("", *PROGRAM_ENDINGS))
    else:
        files = [place]
    return _hash(msgspec.json.encode([(one.name, _hash(data)) for one in files if (data := _bytes(one)) is not None]))


def _hash(data: bytes) -> str:
    return f"sha256:{hashlib.sha256(data).hexdigest()}"
