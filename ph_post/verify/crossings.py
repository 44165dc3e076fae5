"""Check the changes that name a crossing on the fly, by an axis with ideal backlash behind the new program's motions.

Where a crossing lies is not looked for: the table follows the whole changed stretch, and has to stay on the original.
"""

from __future__ import annotations

from collections import Counter
from itertools import product
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from ph_post.gcode.program import ARC, AXES, LINE, Motions, plane_columns
from ph_post.types import Array, BoolArray, IntArray
from ph_post.units import MM, MM_PER_MIN
from ph_post.verify.line_pairs import UNNAMED, VerifyCase
from ph_post.verify.offsets import feeds_of, largest_of, spare_feed
from ph_post.verify.pairing import EXACT, Pairing, crossing_axes, declared_sides
from ph_post.verify.path import MEASURED, measure_deviation, report_path, swings_of
from ph_post.verify.play import TableWay, align, follow_play, nearest_there, possible_sides
from ph_post.verify.polylines import first_unreached, polylines
from ph_post.verify.stretches import Stretches, StretchSide

_FINE = 20.0
"""Chords stand in for arcs within this part of the tolerance, and the bound is widened by as much."""

_ROUNDED = 2.0
"""A point may be off by so many units of its last decimal."""

_WAITING = 0.1
"""Part of the backlash within which an axis counts as having crossed it."""

_LONGER = 0.01
"""A crossing may be longer than declared by this part: lengths of splines are approximate."""

_APART = 1.0
"""Stretches are laid out in one row with so much [m] between them."""


class CrossedStretches(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The stretches of changes that name a crossing, and where each of their motions is along the original.

    `found` the stretches; `fine` (r,) false where the table does not follow; places are laid out in one row:
    `old_low`, `old_high` of the original's motions, `new_low`, `new_high` of the new ones; `group` (g, 2) the
    places from which and to which a crossing lies; `spare` (r,) [m] what rounding leaves; `at_corner` (k,) the
    motions of the program that cross while the path stands still.
    """

    found: Stretches
    fine: BoolArray
    old_low: Array
    old_high: Array
    new_low: Array
    new_high: Array
    group: Array
    spare: Array
    at_corner: BoolArray


class _Polylines(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Polylines of the stretches of one program, those of stretch r from ``first[r]`` on.

    `begin`, `end` are the first and last point of each motion.
    """

    points: Array
    first: IntArray
    begin: IntArray
    end: IntArray


class _Ways(NamedTuple):
    """Polylines of the original and of the new program, and where the former's points are.

    `along` (n,) is their distance [m] from the beginning of their stretch, `row` (r,) that of the stretches in the row.
    """

    old: _Polylines
    new: _Polylines
    along: Array
    row: Array


def check_crossings(case: VerifyCase, pairing: Pairing, found: Stretches) -> CrossedStretches:
    """Check path, number, length, feeds and arcs of the changes that name a crossing."""
    declared = case.declared
    whole = _check_blocks(case, found)
    if not whole.change.size:
        _check_names(case, [], np.zeros(0, dtype=np.int64))
        return _nothing(case, whole)
    sagitta = case.bound / _FINE
    sides = _sides_of(case, pairing, whole)
    starts = _starts(case, pairing, whole, sides)
    ways = _ways_of(case, whole, starts, sagitta)
    old, new = ways.old, ways.new
    grid = _grid(case, whole)
    spare = _ROUNDED * grid + 2.0 * sagitta
    bound = case.bound + declared.within + 2.0 * sagitta + _ignored(case, old)
    # Where the path is flat, the table may wait outside it by what is declared, until the path comes back behind it.
    waits = np.minimum(declared.within, _WAITING * np.max(sides[:, :, 1] - sides[:, :, 0], axis=1))
    tables = [follow_play(new.points, new.first, sides, start, _ROUNDED * grid + EXACT + waits) for start in starts]
    judged = [_says_something(new, starts, tables, number) for number in range(len(starts))]
    fine = _check_followed(case, whole, ways, list(zip(tables, judged, strict=True)), bound)
    places = [align(old.points, old.first, ways.along, one.points, one.first, bound) for one in tables]
    apart = [
        float(away[np.repeat(own, np.diff(one.first))].max(initial=0.0))
        for one, own, (_, away) in zip(tables, judged, places, strict=True)
    ]
    _check_declared(case, max(apart, default=0.0), fine)
    table, (place, _) = tables[0], places[0]
    turns = _turns(pairing, whole, new, table)
    _check_names(case, turns, whole.change[~fine])
    stretch = whole.new.stretch()
    new_low, new_high = (ways.row[stretch] + place[table.place[at]] for at in (new.begin, new.end))
    old_low, old_high = (ways.row[whole.old.stretch()] + ways.along[at] for at in (old.begin, old.end))
    crossed = CrossedStretches(
        found=whole,
        fine=fine,
        old_low=old_low,
        old_high=old_high,
        new_low=new_low,
        new_high=new_high,
        group=_check_lengths(case, whole, ways, (new_low, new_high), (sides, spare, table.turned)),
        spare=spare,
        at_corner=_at_corner(case, whole, new_high - new_low <= spare[stretch]),
    )
    _check_feeds(case, crossed, ways)
    _check_arcs(case, crossed, sides)
    case.findings.count("crossings", len(turns))
    return crossed


def _turns(pairing: Pairing, found: Stretches, new: _Polylines, table: TableWay) -> list[tuple[int, str, int]]:
    """List where the motor comes to the other side of a backlash: the change, the axis, and the direction."""
    # A jog between two dwells is a stop, and no crossing on the fly.
    stopped = np.repeat(pairing.jog[found.new.motion], new.end - new.begin + 1)
    point, axis = np.nonzero(np.where(stopped[:, None], 0, table.turned))
    changes = found.change[np.searchsorted(new.first, point, side="right") - 1]
    signs = table.turned[point, axis]
    return [
        (change, AXES[column], sign)
        for change, column, sign in zip(changes.tolist(), axis.tolist(), signs.tolist(), strict=True)
    ]


def _nothing(case: VerifyCase, found: Stretches) -> CrossedStretches:
    """Return what is known of no stretch at all."""
    return CrossedStretches(
        found=found,
        fine=np.zeros(0, dtype=bool),
        old_low=np.zeros(0),
        old_high=np.zeros(0),
        new_low=np.zeros(0),
        new_high=np.zeros(0),
        group=np.zeros((0, 2)),
        spare=np.zeros(0),
        at_corner=np.zeros(case.compensated.motions.kind.size, dtype=bool),
    )


def _check_blocks(case: VerifyCase, found: Stretches) -> Stretches:
    """Return the stretches that have motions, and report the others, and crossings that no header declares."""
    declared = case.declared
    empty = np.diff(found.new.first) == 0
    for change in found.change[empty].tolist():
        report_path(case, change, -1, case.bound, None, "a replaced motion is missing")
    largest = max((one.metres for one in declared.offsets.values()), default=0.0)
    if declared.crossings and declared.within > largest:
        case.findings.add(
            "crossing",
            "crossings are declared to leave the path farther than backlash does",
            compensated=declared.first,
            expected=f"<= {largest / MM:g} mm",
            got=f"{declared.within / MM:g} mm",
        )
    return found.take(~empty)


def _sides_of(case: VerifyCase, pairing: Pairing, found: Stretches) -> Array:
    """Return what the motor of each axis is ahead of its table in both directions [m], (r, 3, 2).

    Axes that do not cross in a change keep the shift with which it begins.
    """
    first = found.new.motion[found.new.first[:-1]]
    sides = np.repeat(pairing.before_of(first)[:, :, None], 2, axis=2)
    crossing = crossing_axes(case, pairing)[found.change]
    for axis, both in declared_sides(case.declared).items():
        sides[crossing[:, axis], axis] = both
    return sides


def _starts(case: VerifyCase, pairing: Pairing, found: Stretches, sides: Array) -> list[Array]:
    """Return what the motors may be ahead of their tables where the stretches begin [m], each (r, 3).

    A shift to one side says that the axis was moving there. With none, it may be on any side that the motions
    before leave possible; the first has it where the shift says.
    """
    motions = case.compensated.motions
    first = found.new.motion[found.new.first[:-1]]
    shift = np.clip(pairing.before_of(first), sides[:, :, 0], sides[:, :, 1])
    either = np.repeat(shift[:, :, None], 2, axis=2)
    for axis, both in declared_sides(case.declared).items():
        unknown = (np.abs(shift[:, axis]) <= EXACT) & (sides[:, axis, 0] < sides[:, axis, 1])
        if unknown.any():
            ends = (motions.start[:, axis], motions.end[:, axis])
            known = possible_sides(ends, motions.chain.astype(np.int32), swings_of(motions, axis), both)[first]
            either[unknown, axis] = known[unknown]
            far = np.abs(either[:, axis] - shift[:, axis, None])
            either[far[:, 1] < far[:, 0], axis] = either[far[:, 1] < far[:, 0], axis, ::-1]
    axes = [axis for axis in range(len(AXES)) if np.any(np.abs(np.diff(either[:, axis])) > EXACT)]
    starts = []
    for ways in product((0, 1), repeat=len(axes)):
        choice = np.zeros(len(AXES), dtype=np.int64)
        choice[axes] = ways
        starts.append(np.take_along_axis(either, np.broadcast_to(choice[None, :, None], (*shift.shape, 1)), 2)[:, :, 0])
    return starts


def _says_something(new: _Polylines, starts: list[Array], tables: list[TableWay], number: int) -> BoolArray:
    """Mask of the stretches (r,) that a start says something of.

    Where an axis is pushed to the side that its shift says before it crosses, the table is away from the path until
    then as it is behind the original's motor, and the same as from the first start ever after.
    """
    mask = np.ones(len(new.first) - 1, dtype=np.bool_)
    one, other = tables[0], tables[number]
    for stretch in np.flatnonzero(np.any(np.abs(starts[number] - starts[0]) > EXACT, axis=1)).tolist():
        low, high = int(new.first[stretch]), int(new.first[stretch + 1])
        apart = np.abs(one.points[one.place[low:high]] - other.points[other.place[low:high]])
        mask[stretch] = False
        for axis in np.flatnonzero(apart[0] > EXACT).tolist():
            turns = np.flatnonzero(one.turned[low:high, axis])
            mask[stretch] |= not turns.size or bool(apart[turns[0] - 1, axis] > EXACT)
    return mask


def _ways_of(case: VerifyCase, found: Stretches, starts: list[Array], sagitta: float) -> _Ways:
    """Polylines of the original's stretches, and of the motor's; where nothing is replaced, the place of that."""
    new = _traced(case.compensated.motions, found.new, sagitta)
    old = _traced(case.original.motions, found.old, sagitta)
    empty = np.flatnonzero(np.diff(old.first) == 0)
    if empty.size:
        added = np.zeros(old.first.size, dtype=np.int64)
        added[empty + 1] = 1
        there = new.points[new.first[empty]] - starts[0][empty]
        moved = np.cumsum(added)[:-1][found.old.stretch()]
        old = _Polylines(
            points=np.insert(old.points, old.first[empty], there, axis=0),
            first=old.first + np.cumsum(added),
            begin=old.begin + moved,
            end=old.end + moved,
        )
    along = _lengths_along(old)
    row = np.append(0.0, np.cumsum(along[old.first[1:] - 1] + _APART))[:-1]
    return _Ways(old, new, along, row)


def _traced(motions: Motions, side: StretchSide, sagitta: float) -> _Polylines:
    lines = polylines(motions, side.motion, sagitta)
    return _Polylines(
        points=np.nan_to_num(lines.points),
        first=lines.first[side.first],
        begin=lines.first[:-1],
        end=lines.first[1:] - 1,
    )


def _grid(case: VerifyCase, found: Stretches) -> Array:
    """Last decimal [m] that is written in each stretch."""
    decimals = case.declared.decimals or 0
    units = np.array([modal.units for modal in case.compensated.modal])
    block = case.lines.changes.new_last[found.change] - 1
    return np.asarray(units[case.compensated.state[block]] * 10.0**-decimals)


def _lengths_along(way: _Polylines) -> Array:
    """Length from the beginning of its polyline to each point [m]."""
    steps = np.zeros(len(way.points))
    steps[1:] = np.linalg.norm(np.diff(way.points, axis=0), axis=1)
    steps[way.first[:-1]] = 0.0
    along = np.cumsum(steps)
    return np.asarray(along - np.repeat(along[way.first[:-1]], np.diff(way.first)))


def _points_at(ways: _Ways, place: Array) -> Array:
    """Points of the original at places in the row."""
    everywhere = ways.along + np.repeat(ways.row, np.diff(ways.old.first))
    return np.column_stack([np.interp(place, everywhere, ways.old.points[:, axis]) for axis in range(3)])


def _ignored(case: VerifyCase, old: _Polylines) -> Array:
    """Return the longest way (r,) [m] that an axis goes back and on again within its dead band: no table follows.

    The first way of a stretch, and the last, may be one back as well, as that of an arc beside its turning point.
    """
    longest = np.zeros(old.first.size - 1)
    stretch = np.repeat(np.arange(longest.size), np.diff(old.first))
    for name, amount in case.declared.offsets.items():
        step = np.diff(old.points[:, AXES.index(name)])
        moves = np.flatnonzero((np.abs(step) > EXACT) & (stretch[1:] == stretch[:-1]))
        if moves.size == 0:
            continue
        own, step = stretch[moves], step[moves]
        begins = np.flatnonzero(np.append(True, (np.diff(own) != 0) | (np.diff(np.sign(step)) != 0)))
        way, own = np.abs(np.add.reduceat(step, begins)), own[begins]
        inside = (np.append(-1, own[:-1]) == own) & (np.append(own[1:], -1) == own)
        small = np.flatnonzero(way <= np.where(inside, max(case.band, amount.metres), case.band))
        np.maximum.at(longest, own[small], way[small])
    return longest


def _check_followed(
    case: VerifyCase,
    found: Stretches,
    ways: _Ways,
    tables: list[tuple[TableWay, BoolArray]],
    bound: Array,
) -> BoolArray:
    """Check that the table follows the original, whichever side it begins on; mask of the stretches where it does.

    With each table goes the mask of the stretches in which it is judged.
    """
    old, new = ways.old, ways.new
    fine = np.ones(found.change.size, dtype=bool)
    owner = np.repeat(found.new.motion, new.end - new.begin + 1)
    for table, judged in tables:
        stuck = np.where(judged, first_unreached(old.points, old.first, table.points, table.first, bound), -1)
        for rank, place in enumerate(np.flatnonzero((stuck >= 0) & fine).tolist()):
            low, high = table.first[place], table.first[place + 1]
            at = min(int(low + stuck[place]), int(high) - 1)
            deviation = None
            if rank < MEASURED:
                deviation = measure_deviation(
                    old.points[old.first[place] : old.first[place + 1]], table.points[low:high]
                )
            what = "the table does not follow the original's path through the crossing"
            report_path(
                case, int(found.change[place]), int(owner[table.owner[at]]), float(bound[place]), deviation, what
            )
        fine &= stuck < 0
    return fine


def _check_declared(case: VerifyCase, farthest: float, fine: BoolArray) -> None:
    """Check that the largest distance [m] of the table from the path is not far below the declared one."""
    if not fine.size or not fine.all():
        return
    if farthest < case.declared.within - case.bound:
        case.findings.add(
            "crossing",
            "no crossing leaves the path as far as declared",
            compensated=case.declared.first,
            expected=f"{case.declared.within / MM:.4g} mm",
            got=f"{farthest / MM:.4g} mm",
        )


def _check_names(case: VerifyCase, turns: list[tuple[int, str, int]], failed: IntArray) -> None:
    """Check that each change has the crossings that its mark names, and all together as many as the header declares.

    `turns` are the change, axis and new direction of each; `failed` the changes in which they mean nothing.
    """
    changes, broken = case.lines.changes, set(failed.tolist())
    there: dict[int, set[tuple[str, int]]] = {}
    for change, axis, sign in turns:
        there.setdefault(change, set()).add((axis, sign))
    counts = Counter(change for change, _, _ in turns)
    marks = [(change, int(changes.marker[change])) for change in np.flatnonzero(changes.crossed).tolist()]
    case.findings.crossings.update({mark + 1: counts[change] for change, mark in marks})
    for change, names in enumerate(changes.crossings):
        if names is None or change in broken:
            continue
        got, wanted = there.get(change, set()), names - {UNNAMED}
        if got == wanted or (UNNAMED in names and wanted <= got):
            continue
        case.findings.add(
            "crossing",
            "the crossings of the change are not those that its mark names",
            compensated=int(changes.marker[change]),
            expected=_format_names(wanted),
            got=_format_names(got),
        )
    if len(turns) != case.declared.crossings and not broken:
        case.findings.add(
            "count",
            "the number of crossings is not the declared one",
            compensated=case.declared.first,
            expected=str(case.declared.crossings),
            got=str(len(turns)),
        )


def _format_names(names: set[tuple[str, int]] | frozenset[tuple[str, int]]) -> str:
    return ", ".join(f"{axis}{'+' if sign > 0 else '-'}" for axis, sign in sorted(names)) or "none"


def _check_lengths(
    case: VerifyCase,
    found: Stretches,
    ways: _Ways,
    ends: tuple[Array, Array],
    backlash: tuple[Array, Array, NDArray[np.int8]],
) -> Array:
    """Check that no crossing is longer than declared: straight blocks with other ends than the original's, shifted.

    `ends` are the places of the new motions, `backlash` the sides of the axes, what rounding leaves, and where the
    motor changes sides. Returns the places between which the crossings lie, (g, 2).
    """
    old, new, (low, high), (sides, spare, turned) = ways.old, ways.new, ends, backlash
    stretch = found.new.stretch()
    shifted = _shifted(sides)
    kept, clean = np.zeros(stretch.size, dtype=bool), np.zeros(stretch.size, dtype=bool)
    reach = (np.max(sides[:, :, 1] - sides[:, :, 0], axis=1) + case.bound)[stretch]
    span = np.column_stack([low - ways.row[stretch] - reach, high - ways.row[stretch] + reach])
    for shift in shifted:
        near = [
            nearest_there(old.points, old.first, ways.along, stretch, span, new.points[at] - shift[stretch])
            <= spare[stretch]
            for at in (new.begin, new.end)
        ]
        kept |= near[0] & near[1]
        clean |= near[1]
    block = (case.compensated.motions.kind[found.new.motion] == LINE) & ~kept
    begins = block & np.append(True, ~block[:-1] | clean[:-1] | (np.diff(stretch) > 0))[: block.size]
    rows = np.flatnonzero(block)
    first = np.searchsorted(rows, np.flatnonzero(begins))
    if not rows.size:
        return np.zeros((0, 2))
    sums = np.append(0, np.cumsum(np.any(turned != 0, axis=1)))
    turns = np.add.reduceat((sums[new.end + 1] - sums[new.begin])[rows], first)
    last = np.append(first[1:], rows.size) - 1
    group = np.column_stack([low[rows[first]], high[rows[last]]])[turns > 0]
    length = group[:, 1] - group[:, 0]
    most = case.declared.crossing_length * (1.0 + _LONGER) + 2.0 * spare[stretch[rows[first]]][turns > 0]
    for place in np.flatnonzero(length > most).tolist():
        motion = int(found.new.motion[rows[first[turns > 0][place]]])
        case.findings.add(
            "crossing",
            "the crossing is longer than declared",
            compensated=int(case.compensated.motions.block[motion]),
            expected=f"<= {case.declared.crossing_length / MM:.4g} mm",
            got=f"{length[place] / MM:.4g} mm",
        )
    return np.asarray(group)


def _shifted(sides: Array) -> list[Array]:
    """Every combination of the shifts that the axes may carry in each stretch [m], each (r, 3)."""
    choices: list[list[Array]] = []
    for axis in range(len(AXES)):
        low, high = sides[:, axis].T
        crosses = bool(np.any(low < high))
        choices.append([low, high, np.where(low < high, 0.0, low)] if crosses else [low])
    return [np.column_stack(one) for one in product(*choices)]


def _at_corner(case: VerifyCase, found: Stretches, still: BoolArray) -> BoolArray:
    """Mask of the motions of the program that move axes while the path stands still."""
    motions = case.compensated.motions
    mask = np.zeros(motions.kind.size, dtype=bool)
    own = found.new.motion[still & (motions.kind[found.new.motion] == LINE)]
    way = np.nan_to_num(np.abs(motions.end[own] - motions.start[own]))
    mask[own[np.any(way > EXACT, axis=1)]] = True
    return mask


def _check_feeds(case: VerifyCase, crossed: CrossedStretches, ways: _Ways) -> None:
    """Check that the table keeps the original's feed: a block of a crossing is faster only as its way is longer."""
    found, new = crossed.found, ways.new
    stretch = found.new.stretch()
    mine = np.flatnonzero(crossed.fine[stretch] & (np.diff(found.old.first)[stretch] > 0))
    low, high, spare = crossed.new_low[mine], crossed.new_high[mine], crossed.spare[stretch[mine]]
    begin, end = found.old.first[stretch[mine]], found.old.first[stretch[mine] + 1]
    reach = np.minimum(spare + case.bound, 0.25 * (high - low))
    first = np.clip(np.searchsorted(crossed.old_high, low + reach), begin, end - 1)
    last = np.clip(np.searchsorted(crossed.old_low, high - reach), first + 1, end)
    bound = largest_of(feeds_of(case.original.motions, found.old), first, last)
    path = _points_at(ways, high) - _points_at(ways, low)
    motor = new.points[new.end[mine]] - new.points[new.begin[mine]]
    way = np.maximum(np.linalg.norm(path, axis=1) - spare, 0.0)
    longer = np.maximum(np.linalg.norm(motor, axis=1), np.hypot(way, np.linalg.norm(motor - path, axis=1)))
    straight = case.compensated.motions.kind[found.new.motion[mine]] == LINE
    with np.errstate(divide="ignore", invalid="ignore"):
        # A block of no length, as of a line that is there twice, is no longer than its way.
        bound = bound * np.where(straight, np.fmax(longer / way, 1.0), 1.0)
    feed = feeds_of(case.compensated.motions, found.new)[mine]
    right = feed <= bound * (1.0 + spare_feed(case, found.new)[mine])
    right |= np.isnan(feed) & np.isnan(bound)
    case.findings.count("feeds", mine.size)
    for place in np.flatnonzero(~right).tolist():
        case.findings.add(
            "feed",
            "the feed beside the crossing is above the original's",
            compensated=int(case.compensated.motions.block[found.new.motion[mine[place]]]),
            expected=f"<= {bound[place] / MM_PER_MIN:.6g} mm/min",
            got=f"{feed[place] / MM_PER_MIN:.6g} mm/min",
        )


def _check_arcs(case: VerifyCase, crossed: CrossedStretches, sides: Array) -> None:
    """Check that arcs keep their plane and sense, and their centre but for a shift."""
    one, other, found = case.original.motions, case.compensated.motions, crossed.found
    stretch = found.new.stretch()
    arcs = np.flatnonzero((other.kind[found.new.motion] == ARC) & crossed.fine[stretch])
    middle = 0.5 * (crossed.new_low + crossed.new_high)[arcs]
    begin, end = found.old.first[stretch[arcs]], found.old.first[stretch[arcs] + 1]
    some = begin < end
    arcs, middle, begin, end = arcs[some], middle[some], begin[some], end[some]
    if not arcs.size:
        return
    old = found.old.motion[np.clip(np.searchsorted(crossed.old_high, middle), begin, end - 1)]
    new = found.new.motion[arcs]
    columns = plane_columns(other.plane[new])[:, :2]
    moved = other.center[new] - one.center[old]
    off = np.zeros(moved.shape)
    for n in range(2):
        both = sides[stretch[arcs], columns[:, n]]
        values = np.column_stack([both, np.clip(0.0, both[:, 0], both[:, 1])])
        off[:, n] = np.min(np.abs(moved[:, n, None] - values), axis=1)
    same = (one.kind[old] == ARC) & (one.plane[old] == other.plane[new])
    same &= np.sign(one.angle[old]) == np.sign(other.angle[new])
    for place in np.flatnonzero(~same | np.any(off > case.bound, axis=1)).tolist():
        case.findings.add(
            "path",
            "the arc beside the crossing is another one",
            original=int(one.block[old[place]]),
            compensated=int(other.block[new[place]]),
        )
