"""Plan, write and judge a part program until it is good in the time allowed."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from functools import cached_property
from typing import Final

import numpy as np
from msgspec.structs import replace

from ph_post.api.compensated_program import CompensatedProgram, ProgramRequest, declaration_of, refusal
from ph_post.api.failed_changes import (
    Places,
    changed_places,
    crossed_in,
    failed_places,
    moved_by,
    verified,
    with_miscounts,
)
from ph_post.api.guard import (
    FURTHER,
    MOST,
    ROUNDS,
    SLACK,
    Guard,
    GuardFinding,
    by_what_is_done,
    otherwise,
    tightened,
    with_neighbours,
)
from ph_post.api.results import ProgramMotion
from ph_post.compensate.plan_warnings import round_up
from ph_post.compensate.strategies.registry import find_traits
from ph_post.dialects.base import Dialect
from ph_post.drive.axes import has_backlash
from ph_post.edit.affordable import SPARE
from ph_post.edit.beams import BeamGuard
from ph_post.edit.edits import EditOptions, Edits, merge_edits, no_offsets
from ph_post.edit.offset_edits import plan_offsets
from ph_post.edit.preconditions import reckoned_feeds
from ph_post.edit.reversal_search import stretch_words
from ph_post.edit.reversals import section_spans
from ph_post.edit.window_plans import PlannedWindows, WindowPlan, edit_windows, plan_windows, shifts_axes
from ph_post.edit.write import LongLinesError, apply_edits
from ph_post.gcode.paths import ProgramPath, paths_of
from ph_post.gcode.program import PartProgram
from ph_post.gcode.read import reread
from ph_post.progress import Progress
from ph_post.simulate.controllers.moves import moved_axes
from ph_post.types import Machine

HALTED: Final = 2
"""Times that corners which the tool cuts by more than before are halted in, before what is about them is left."""

SPARED: Final = 4
"""Plans that leave what is worse beside what the one before had no time for, before sections are left in parts."""

FEW: Final = 2
"""Of so many sections one may be left for that: where more would be, it is another plan that is missing."""

NEARLY: Final = 0.15
"""A plan that takes no more than this part of the time allowed too long may lose what gains least for its time."""

SHAVED: Final = 3
"""Times that this is tried, where the best plan in time leaves twice as much error as the one that was too long."""

RARE: Final = 0.05
HALF: Final = 0.5
"""Where no plan is good in all of many sections, one that makes so few of them worse is written if it leaves no more
than so much of the error of the whole, and none of that has grown."""

FAR_OFF: Final = 2.0
"""A plan that takes so many times what was reckoned for it shows that its crossings were not reckoned well."""

BESIDE: Final = 3
"""Motions before and behind a change that does not pass the check which are left as they are with it."""

BESIDE_WORSE: Final = (1, BESIDE)
"""Those about one that makes the part worse, the first time and the second."""


class EditPlanner:
    """Plans the offsets of axes with backlash outside the loop, and the windows of the others, which stay.

    They share the time allowed by the number of their axes.
    """

    def __init__(
        self, program: PartProgram, machine: Machine, dialect: Dialect, request: ProgramRequest, progress: Progress
    ) -> None:
        self._program, self.machine, self.dialect = program, machine, dialect
        self._request, self._progress = request, progress
        loops = [machine.axes[name].loop for name in moved_axes(program) if has_backlash(machine.axes[name])]
        if not find_traits(request.plan.strategy).compensates:
            loops = []
        behind = sum(not loop.encloses_backlash for loop in loops) if shifts_axes(request.plan) else 0
        self.offsets_axes = behind > 0
        self._share = behind / max(len(loops), 1)
        self._has_windows = behind < len(loops)
        self._planned: tuple[float, PlannedWindows] | None = None
        self.windows: tuple[WindowPlan, ...] = ()
        """The plans of axes with backlash inside the loop, those of the last edits."""

    @cached_property
    def paths(self) -> tuple[ProgramPath, ...]:
        """The paths of the program."""
        self._progress("fitting the path")
        return paths_of(self._program)

    def _windows(self, max_slowdown: float) -> PlannedWindows:
        """Plan the axes with backlash inside the loop; the last plan is kept for the next time."""
        if self._planned is None or self._planned[0] != max_slowdown:
            plan = replace(self._request.plan, max_slowdown=max_slowdown * (1.0 - self._share))
            tolerance, progress = self._request.edit.tolerance, self._progress
            found = plan_windows(self._program, self.paths, self.machine, plan, tolerance, progress)
            self._planned = max_slowdown, found
        return self._planned[1]

    def plan(self, options: EditOptions) -> Edits:
        """Return the edits within the bounds of the options."""
        edits = Edits(runs=no_offsets(self._program.motions.kind.size))
        if self.offsets_axes:
            self._progress("planning offsets")
            share = replace(options, max_slowdown=options.max_slowdown * self._share)
            edits = plan_offsets(self._program, self.machine, self.dialect, share)
        self.windows = ()
        if not self._has_windows or options.max_slowdown < 0.0:
            return edits
        found = edit_windows(self._program, self._windows(options.max_slowdown), options)
        self.windows = found.plans
        return merge_edits(edits, found.edits)


class PlanSearch:
    """Plans, writes and judges a program until it is good, and once more, otherwise, where the time was short.

    Parameters
    ----------
    original : PartProgram
    planner : EditPlanner
    before : ProgramMotion
        Of the original, with feeds that are reckoned with where none is known.
    request : ProgramRequest
    warnings : tuple of str
        Said of every plan.
    rounds : bool
        Whether the controller rounds corners by more than the backlash, which another path mode would change.
    progress : Progress
    """

    def __init__(
        self,
        original: PartProgram,
        planner: EditPlanner,
        before: ProgramMotion,
        request: ProgramRequest,
        warnings: tuple[str, ...],
        rounds: bool,
        progress: Progress,
    ) -> None:
        self._rounds = rounds
        self._planner, self._before, self._request = planner, before, request
        self._guard = Guard(before)
        self._warnings, self._progress = warnings, progress
        self._original = original
        self._count = section_spans(self._original.motions)[0].size
        self._said: tuple[str, ...] = ()
        self._why, self._reasons = list[str](), dict[str, None]()
        self._best: CompensatedProgram | None = None
        self._kept: tuple[EditOptions, GuardFinding] | None = None
        self._nearly: tuple[EditOptions, GuardFinding, tuple[str, ...]] | None = None
        self._over, self._further, self._enough = math.inf, 0, math.inf
        self._planned: set[float] = set()
        self._parts, self._halted = Counter[int](), 0
        self._largest, self._taken, self._divided = 0.0, 1.0, False
        self._longer, self._spared, self._late = 0.0, 0, 0
        self._first: tuple[EditOptions, tuple[str, ...]] | None = None
        self._whole: tuple[CompensatedProgram, GuardFinding] | None = None

    def run(self, options: EditOptions) -> CompensatedProgram:
        """Return the best plan; the program itself where none is good."""
        for _ in range(ROUNDS + FURTHER):
            edits = self._plan(options)
            if edits.empty:
                again = self._in_parts(options) if edits.short else None
            elif self._kept is not None and edits.slowdown in self._planned:
                # The same plan again: what is left of the time is too little for the next.
                again = self._other(options, self._kept[1])
            else:
                self._planned.add(edits.slowdown)
                again = self._judge(*self._written(edits), options)
            if again is None:
                break
            options = replace(again, pace=max(1.0, self._taken), longer=self._longer)
        self._shave()
        if self._best is not None:
            return self._best
        if self._whole is not None:
            return self._better_as_a_whole(*self._whole)
        original = self._original
        if edits.empty and math.isinf(self._enough):
            edits = replace(edits, warnings=(*edits.warnings, *self._said))
        else:
            edits = _nothing_gained(original, edits, self._enough)
        return CompensatedProgram(before=original, after=original, edits=edits, windows=self._planner.windows)

    def _plan(self, options: EditOptions) -> Edits:
        """Plan, with what is said of every plan."""
        edits = self._planner.plan(options)
        return replace(edits, warnings=(*edits.warnings, *self._warnings))

    def _shave(self) -> None:
        """Keep the plan that hardly took too long without what gains least for its time, where that is far better."""
        if self._nearly is None:
            return
        options, judged, self._said = self._nearly
        allowed = self._request.edit.max_slowdown
        if self._kept is not None and judged.rms > HALF * self._kept[1].rms:
            return
        # The same plan again, by what crossings took since: what is said of time is that.
        pace = max(1.0, self._taken, judged.slowdown / max(judged.planned, 1e-9))
        most = max(options.max_slowdown, judged.planned)
        options = replace(options, max_slowdown=most, pace=pace, longer=self._longer)
        for _ in range(SHAVED):
            # Each second that was reckoned took more than one.
            options = replace(options, shave=options.shave + (judged.slowdown - allowed) + SLACK)
            edits = self._plan(options)
            if edits.empty:
                return
            made, refused = self._written(edits)
            if refused or made.verdict is None or not made.verdict.ok or made.motions is None:
                return
            found = self._compared(made.motions[1], edits, options)
            if found is None or found.worse:
                return
            judged = found
            if judged.slowdown <= allowed + SLACK:
                if self._kept is None or judged.rms < self._kept[1].rms:
                    self._best, self._kept = made, (options, judged)
                return

    def _better_as_a_whole(self, made: CompensatedProgram, judged: GuardFinding) -> CompensatedProgram:
        """Return a plan by which the part is better, and worse in a few sections, which are named."""
        assert made.edits is not None
        low, high = section_spans(self._original.motions)
        where = stretch_words(self._original, [(int(low[n]), int(high[n])) for n in sorted(judged.worse)])
        said = (
            f"the error grows in {where}, to no more than it is elsewhere in the original: no plan within the time"
            " allowed is better in all of the part"
        )
        return replace(made, edits=replace(made.edits, warnings=(*made.edits.warnings, said)))

    def _written(self, edits: Edits) -> tuple[CompensatedProgram, Places]:
        """Write a plan, and check it; the places are those whose lines no controller would take, or that one."""
        original, request, planner = self._original, self._request, self._planner
        self._progress("writing")
        original.source.let_go()
        declaration = declaration_of(original, edits, planner.machine, planner.dialect, request)
        long: LongLinesError | None = None
        try:
            data = apply_edits(original, edits, planner.dialect, declaration)
        except LongLinesError as error:
            long, data = error, error.text
        original.source.let_go()
        self._progress("verifying")
        after = reread(original, data)
        verdict, refused = verified(original, after, request, planner.machine)
        self._why = [] if verdict is not None and verdict.ok else ["a change would not pass the check"]
        if long is not None:
            own = moved_by(original, after, long.lines)
            if not own:
                raise long
            self._why.append(f"a line would be too long for {planner.dialect.name}")
            refused = (*refused, *own)
        original.source.let_go()
        after.source.let_go()
        timed = reckoned_feeds(after, planner.machine)
        plain = self._before
        motion = ProgramMotion(timed, plain.original, planner.machine, "compensated program", self._progress, plain)
        made = CompensatedProgram(
            before=original,
            after=after,
            declaration=declaration,
            edits=replace(edits, warnings=(*edits.warnings, *self._said)),
            windows=planner.windows,
            verdict=verdict,
            motions=(self._before, motion),
        )
        return made, refused

    def _judge(self, made: CompensatedProgram, refused: Places, options: EditOptions) -> EditOptions | None:
        """Keep a plan that is good, and better than the one before it; return the options of another to be tried."""
        assert made.edits is not None
        assert made.motions is not None
        if refused or made.verdict is None or not made.verdict.ok:
            return self._without_failed(made, refused, options)
        judged = self._compared(made.motions[1], made.edits, options)
        if judged is None:
            again = self._in_parts(options) if made.edits.short else None
            self._best = self._best or (made if again is None else None)
            return again
        rare = len(judged.worse) <= RARE * self._count and judged.remains <= HALF
        over = judged.slowdown - self._request.edit.max_slowdown
        in_time = over <= SLACK
        nearly = not in_time and not judged.worse and over <= NEARLY * self._request.edit.max_slowdown
        if nearly and (self._nearly is None or judged.slowdown < self._nearly[1].slowdown):
            self._nearly = options, judged, self._said
        if rare and in_time and (self._whole is None or judged.remains < self._whole[1].remains):
            self._whole = made, judged
        if judged.planned > self._largest:
            self._largest, self._taken = judged.planned, judged.slowdown / judged.planned
        if judged.worse:
            again = self._stopping(options, judged, behind=any(one.behind for one in made.edits.crossings))
        else:
            self._enough = min(self._enough, judged.slowdown)
            # One axis alone may leave the part worse than none, which nothing shows where errors are not simulated.
            again = self._in_parts(options) if made.edits.short and not judged.simulated else None
        if again is not None:
            return again
        tighter = tightened(options, judged, self._request.edit.max_slowdown, self._count, late=self._late)
        self._late += not in_time
        if tighter is not None:
            return self._less(made.edits, judged, options, self._parting(tighter, judged, options))
        if self._kept is None or judged.rms <= self._kept[1].rms:
            self._best = made
            self._kept = options, judged
        return self._other(options, judged) if made.edits.short and judged.simulated else None

    def _compared(self, motion: ProgramMotion, edits: Edits, options: EditOptions) -> GuardFinding | None:
        """Say what a plan does to the part; None where nothing can."""
        judged = self._guard.compare(motion, edits.slowdown)
        if judged is None:
            return None
        judged = by_what_is_done(judged, options.left, self._count)
        if not judged.gains and (edits.short or not _crosses(edits)):
            # Axes that only come to their sides once do it for nothing, and so may some that cross while others do not.
            judged = replace(judged, worse=frozenset(range(self._count)))
        chooses = find_traits(self._request.plan.strategy).chooses
        if not (chooses or self._planner.offsets_axes):
            # Dips and stops that were asked for by name keep to the time; what they do to the part is told.
            judged = replace(judged, worse=frozenset())
        return self._reckoned_anew(edits, judged, options)

    def _reckoned_anew(self, edits: Edits, judged: GuardFinding, options: EditOptions) -> GuardFinding:
        """Reckon crossings on the fly by what those of a plan took, where that was far more and too much.

        Where lines are as short as blocks of crossings, a controller slows down in ways that are not reckoned. Stops
        take what is reckoned for them.
        """
        over = judged.slowdown > max(FAR_OFF * judged.planned, self._request.edit.max_slowdown + SLACK)
        if not over or self._kept is not None or len(edits.crossings) <= len(edits.stops):
            return judged
        self._longer += (judged.slowdown - judged.planned) * options.cycle / len(edits.crossings)
        return replace(judged, planned=judged.slowdown)

    def _stopping(self, options: EditOptions, judged: GuardFinding, *, behind: bool) -> EditOptions | None:
        """Return the options of a plan that stops in corners where one without made the part worse; None for none."""
        if behind:
            return replace(options, plain_corners=True)
        halts = options.halts | judged.corners
        if len(halts) == len(options.halts) or self._halted == HALTED or self._may_not_rest:
            return None
        self._halted += 1
        return replace(options, halts=halts)

    @cached_property
    def _may_not_rest(self) -> bool:
        """Whether the tool would mark the part where it rests, or no axis has an offset in whose plan it could."""
        return not self._planner.offsets_axes or BeamGuard(self._original, self._planner.machine).tends

    def _less(
        self, edits: Edits, judged: GuardFinding, options: EditOptions, tighter: EditOptions
    ) -> EditOptions | None:
        """Return the options of another plan behind one that was not good; None where enough were tried."""
        if self._kept is not None or tighter.max_slowdown < options.max_slowdown:
            self._over = min(self._over, options.max_slowdown)
        divides = options.in_parts and not (self._kept is not None and self._kept[0].in_parts)
        if divides and not judged.worse:
            return tighter
        if self._kept is not None and not (divides and self._spared):
            return self._in_parts(options) if options.largest_first else self._other(*self._kept)
        if judged.worse and edits.short and not self._divided:
            self._first = self._first or (options, self._said)
            if self._spared == SPARED or not edits.spared or FEW * len(tighter.left) > self._count:
                # One axis alone may leave the part worse than none.
                return self._in_parts(options)
            # All other sections stay as they are: with others left alone others would be worse.
            self._spared += 1
            tighter = replace(tighter, spared=edits.spared)
        if tighter.left or tighter.stretches:
            where = stretch_words(self._original, self._left_alone(tighter))
            why = "worse where a table runs on in its backlash"
            if tighter.stretches or tighter.left - judged.runs_on:
                why = "no better; a path mode that rounds corners less may help" if self._rounds else "no better"
            self._said = (f"not compensated in {where}: the part would be {why}",)
        return tighter

    def _other(self, options: EditOptions, judged: GuardFinding) -> EditOptions | None:
        """Return the options of another plan beside a good one; None where enough were tried."""
        self._further += 1
        if self._spared or options.largest_first or self._further > FURTHER:
            return self._in_parts(options)
        again = otherwise(options, judged, self._request.edit.max_slowdown, self._over)
        return None if again.largest_first and options.in_parts else again

    def _in_parts(self, options: EditOptions) -> EditOptions | None:
        """Return the options of a plan up to where the time ends, all axes together; None where that was tried."""
        if self._divided or not self._planner.offsets_axes:
            return None
        self._divided, self._further, self._over = True, 1, math.inf
        less = self._request.edit.max_slowdown / max(self._taken, 1.0 / MOST)
        if less <= self._largest <= less + SPARE:
            # With what does not count as slower it would be the same plan again, which took too long.
            less -= SPARE
        # What was left since beside axes that had no time is left no more.
        first, self._said = self._first or (options, self._said)
        return replace(
            options,
            in_parts=True,
            largest_first=False,
            max_slowdown=less,
            spared=frozenset(),
            left=first.left,
            stretches=first.stretches,
        )

    def _without_failed(self, made: CompensatedProgram, refused: Places, options: EditOptions) -> EditOptions | None:
        """Stop for crossings on the fly that do not pass the check, and leave what does not pass it then as it is.

        Where one of them lies behind a corner all corners are taken plain first. Of a section the motions about it are
        left first, then all of it. Where there is a good plan none is left.
        """
        original, verdict = self._original, made.verdict and with_miscounts(made, made.verdict)
        places = refused if verdict is None else (*refused, *failed_places(original, made.after, verdict))
        assert made.edits is not None
        crossed = crossed_in(made.edits, places)
        if not crossed and verdict is not None:
            crossed = crossed_in(made.edits, changed_places(original, made.after, verdict))
        if any(one.behind for one in crossed or made.edits.crossings):
            return replace(options, plain_corners=True)
        standing = frozenset(part.motion for one in crossed for part in one.parts) - options.standing
        if standing and (verdict is None or verdict.found == len(verdict.failures)):
            return replace(options, standing=options.standing | standing)
        if self._best is not None:
            return None
        self._reasons |= dict.fromkeys(self._why)
        stretches, sections = self._parted(places, (BESIDE,))
        failed = with_neighbours(sections, options.left, self._count) - options.left
        if not failed and not stretches:
            if verdict is not None and not verdict.ok:
                raise refusal(original.name, verdict)
            failed = frozenset(range(self._count)) - options.left
        options = replace(options, left=options.left | failed, stretches=(*options.stretches, *stretches))
        where = stretch_words(original, self._left_alone(options))
        self._said = (f"not compensated in {where}: {', or '.join(self._reasons)}",)
        return options

    def _left_alone(self, options: EditOptions) -> Places:
        """Return the stretches that are left as they are: sections, and parts of others."""
        low, high = section_spans(self._original.motions)
        left = [(int(low[n]), int(high[n])) for n in options.left]
        left += [one for one in options.stretches if not any(a <= one[0] and one[1] <= b for a, b in left)]
        return tuple(sorted(left))

    def _parting(self, tighter: EditOptions, judged: GuardFinding, options: EditOptions) -> EditOptions:
        """Leave of sections whose largest error alone is worse no more than the motions about it, at first."""
        stretches, whole = self._parted(judged.places, BESIDE_WORSE)
        if not stretches:
            return tighter
        low, _ = section_spans(self._original.motions)
        parted = set((np.searchsorted(low, [first for first, _ in stretches], side="right") - 1).tolist()) - whole
        left = options.left | with_neighbours(judged.worse - parted, options.left, self._count)
        return replace(tighter, left=left, stretches=(*options.stretches, *stretches))

    def _parted(self, places: Places, beside: Sequence[int]) -> tuple[Places, frozenset[int]]:
        """Return the stretches about places, and the sections of which no more is left, or parts were left before.

        A stretch goes `beside` its place by so many motions, the first time, the second and so on.
        """
        low, high = section_spans(self._original.motions)
        numbers = np.searchsorted(low, np.array(places, dtype=np.int64).reshape(-1, 2), side="right") - 1
        parts: dict[int, list[tuple[int, int]]] = {}
        whole: set[int] = set()
        for (first, last), (one, other) in zip(places, np.maximum(numbers, 0).tolist(), strict=True):
            if one == other:
                more = beside[min(self._parts[one], len(beside) - 1)]
                parts.setdefault(one, []).append((first - more, last + more + 1))
            else:
                whole.update(range(one, other + 1))
        stretches = []
        for number, found in parts.items():
            begin, end = int(low[number]), int(high[number])
            own = [(max(first, begin), min(last, end)) for first, last in dict.fromkeys(found)]
            if self._parts[number] >= len(beside) or 2 * sum(last - first for first, last in own) > end - begin:
                whole.add(number)
            elif number not in whole:
                stretches += own
        self._parts.update(parts.keys())
        return tuple(stretches), frozenset(whole)


def _nothing_gained(program: PartProgram, edits: Edits, enough: float) -> Edits:
    """Return no edits, with the reason why those that were planned are not written.

    `enough` is the slowdown of a plan that makes the part better, infinite where none was found.
    """
    nothing = Edits(runs=no_offsets(program.motions.kind.size))
    more = "a larger --max-slowdown may"
    if math.isfinite(enough):
        more = f"--max-slowdown {round_up(enough):g} would allow one"
    said = f"not compensated: no plan within the time allowed makes the part better; {more}"
    return replace(nothing, warnings=(*edits.warnings, said))


def _crosses(edits: Edits) -> bool:
    """Return whether any axis goes through its backlash, and not only onto its side where a cut begins."""
    return bool(edits.crossings or edits.dips or any(one.whole for stop in edits.stops for one in stop.shifts))
