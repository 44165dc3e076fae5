"""Choose a design for every window, by search on the simulated machine."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import cached_property
from typing import Final

import msgspec

from ph_post.compensate.crossing_times import (
    MOST,
    NO_REST,
    Rest,
    crossing_at_turn,
    has_moved,
    rest_before,
    shortest_crossing,
    turning_acceleration,
    wound,
)
from ph_post.compensate.families import BARE, DesignFamily, ReversalCase, jogs_last
from ph_post.compensate.friction import Friction, friction_of, friction_of_machine
from ph_post.compensate.friction_layout import first_step
from ph_post.compensate.layout import approached_way, first_direction, first_pushes, reversing_axes
from ph_post.compensate.offsets import may_shift, whole_jog
from ph_post.compensate.search import (
    DesignBounds,
    DesignSearch,
    TriedDesign,
    best_of,
    largest_lag,
    rest_design,
    time_to_stop,
)
from ph_post.compensate.standstill import CREEP, creep_of_shape
from ph_post.compensate.strategies.base import PlanningTask, ProfileRequest, StrategyResult
from ph_post.compensate.survey import Drives, SearchSite, search_sites
from ph_post.compensate.time_shares import allocate
from ph_post.compensate.trial import SAME_TURN, Surroundings, Trial, direction_at, find_surroundings
from ph_post.simulate.assess import PICKUPS
from ph_post.simulate.contour import Nominal, settling_time
from ph_post.types import Axis, Crossing, Jog, Machine, Scenario

MOST_APPROACH: Final = 0.5
"""Part of the time allowed that may be spent before the path begins."""

MOST_PUSH: Final = 0.8
"""The same of pushing axes onto their sides whose gap is inside their loop, in a plan that is raced beside others."""

LITTLE: Final = 0.05
"""Part of the time allowed that axes may be pushed for first without the same being tried without that."""

SPARE: Final = 0.97
"""Part of the time allowed that is given to the turning points; the rest is for rounding."""

BESIDE: Final = 0.3
"""Part of the effort that further choices are searched with."""

SMOOTH: Final = (1.0, 2.0, 4.0)
"""Times the shortest duration in which offsets change at full feed."""

ON_THE_FLY: Final = "fly"
"""The strategy that changes offsets without a stop."""

LONGEST_STOP: Final = 1.0
"""Time [s] up to which designs are tried at a turning point whatever the machine; more is tried where it needs more."""

STOPS: Final = 4.0
"""Times that a stop takes which are tried."""

CROSSINGS: Final = 8.0
"""Times that the shortest crossing takes which are tried."""

NOTHING_BETTER: Final = "nothing that was tried is better in every case"

STANDS: Final = "the motion begins, ends or rests here"

Choice = Callable[[PlanningTask, ReversalCase], Sequence[DesignFamily]]
"""The families to search at a turning point."""


def choose(task: PlanningTask, *choices: Choice, offsets: bool, lead: bool, races: bool = False) -> StrategyResult:
    """Search every window for its best design.

    Parameters
    ----------
    task : PlanningTask
    choices : callable
        Families to search there. Each choice is searched by itself; the best of all is proposed.
    offsets : bool
        Whether axes that are not closed over the table get a lasting offset.
    lead : bool
        Whether designs include inverse dynamics.
    races : bool
        Whether the result has rivals: the best of each choice, without rests, and without any design.

    Returns
    -------
    StrategyResult
        To be proven.
    """
    chooser = _Chooser(task, offsets=offsets, lead=lead)
    found = [
        chooser.candidates(choice, task.options.effort * (1.0 if number == 0 else BESIDE))
        for number, choice in enumerate(choices)
    ]
    merged = [best_of([one for own in owns for one in own]) for owns in zip(*found, strict=True)]
    result = chooser.propose(merged)
    if not races:
        return result
    rivals = [chooser.propose(own) for own in found] if len(found) > 1 else []
    if any(one.design.stop for own in merged for one in own):
        rivals += [chooser.propose([[one for one in own if not one.design.stop] for own in merged])]
    if chooser.pushing > LITTLE * task.allowed:
        rivals += [chooser.propose(merged, pushes_first=not chooser.pushes_first)]
    if result.carries and chooser.rests_inside:
        rivals += [msgspec.structs.replace(result, carries=False)]
    return msgspec.structs.replace(result, rivals=(*rivals, *chooser.smooth_offsets()))


def smooth_offsets(task: PlanningTask, *, lead: bool) -> tuple[StrategyResult, ...]:
    """Return results that leave the feed alone and change lasting offsets around every reversal, for tables.

    Parameters
    ----------
    task : PlanningTask
    lead : bool
        Whether the command includes inverse dynamics.
    """
    return _Chooser(task, offsets=True, lead=lead).smooth_offsets()


def _longer(
    found: Sequence[Sequence[TriedDesign]], picks: Sequence[TriedDesign | None], windows: Collection[int]
) -> list[list[TriedDesign]]:
    """Keep of some windows those designs alone that take longer than what was picked."""
    least = [-math.inf if one is None or k not in windows else one.longer for k, one in enumerate(picks)]
    return [[one for one in own if one.longer > most] for own, most in zip(found, least, strict=True)]


def search_scenarios(machine: Machine, axes: Sequence[str]) -> tuple[tuple[Scenario, ...], int]:
    """Return the scenarios to search with, and how many of them are nominal.

    The nominal ones have the backlash of the machine file and come first; the others have it, or friction, smaller
    and larger by its uncertainty. Each has one of the pick-up rules that the file leaves open.
    """
    drives = [machine.axes[name] for name in axes]
    inside = [axis for axis in drives if axis.loop.encloses_backlash]
    rules = PICKUPS if any(axis.gap.pickup is None for axis in inside) else (None,)
    spreads = (0.0, -1.0, 1.0) if any(axis.uncertainty.backlash for axis in drives) else (0.0,)
    found = [Scenario(pickup=rule, spread=spread) for spread in spreads for rule in rules]
    rubs = max((axis.uncertainty.friction for axis in drives if friction_of(axis) is not None), default=0.0)
    if rubs > 0.0:
        found += [Scenario(pickup=rule, friction=factor) for factor in (1.0 - rubs, 1.0 + rubs) for rule in rules]
    return tuple(found), len(rules)


class _Chooser:
    """The search over all windows of a job."""

    def __init__(self, task: PlanningTask, *, offsets: bool, lead: bool) -> None:
        self.task, self.offsets, self.lead = task, offsets, lead
        self.written = task.options.writes_program
        self.track, self.period = task.analysis.track, task.machine.servo_period
        self.friction = friction_of_machine(task.machine, task.path.axes) if lead else {}
        self.sized = task.sized
        self.places = find_surroundings(task.analysis, task.feed, task.looped)
        self.reversing = [
            reversing_axes(self.sized, [task.turning_points[k] for k in window.members], self._turned)
            for window in task.windows
        ]
        self.friction_first = self._friction_first()
        # Where there is no time to lead friction while axes come onto their sides, they come nearly onto them.
        self.winding = self._as_approach(self._winding_time(self.friction)) or self._as_approach(self._winding_time({}))
        self.pushing = self._pushing()
        self.pushes_first = self._as_approach(self.pushing) > 0.0
        pairs = zip(self.places, self.reversing, strict=True)
        self.active = max(sum(place is not None and bool(drives) for place, drives in pairs), 1)

    @property
    def rests_inside(self) -> bool:
        """Return whether an axis whose gap is inside its loop rests before it turns back anywhere."""
        axes = self.task.machine.axes
        return any(one.kind == "dwell" and axes[one.axis].loop.encloses_backlash for one in self.task.turning_points)

    @property
    def _turned(self) -> tuple[str, ...]:
        """Axes whose friction is led and turns round with them."""
        return tuple(name for name, one in self.friction.items() if one.turns)

    def _winding_time(self, friction: Mapping[str, Friction]) -> float:
        """Time that it takes at most to bring axes behind the loop to their first flank, against friction [s].

        Every part program has an approach that does it. Where it would take most of the time allowed designs leave
        nothing for it.
        """
        if not self.offsets or self.written or self.task.options.start == "moving":
            return 0.0
        drives = [self.sized.axes[name] for name in self.task.path.axes]
        behind = [axis for axis in drives if not axis.loop.encloses_backlash and axis.gap.lost_motion > 0.0]
        whole = [shortest_crossing(axis, self.lead, self.period) for axis in behind]
        pairs = zip(behind, whole, strict=True)
        return max(
            (wound(axis, 1, friction.get(axis.name), one, self.period).duration for axis, one in pairs), default=0.0
        )

    def _pushing(self) -> float:
        """Time that it takes to push axes onto their sides whose gap is inside their loop [s], likewise."""
        task = self.task
        if not (self.offsets and task.options.pushes_first) or self.written or task.options.start == "moving":
            return 0.0
        pushes = first_pushes(self.track, self.sized, task.turning_points, self._turned)
        return self._as_approach(max((one.end for one in pushes), default=0.0), MOST_PUSH)

    def _as_approach(self, duration: float, most: float = MOST_APPROACH) -> float:
        """Return a time before the path [s] if that leaves enough of the time allowed, else 0."""
        return duration if duration <= most * self.task.allowed else 0.0

    def _friction_first(self) -> float:
        """Time that friction is led for before the path begins, where that leaves most of the time allowed [s]."""
        if self.task.options.start == "moving":
            return 0.0
        return self._as_approach(first_step(self.task.machine, self.friction))

    @cached_property
    def sites(self) -> tuple[SearchSite, ...]:
        """The windows that are searched, each with its plain motion on all machines."""
        task, nominal = self.task, Nominal(self.track)
        tried, count = search_scenarios(task.machine, task.path.axes)
        options = task.options
        bounds = DesignBounds(slowest=options.min_feed or 0.0, retrograde=options.allow_retrograde)
        sites = []
        for number, (place, drives) in enumerate(zip(self.places, self.reversing, strict=True)):
            if place is not None and drives:
                trial = Trial(nominal, self.track, place, task.machine, tried, self.sized, self.friction)
                search = DesignSearch(trial, self._case(place, number), bounds, count)
                sites.append(SearchSite(number=number, drives=drives, search=search))
        return tuple(sites)

    def candidates(self, choice: Choice, effort: float) -> list[list[TriedDesign]]:
        """Return the candidates of every window, by the time they add."""
        found: list[list[TriedDesign]] = [[] for _ in self.places]
        for site in self.sites:
            site.search.forget()
            if self._may_rest(site.drives):
                site.search.add_rest(jogs=self.written)
        families = [choice(self.task, site.search.case) for site in self.sites]
        for number, own in search_sites(self.sites, families, effort, self.task.progress).items():
            found[number] = own
        for number, (place, drives) in enumerate(zip(self.places, self.reversing, strict=True)):
            resting = place is None and drives and self._may_rest(drives) and not self.task.options.min_feed
            if resting and not self._at_an_end(number):
                found[number] = [self._rest(number)]
        return found

    def propose(
        self, found: Sequence[Sequence[TriedDesign]], part: float = 1.0, *, pushes_first: bool | None = None
    ) -> StrategyResult:
        """Share the time out where it does most, a part of what is allowed."""
        pushes_first = self.pushes_first if pushes_first is None else pushes_first
        time = self._time_for_designs(part, pushes_first=pushes_first)
        picks = allocate(found, time, [self._left_alone(number) for number in range(len(found))])
        if self.task.options.max_standstill is not None:
            picks = self._standing_less(found, picks, self.task.options.max_standstill)
        requests = map(self._request, picks, range(len(picks)))
        return StrategyResult(
            requests=tuple(requests),
            proven=True,
            shorter=lambda less: self.propose(found, less, pushes_first=pushes_first),
            longer_at=lambda windows: self.propose(_longer(found, picks, windows), part, pushes_first=pushes_first),
            shifted=self._behind(),
            winds_up=self.winding > 0.0,
            pushes_first=pushes_first,
            carries=not self.written and self.offsets,
            friction_part=1.0 if self.friction else 0.0,
            friction_first=self.friction_first,
            crosses_by=BARE.name,
        )

    def _time_for_designs(self, part: float = 1.0, *, pushes_first: bool) -> float:
        """Time that is left of a part of what is allowed when the path begins [s]."""
        approach = max(self.winding, self.friction_first, self.pushing if pushes_first else 0.0)
        return SPARE * part * self.task.allowed - approach

    def _standing_less(
        self, found: Sequence[Sequence[TriedDesign]], picks: Sequence[TriedDesign | None], most: float
    ) -> list[TriedDesign | None]:
        """Let the tool stand or creep only where that gains most, and in all no longer than it may [s]."""
        alone = [self._left_alone(number) for number in range(len(picks))]
        gain = [0.0 if one is None else alone[k] - one.merit for k, one in enumerate(picks)]
        kept = list(picks)
        for number in sorted(range(len(picks)), key=lambda k: -gain[k]):
            pick = picks[number]
            if pick is None:
                continue
            if self._creep(pick, number) > most:
                fitting = [one for one in found[number] if self._creep(one, number) <= most]
                kept[number] = pick = min(fitting, key=lambda one: one.merit, default=None)
            most -= 0.0 if pick is None else self._creep(pick, number)
        return kept

    def _creep(self, one: TriedDesign, number: int) -> float:
        """Time that the tool stands or creeps in a design [s]; of a rest all that it adds."""
        place, shape = self.places[number], one.design.shape
        if one.design.stop or place is None or shape is None:
            return one.longer if one.design.stop else 0.0
        fastest = max(segment.feed or self.task.path.feed for segment in self.task.path.segments)
        return creep_of_shape(shape, one.design.t_star, CREEP * fastest / place.cruise)

    def smooth_offsets(self) -> tuple[StrategyResult, ...]:
        """Return results without any design, in which offsets change at full feed in several times."""
        if self.written or not self.offsets or not self._behind():
            return ()
        return tuple(
            StrategyResult(
                requests=tuple(
                    ProfileRequest(shape=None, crossings=self._bare(number, times))
                    for number in range(len(self.places))
                ),
                shifted=self._behind(),
                winds_up=winds_up,
                rests=False,
                friction_part=1.0 if self.friction else 0.0,
                friction_first=self.friction_first,
                crosses_by=ON_THE_FLY,
            )
            for times in SMOOTH
            # Without any design all of the time may be spent on it.
            for winds_up in ((True, False) if 0.0 < self._winding_time({}) <= self.task.allowed else (False,))
        )

    def _left_alone(self, number: int) -> float:
        """Merit of a window in which nothing is done; infinite where something must be."""
        drives = self.reversing[number]
        if not drives or (self.written and self.offsets and any(may_shift(axis) for axis, _ in drives)):
            return math.inf
        site = next((one for one in self.sites if one.number == number), None)
        if site is not None:
            return site.search.merit(site.search.plain)
        return max(largest_lag(axis) for axis, _ in drives)

    def _at_an_end(self, number: int) -> bool:
        """Return whether the path begins or ends at a window."""
        s = self.task.windows[number].s
        return s <= SAME_TURN or s >= self.track.length - SAME_TURN

    def _rest(self, number: int) -> TriedDesign:
        """Rest where the feed is not steady; the time is reckoned from the feed there."""
        drives = self.reversing[number]
        axes = [self.task.machine.axes[name] for name in self.task.path.axes]
        longest = max(shortest_crossing(axis, self.lead, self.period) for axis, _ in drives)
        cruise = self.task.feed.at(self.task.windows[number].s)
        crossing = jogs_last(drives) if self.written else longest
        return rest_design(axes, cruise, drives, self._bare(number), crossing, self.lead)

    def _behind(self) -> tuple[str, ...]:
        """Axes whose gap is behind their loop, whether they turn back in windows, corners or nowhere."""
        if not self.offsets:
            return ()
        if self.written:
            axes = [axis for axis, _ in reversing_axes(self.sized, self.task.turning_points)]
            axes += [axis for name in self.task.path.axes if self._leaves_its_zero(axis := self.sized.axes[name])]
            if any(may_shift(axis) for axis in axes):
                # One axis alone may do harm where the lags of two cancel: those that never turn back come along.
                axes += [self.sized.axes[name] for name in self.task.path.axes]
            return tuple(sorted({axis.name for axis in axes if may_shift(axis)}))
        drives = [self.sized.axes[name] for name in self.task.path.axes]
        if self.task.options.start == "moving":
            # Nobody knows the flank of an axis that rests there, and there is no time to bring it to one.
            drives = [axis for number, axis in enumerate(drives) if direction_at(self.track, 0.0, number)]
        return tuple(axis.name for axis in drives if not axis.loop.encloses_backlash and axis.gap.lost_motion > 0.0)

    def _leaves_its_zero(self, axis: Axis) -> bool:
        """Return whether a program brings an axis to its start, or away from it, off the side of its zero."""
        side, direction = axis.reference_side, first_direction(self.track, self.task.turning_points, axis.name)
        return side * direction != 0 and {direction, approached_way(axis, direction)} != {side}

    def _request(self, found: TriedDesign | None, number: int) -> ProfileRequest:
        place, drives = self.places[number], self.reversing[number]
        if not drives:
            return ProfileRequest(shape=None, note="no axis with backlash reverses here")
        bare = self._bare(number)
        if place is None and self._may_rest(drives) and self._at_an_end(number):
            return ProfileRequest(shape=None, crossings=bare, stop=True)
        if found is None:
            why = STANDS if place is None else NOTHING_BETTER
            return ProfileRequest(shape=None, crossings=bare, note="" if bare else why)
        design = found.design
        return ProfileRequest(
            shape=design.shape,
            t_star=design.t_star,
            turn=design.turn,
            may_leave_window=True,
            crossings=design.crossings or bare,
            friction=design.friction,
            stop=design.stop,
            strategy=found.family.name,
        )

    def _bare(self, number: int, times: float = 1.0) -> tuple[Crossing | Jog, ...]:
        """Crossings of the lasting offsets that a window needs in any case, in some times the shortest duration."""
        drives = self.reversing[number]
        if not self.offsets:
            return ()
        if self.written:
            return tuple(whole_jog(axis, direction, 0.0) for axis, direction in drives if may_shift(axis))
        turning = self._turning(number, self.task.feed.at(self.task.windows[number].s))
        rests = self._rests(number)
        return tuple(
            crossing_at_turn(
                axis,
                direction,
                times * shortest_crossing(axis, self.lead, self.period, MOST),
                turning[axis.name],
                rests[axis.name],
            )
            for axis, direction in drives
            if not axis.loop.encloses_backlash and axis.gap.lost_motion > 0.0
        )

    def _turning(self, number: int, feed: float) -> dict[str, float]:
        """Acceleration with which each axis turns back at a window [m/s²]."""
        members = (self.task.turning_points[k] for k in self.task.windows[number].members)
        return {point.axis: turning_acceleration(point, feed) for point in members}

    def _rests(self, number: int) -> dict[str, Rest]:
        """Return when each axis may be moved while it rests before it turns back at a window."""
        points, found = self.task.turning_points, {}
        for point in (points[k] for k in self.task.windows[number].members):
            axis = self.task.machine.axes[point.axis]
            # Inside a loop a motor is carried from a side that is known.
            sure = not axis.loop.encloses_backlash or has_moved(self.track, points, point)
            found[point.axis] = rest_before(self.track, point, axis, self.lead) if sure else NO_REST
        return found

    def _may_rest(self, drives: Drives) -> bool:
        """Return whether a rest in the plain motion will do: no backlash inside a loop is crossed there."""
        return self.offsets and not any(axis.loop.encloses_backlash for axis, _ in drives)

    def _case(self, place: Surroundings, number: int) -> ReversalCase:
        """Make the case of a window, with an equal share of the time."""
        drives = self.reversing[number]
        budget = self._time_for_designs(pushes_first=self.pushes_first) / self.active
        shortest = {axis.name: shortest_crossing(axis, self.lead, self.period) for axis, _ in drives}
        axes = self.task.path.axes
        longest = max(
            LONGEST_STOP,
            STOPS * time_to_stop([self.task.machine.axes[name] for name in axes], place.cruise),
            CROSSINGS * max(shortest.values()),
            settling_time(self.task.machine, axes),
        )
        return ReversalCase(
            place=place,
            budget=min(max(budget, self.period), longest),
            longest=longest,
            reversing=drives,
            shortest=shortest,
            turning=self._turning(number, place.cruise),
            rests=self._rests(number),
            lead=self.lead,
            crosses=self.offsets and not self.written,
            friction=self.friction,
            period=self.period,
        )
