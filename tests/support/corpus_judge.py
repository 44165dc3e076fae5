"""What compensation makes of a program of the corpus, judged by a table with ideal play that the tests move themselves.

Motions come from the tests' own interpreters, and so do the distances. A reversal counts as followed where the table
is near the path until an axis turns again; where text was changed does not count.
"""

from __future__ import annotations

import math
import re
from typing import Final, NamedTuple

import numba
import numpy as np
from scipy.spatial import cKDTree

from ph_post.api.compensation import compensated, undo
from ph_post.api.options import CompensateOptions
from ph_post.errors import PhPostError
from ph_post.files.storage import SourceBytes
from ph_post.progress import no_progress
from support.canon import RS274
from support.canon_player import CUTS, canon_moves
from support.corpus import TOOLS, Entry, stepper
from support.ideal_play import Polyline, distances
from support.interpreted import installed_version
from support.lathe_player import is_lathe, lathe_moves
from support.reference_player import BEGINS, Move, interpret, play, up_to_refused
from support.sinumerik_motions import Run as SiemensRun
from support.tnc_motions import TncRun, iso_run

GAP = 0.05
"""Backlash of every axis [mm]."""

COARSE = 0.05
"""Distance of the samples [mm]."""

MOST = 60_000
"""Samples of a program at most, beside those that arcs need."""

SAGITTA = 3e-4
"""Distance [mm] of the chords of an arc from it."""

SHARP = 0.1
"""Change of a step between samples, as a part of it, that is a corner."""

RAPID = 0.5
"""Distance of the samples of rapids [mm]."""

TAKEN_UP = 3.0 * GAP
"""Distance [mm] from a rapid's way within which an axis may come to its side of the backlash, away from all cuts."""

NO_WAY = 1e-9
"""Way [mm] that is none: places in inches are rounded."""

SAME_HEIGHT = 1e-6
"""Difference of heights that is none [mm]."""

BAND = 0.005
"""Ways back [mm] that are no reversal."""

SHOWS = 0.003
"""Error [mm] of the plain program behind a reversal from which there is something to compensate."""

FOLLOWED = 0.35
"""Part of that error that is left where a reversal is compensated."""

GRBL = ("grbl", "grblhal")
"""Dialects of controllers that refuse an arc which does not end on its circle: behind that a sender stops."""

PRINTERS = ("marlin", "klipper")
"""Dialects of machines that home, and cut nothing where they push no filament."""

THOUSAND = 1000.0
"""Increments of a Fanuc controller in a millimetre: lengths without a point count them."""

_END = re.compile(r"^[N\d\s]*M0?(?:2|30)\b", re.MULTILINE)
"""Where a program ends: what is behind it is not run, or called."""

_SWITCHES = {
    "siemens": re.compile(r"^[^;\n]*\b(?:TRAORI|TRANSMIT|TRACYL|TRAANG)\b", re.MULTILINE | re.IGNORECASE),
    "heidenhain": re.compile(
        r"^[^;\n]*\b(?:M128\b|FUNCTION TCPM\b|PLANE +(?!RESET|SPATIAL)\w|PLANE +SPATIAL\b.*?\bSP[ABC] *[-+]?[0.]*[1-9]"
        r"|CYCL +DEF +19\.1 .*?[ABC] *[-+]?[0.]*[1-9])",
        re.MULTILINE | re.IGNORECASE,
    ),
    "others": re.compile(r"^[^(;\n]*\bM4(?:28|29|30)\b", re.MULTILINE | re.IGNORECASE),
}
"""Words with which machines of five axes switch their kinematics, by dialect: X, Y and Z are then no axes of theirs.

So it is in a plane that is tilted, where a head tilts and no table.
"""

_UNDOTTED = re.compile(r"([XYZIJKR])([-+]?\d+)(?![\d.])")

_UNREAD = re.compile(r"#.*|^\s*(?:M117|M20[1-5]|PROG|END|O\d|%|\$).*|[A-Z](?=\s*(?:[A-Z(;]|$))", re.MULTILINE)
"""Text, limits of printers, which name axes, numbers of programs and letters without numbers."""

_UNMOVED: Final = re.compile(
    r"^(?![ \t]*(?:N\d+[ \t]*)?(?:G[ \t]*0*(?:[0-4]|1[789]|2[018]|9[0-2])|M[ \t]*0*(?:0|1|2|18|30|8[234]))(?![\d.]))"
    r"[^\n]+",
    re.MULTILINE,
)
"""Lines of printers that move nothing and set no mode: settings, texts, and macros, which leave all as it was."""


_CALLED: Final = re.compile(r"^(?![^(;\n]*M0*(?:2|30)(?!\d))[^(;\n]*(?:M0*(?:17|99)(?!\d)|^RET\b)", re.MULTILINE)
"""Where a subprogram ends."""

_MEASURE: Final = re.compile(r"^[^(;\n]*G9[01](?![\d.])", re.MULTILINE)


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
    """Compensate a program on the stepper machine, what it computes written out, and play both."""
    source = SourceBytes(name=entry.title, stem=entry.name.rpartition("/")[2], data=entry.data)
    try:
        result = compensated(
            source,
            stepper(entry.dialect),
            CompensateOptions(expand=True, tool_table=TOOLS, controller_version=_version(entry.dialect)),
            "program",
            no_progress,
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
    # Holes of drilling cycles are compensated before all else, in a program that the rest is compared with.
    plain = result.shifted.original or result.original
    return compare(found, entry.dialect, plain.data, text)


def _version(dialect: str | None) -> str | None:
    """Return the version of the controller that plays a program, where versions differ."""
    return ".".join(map(str, installed_version())) if dialect == "linuxcnc" and RS274 else None


def compare(found: Judged, dialect: str, before: bytes, after: bytes) -> Judged:
    """Play a program before and after compensation, and add to a finding what the tables do."""
    turned = is_lathe(before.decode("utf-8-sig", "replace"))
    if dialect in GRBL:
        refused = [_taken(_read(data.decode("utf-8-sig", "replace")))[1] for data in (before, after)]
        # A mode may be named anew in the line.
        bare = [re.sub(r"G0*[0-3](?!\d)|\s", "", line) for line in refused]
        if bare[1] != bare[0]:
            return found._replace(outcome="refused", reason=f"the controller refuses {refused[1].strip()}")
    one, other = (played_places(dialect, data, turned=turned) for data in (before, after))
    if one is None or other is None:
        return found
    of_path = np.flatnonzero(one[1] | np.append(one[1][1:], False))
    # A piece is cut if the move to its end cuts: the others are ways through the air between two stretches.
    polyline = Polyline(one[0][of_path], one[1][of_path[1:]] & (np.diff(of_path) == 1))
    one, other = in_the_work(one, one), in_the_work(other, one)
    if not (one[1].any() and other[1].any()):
        return found
    return _compared(found, one, other, polyline, axes_of(dialect, after))


def axes_of(dialect: str, after: bytes) -> str:
    """Axes whose backlash counts for a compensated program.

    A printer's Z goes up from where homing left it, on a side that only the firmware knows.
    """
    return "XY" if dialect in PRINTERS and b"offset Z" not in after else "XYZ"


def played_places(dialect: str, data: bytes, *, turned: bool | None = None) -> tuple[np.ndarray, np.ndarray] | None:
    """Places of the motors (n, 3) [mm] and whether the tool cuts; None where nothing here reads the language.

    It is `turned` where that is known of the original, in which no feeds were added.
    """
    text = data.decode("utf-8-sig", "replace")
    sets = dialect in _SETTING_DECIDES and (nobody_knows_where(text) or _SETTING_DECIDES[dialect](text.upper()))
    if sets or _SWITCHES.get(dialect, _SWITCHES["others"]).search(text):
        return None
    own = {"siemens": SiemensRun, "heidenhain": TncRun, "heidenhain-iso": iso_run}
    try:
        if dialect in own:
            run = own[dialect](text)
            kept = _thinned(run.path)
            return run.path[kept], run.cutting[kept]
        # Printers home, and may be pushed by hand where they let go of their motors; others stand where nobody knows.
        begins = [((0.0, 0.0, 0.0) if dialect in PRINTERS else one, one) for one in BEGINS]
        told: list[list[Move] | None] = [None]
        if dialect == "linuxcnc":
            told = [canon_moves(text, begin, TOOLS.read_text()) for begin, _ in begins]
        elif dialect == "fanuc" and (is_lathe(text) if turned is None else turned):
            told = [lathe_moves(text.upper(), begin) for begin, _ in begins]
        if all(moves is not None for moves in told):
            switched = dialect == "linuxcnc" and any(move.line == CUTS for move in told[0])
            return _sampled(told, {CUTS} if switched else None)
        read = _read(_UNMOVED.sub("", text.upper()) if dialect in PRINTERS else text)
        if dialect in GRBL:
            read, _ = _taken(read)
        if dialect == "fanuc":
            read = _UNDOTTED.sub(lambda found: f"{found[1]}{float(found[2]) / THOUSAND}", read)
        laid = _laid(read) if dialect in PRINTERS else _turning(read)
        runs = [
            [interpret(read, one, spiral=True, released=other, own_center=incremental) for incremental in (True, False)]
            for one, other in begins
        ]
        # Of a program none of whose arcs end where they should about centres from their starts these are places.
        placed = _astray(runs[0][0]) and not _astray(runs[0][1])
        return _sampled([either[placed] for either in runs], laid)
    except (ArithmeticError, LookupError, TypeError, ValueError):
        return None


def _read(text: str) -> str:
    """Return what a controller reads of a program: up to its end, and without text."""
    return _UNREAD.sub("", _END.split(text.upper())[0])


def _taken(read: str) -> tuple[str, str]:
    """Return what Grbl takes of a program, and the line that it refuses; all of what the tests cannot read."""
    try:
        own, placed = (interpret(read, spiral=True, own_center=one) for one in (True, False))
        return up_to_refused(read, own_center=not _astray(own) or _astray(placed))
    except (ArithmeticError, LookupError, TypeError, ValueError):
        return read, ""


def _counts_in_any(text: str) -> bool:
    """Return whether the control's setting decides what lengths without a point are: all are small in increments."""
    bare = re.sub(r"\([^)]*\)|G0?4\b.*|K\d+", "", text)
    found = [abs(float(one[2])) for one in _UNDOTTED.finditer(bare)]
    return any(found) and max(found) < THOUSAND and "IN INCREMENTS" not in text


def _measures_in_any(text: str) -> bool:
    """Return whether the control's setting decides what X is: a lathe's program that says nothing of diameters."""
    bare = re.sub(r";.*", "", text)
    feeds = [float(found) for found in re.findall(r"F=? *(\d*\.?\d+)", bare)]
    turned = re.search(r"G96|LIMS|CYCLE9[3-8]", bare) or (0.0 < max(feeds, default=0.0) <= 2.0 and "G94" not in bare)
    return bool(turned) and "DIAM" not in bare


_SETTING_DECIDES = {"fanuc": _counts_in_any, "siemens": _measures_in_any}


def _astray(moves: list[Move]) -> bool:
    """Return whether an arc ends at another distance from its centre than it begins, by a hundredth of a millimetre."""
    arcs = [(move, list(move.plane[:2])) for move in moves if move.mode > 1]
    ends = [[math.dist(at[axes], move.center) for at in (move.start, move.end)] for move, axes in arcs]
    return any(abs(first - last) > 0.01 + 0.001 * first for first, last in ends)


def nobody_knows_where(text: str) -> bool:
    """Return whether a text is a subprogram that says neither G90 nor G91: whoever calls it decides where it leads."""
    bare = re.sub(r"\([^)]*\)", "", text.upper())
    ends = [found.start() for found in (_END.search(bare),) if found]
    called = _CALLED.search(bare)
    return called is not None and not any(end < called.start() for end in ends) and _MEASURE.search(bare) is None


def _thinned(path: np.ndarray) -> np.ndarray:
    """Mask of the samples (n, 3) that are kept of very many: some along the way, and all beside its corners."""
    kept = np.arange(len(path)) % max(1, len(path) // MOST) == 0
    steps = np.diff(path, axis=0)
    turns = np.linalg.norm(np.diff(steps, axis=0), axis=1) > SHARP * np.linalg.norm(steps[1:], axis=1)
    kept[1:-1] |= turns
    kept[:-2] |= turns
    kept[2:] |= turns
    return kept


def _laid(text: str) -> set[int] | None:
    """Numbers of the lines in which a printer lays filament; None where none does: it holds another tool."""
    found, absolute, at = set(), True, 0.0
    for number, line in enumerate(text.splitlines(), 1):
        words = dict(re.findall(r"([A-Z])([-+]?[\d.]+)", line.partition(";")[0]))
        absolute = {"82": True, "83": False}.get(words.get("M", ""), absolute)
        if "E" not in words:
            continue
        before, at = at if absolute else 0.0, float(words["E"])
        draws = "G" in words and bool(words.keys() & {"X", "Y"})
        if draws and words["G"].lstrip("0") in ("", "1", "2", "3") and at > before:
            found.add(number)
    return found or None


def _turning(text: str) -> set[int] | None:
    """Numbers of the lines in which the spindle turns; None where a program does not switch it on and off.

    A move in a line that stops it ends before, and nobody knows of the lines before the first that says something.
    """
    found, turns, said = set(), True, set()
    for number, line in enumerate(text.splitlines(), 1):
        orders = {order.lstrip("0") for order in re.findall(r"M(\d+)(?![\d.])", re.sub(r"\([^)]*\)|;.*", "", line))}
        said |= orders & {"3", "4", "5"}
        turns = (turns or bool(orders & {"3", "4"})) and ("5" not in orders or bool(orders & {"3", "4"}))
        if turns:
            found.add(number)
    return found if "5" in said and len(said) > 1 else None


def _sampled(runs: list[list[Move]], laid: set[int] | None = None) -> tuple[np.ndarray, np.ndarray] | None:
    """Return places, and whether the tool cuts there, of moves that lead from several places at the beginning.

    A move that leads from where the machine happens to stand is no more than a rapid to its end, and one in another
    line than those `laid` no more than one through the air: nothing is laid there, or the spindle stands.
    """
    moving = [same for same in zip(*runs, strict=True) if any(move.length > 0.0 for move in same)]
    if not moving:
        return None
    last = [move.end for move in moving[-1]]
    step = max(COARSE, sum(same[0].length for same in moving if same[0].mode) / MOST)
    points, cuts = [], []
    for same in moving:
        move = same[0]
        ends = np.array([(one.start - to, one.end - to) for one, to in zip(same, last, strict=True)])
        places = np.array([(one.start, one.end) for one in same])
        # Beside the last place, or wherever that is, as behind motors that were let go of.
        known = bool(min(np.ptp(found, axis=0).max() for found in (ends, places)) < 1e-9)
        count = max(2, math.ceil(move.length / (step if move.mode else RAPID)), _chords(move)) if known else 1
        if not points:
            # On an axis on which all begin at one place it is known from where the first move comes.
            begin = np.where(np.ptp(ends[:, 0], axis=0) < 1e-9, move.start, move.end)
            points, cuts = [begin[None]], [np.zeros(1, dtype=bool)]
        points.append(move.at(np.linspace(0.0, 1.0, count + 1)[1:]))
        cuts.append(np.full(count, known and move.mode > 0 and (laid is None or move.line in laid)))
    return np.concatenate(points), np.concatenate(cuts)


def _chords(move: Move) -> int:
    """Number of chords that stay as near as `SAGITTA` to an arc; 0 for a line."""
    if move.mode < 2:
        return 0
    away = move.start[list(move.plane[:2])] - np.array(move.center)
    return math.ceil(abs(move.sweep) * math.sqrt(float(np.linalg.norm(away)) / (8.0 * SAGITTA)))


Places = tuple[np.ndarray, np.ndarray]


def _compared(found: Judged, one: Places, other: Places, polyline: Polyline, axes: str) -> Judged:
    (motor, cuts), (after, cuts_after) = one, other
    tree = cKDTree(motor[cuts])
    cuts_after &= ~((polyline.distances(after) > TAKEN_UP) & (distances(after, motor) < TAKEN_UP))
    labels = _stretches(motor, cuts)
    worst: list[tuple[np.ndarray, ...]] = []
    for side in (-1.0, 1.0):
        errors = [polyline.distances(table_of(m, side, axes)[c]) for m, c in ((motor, cuts), (after, cuts_after))]
        near = tree.query(after[cuts_after])[1]
        own = [(labels, errors[0]), (labels[near], errors[1])]
        worst.append((*errors, *(_by_stretch(rows, error, int(labels.max(initial=0)) + 1) for rows, error in own)))
    rms = tuple(max(math.sqrt(float((w[k] ** 2).mean())) for w in worst) for k in (0, 1))
    p95 = tuple(max(float(np.quantile(w[k], 0.95)) for w in worst) for k in (0, 1))
    plain, led = (np.max([w[k] for w in worst], axis=0) for k in (2, 3))
    shown = plain > SHOWS
    followed = shown & (led <= np.maximum(FOLLOWED * plain, SHOWS))
    return found._replace(rms=rms, p95=p95, shown=int(shown.sum()), followed=int(followed.sum()))


def in_the_work(made: Places, original: Places) -> Places:
    """Leave out what cuts nothing: the height at which the tool goes from place to place, and the end of rapids.

    Behind a rapid an axis comes to its side of the backlash within `TAKEN_UP` of where a rapid of the original ended,
    and no lower. Where Z hardly moves that is no cut up to where the tool is nearest to that end: it is on its way
    there.
    """
    motor, cuts = made
    kept = cuts.copy()
    if len(motor) == 1:
        return motor, kept
    # Before the first move it stands where nobody knows, and up to the first sideways it only comes to its height.
    sideways = (motor[1:, :2] != motor[:-1, :2]).any(axis=1)
    first = 1 + int(sideways.argmax())
    kept[1:first] &= motor[1:first, 2] <= motor[: first - 1, 2]
    heights = motor[first:, 2]
    top, bottom = heights.max(), heights.min()
    flat = bool(top - bottom <= 4.0 * GAP)
    if not flat:
        kept &= motor[:, 2] < top - 2.0 * GAP
    ends = original[0][~original[1]]
    near, nearest = cKDTree(ends).query(motor, distance_upper_bound=TAKEN_UP)
    there = motor[:, 2] >= np.append(ends[:, 2], np.inf)[nearest] - SAME_HEIGHT
    leaves = np.append(np.flatnonzero(~(cuts & there)), len(cuts))
    for row in np.flatnonzero(cuts & ~np.append(False, cuts[:-1])).tolist():
        behind = int(leaves[np.searchsorted(leaves, row)])
        if flat and behind > row:
            # Of places that are as near it is the last: an approach ends as far beyond as it began before.
            here = near[row:behind]
            behind = row + int(np.flatnonzero(here <= here.min() + SAME_HEIGHT)[-1])
        kept[row:behind] = False
    return motor, kept


def table_of(motor: np.ndarray, side: float, axes: str) -> np.ndarray:
    """Places of the table, of which some axes have backlash; Z has its zero from where it moves down."""
    columns = list(motor.T.copy())
    for axis, name in enumerate("XYZ"):
        if name in axes and np.ptp(motor[:, axis]) > NO_WAY:
            columns[axis] = play(motor[:, axis], GAP, side) - (0.5 * GAP if name == "Z" else 0.0)
    return np.column_stack(columns)


def _stretches(motor: np.ndarray, cuts: np.ndarray) -> np.ndarray:
    """Numbers, for the samples that cut, of the stretches from one reversal of any axis to the next."""
    turned = np.zeros(len(motor), dtype=np.bool_)
    for column in motor.T:
        _mark_turns(np.ascontiguousarray(column), turned)
    return np.asarray(np.cumsum(turned)[cuts])


@numba.njit(cache=True)
def _mark_turns(column, turned):  # type: ignore[no-untyped-def]
    low = high = column[0]
    sign = 0
    for row in range(column.size):
        place = column[row]
        if sign == 0:
            low, high = min(low, place), max(high, place)
        if sign >= 0 and high - place > BAND:
            turned[row] |= sign != 0
            sign, low = -1, place
        elif sign <= 0 and place - low > BAND:
            turned[row] |= sign != 0
            sign, high = 1, place
        if sign < 0:
            low = min(low, place)
        else:
            high = max(high, place)


def _by_stretch(labels: np.ndarray, errors: np.ndarray, count: int) -> np.ndarray:
    """Root mean square of errors by stretch, shape (count,)."""
    total, number = np.bincount(labels, errors**2, count), np.bincount(labels, minlength=count)
    return np.sqrt(total / np.maximum(number, 1))
