"""The page of a batch: how many programs, what they gain, and a row each that is sorted and searched by hand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ph_post.batch.rows import BatchRow, one_line
from ph_post.report.page import make_page
from ph_post.units import MICROMETRE


def batch_page(rows: Sequence[BatchRow], missing: int = 0) -> str:
    """Return the page, one file that needs no network; `missing` rows are still to come."""
    data = {"rows": [_view(row) for row in rows], "missing": missing}
    lines = [f"{row.file}  {row.machine}  {row.status}  {row.reason or row.not_compensated}" for row in rows]
    return make_page("batch", "ph-post batch", data, lines)


def _view(row: BatchRow) -> dict[str, Any]:
    left = f"not compensated: {row.not_compensated}" if row.not_compensated else ""
    return {
        "file": row.file,
        "machine": row.machine,
        "status": row.status,
        "before": _micrometres(row.error_gap_before),
        "after": _micrometres(row.error_gap_after),
        "worst": _micrometres(row.error_gap_worst),
        "time": [None if one is None else round(one, 2) for one in (row.time_before, row.time_after)],
        "reversals": [row.compensated, row.reversals],
        "share": row.share,
        "seconds": round(row.seconds, 2),
        "words": [one_line(word) for word in (row.reason, left, *row.warnings) if word],
    }


def _micrometres(length: float | None) -> float | None:
    return None if length is None else round(length / MICROMETRE, 3)
