"""Check the words of changes that name a crossing, where commands and extrusion lie, and which modes are on."""

from __future__ import annotations

import re
from itertools import zip_longest
from typing import Any

import numpy as np

from ph_post.gcode.numbers import COMMENT
from ph_post.gcode.program import ARC, CUBIC, LINE, RAPID, Motions, PartProgram, WordTable, span_of
from ph_post.types import Array, BoolArray, IntArray
from ph_post.units import MM
from ph_post.verify.crossings import CrossedStretches
from ph_post.verify.line_pairs import NO_CHANGE, VerifyCase

_OWN = b"GXYZFNIJKRPQ"
"""Letters of the blocks of crossings, and of the parts of motions beside them; P and Q of a path mode, too."""

_IS_COMMAND = np.isin(np.arange(256), np.frombuffer(b"MSTO", dtype=np.uint8))
_DWELL = 4.0
_EXTRUDED = re.compile(rb"[Ee][ \t]*([-+]?(?:\d+\.?\d*|\.\d+))")
_BEGIN = rb"(?:\A|(?<=[\r\n]))[ \t]*(?:N\d+[ \t]*)?"
_RELATIVE = re.compile(_BEGIN + rb"M[ \t]*0*8([23])\b", re.IGNORECASE)
_PLACED = re.compile(
    _BEGIN + rb"G[ \t]*0*(?:[0-3]|92)(?![\d.])[^\r\n;(]*E[ \t]*([-+]?(?:\d+\.?\d*|\.\d+))", re.IGNORECASE
)
"""Where moves, and what sets it, place the extruder: E of another command is no place, nor of a text."""
_ROUNDED = re.compile(r"G64 P(\d*\.?\d+)( Q0)?")
_HALF = 0.5
"""Steps of the last decimal by which a rounding may be above its tolerance."""

_PARTS = 3
"""Parts of a line or an arc on which an offset changes with cutter compensation."""

_RADIUS = 10.0 * MM
"""Radius of a cutter for which their joints leave something of all of them."""

_DROP = 1e-4
"""Extrusion [mm of filament] that is rounding, and the part of itself that is."""


def words_of_changes(case: VerifyCase, words: tuple[WordTable, WordTable]) -> tuple[WordTable, WordTable]:
    """Return the words of the replaced and of the new lines of all changes, out of words that have them."""
    sides = zip(words, (case.lines.old_change, case.lines.new_change), strict=True)
    old, new = (own.take(np.flatnonzero(change[own.block] != NO_CHANGE)) for own, change in sides)
    return old, new


def check_crossing_words(case: VerifyCase, crossed: CrossedStretches, words: tuple[WordTable, WordTable]) -> None:
    """Check words, commands, extrusion and modes in the changes that name a crossing; `words` are those of changes."""
    changes = case.lines.changes
    if any(_corrects(modal.compensation) for modal in case.original.modal):
        for change in range(changes.crossed.size):
            _check_modes(case, change)
    for change in np.flatnonzero(changes.crossed).tolist():
        _check_letters(case, change, words)
        _check_breaks(case, change)
        _check_path_modes(case, change)
    broken = set(crossed.found.change[~crossed.fine].tolist())
    extruder = _Extruder(case.original)
    for change in np.unique(crossed.found.change).tolist():
        if change not in broken:
            own = _Places(case, crossed, change)
            _check_halts(case, own)
            _check_commands(case, own, change, words)
            _check_extrusion(case, own, change, extruder)


def _spans(case: VerifyCase, change: int) -> tuple[tuple[PartProgram, int, int], tuple[PartProgram, int, int]]:
    """Return the replaced lines and the new ones of a change."""
    changes = case.lines.changes
    return (
        (case.original, int(changes.old_first[change]), int(changes.old_last[change])),
        (case.compensated, int(changes.new_first[change]), int(changes.new_last[change])),
    )


def _check_letters(case: VerifyCase, change: int, words: tuple[WordTable, WordTable]) -> None:
    """Check that nothing but places and feeds is added to what the replaced lines say."""
    (_, *old), (other, *new) = _spans(case, change)
    one, own = words
    there = set(_OWN) | set(one.letter[one.rows(old[0], old[1])].tolist())
    rows = own.rows(new[0], new[1])
    for word in range(rows.start, rows.stop):
        letter = int(own.letter[word])
        if letter not in there and not (letter == ord("Q") and _is_cubic(other, int(own.block[word]))):
            text = other.data[own.start[word] : own.end[word]].decode("latin-1")
            case.findings.add(
                "command",
                "a word that has no place in a crossing",
                compensated=int(own.block[word]),
                expected="X, Y, Z, F and words of arcs",
                got=text,
            )


def _is_cubic(program: PartProgram, block: int) -> bool:
    """Return True for a line with a cubic: a part of a G5.1 is a G5, which has a P and a Q."""
    low, high = span_of(program.motions.block, block)
    return bool(np.any(program.motions.kind[low:high] == CUBIC))


def _corrects(word: str | None) -> bool:
    """Return True for a word of cutter compensation that is on."""
    return word not in (None, "G40")


def _check_modes(case: VerifyCase, change: int) -> None:
    """Check that with cutter compensation a change is of lines or arcs in three parts, with room for the cutter.

    An offset of the tool to either side leaves all parts of lines then. Of arcs it does so up to the radius that fits
    into those of the contour, on the side on which the tool is.
    """
    (program, first, last), (other, new_first, new_last) = _spans(case, change)
    active = [program.modal_after(block).compensation for block in range(first - 1, last)]
    if not any(map(_corrects, active)):
        return
    old, new = program.motions, other.motions
    rows = np.flatnonzero((old.block >= first) & (old.block < last))
    made = np.flatnonzero((new.block >= new_first) & (new.block < new_last))
    kinds = {*old.kind[rows].tolist(), *new.kind[made].tolist()}
    added = [other.modal_after(block).compensation for block in range(new_first, new_last)]
    if {*old.kind[rows].tolist()} == {RAPID} and not any(map(_corrects, [*active[1:], *added])):
        # What is added behind the rapid that leaves a contour is no part of it.
        return
    fine = rows.size > 0 and kinds in ({LINE}, {LINE, ARC}) and case.lines.changes.crossed[change]
    if fine and made.size <= _PARTS * rows.size and len(set(active)) == 1:
        side = 1 if str(active[0]).startswith("G41") else -1
        round_arcs = (side, _smallest_inner(program, rows, side))
        fine = (
            _rooms(new, made, old.end[rows], _far(case), *(round_arcs if ARC in kinds else (0, _RADIUS))) >= 0.0
        ).all()
    else:
        fine = False
    if not fine:
        case.findings.add(
            "crossing",
            "a change on a contour with cutter compensation that is more than three parts with room for the cutter",
            original=max(first, 0),
            compensated=new_first,
            expected="G40",
            got=next(one for one in active if one is not None and _corrects(one)),
        )


def _smallest_inner(program: PartProgram, rows: IntArray, side: int) -> float:
    """Return the least radius [m] of a contour's arcs about whose inside the tool is, up to that of a large one."""
    motions, begin, end = program.motions, int(rows[0]), int(rows[-1])

    def corrected(k: int) -> bool:
        return 0 <= k < motions.kind.size and _corrects(program.modal_after(int(motions.block[k])).compensation)

    while corrected(begin - 1):
        begin -= 1
    while corrected(end + 1):
        end += 1
    own = np.arange(begin, end + 1)
    arcs = own[(motions.kind[own] == ARC) & (side * motions.angle[own] > 0.0)]
    radii = np.linalg.norm(motions.start[arcs, :2] - motions.center[arcs], axis=1)
    return float(radii.min(initial=_RADIUS))


def _far(case: VerifyCase) -> float:
    """Return how far a shifted place may be from its own [m]."""
    return 2.0 * sum(one.metres for one in case.declared.offsets.values())


def _rooms(motions: Motions, made: IntArray, corners: Array, far: float, side: int, radius: float) -> Array:
    """Return what a cutter leaves [m] of the parts beside every joint but those in the corners of the contour.

    A joint shortens them that turns to the `side` on which it is, 1 for the left; for 0 to either.
    """
    ends = [motions.start[made, :2], motions.end[made, :2]]
    ways = np.stack([ends[1] - ends[0]] * 2)
    arcs = motions.kind[made] == ARC
    for way, place in zip(ways, ends, strict=True):
        away = (place - motions.center[made])[arcs]
        way[arcs] = np.sign(motions.angle[made][arcs])[:, None] * np.column_stack([-away[:, 1], away[:, 0]])
    sizes = np.where(arcs, np.abs(motions.angle[made]) * np.hypot(*ways[0].T), np.hypot(*ways[0].T))
    into, out = (np.arctan2(way[:, 1], way[:, 0]) for way in (ways[1], ways[0]))
    turns = np.remainder(out[1:] - into[:-1] + np.pi, 2.0 * np.pi) - np.pi
    turns = np.maximum(side * turns, 0.0) if side else np.abs(turns)
    joints = motions.end[made[:-1], :2]
    apart = np.linalg.norm(joints[:, None, :] - corners[None, :, :2], axis=2).min(axis=1) > far
    return np.asarray((np.minimum(sizes[:-1], sizes[1:]) - radius * np.tan(0.5 * turns))[apart])


def _check_breaks(case: VerifyCase, change: int) -> None:
    """Check that no crossing goes on over a tool change, home, probe, or a change of coordinates."""
    _, (program, first, last) = _spans(case, change)
    for mark in program.breaks:
        if first < mark.block < last:
            case.findings.add("crossing", f"a crossing over this place: {mark.kind}", compensated=mark.block)


def _check_path_modes(case: VerifyCase, change: int) -> None:
    """Check that joints are rounded as they were, or within the tolerance, and that lines are not joined then."""
    (one, first, last), (other, new_first, new_last) = _spans(case, change)
    modes = {one.modal_after(block).path for block in range(first - 1, last)}
    for block in range(new_first, new_last):
        modal = other.modal_after(block)
        if modal.path in modes:
            continue
        match = _ROUNDED.fullmatch(modal.path or "")
        step = _HALF * 10.0 ** -len(match[1].partition(".")[2]) if match else 0.0
        if match is None or not (float(match[1]) - step) * modal.units <= case.band or match[2] is None:
            case.findings.add(
                "path",
                "a path mode that rounds joints by more than the tolerance, or joins lines",
                compensated=block,
                expected=f"at most G64 P{case.band / modal.units:.6g} Q0",
                got=modal.path or "none",
            )
            return


class _Places:
    """Where the lines of a change are along the original, and the crossings in it."""

    def __init__(self, case: VerifyCase, crossed: CrossedStretches, change: int) -> None:
        found = crossed.found
        low, high = np.searchsorted(found.change, [change, change + 1])
        self.spare = float(crossed.spare[low]) + case.bound + case.declared.within
        self._sides: list[tuple[IntArray, Array, Array]] = []
        self.halts: list[BoolArray] = []
        """Motions of either program at whose ends the controller stops."""
        for program, side, begin, end in (
            (case.original, found.old, crossed.old_low, crossed.old_high),
            (case.compensated, found.new, crossed.new_low, crossed.new_high),
        ):
            rows = slice(int(side.first[low]), int(side.first[high]))
            self.halts.append(program.motions.exact[side.motion[rows]] == 1)
            self._sides.append((program.motions.block[side.motion[rows]].astype(np.int64), begin[rows], end[rows]))
        starts = self._sides[1][1]
        inside = (crossed.group[:, 1] >= starts.min()) & (crossed.group[:, 0] <= self._sides[1][2].max())
        self._groups = crossed.group[inside]

    def of(self, side: int, block: int, after: bool) -> float:
        """Place at which a line's commands are executed: before its motion, or after it."""
        blocks, begin, end = self._sides[side]
        if not blocks.size:
            return float(self._sides[1 - side][1][0])
        if after:
            place = int(np.searchsorted(blocks, block, side="right")) - 1
            return float(end[place]) if place >= 0 else float(begin[0])
        place = int(np.searchsorted(blocks, block))
        return float(begin[place]) if place < blocks.size else float(end[-1])

    def ends(self, side: int) -> tuple[IntArray, Array, Array]:
        """Lines of the motions, and where they begin and end."""
        return self._sides[side]

    def alike(self, one: float, other: float) -> bool:
        """Return true for places that are the same, or in the same crossing."""
        if abs(one - other) <= self.spare:
            return True
        low, high = min(one, other), max(one, other)
        return bool(np.any((self._groups[:, 0] <= low + self.spare) & (high <= self._groups[:, 1] + self.spare)))


def _check_halts(case: VerifyCase, own: _Places) -> None:
    """Check that the controller stops wherever it stopped at the end of a motion."""
    blocks, _, ends = own.ends(0)
    stops = own.ends(1)[2][own.halts[1]]
    for block, place in zip(blocks[own.halts[0]].tolist(), ends[own.halts[0]].tolist(), strict=True):
        if not np.any(np.abs(stops - place) <= own.spare):
            case.findings.add("path", "the path mode at its end is another one", original=int(block))


def _check_commands(case: VerifyCase, own: _Places, change: int, words: tuple[WordTable, WordTable]) -> None:
    """Check that commands of replaced lines, and their dwells, stay where they were along the path."""
    (one, *old), (other, *new) = _spans(case, change)
    before = _commands_of(one, words[0], old[0], old[1])
    rest = _commands_of(other, words[1], new[0], new[1])
    for letter, value, block in before:
        # Lost ones are found elsewhere; added dwells stand between them.
        at = next((n for n, found in enumerate(rest) if found[:2] == (letter, value)), None)
        if at is None:
            continue
        _, _, there = rest[at]
        rest = rest[at + 1 :]
        after = letter == "M" and value in one.language.after_motion
        if not own.alike(own.of(0, block, after), own.of(1, there, after)):
            text = f"G4 of {value:g} s" if letter == "G" else f"{letter}{value:g}"
            case.findings.add(
                "command",
                f"{text} is moved along the path, across a crossing or a part of its motion",
                original=block,
                compensated=there,
                expected=f"{(own.of(0, block, after) - own.ends(1)[1][0]) / MM:.4g} mm behind the change's beginning",
                got=f"{(own.of(1, there, after) - own.ends(1)[1][0]) / MM:.4g} mm",
            )


def _commands_of(program: PartProgram, words: WordTable, first: int, last: int) -> list[tuple[str, float, int]]:
    """Commands of some lines, in order: letter, value and line; of dwells the time [s]."""
    rows = words.rows(first, last)
    wanted = _IS_COMMAND[words.letter[rows]]
    found = [
        (chr(int(words.letter[word])), float(np.nan_to_num(words.value[word])), int(words.block[word]))
        for word in (rows.start + np.flatnonzero(wanted)).tolist()
    ]
    blocks, times = program.dwells(first, last, words)
    found += [
        ("G", float(np.nan_to_num(time)), int(block))
        for block, time in zip(blocks.tolist(), times.tolist(), strict=True)
    ]
    return sorted(found, key=lambda one: one[2])


def _check_extrusion(case: VerifyCase, own: _Places, change: int, extruder: _Extruder) -> None:
    """Check that what is extruded up to each place of the original stays the same."""
    (one, *old), (other, *new) = _spans(case, change)
    if one.language.bound is None or not (_extrudes(one, old) or _extrudes(other, new)):
        return
    start, relative = extruder.before(old[0])
    moved, placed = _extruded(one, old, own.ends(0)[0], start, relative)
    new_moved, new_placed = _extruded(other, new, own.ends(1)[0], start, relative)
    # Between two motions of the original may be a way through the air.
    places = np.append(own.ends(1)[1][0], np.stack(own.ends(0)[1:], axis=1))
    amounts = np.append(0.0, np.stack([np.append(0.0, moved)[:-1], moved], axis=1))
    new_blocks, _, new_end = own.ends(1)
    for block, place, amount in zip(new_blocks.tolist(), new_end.tolist(), new_moved.tolist(), strict=True):
        low, high = place - own.spare, place + own.spare
        # Where filament is drawn back the most is at neither end.
        near = [*np.interp((low, high), places, amounts), *amounts[(low <= places) & (places <= high)]]
        least, most = min(near), max(near)
        spare = _DROP * max(1.0, abs(most))
        if not least - spare <= amount <= most + spare:
            case.findings.add(
                "command",
                "E is not in proportion to the original's way",
                compensated=int(block),
                expected=f"E {start + 0.5 * (least + most):.6g} in all",
                got=f"E {start + amount:.6g}",
            )
    for (block, amount), (there, got) in zip_longest(placed, new_placed, fillvalue=(-1, 0.0)):
        here = min(block, there) >= 0 and own.alike(own.of(0, block, after=False), own.of(1, there, after=False))
        if not here or abs(got - amount) > _DROP * max(1.0, abs(amount)):
            case.findings.add(
                "command",
                "what is extruded in place is not what the original extrudes there",
                original=block if block >= 0 else None,
                compensated=there if there >= 0 else None,
                expected=f"E {amount:.6g}",
                got=f"E {got:.6g}",
            )
            break


def _extrudes(program: PartProgram, span: Any) -> bool:
    text = program.data[program.lines[span[0]] : program.lines[span[1]]]
    return _EXTRUDED.search(COMMENT.sub(b"", text)) is not None


class _Extruder:
    """The extruder of a program, before lines that are asked for in order."""

    def __init__(self, program: PartProgram) -> None:
        self._program, self._read = program, 0
        self._relative, self._place = False, 0.0

    def before(self, line: int) -> tuple[float, bool]:
        """Return the extruder's place before a line, and true where E words are relative."""
        end = int(self._program.lines[line])
        text = self._program.data[self._read : end]
        self._read = end
        for mode in _RELATIVE.findall(text)[-1:]:
            self._relative = mode == b"3"
        for word in _PLACED.findall(text)[-1:]:
            self._place = float(word)
        return (0.0 if self._relative else self._place), self._relative


def _extruded(
    program: PartProgram, span: Any, blocks: IntArray, start: float, relative: bool
) -> tuple[Array, list[tuple[int, float]]]:
    """Return what the motions of some lines (n,) extrude up to their ends (n,) [mm], and which lines do it in place."""
    at, along = start, np.zeros(blocks.size)
    placed: list[tuple[int, float]] = []
    for block in range(span[0], span[1]):
        words = _EXTRUDED.findall(COMMENT.sub(b"", program.text(block)))
        if not words:
            continue
        amount = float(words[-1]) - (0.0 if relative else at)
        at += amount
        first = int(np.searchsorted(blocks, block))
        if first < blocks.size and blocks[first] == block:
            along[first:] += amount
        else:
            placed.append((block, amount))
    return along, placed
