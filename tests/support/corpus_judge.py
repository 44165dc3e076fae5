"""What compensation makes of a program of the corpus, judged by a table with ideal play that the tests move themselves.

Motions come from the tests' own interpreters, and so do the distances. A reversal counts as followed where the table
is near the path until an axis turns again; where text was changed does not count.
"""

from __future__ import annotations

import math
import re
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ph_post.api.compensation import compensated, undo
from ph_post.api.options import CompensateOptions
from ph_post.errors import PhPostError
from ph_post.files.storage import SourceBytes
from ph_post.progress import no_progress
from support.corpus import Entry, stepper
from support.ideal_play import distances
from support.reference_player import BEGINS, Move, interpret, play
from support.sinumerik_motions import Run as SiemensRun
from support.tnc_motions import TncRun, iso_run

GAP = 0.05
"""Backlash of every axis [mm]."""

COARSE = 0.05
"""Distance of the samples [mm]."""

MOST = 60_000
"""Samples of a program at most."""

RAPID = 0.5
"""Distance of the samples of rapids [mm]."""

TAKEN_UP = 3.0 * GAP
"""Distance [mm] from a rapid's way within which an axis may come to its side of the backlash, away from all cuts."""

BAND = 0.005
"""Ways back [mm] that are no reversal."""

SHOWS = 0.003
"""Error [mm] of the plain program behind a reversal from which there is something to compensate."""

FOLLOWED = 0.35
"""Part of that error that is left where a reversal is compensated."""

_UNREAD = re.compile(r"#.*|^\s*(?:M117|PROG|END|O\d|%|\$).*|[A-Z](?=\s*(?:[A-Z]|$))", re.MULTILINE)
"""Text, numbers of programs and letters without numbers."""


class Judged(NamedTuple):
    """What became of a program: `outcome`, the package's own counts, and what the tests' table says.

    `shown` reversals after which the plain table is off by more than `SHOWS`, `followed` those of them after which the
    compensated one is not; `rms` and `p95` before and after [mm], None where no interpreter of the tests plays it;
    `time` the controller takes before and after [s].
    """

    outcome: str
    reversals: int = 0
    compensated: int = 0
    shown: int = 0
    followed: int = 0
    rms: tuple[float, float] | None = None
    p95: tuple[float, float] | None = None
    time: tuple[float, float] | None = None
    restored: bool = True
    reason: str = ""


def judge(entry: Entry) -> Judged:
    """Compensate a program on the stepper machine, and play both."""
    source = SourceBytes(name=entry.title, stem=entry.name.rpartition("/")[2], data=entry.data)
    try:
        result = compensated(
            source, stepper(entry.dialect), CompensateOptions(expand=entry.expand), "program", no_progress
        )
        text = result.program()
        rows = result.axis_reversals
    except PhPostError as error:
        return Judged("refused", reason=str(error))
    counts = sum(row.all for row in rows), sum(row.compensated for row in rows)
    outcome = "unchanged" if text == entry.data else "expanded" if result.expanded else "compensated"
    made = SourceBytes(name=source.name, stem=source.stem, data=text)
    restored = text == entry.data or undo(made) == entry.data
    try:
        time = result.before.time, result.after.time
    except (PhPostError, MemoryError):
        time = None
    found = Judged(outcome, *counts, time=time, restored=restored)
    return compare(found, entry.dialect, result.original.data, text)


def compare(found: Judged, dialect: str, before: bytes, after: bytes) -> Judged:
    """Play a program before and after compensation, and add to a finding what the tables do."""
    one, other = (_played(dialect, data) for data in (before, after))
    if one is None or other is None or not all((cuts & _deep(places)).any() for places, cuts in (one, other)):
        return found
    # A printer's Z goes up from where homing left it, on a side that only the firmware knows.
    rises = dialect in ("marlin", "klipper") and b"offset Z" not in after
    return _compared(found, one, other, "XY" if rises else "XYZ")


def _played(dialect: str, data: bytes) -> tuple[np.ndarray, np.ndarray] | None:
    """Places of the motors (n, 3) [mm] and whether the tool cuts; None where nothing here reads the language."""
    text = data.decode("utf-8-sig", "replace")
    runs = {"siemens": SiemensRun, "heidenhain": TncRun, "heidenhain-iso": iso_run}
    try:
        if dialect in runs:
            run = runs[dialect](text)
            thin = max(1, len(run.path) // MOST)
            return run.path[::thin], run.cutting[::thin]
        # Printers home; others stand where nobody knows.
        begins = [(0.0, 0.0, 0.0)] if dialect in ("marlin", "klipper") else BEGINS
        read = _UNREAD.sub("", text.upper())
        runs = [[move for move in interpret(read, begin) if move.length > 0.0] for begin in begins]
    except (ArithmeticError, LookupError, TypeError, ValueError):
        return None
    return _sampled(runs) if runs[0] else None


def _sampled(runs: list[list[Move]]) -> tuple[np.ndarray, np.ndarray]:
    """Return places, and whether the tool cuts there, of moves that lead from several places at the beginning.

    A move that leads from where the machine happens to stand is no more than a rapid to its end.
    """
    moves, last = runs[0], [run[-1].end for run in runs]
    step = max(COARSE, sum(move.length for move in moves if move.mode) / MOST)
    points, cuts = [], []
    for number, move in enumerate(moves):
        ends = np.array([(run[number].start - to, run[number].end - to) for run, to in zip(runs, last, strict=True)])
        known = bool(np.ptp(ends, axis=0).max() < 1e-9)
        count = max(2, math.ceil(move.length / (step if move.mode else RAPID))) if known else 1
        if known and not points:
            points, cuts = [move.start[None]], [np.zeros(1, dtype=bool)]
        points.append(move.at(np.linspace(0.0, 1.0, count + 1)[1:]))
        cuts.append(np.full(count, known and move.mode > 0))
    return np.concatenate(points), np.concatenate(cuts)


Places = tuple[np.ndarray, np.ndarray]


def _compared(found: Judged, one: Places, other: Places, axes: str) -> Judged:
    (motor, cuts), (after, cuts_after) = ((places, cuts & _deep(places)) for places, cuts in (one, other))
    path, tree = motor[cuts | np.append(cuts[1:], False)], cKDTree(motor[cuts])
    cuts_after &= ~((distances(after, path) > TAKEN_UP) & (distances(after, motor) < TAKEN_UP))
    labels = _stretches(motor, cuts)
    worst: list[tuple[np.ndarray, ...]] = []
    for side in (-1.0, 1.0):
        errors = [distances(_table(m, side, axes)[c], path) for m, c in ((motor, cuts), (after, cuts_after))]
        near = tree.query(after[cuts_after])[1]
        own = [(labels, errors[0]), (labels[near], errors[1])]
        worst.append((*errors, *(_by_stretch(rows, error, int(labels.max(initial=0)) + 1) for rows, error in own)))
    rms = tuple(max(math.sqrt(float((w[k] ** 2).mean())) for w in worst) for k in (0, 1))
    p95 = tuple(max(float(np.quantile(w[k], 0.95)) for w in worst) for k in (0, 1))
    plain, led = (np.max([w[k] for w in worst], axis=0) for k in (2, 3))
    shown = plain > SHOWS
    followed = shown & (led <= np.maximum(FOLLOWED * plain, SHOWS))
    return found._replace(rms=rms, p95=p95, shown=int(shown.sum()), followed=int(followed.sum()))


def _deep(motor: np.ndarray) -> np.ndarray:
    """Mask of the places below those at which the tool goes through the air; all of them where Z hardly moves."""
    top, bottom = motor[:, 2].max(), motor[:, 2].min()
    return motor[:, 2] < (top - 2.0 * GAP if top - bottom > 4.0 * GAP else math.inf)


def _table(motor: np.ndarray, side: float, axes: str) -> np.ndarray:
    """Places of the table, of which some axes have backlash; Z has its zero from where it moves down."""
    columns = list(motor.T.copy())
    for axis, name in enumerate("XYZ"):
        if name in axes and np.ptp(motor[:, axis]):
            columns[axis] = play(motor[:, axis], GAP, side) - (0.5 * GAP if name == "Z" else 0.0)
    return np.column_stack(columns)


def _stretches(motor: np.ndarray, cuts: np.ndarray) -> np.ndarray:
    """Numbers, for the samples that cut, of the stretches from one reversal of any axis to the next."""
    turned = np.zeros(len(motor), dtype=np.int64)
    for column in motor.T:
        low = high = column[0]
        sign = 0
        for row, place in enumerate(column.tolist()):
            low, high = (min(low, place), max(high, place)) if sign == 0 else (low, high)
            if sign >= 0 and high - place > BAND:
                turned[row] += sign != 0
                sign, low = -1, place
            elif sign <= 0 and place - low > BAND:
                turned[row] += sign != 0
                sign, high = 1, place
            low, high = (min(low, place), high) if sign < 0 else (low, max(high, place))
    return np.asarray(np.cumsum(turned > 0)[cuts])


def _by_stretch(labels: np.ndarray, errors: np.ndarray, count: int) -> np.ndarray:
    """Root mean square of errors by stretch, shape (count,)."""
    total, number = np.bincount(labels, errors**2, count), np.bincount(labels, minlength=count)
    return np.sqrt(total / np.maximum(number, 1))
