"""Families of designs for a turning point, as functions of a few numbers of order one.

Times are in units of the time that the design may add, travels in units of the gap, so that a point that is
good at one turning point is a good start at another. Interpolator tables take crossings at any feed; part
programs take full stops, with jogs between dwells.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Final

import msgspec
import numpy as np

from ph_post.compensate import profile, shapes
from ph_post.compensate.crossing_times import NO_REST, TRAVEL, Rest, carried, crossing_at_turn, whole_crossing
from ph_post.compensate.friction import Friction, direct_change, held_change
from ph_post.compensate.inverse import motor_inertia
from ph_post.compensate.offsets import DWELL, LEAST, make_jog, may_shift, whole_jog
from ph_post.compensate.profile import stop
from ph_post.compensate.strategies.registry import TAKE_UP
from ph_post.compensate.trial import EMPTY, Design, Surroundings
from ph_post.types import Array, Axis, Crossing, FrictionChange, Jog

ORDER: Final = 3
"""Derivatives of the feed that vanish at junctions."""

MUCH_LONGER: Final = 2.0
"""Times the budget up to which more time brings nothing new."""

ONE: Final = np.ones(1)


class ReversalCase(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A turning point as the families see it.

    `budget` [s] is the time that a design may add, `reversing` the axes that turn back here and have a gap,
    each with the direction it goes on in; `shortest` [s] by axis what a crossing takes at least, `turning` [m/s²] the
    acceleration with which it turns back where its gap is behind the loop, `rests` when it may be moved while it rests
    before. `lead` is whether designs include inverse dynamics, `crosses` whether gaps behind the loop are crossed.
    `friction` is by axis what is led of that, in rows of `period` [s]. What takes more than `longest` [s] is not tried.
    """

    place: Surroundings
    budget: float
    reversing: tuple[tuple[Axis, int], ...]
    shortest: dict[str, float]
    lead: bool
    turning: Mapping[str, float] = {}
    rests: Mapping[str, Rest] = {}
    crosses: bool = True
    friction: Mapping[str, Friction] = EMPTY
    period: float = 1e-3
    longest: float = math.inf

    @property
    def inside_loop(self) -> bool:
        """True where the gap of an axis that turns back lies inside its loop."""
        return any(axis.loop.encloses_backlash for axis, _ in self.reversing)

    @property
    def may_take_longer(self) -> bool:
        """True where much longer designs than the budget allows are worth trying."""
        return self.longest > MUCH_LONGER * self.budget

    @property
    def behind(self) -> tuple[tuple[Axis, int], ...]:
        """Those of them whose gap is behind their loop."""
        drives = ((axis, way) for axis, way in self.reversing if not axis.loop.encloses_backlash)
        return tuple((axis, way) for axis, way in drives if axis.gap.lost_motion > 0.0)

    @property
    def rubbing(self) -> tuple[tuple[Axis, int, Friction], ...]:
        """Axes that turn back here with friction that is led, each with the direction it goes on in, and that."""
        found = ((axis, way, self.friction.get(axis.name)) for axis, way in self.reversing)
        return tuple((axis, way, one) for axis, way, one in found if one is not None and one.turns)


class DesignFamily(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """One family: `make` builds a design from `low` <= x <= `high`.

    `seeds` are good starts, tried for each of the `budgets`, parts of an equal share of the time.
    """

    name: str
    low: Array
    high: Array
    seeds: tuple[Array, ...]
    make: Callable[[Array, ReversalCase], Design]
    budgets: tuple[float, ...] = (1.0,)


def _stop(down: float, hold: float, up: float, floor: float, lead: bool) -> Design:
    """Ramp down, hold with the turning point in its middle, ramp up [s]."""
    total = down + hold + up
    shape = profile.plateau(down, hold, up, floor, ORDER)
    turn = shapes.share_of_way(shape, (down + 0.5 * hold) / total)
    return Design(shape=shape, t_star=0.5 * total, turn=turn, lead=lead)


def _ramps(share: float, skew: float, case: ReversalCase, floor: float) -> tuple[float, float, float]:
    """Durations of ramp down, hold and ramp up that add the budget, of which the ramps have a share."""
    slow = 1.0 - floor
    ramps = 2.0 * share * case.budget / slow
    return ramps * (1.0 - 0.5 * skew), (1.0 - share) * case.budget / slow, ramps * 0.5 * skew


def make_plateau(x: Array, case: ReversalCase) -> Design:
    """Slow down, hold a feed, speed up: x = (share of the ramps, skew, floor, part of the budget)."""
    part = msgspec.structs.replace(case, budget=case.budget * float(x[3]))
    down, hold, up = _ramps(float(x[0]), float(x[1]), part, float(x[2]))
    return _with_offsets(_stop(down, hold, up, float(x[2]), case.lead), case)


def _with_offsets(design: Design, case: ReversalCase) -> Design:
    """Add the crossings that lasting offsets need in any case."""
    if not case.crosses:
        return design
    return msgspec.structs.replace(design, crossings=make_bare(ONE, case).crossings)


def make_crossing(x: Array, case: ReversalCase) -> Design:
    """Stop and cross: x = (share of the ramps, skew, start, T_1, a_1, T_2, a_2, push, push's duration).

    The motor crosses a_1 of the gap in T_1, a_2 in T_2 which overlaps it, and is then pushed on. With nothing
    but a push it coasts to the flank, wherever that is. A motor behind its loop travels the whole gap, once.
    """
    share, skew, start, t1, a1, t2, a2, push, pd = (float(value) for value in x)
    down, hold, up = _ramps(share, skew, case, 0.0)
    design = _stop(down, hold, up, 0.0, case.lead)
    begin = -design.t_star + down
    crossings: list[Crossing] = []
    for axis, direction in case.reversing:
        gap = axis.gap.lost_motion * direction
        if not axis.loop.encloses_backlash:
            if gap:
                crossings.append(whole_crossing(axis, direction, begin + 0.5 * hold, case.shortest[axis.name]))
            continue
        unit = _push_unit(axis, case.budget) * direction
        first = Crossing(
            axis=axis.name,
            start=begin + start * hold,
            duration=t1 * case.budget,
            travel=a1 * gap,
            order=ORDER,
        )
        second = Crossing(
            axis=axis.name,
            start=first.start + OVERLAP * first.duration,
            duration=t2 * case.budget,
            travel=a2 * gap,
            order=TRAVEL,
            push=push * unit,
            push_duration=pd * case.budget,
        )
        crossings += [first, second]
    return msgspec.structs.replace(design, crossings=tuple(crossings))


OVERLAP: Final = 0.8
"""Part of the first crossing after which the second begins."""


def _push_unit(axis: Axis, budget: float) -> float:
    """Return the push [m] that carries the motor over the gap in half the budget."""
    return 8.0 * motor_inertia(axis) * axis.gap.lost_motion / budget**2


def make_offset(x: Array, case: ReversalCase) -> Design:
    """Slow down and shift the offset: x = (share of the ramps, floor, part of the budget, T, shift)."""
    part = msgspec.structs.replace(case, budget=case.budget * float(x[2]))
    down, hold, up = _ramps(float(x[0]), 1.0, part, float(x[1]))
    design = _stop(down, hold, up, float(x[1]), case.lead)
    crossings = []
    for axis, direction in case.behind:
        duration = float(x[3]) * case.shortest[axis.name]
        crossings.append(whole_crossing(axis, direction, float(x[4]) * duration, duration))
    return msgspec.structs.replace(design, crossings=tuple(crossings))


def make_dip(x: Array, case: ReversalCase) -> Design:
    """Eq. (26) of the paper: x = (t* in budgets, V_2 ... V_{n-2})."""
    coefficients = np.ones(x.size + 3)
    coefficients[2:-2] = x[1:]
    shape = shapes.single(coefficients)
    return _with_offsets(Design(shape=shape, t_star=float(x[0]) * case.budget, lead=case.lead), case)


def make_friction(x: Array, case: ReversalCase) -> Design:
    """Slow down or stop, and turn the friction that is led round meanwhile.

    x = (share of the ramps, skew, floor, part of the budget, shift, release, hold, take, held): the last are the
    durations of the three steps of :class:`FrictionChange` in units of the shortest ones, and the part of the friction
    that carries the motor through its backlash. Around the middle of the hold they are shifted by a part of their
    duration.
    """
    share, skew, floor, part, shift, release, hold, take, held = (float(value) for value in x)
    less = msgspec.structs.replace(case, budget=case.budget * part)
    down, still, up = _ramps(share, skew, less, floor)
    design = _with_offsets(_stop(down, still, up, floor, case.lead), case)
    middle = -design.t_star + down + 0.5 * still
    changes = []
    for axis, way, friction in case.rubbing:
        one = held_change(axis, friction, -way, way, held, case.period)
        one = msgspec.structs.replace(one, release=release * one.release, hold=hold * one.hold, take=take * one.take)
        changes.append(msgspec.structs.replace(one, start=middle + (shift - 0.5) * one.duration))
    return msgspec.structs.replace(design, friction=tuple(changes))


def make_turn(x: Array, case: ReversalCase) -> Design:
    """Leave the feed alone, and turn the friction that is led round: x = (shift, duration), as in `make_friction`."""
    shift, longer = float(x[0]), float(x[1])
    changes = []
    for one in direct_changes(case):
        middle, duration = one.start + 0.5 * one.release, longer * one.release
        changes.append(msgspec.structs.replace(one, start=middle + (shift - 0.5) * duration, release=duration))
    return msgspec.structs.replace(make_bare(ONE, case), friction=tuple(changes))


def make_carried(x: Array, case: ReversalCase) -> Design:
    """Slow down, and carry the motor through a backlash inside the loop meanwhile.

    x = (share of the ramps, skew, floor, part of the budget, shift, T, lap): what carries it is shifted by a part of
    its duration from the middle of the hold; the others are those of `make_carried_through`.
    """
    share, skew, floor, part, shift, longer, lap = (float(value) for value in x)
    less = msgspec.structs.replace(case, budget=case.budget * part)
    down, still, up = _ramps(share, skew, less, floor)
    design = _with_offsets(_stop(down, still, up, floor, case.lead), case)
    return _carried(design, case, -design.t_star + down + 0.5 * still, shift, longer, lap)


def make_carried_through(x: Array, case: ReversalCase) -> Design:
    """Leave the feed alone, and carry the motor through a backlash inside the loop: x = (shift, T, lap).

    Friction is let go, the motor crosses in T of its shortest times, and friction is led the other way; of the first
    and the last the part `lap` is done while the motor crosses. All of that is shifted by a part of its duration from
    where the axis turns back; where it has rested for long enough by then, all is done while it rests.
    """
    shift, longer, lap = (float(value) for value in x)
    return _carried(make_bare(ONE, case), case, 0.0, shift, longer, lap)


def _carried(design: Design, case: ReversalCase, middle: float, shift: float, longer: float, lap: float) -> Design:
    """Add to a design what carries motors through backlash inside the loop, around an instant [s] of it."""
    crossings, changes = list(design.crossings), []
    rubbing = {axis.name: friction for axis, _, friction in case.rubbing}
    for axis, way in case.reversing:
        inside = axis.loop.encloses_backlash and axis.gap.lost_motion > 0.0
        duration = longer * case.shortest[axis.name] if inside else 0.0
        own = carried(axis, way, rubbing.get(axis.name), duration, lap, case.period)
        begin = case.rests.get(axis.name, NO_REST).start_of(own.duration)
        placed = own.at(middle + (shift - 0.5) * own.duration if begin is None else begin)
        crossings += placed[0]
        changes += placed[1]
    return msgspec.structs.replace(design, crossings=tuple(crossings), friction=tuple(changes))


def direct_changes(case: ReversalCase) -> tuple[FrictionChange, ...]:
    """Turn the friction that is led round at the turning point, or where the backlash begins to be crossed there."""
    crossings = {one.axis: one for one in make_bare(ONE, case).crossings}
    found = []
    for axis, way, friction in case.rubbing:
        crossing = crossings.get(axis.name)
        begin = 0.0 if crossing is None else crossing.start
        change = direct_change(axis, friction, -way, way, begin, case.period)
        if crossing is not None and crossing.end < 0.0:
            # It is made while the axis rests: friction is turned round before it.
            change = msgspec.structs.replace(change, start=begin - change.duration)
        found.append(change)
    return tuple(found)


def make_bare(x: Array, case: ReversalCase) -> Design:
    """Leave the feed alone and cross the gaps behind the loop: x = (T,)."""
    crossings = tuple(
        crossing_at_turn(
            axis,
            direction,
            float(x[0]) * case.shortest[axis.name],
            case.turning[axis.name],
            case.rests.get(axis.name, NO_REST),
        )
        for axis, direction in case.behind
    )
    return Design(crossings=crossings, lead=case.lead)


def _family(
    name: str,
    make: Callable[[Array, ReversalCase], Design],
    bounds: Sequence[Sequence[float]],
    *seeds: Sequence[float],
    budgets: tuple[float, ...] = (1.0,),
) -> DesignFamily:
    low, high = np.array(bounds, dtype=np.float64).T
    return DesignFamily(
        name=name,
        make=make,
        low=low,
        high=high,
        seeds=tuple(np.array(seed) for seed in seeds),
        budgets=budgets,
    )


CROSSING: Final = _family(
    TAKE_UP,
    make_crossing,
    [
        (0.1, 0.9),
        (0.4, 1.6),
        (-0.6, 1.0),
        (0.05, 1.5),
        (0.0, 1.2),
        (0.05, 1.5),
        (0.0, 0.8),
        (0.0, 8.0),
        (0.05, 1.2),
    ],
    [0.5, 1.5, -0.1, 0.16, 0.73, 0.16, 0.09, 1.0, 0.26],
    [0.5, 1.0, -0.05, 0.5, 0.8, 0.7, 0.2, 0.3, 0.5],
    [0.4, 1.0, 0.0, 0.6, 0.995, 0.4, 0.01, 0.0, 0.3],
    [0.3, 1.0, 0.0, 0.3, 0.5, 0.3, 0.3, 2.0, 0.5],
    [0.4, 1.0, -0.2, 0.05, 0.0, 0.05, 0.0, 1.9, 0.35],
    [0.45, 1.2, -0.3, 0.05, 0.0, 0.05, 0.0, 2.5, 0.3],
)

OFFSET: Final = _family(
    TAKE_UP,
    make_offset,
    [(0.1, 0.98), (0.0, 0.95), (0.02, 1.0), (1.0, 3.0), (-0.5, 0.5)],
    [0.4, 0.0, 1.0, 1.0, 0.0],
    [0.6, 0.0, 1.0, 1.0, 0.0],
    [0.9, 0.05, 1.0, 1.0, 0.0],
    [0.8, 0.3, 1.0, 1.0, 0.0],
    budgets=(0.15, 0.3, 0.6, 1.0, 1.7, 3.0, 5.0),
)

RUBBING: Final = _family(
    TAKE_UP,
    make_friction,
    [
        (0.1, 0.98),
        (0.4, 1.6),
        (0.0, 0.9),
        (0.05, 1.0),
        (-0.6, 0.6),
        (1.0, 4.0),
        (0.0, 2.5),
        (1.0, 4.0),
        (0.0, 0.7),
    ],
    [0.5, 1.0, 0.0, 1.0, 0.0, 1.0, 1.0, 1.0, 0.3],
    [0.5, 1.0, 0.0, 1.0, 0.0, 1.0, 1.0, 1.0, 0.15],
    [0.6, 1.0, 0.1, 1.0, 0.0, 1.0, 0.7, 1.0, 0.2],
    [0.6, 1.0, 0.25, 1.0, 0.0, 1.0, 0.7, 1.0, 0.2],
    [0.6, 1.0, 0.4, 0.6, 0.0, 1.0, 0.5, 1.0, 0.3],
)

CARRIED: Final = _family(
    TAKE_UP,
    make_carried,
    [(0.1, 0.98), (0.4, 1.6), (0.0, 0.9), (0.05, 1.0), (-0.6, 0.6), (0.8, 3.0), (0.0, 1.0)],
    [0.6, 1.0, 0.3, 1.0, 0.0, 1.0, 0.5],
    [0.6, 1.0, 0.5, 1.0, 0.0, 1.0, 0.5],
    [0.5, 1.0, 0.0, 1.0, 0.0, 1.0, 0.5],
    budgets=(0.6, 1.0, 1.7, 3.0),
)

CARRIED_THROUGH: Final = _family(
    TAKE_UP,
    make_carried_through,
    [(-1.0, 1.0), (0.8, 3.0), (0.0, 1.0)],
    [0.0, 1.0, 0.5],
    [0.1, 1.0, 0.5],
)

TURN: Final = _family(TAKE_UP, make_turn, [(-1.0, 1.0), (1.0, 3.0)], [0.0, 1.0], [0.3, 1.0])

BARE: Final = _family(TAKE_UP, make_bare, [(0.88, 3.0)], [1.0], [0.92])

PLATEAU: Final = _family(
    "dwell",
    make_plateau,
    [(0.1, 0.98), (0.4, 1.6), (0.0, 0.95), (0.05, 1.0)],
    [0.5, 1.0, 0.0, 1.0],
    [0.6, 1.0, 0.25, 1.0],
    [0.8, 1.2, 0.5, 0.5],
)


@lru_cache(maxsize=8)
def dips(degree: int, lowest: float) -> DesignFamily:
    """Return Eq. (26) of a degree with V_2 ... V_{n-2} free; V(½)/V_c of the seeds is at least `lowest`."""
    free = degree - 3
    seeds = []
    for ratio in (0.75, 0.5, 0.25, 0.1, 0.0, -0.15, -0.3):
        for t_star in (0.6, 1.0, 1.7, 3.0):
            if ratio < lowest:
                continue
            middle = profile.coefficients_from_ratio(ratio, degree)[2:-2]
            seeds.append([t_star, *middle])
    bounds = [(0.1, 8.0)] + [(-8.0, 4.0)] * free
    return _family("suppress" if lowest >= 0.0 else "retrograde", make_dip, bounds, *seeds)


SHORTEST_RAMP: Final = 1e-3
"""Least part of the budget that a ramp takes; the limits forbid ramps as short as that anyway."""


def make_stop(x: Array, case: ReversalCase) -> Design:
    """Stop and jog: x = (share of ramps, part of the budget, share of the pause before, travel, time out).

    What the jogs and their least dwells leave of the budget goes to the ramps and to pauses before and behind
    them. Axes jog one after the other. Behind its loop an axis jogs by the gap, once; inside it, by `travel`
    gaps out and back, and stays out for part of the time in which the motor crosses the gap meanwhile.
    """
    share, part, before, travel, out = (float(value) for value in x)
    jogs, least = _sequence(case.reversing, travel, out)
    spare = max(part * case.budget - least, 0.0)
    ramp = max(share * spare, SHORTEST_RAMP * case.budget)
    pause = (1.0 - share) * spare
    hold = least + pause
    begin = -0.5 * hold + before * pause
    placed = tuple(msgspec.structs.replace(jog, start=jog.start + begin) for jog in jogs)
    return Design(shape=stop(ramp, hold, ORDER), t_star=ramp + 0.5 * hold, crossings=placed)


def make_jog_stop(x: Array, case: ReversalCase) -> Design:
    """Stop and jog axes behind their loops: the first three of `make_stop`."""
    return make_stop(np.concatenate([x, [0.0, 0.0]]), case)


def jogs_last(reversing: Sequence[tuple[Axis, int]]) -> float:
    """Time that axes behind their loops take to jog by their backlash one after the other, dwells included [s]."""
    return _sequence(reversing, 0.0, 0.0)[1]


def _sequence(reversing: Sequence[tuple[Axis, int]], travel: float, out: float) -> tuple[list[Jog], float]:
    """Jogs of all axes with their dwells, from 0 on, and how long that takes [s]."""
    jogs: list[Jog] = []
    t = DWELL
    for axis, direction in reversing:
        if axis.loop.encloses_backlash:
            way = max(travel * axis.gap.lost_motion, LEAST)
            there = make_jog(axis, way * direction, t)
            turn = there.end + max(DWELL, out * _time_to_cross(axis, way) - there.duration)
            jogs += [there, msgspec.structs.replace(there, start=turn, travel=-there.travel)]
        elif may_shift(axis):
            jogs.append(whole_jog(axis, direction, t))
        t = jogs[-1].end + DWELL if jogs else t
    return jogs, t


def _time_to_cross(axis: Axis, error: float) -> float:
    """Time that a motor without losses takes through its backlash under a position error [m], in seconds."""
    return math.sqrt(2.0 * motor_inertia(axis) * axis.gap.lost_motion / error)


JOG: Final = _family(
    TAKE_UP,
    make_jog_stop,
    [(0.1, 1.0), (0.2, 1.0), (0.0, 1.0)],
    [1.0, 1.0, 0.0],
    [0.7, 1.0, 0.2],
    [0.4, 1.0, 0.1],
)

PULSE: Final = _family(
    TAKE_UP,
    make_stop,
    [(0.1, 1.0), (0.2, 1.0), (0.0, 1.0), (0.002, 2.0), (0.0, 1.5)],
    *(
        [share, 1.0, 0.2, travel, out]
        for share in (0.5, 0.8)
        for out in (0.8, 1.0)
        for travel in (0.01, 0.02, 0.05, 0.1, 0.3, 1.0)
    ),
)
