"""The records of a fleet: a machine file from each, and what has drifted since the run before."""

from __future__ import annotations

import csv
import hashlib
import io
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal

import msgspec

from ph_post.api.inputs import machine_of_text, read_log
from ph_post.api.measurements import identify
from ph_post.batch.folder import files_below, require_room
from ph_post.batch.rows import cell_text, one_line, shown_name, text_of_cell
from ph_post.batch.work import OtherVersionError
from ph_post.batch.workers import LostJobError, open_workers
from ph_post.bounds import processors
from ph_post.drive.machinefile import machine_source
from ph_post.errors import InputError, OptionsError, PhPostError
from ph_post.files.storage import (
    BINARY_LOG_ENDINGS,
    SourceBytes,
    SourceText,
    make_folder,
    read_raw,
    require_folder,
    require_out,
    write_atomically,
)
from ph_post.progress import Progress, no_progress
from ph_post.types.loops import Feedback
from ph_post.version import package_version

LOG_ENDINGS: Final = (".csv", *sorted(BINARY_LOG_ENDINGS))
"""Endings of the records of a fleet."""

TABLE: Final = "drift.csv"

SURE: Final = 3.0
"""Standard errors of the difference by which a value has drifted."""

HEAD: Final = (
    *("log", "status", "axis", "parameter", "value", "stderr", "unit"),
    *("before", "stderr_before", "change", "drifted", "reason", "output", "key", "output_sha256"),
)
"""Columns of the table."""


Status = Literal["identified", "refused", "failed"]


class DriftRow(msgspec.Struct, frozen=True, kw_only=True):
    """One parameter of one log, in the units of the shop, beside that of the run before; or why there is none.

    `drifted` is "yes" where both are known and differ by more than three standard errors of their difference, "no"
    where by less. Of a log that is refused there is one row without a parameter, with the `reason`.
    """

    log: str
    status: Status
    axis: str = ""
    parameter: str = ""
    value: float | None = None
    stderr: float | None = None
    unit: str = ""
    before: float | None = None
    stderr_before: float | None = None
    drifted: Literal["yes", "no", ""] = ""
    reason: str = ""
    output: str = ""
    key: str = ""
    output_sha256: str = ""

    @property
    def change(self) -> float | None:
        """The value less that of the run before."""
        return None if self.value is None or self.before is None else self.value - self.before


class FleetRequest(msgspec.Struct, frozen=True, kw_only=True):
    """How logs are read and identified, and by whom; as the options of ``identify``."""

    columns: tuple[str, ...] = ()
    sides: Mapping[str, str] = {}
    feedback: Mapping[str, Feedback] = {}
    gear_ratio: float | None = None
    screw_lead: float | None = None
    force: bool = False
    workers: int | None = None
    scheduler: str | None = None


class LogJob(msgspec.Struct, frozen=True, kw_only=True):
    """One log, with all that decides what is identified from it."""

    source: SourceBytes
    machine: SourceText | None
    request: FleetRequest
    version: str


class LogOutcome(msgspec.Struct, frozen=True, kw_only=True):
    """Rows without what only the table knows, and the machine file; none where the log was refused."""

    rows: tuple[DriftRow, ...]
    file: str = ""


def identify_job(job: LogJob) -> LogOutcome:
    """Identify a machine from one log, as ``identify`` does; whatever is wrong with it becomes its row.

    Raises
    ------
    OtherVersionError
        Where this process has another version of the package.
    """
    if job.version != package_version():
        raise OtherVersionError(f"has ph-post {package_version()}; expected {job.version}")
    request = job.request
    try:
        machine = None if job.machine is None else machine_of_text(job.machine)
        log = read_log(job.source, columns=request.columns, sides=request.sides, machine=machine)
        found = identify(
            log,
            machine,
            feedback=request.feedback or None,
            gear_ratio=request.gear_ratio,
            screw_lead=request.screw_lead,
        )
        file = found.machine_file()
    except Exception as error:
        known = isinstance(error, PhPostError)
        words = str(error) if known else f"internal error: {type(error).__name__}: {error}"
        return LogOutcome(rows=(DriftRow(log="", status="refused", reason=one_line(words)),))
    rows = tuple(
        DriftRow(
            log="", status="identified", axis=axis, parameter=name, value=one.value, stderr=one.stderr, unit=one.unit
        )
        for axis, parameters in found.axes.items()
        for name, one in parameters.items()
    )
    return LogOutcome(rows=rows, file=file)


def _lost(reason: str) -> LogOutcome:
    return LogOutcome(rows=(DriftRow(log="", status="failed", reason=reason),))


class FleetResult(msgspec.Struct, frozen=True, kw_only=True):
    """The table, and how many of the logs an earlier run has identified."""

    rows: tuple[DriftRow, ...]
    kept: int = 0

    @property
    def drifted(self) -> tuple[DriftRow, ...]:
        """Rows of what has drifted."""
        return tuple(row for row in self.rows if row.drifted == "yes")

    @property
    def ok(self) -> bool:
        """True where no log was refused."""
        return all(row.status == "identified" for row in self.rows)


def run_fleet(
    folder: str,
    machine: str | None,
    place: str,
    request: FleetRequest,
    progress: Progress = no_progress,
) -> FleetResult:
    """Identify a machine from every log of a folder, and compare with the run before.

    Parameters
    ----------
    folder : str
        Logs; the name of each is that of its machine.
    machine : str, optional
        A machine file for all of them, or a folder in which each has its own, under the log's name.
    place : str
        Folder of the machine files that are written, and of the table.
    request : FleetRequest
    progress : callable, optional
        Called with every stage.

    Raises
    ------
    InputError
        Where the folder has no logs, or a file, an option or the scheduler is bad: nothing is written then.
    """
    if request.workers is not None and request.scheduler is not None:
        raise OptionsError("--workers is for processes of this computer, which --scheduler replaces; leave one out")
    fleet = _Fleet(require_folder(folder, "logs"), machine, require_out(place), request)
    fleet.begin()
    if fleet.left:
        scheduler = request.scheduler
        progress("starting workers" if scheduler is None else f"connecting to {scheduler}")
        with open_workers(min(request.workers or processors(), len(fleet.left)), scheduler) as workers:
            workers.wait(progress)
            for done, (name, found) in enumerate(workers.run(identify_job, fleet.jobs(), progress), start=1):
                fleet.take(name, _lost(str(found)) if isinstance(found, LostJobError) else found)
                progress(f"{done} of {len(fleet.left)} logs done")
    fleet.write()
    return FleetResult(rows=fleet.sorted_rows(), kept=fleet.kept)


class _Fleet:
    """The logs of one run, and the rows that are known."""

    def __init__(self, folder: Path, machine: str | None, place: Path, request: FleetRequest) -> None:
        self._folder, self._machine, self._place, self._request = folder, machine, place, request
        self._rows: dict[str, tuple[DriftRow, ...]] = {}
        self._before: dict[str, list[DriftRow]] = {}
        self._keys: dict[str, str] = {}
        self._names: list[str] = []
        self.left: list[str] = []
        self.kept = 0

    def begin(self) -> None:
        """Find the logs, and what an earlier run has done; refuse what is bad before any work."""
        self._names = sorted(name for name, _ in files_below(self._folder, os.path.realpath(self._place), LOG_ENDINGS))
        if not self._names:
            expected = f"files that end in {' '.join(LOG_ENDINGS)}"
            raise InputError(os.fspath(self._folder), "no logs", expected=expected)
        if os.path.realpath(self._place) == os.path.realpath(self._folder):
            raise InputError(
                os.fspath(self._place), "the outputs would stand among the logs", expected="another folder"
            )
        if self._machine is not None and os.path.realpath(self._machine) == os.path.realpath(self._place):
            what = "the outputs would overwrite the machine files"
            raise InputError(os.fspath(self._place), what, expected="another folder")
        require_room(self._place)
        if self._machine is not None and not Path(self._machine).is_dir():
            machine_of_text(machine_source(self._machine))
        for row in read_drift(self._place / TABLE):
            self._before.setdefault(row.log, []).append(row)
        for name in self._names:
            rows = self._decide(name)
            if rows is not None:
                self._rows[name] = rows

    def _decide(self, name: str) -> tuple[DriftRow, ...] | None:
        """Return the rows of a log that is done already, or cannot be read; None where there is work."""
        twins = [one for one in self._names if self._target(one) == self._target(name)]
        if len(twins) > 1:
            return self._refused(name, f"{' and '.join(twins)} would be one machine file")
        try:
            self._keys[name] = self._job(name)[1]
        except PhPostError as error:
            return self._refused(name, str(error))
        rows, target = tuple(self._before.get(shown_name(name), ())), self._target(name)
        there = target.read_bytes() if target.is_file() else None
        mine = there is not None and any(row.output_sha256 == _hash(there) for row in rows)
        if rows and rows[0].key == self._keys[name] and (rows[0].status == "refused" or mine):
            self.kept += 1
            return rows
        if there is not None and not mine and not self._request.force:
            what = InputError(
                os.fspath(target),
                "is there already, and not as ph-post wrote it",
                expected="that file moved away, or --force",
            )
            self._keys[name] = ""
            return self._refused(name, str(what))
        self.left.append(name)
        return None

    def _refused(self, name: str, reason: str, status: Status = "refused") -> tuple[DriftRow, ...]:
        """Return the rows of a log that gives nothing now; what was known last stays, to be compared with later."""
        shared: dict[str, Any] = {"status": status, "reason": one_line(reason), "key": self._keys.get(name, "")}
        older = [
            msgspec.structs.replace(
                row, value=None, stderr=None, drifted="", before=last[0], stderr_before=last[1], **shared
            )
            for row in self._before.get(shown_name(name), ())
            if (last := _last(row))[0] is not None
        ]
        return tuple(older) or (DriftRow(log=shown_name(name), **shared),)

    def _target(self, name: str) -> Path:
        return (self._place / name).with_suffix(".toml")

    def _job(self, name: str) -> tuple[LogJob, str]:
        version = package_version()
        source, machine = read_raw(self._folder / name), self._machine_of(name)
        plain = msgspec.structs.replace(self._request, workers=None, scheduler=None, force=False)
        facts = [version, plain, None if machine is None else machine.digest, _hash(source.data)]
        key = _hash(msgspec.json.encode(facts, order="deterministic"))
        return LogJob(source=source, machine=machine, request=plain, version=version), key

    def _machine_of(self, name: str) -> SourceText | None:
        if self._machine is None or not Path(self._machine).is_dir():
            return None if self._machine is None else machine_source(self._machine)
        return machine_source((Path(self._machine) / name).with_suffix(".toml"))

    def jobs(self) -> Iterator[tuple[str, LogJob]]:
        """Make the jobs, one by one; raises where a log has gone meanwhile."""
        for name in self.left:
            job, self._keys[name] = self._job(name)
            yield name, job

    def take(self, name: str, outcome: LogOutcome) -> None:
        """Write the machine file of a log, and its rows into the table, at once."""
        target = self._target(name)
        if not outcome.file:
            self._rows[name] = self._refused(name, outcome.rows[0].reason, outcome.rows[0].status)
        else:
            make_folder(os.fspath(target.parent))
            write_atomically({os.fspath(target): outcome.file})
            older = {(row.axis, row.parameter): _last(row) for row in self._before.get(shown_name(name), ())}
            shared = {
                "log": shown_name(name),
                "key": self._keys[name],
                "output": shown_name(os.fspath(target)),
                "output_sha256": _hash(outcome.file.encode()),
            }
            self._rows[name] = tuple(
                _compared(msgspec.structs.replace(row, **shared), *older.get((row.axis, row.parameter), (None, None)))
                for row in outcome.rows
            )
        self.write()

    def sorted_rows(self) -> tuple[DriftRow, ...]:
        """Return all rows, log by log."""
        return tuple(row for name in sorted(self._rows) for row in self._rows[name])

    def write(self) -> None:
        """Write the table; rows of logs that are still to come are those of the run before."""
        make_folder(os.fspath(self._place))
        old = {name: tuple(self._before.get(shown_name(name), ())) for name in self.left}
        rows = {**old, **self._rows}
        text = drift_text([row for name in sorted(rows) for row in rows[name]])
        file = self._place / TABLE
        if not file.exists() or file.read_bytes() != text.encode():
            write_atomically({os.fspath(file): text})


def _last(row: DriftRow) -> tuple[float | None, float | None]:
    """Return the last known value of a parameter, and its standard error."""
    return (row.before, row.stderr_before) if row.value is None else (row.value, row.stderr)


def _compared(row: DriftRow, before: float | None, stderr: float | None) -> DriftRow:
    """Put the value of the run before beside that of now."""
    drifted: Literal["yes", "no", ""] = ""
    if row.value is not None and before is not None and row.stderr is not None and stderr is not None:
        drifted = "yes" if abs(row.value - before) > SURE * math.hypot(row.stderr, stderr) else "no"
    return msgspec.structs.replace(row, before=before, stderr_before=stderr, drifted=drifted)


def drift_text(rows: Sequence[DriftRow]) -> str:
    """Return the table as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(HEAD)
    for row in rows:
        cells = (getattr(row, name) for name in HEAD)
        writer.writerow(
            "" if one is None else f"{one:.9g}" if isinstance(one, float) else cell_text(one) for one in cells
        )
    return text.getvalue()


def drift_view(row: DriftRow) -> dict[str, Any]:
    """Return a row as ``--json`` has it."""
    return {name: getattr(row, name) for name in HEAD}


def read_drift(file: Path) -> list[DriftRow]:
    """Return the rows of an earlier table; none where there is none.

    Raises
    ------
    InputError
        Where it cannot be read, or is another.
    """
    if not file.exists():
        return []
    lines = csv.DictReader(io.StringIO(read_raw(file).data.decode("utf-8", "replace"), newline=""))
    if tuple(lines.fieldnames or ()) != HEAD:
        raise InputError(os.fspath(file), "is there already, and no table of ph-post fleet", expected="another folder")
    numbers = ("value", "stderr", "before", "stderr_before")
    try:
        return [
            msgspec.convert(
                {k: float(v) if k in numbers else text_of_cell(v) for k, v in line.items() if v and k != "change"},
                DriftRow,
            )
            for line in lines
        ]
    except (TypeError, ValueError, msgspec.ValidationError) as error:
        raise InputError(os.fspath(file), "is no table of ph-post fleet any more", got=one_line(str(error))) from None


def _hash(data: bytes) -> str:
    return f"sha256:{hashlib.sha256(data).hexdigest()}"
