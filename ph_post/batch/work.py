"""What a worker does: one program through the same function as ``convert``."""

from __future__ import annotations

import threading
import time
from typing import Any, Final

import msgspec

from ph_post.api.compensation import compensated
from ph_post.api.options import CompensateOptions
from ph_post.api.path_compensation import PathCompensation
from ph_post.batch.rows import BatchRow
from ph_post.errors import PhPostError
from ph_post.files.storage import SourceBytes, is_program
from ph_post.progress import no_progress
from ph_post.report.result_line import summarize
from ph_post.simulate.contour import ContourError
from ph_post.types import Machine
from ph_post.version import package_version

_alone: Final = threading.Lock()
"""Held while a program is converted: a process has one at a time, however many threads it is given."""

WARMING: Final = b"G21 G90 G94 G17\nG0 X0 Y0 Z1\nG1 Z0 F600\nG1 X8 F900\nG3 X8 Y8 J4\nG1 X0\nG3 X0 Y0 J-4\nG0 Z1\nM2\n"
"""A program with lines and arcs that has the code compiled that most programs need."""


class OtherVersionError(PhPostError):
    """A worker has another version of this package; its outputs would not be those of ``convert`` here."""


class BatchJob(msgspec.Struct, frozen=True, kw_only=True):
    """One program for one machine, with all that decides its output; `file` and `label` name them in the report."""

    file: str
    label: str
    source: SourceBytes
    machine: Machine
    options: CompensateOptions
    version: str
    simulated: bool = True


class BatchOutcome(msgspec.Struct, frozen=True, kw_only=True):
    """A row of the report, and the program; None where it was refused."""

    row: BatchRow
    program: bytes | None = None


def convert_job(job: BatchJob) -> BatchOutcome:
    """Compensate one program; whatever is wrong with it becomes its row.

    Raises
    ------
    OtherVersionError
        Where this process has another version of the package than that which asks.
    """
    if job.version != package_version():
        raise OtherVersionError(f"has ph-post {package_version()}; expected {job.version}")
    begin = time.perf_counter()
    with _alone:
        try:
            found = _converted(job)
        except PhPostError as error:
            found = BatchOutcome(row=BatchRow(file=job.file, machine=job.label, status="refused", reason=str(error)))
        except Exception as error:
            words = f"internal error: {type(error).__name__}: {error}"
            found = BatchOutcome(row=BatchRow(file=job.file, machine=job.label, status="refused", reason=words))
    seconds = time.perf_counter() - begin
    return msgspec.structs.replace(found, row=msgspec.structs.replace(found.row, seconds=seconds))


def _converted(job: BatchJob) -> BatchOutcome:
    options = job.options.without_expansion()
    if is_program(job.source):
        options = job.options.without_path_options()
    result = compensated(job.source, job.machine, options, "program", no_progress)
    program = result.program()
    found = summarize(result, "program" if isinstance(result, PathCompensation) else None, simulated=job.simulated)
    times: tuple[Any, Any] = (None, None) if found.time is None else found.time
    row = BatchRow(
        file=job.file,
        machine=job.label,
        status="unchanged" if program == job.source.data else "compensated",
        error_gap_before=_largest(found.error_gap[0]),
        error_gap_after=_largest(found.error_gap[1]),
        error_gap_worst=_largest(found.error_gap_worst),
        rms_gap_before=_rms(found.error_gap[0]),
        rms_gap_after=_rms(found.error_gap[1]),
        error_before=_largest(found.error[0]),
        error_after=_largest(found.error[1]),
        time_before=times[0],
        time_after=times[1],
        reversals=None if found.reversals is None else found.reversals.all,
        compensated=None if found.reversals is None else found.reversals.compensated,
        axes=found.axes,
        not_compensated=found.left,
        warnings=(*(result.notes if isinstance(result, PathCompensation) else ()), *result.warnings),
        reason=f"not simulated: {found.trouble}" if found.trouble else "",
    )
    return BatchOutcome(row=row, program=program)


def _largest(error: ContourError | None) -> float | None:
    return None if error is None else error.max


def _rms(error: ContourError | None) -> float | None:
    return None if error is None else error.rms


def warm_up(machine: Machine, options: CompensateOptions, version: str) -> None:
    """Have the code compiled that programs for a machine need; raises as :func:`convert_job`."""
    source = SourceBytes(name="first.ngc", stem="first", data=WARMING)
    convert_job(BatchJob(file="", label="", source=source, machine=machine, options=options, version=version))
