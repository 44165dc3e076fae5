"""Plan the offsets of X and Y in drilling cycles, in the words of the cycles' own lines.

A cycle goes to its hole in a rapid, and X and Y rest while it drills. So the words of a hole carry the offset to the
side from which the axis comes, and nothing else of the cycle changes: neither its depth, its plane R nor the order of
its moves. Where it is not known on which side of its backlash an axis is as the cycle begins, an empty cycle stands
before it: one that drills from R to R beside the hole, so that the axis comes from there. It goes to its place as the
cycle itself does, at the height at which the tool is, and then to R.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import msgspec

from ph_post.compensate.offsets import may_shift
from ph_post.compensate.plan_warnings import friction_warnings
from ph_post.dialects.base import Dialect
from ph_post.edit.changes import Change
from ph_post.edit.edits import EditOptions
from ph_post.edit.further_edits import FurtherAxisPlan, Stand
from ph_post.edit.preconditions import (
    double_compensation,
    why_not_editable,
    word_decimals,
    written_offsets,
)
from ph_post.gcode.holes import ACROSS, TAPS, HoleRun, goes_on, hole_runs, place_before
from ph_post.gcode.program import PartProgram
from ph_post.types import Axis, Machine

BEYOND: Final = 2.0
"""Times its backlash that an axis goes at least before it is known to be on the side of its way."""

_RESTS: Final = 1e-9
"""Axes that move by no more [m] rest."""

_MOST_REASONS: Final = 12
"""Runs of holes that are named."""

_HELD: Final = (90.0, 98.0, 99.0)
"""Modes that the first line of a run may set for itself."""

_READIES: Final = 29.0
"""The M word behind which a rigid tapping cycle has to stand at once."""


class HolePlan(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The plan of the holes: of each axis across it, and empty cycles before lines.

    `runs` are first and last lines of the runs in which all axes are compensated, of the original; `left` are warnings.
    """

    axes: tuple[FurtherAxisPlan, ...] = ()
    changes: tuple[Change, ...] = ()
    runs: tuple[tuple[int, int], ...] = ()
    left: tuple[str, ...] = ()

    @property
    def changed(self) -> bool:
        """Whether anything is to be changed."""
        return bool(self.changes) or any(plan.shifts for plan in self.axes)


def plan_holes(program: PartProgram, machine: Machine, dialect: Dialect, options: EditOptions) -> HolePlan:
    """Plan the offsets of X and Y in drilling cycles, of axes whose backlash is outside their loops.

    Raises
    ------
    InputError
        Where the dialect's decimals are too few for an axis.
    """
    axes = [machine.axes[name] for name in ACROSS if name in machine.axes and may_shift(machine.axes[name])]
    runs = hole_runs(program) if axes and dialect.abilities.drills else []
    if not runs:
        return HolePlan()
    troubles = why_not_editable(program)
    units = {program.modal_after(hole.block).units for run in runs for hole in run.holes}
    if len(units) > 1 or troubles:
        why = [*troubles, "they are in mm and in inches"][0]
        return HolePlan(left=(f"holes not compensated: {why}",))
    planners = [_AxisHoles(program, dialect, axis, options, unit) for axis in axes for unit in units]
    changes, done, left = list[Change](), list[tuple[int, int]](), dict[str, list[tuple[int, int]]]()
    for run in runs:
        why = run.why or _plan_run(program, dialect, planners, run, changes)
        if why:
            left.setdefault(why, []).append((run.first, run.last))
            for planner in planners:
                planner.leave(run)
        else:
            done.append((run.first, run.last))
    said = _left_words(program, left)
    if done:
        amplitude = {axis.name: axis.gap.lost_motion for axis in axes}
        said += [*friction_warnings(amplitude, "cutter", climbs=False), *double_compensation(program, dialect, machine)]
    return HolePlan(
        axes=tuple(planner.plan() for planner in planners),
        changes=tuple(changes),
        runs=tuple(done),
        left=tuple(said),
    )


def _left_words(program: PartProgram, left: Mapping[str, Sequence[tuple[int, int]]]) -> list[str]:
    words = [
        f"holes not compensated in {program.line_words(*span)}: {why}"
        for why, spans in left.items()
        for span in spans[:_MOST_REASONS]
    ]
    return words[:_MOST_REASONS]


def _plan_run(
    program: PartProgram, dialect: Dialect, planners: Sequence[_AxisHoles], run: HoleRun, changes: list[Change]
) -> str:
    """Plan a run of holes; return why it stays as it is, empty where it does not."""
    for planner in planners:
        planner.begin(run)
    if why := next((planner.trouble for planner in planners if planner.trouble), ""):
        return why
    beside = [planner for planner in planners if planner.comes_beside]
    if beside and run.cycle in TAPS and _is_readied(program, run.first):
        return "M29 stands before them, behind which no other cycle may stand"
    carried = frozenset(planner.name for planner in planners if planner.carried)
    line = goes_on(program, run.last, carried) if carried else None
    if line is not None:
        return f"{program.line_words(line)} goes on from where they end"
    if beside:
        changes.append(_empty_cycles(program, dialect, planners, run))
    for planner in planners:
        planner.take()
    return ""


def _is_readied(program: PartProgram, block: int) -> bool:
    """Return whether M29 is the last that is said before a line."""
    words = program.commands
    found = words.block[(words.letter == ord("M")) & (words.value == _READIES) & (words.block <= block)]
    return bool(found.size) and not any(program.words_of(line) for line in range(int(found[-1]) + 1, block))


def _empty_cycles(program: PartProgram, dialect: Dialect, planners: Sequence[_AxisHoles], run: HoleRun) -> Change:
    """Write cycles from R to R that bring axes beside the first hole, and over it where its line does not name them."""
    hole, words, data = run.holes[0], program.words, program.data
    first = hole.words

    def number(letter: str) -> str:
        word = first[letter]
        return data[words.start[word] + 1 : words.end[word]].decode("latin-1").strip()

    own = program.words_of(run.first)
    held = [f"G{words.value[row]:g}" for row in own if words.letter[row] == ord("G") and words.value[row] in _HELD]
    modes = [*held, "G81"]
    known = {planner.name for planner in planners}
    # An axis without backlash goes to where the cycle takes it, too: the tool is nowhere but beside the hole.
    others = [letter + number(letter) for letter in ACROSS if letter not in known and letter in first]
    feed = ["F" + number("F")] if "F" in first else []
    gap = "" if dialect.syntax.terse else " "
    there = [text for planner in planners if (text := planner.word(beside=True))]
    lines = [gap.join([*modes, *there, *others, "Z" + number("R"), "R" + number("R"), *feed])]
    if any(planner.comes_beside and planner.name not in first for planner in planners):
        over = [text for planner in planners if (text := planner.word(beside=False))]
        lines.append(gap.join(["G81", *over, *others, "Z" + number("R"), "R" + number("R")]))
    label = ", ".join(planner.name for planner in planners if planner.comes_beside)
    return Change(block=run.first, removed=0, lines=lines, label=[f"{label} approach"])


class _AxisHoles:
    """Plans the holes of one axis, run by run."""

    def __init__(self, program: PartProgram, dialect: Dialect, axis: Axis, options: EditOptions, units: float) -> None:
        self._program, self._dialect, self._axis, self._units = program, dialect, axis, units
        self.name = axis.name
        self._decimals = word_decimals(dialect, units)
        self._step = units * 10.0**-self._decimals
        minus, plus = written_offsets(axis, dialect, units)
        self._sides = round(minus / self._step), round(plus / self._step)
        lost = axis.gap.lost_motion
        over = max(options.overshoot, lost) if options.overshoot is not None else BEYOND * lost
        self._over = math.ceil(over / self._step - 1e-6)
        self._shifts, self._stands = dict[int, int](), list[Stand]()
        self._done = self._all = self._beyond = 0

    def _place(self, word: int) -> float:
        return float(self._program.words.value[word]) * self._units

    def begin(self, run: HoleRun) -> None:
        """Look at a run: what its words would carry, and how the axis comes to its first hole."""
        place = self._begun = place_before(self._program, run.first, self.name)
        self._run_shifts, self._run_stands = dict[int, int](), list[Stand]()
        self.trouble, self.comes_beside, sign, reversals = "", False, 0, 0
        own = [hole.words.get(self.name) for hole in run.holes]
        self.target = self._place(own[0]) if own and own[0] is not None else place
        self._fine = self._decimals
        self.carried = 0
        if math.isnan(self.target):
            if any(word is not None for word in own):
                self.trouble = f"the place of {self.name} is not known where they begin"
            return
        way = self.target - place
        if not abs(way) >= BEYOND * self._axis.gap.lost_motion:
            self.comes_beside, sign = True, self._next_way(own)
        else:
            sign = 1 if way > 0.0 else -1
        self.first_offset = self._sides[sign > 0]
        self.beside = -sign * self._over
        place = self.target
        for word in own:
            if word is not None:
                way = self._place(word) - place
                turn = sign if abs(way) <= _RESTS else 1 if way > 0.0 else -1
                reversals += turn != sign
                place, sign = place + way, turn
                self._run_shifts[word] = self._sides[sign > 0]
                self._fine = max(self._fine, int(self._program.words.decimals[word]))
            self.carried = self._sides[sign > 0]
            self._run_stands.append(Stand(place=place, motor=place + self.carried * self._step, counts=True))
        self._reversals = reversals

    def _next_way(self, own: Sequence[int | None]) -> int:
        """Return the direction in which the axis goes on behind the first hole; plus where it does not."""
        places = [self._place(word) for word in own if word is not None]
        ways = [place - self.target for place in places if abs(place - self.target) > _RESTS]
        return -1 if ways and ways[0] < 0.0 else 1

    def word(self, *, beside: bool) -> str:
        """Word of the place beside the first hole, or over it; empty where nobody knows the place."""
        if math.isnan(self.target):
            return ""
        steps = self.beside if beside and self.comes_beside else self.first_offset
        scale = 10 ** (self._fine - self._decimals)
        count = round(self.target / self._units * 10**self._fine) + steps * scale
        return self.name + self._dialect.numbers.length(count, self._fine)

    def _start(self) -> None:
        """Note where the axis comes from; from where nobody knows, it may be on either side."""
        self._stands.append(Stand(place=math.nan, motor=math.nan, counts=False))
        if not math.isnan(self._begun):
            self._stands.append(Stand(place=self._begun, motor=self._begun, counts=False))

    def take(self) -> None:
        """Take the run as it was looked at."""
        self._start()
        if math.isnan(self.target):
            return
        if self.comes_beside:
            motor = self.target + self.beside * self._step
            # The original does not go there.
            self._stands.append(Stand(place=math.nan, motor=motor, counts=False))
            self._beyond = max(self._beyond, abs(self.beside))
        self._stands += self._run_stands
        self._shifts |= {word: steps for word, steps in self._run_shifts.items() if steps}
        self._done += self._reversals
        self._all += self._reversals

    def leave(self, run: HoleRun) -> None:
        """Leave a run as it is; what is not known of its places is not counted."""
        if run.why:
            return
        self.begin(run)
        self._start()
        if not (math.isnan(self.target) or self.trouble):
            self._stands += [Stand(place=one.place, motor=one.place, counts=True) for one in self._run_stands]
            self._all += self._reversals

    def plan(self) -> FurtherAxisPlan:
        """Return what comes of all runs."""
        return FurtherAxisPlan(
            axis=self._axis,
            step=self._step,
            decimals=self._decimals,
            sides=self._sides,
            beyond=self._beyond,
            shifts=self._shifts,
            added=(),
            done=self._done,
            reversals=self._all,
            stands=tuple(self._stands),
            left=(),
        )
