"""Check a compensated program, and find the motions whose changes do not pass."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

import numpy as np
from msgspec.structs import replace

from ph_post.api.compensated_program import CompensatedProgram, ProgramRequest
from ph_post.dialects.declaration import line_origins
from ph_post.edit.edits import CrossingEdit, Edits
from ph_post.errors import InputError
from ph_post.gcode.program import PartProgram
from ph_post.types import Machine
from ph_post.verify.verdict import Verdict
from ph_post.verify.verify import verify

Places = tuple[tuple[int, int], ...]
"""First and last motion of places in a program."""

_LINE: Final = re.compile(r":(\d+)(?::\d+)?$")

_CARRIED_ON: Final = ("break", "path", "state")
"""Kinds of failures by what a chain leaves in force for the next: how it moves, and in which modes."""


def verified(
    original: PartProgram, after: PartProgram, request: ProgramRequest, machine: Machine
) -> tuple[Verdict | None, Places]:
    """Check a program; None where a controller would refuse one of its lines, with the place of that line."""
    try:
        return verify(original, after, tolerance=request.edit.tolerance, machine=machine), ()
    except InputError as error:
        line = _LINE.search(error.where)
        if line is None or not 0 < int(line[1]) <= after.blocks:
            raise
        places = moved_by(original, after, [int(line[1]) - 1])
        if not places:
            raise
        return None, places


def moved_by(original: PartProgram, after: PartProgram, lines: Sequence[int]) -> Places:
    """Return the motions of an original for which lines of its compensated program stand, from 0; none if unknown."""
    origins = line_origins(after, original)
    if origins is None:
        return ()
    motions = np.searchsorted(original.motions.block, origins.first[list(lines)])
    return tuple((motion, motion) for motion in dict.fromkeys(motions.tolist()))


def crossed_in(edits: Edits, places: Places) -> list[CrossingEdit]:
    """Return the crossings that lie on any of the motions between places."""
    found = []
    for one in edits.crossings:
        begin, end = one.parts[0].motion, one.parts[-1].motion
        if any(begin <= last and first <= end for first, last in places):
            found.append(one)
    return found


def changed_places(program: PartProgram, after: PartProgram, verdict: Verdict) -> Places:
    """Return the motions whose lines were changed with those in which a checker found failures.

    A change that begins with the rapid to a cut has its failures told of that line.
    """
    origins = line_origins(after, program)
    if origins is None:
        return ()
    lines = [one.compensated - 1 for one in verdict.failures if one.compensated is not None]
    spans = np.stack((origins.first[lines], origins.end[lines]), axis=1)
    motions = np.searchsorted(program.motions.block, spans) - (0, 1)
    return tuple((int(first), int(last)) for first, last in motions.tolist() if first <= last)


def with_miscounts(made: CompensatedProgram, verdict: Verdict) -> Verdict:
    """Return a verdict in which a failed count of crossings is told of the changes that have other ones than planned.

    Which crossings a change has its mark names, but not how many are alike.
    """
    failed = [one for one in verdict.failures if one.kind == "count"]
    origins = line_origins(made.after, made.before)
    if not failed or not verdict.crossings or made.edits is None or origins is None:
        return verdict
    block, marks = made.before.motions.block, np.array(sorted(verdict.crossings))
    lines = [int(block[one.parts[0].motion]) for one in made.edits.crossings]
    for stop in made.edits.stops:
        # A stop at the end of a motion stands behind its line.
        line = int(block[stop.motion]) + (stop.share == 1.0) if stop.behind is None else stop.behind + 1
        lines += [line for shift in stop.shifts if stop.crosses_in(shift.axis)]
    own = np.searchsorted(origins.first[marks - 1], lines, side="right") - 1
    found = np.array([verdict.crossings[mark] for mark in marks.tolist()])
    wrong = marks[np.bincount(np.maximum(own, 0), minlength=marks.size) != found].tolist()
    told = [replace(failed[0], compensated=mark) for mark in wrong] or failed
    rest = [one for one in verdict.failures if one.kind != "count"]
    return replace(verdict, failures=(*rest, *told), found=verdict.found + len(told) - len(failed))


def failed_places(program: PartProgram, after: PartProgram, verdict: Verdict) -> Places:
    """Return the motions between which a checker found failures, the first and the last where it lists but some.

    Where what one chain leaves in force for the next has failed motions of both are returned; none at all where another
    failure is not within the lines of a chain: leaving any alone would not mend that. What is counted over the whole
    program has no line: the lines are those of the other failures.
    """
    motions = program.motions
    origins = line_origins(after, program)
    found: list[tuple[int, int]] = []
    for one in verdict.failures:
        if one.original is not None:
            first = end = one.original - 1
        elif one.compensated is None:
            continue
        elif origins is None:
            return ()
        else:
            first, end = int(origins.first[one.compensated - 1]), int(origins.end[one.compensated - 1])
            # What was only added stands between two lines.
            first, end = (first, end - 1) if end > first else (first - 1, first)
        last = int(np.searchsorted(motions.block, first, side="right")) - 1
        behind = int(np.searchsorted(motions.block, end))
        if last >= 0 and behind < motions.block.size and motions.chain[last] == motions.chain[behind]:
            found.append((last, behind))
        elif one.original is not None and one.kind not in _CARRIED_ON:
            return ()
        elif one.original is not None:
            # Between two chains: what one leaves in force, the other begins with.
            found += [(n, n) for n in (last, behind) if 0 <= n < motions.block.size]
        elif last >= 0:
            found.append((last, last))
    return ((0, motions.kind.size - 1),) if verdict.found > len(verdict.failures) else tuple(dict.fromkeys(found))
