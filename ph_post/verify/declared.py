"""Declarations of a compensated program, read independently of the writer, and the lines that it replaced."""

from __future__ import annotations

import re
from collections.abc import Mapping
from decimal import Decimal
from typing import Any

import msgspec
import numpy as np

from ph_post.gcode.program import PartProgram, PlaceArray, expand
from ph_post.types import BoolArray, IntArray
from ph_post.units import LENGTHS, MM, MS
from ph_post.verify.verdict import Findings, quoted

_COMPENSATED = re.compile(rb"\(ph-post \S.* compensated this program\)\s*", re.IGNORECASE)
_FACT = re.compile(rb"\(ph-post: ([^+].*)\)\s*", re.IGNORECASE)
_MORE = re.compile(rb"\(  (.*)\)\s*")
"""A fact that is too long for its line goes on in lines that begin with two blanks."""

_BEFORE = re.compile(rb"\s*(?:%.*|O\d+\b.*)?\s*", re.IGNORECASE)
"""Lines that may come before the header: blank lines, ``%`` and an O-number."""

_UNDO = re.compile(rb"\(ph-post: undo (\d+)/(\d+) ([A-Za-z0-9+/=]*)\)\s*", re.IGNORECASE)
_SEMICOLON = b"; "
"""Some languages have comments to the end of the line only."""

_LEADING = 8
"""The header begins on one of the first lines."""

_KNOWN = {
    "original": re.compile(r"original sha256 ([0-9a-f]{64})", re.IGNORECASE),
    "machine": re.compile(r"machine (.*), sha256 ([0-9a-f]*)", re.IGNORECASE),
    "options": re.compile(r"options sha256 ([0-9a-f]*)", re.IGNORECASE),
    "offset": re.compile(r"offset ([XYZ]) (\d*\.?\d+) (mm|inch)", re.IGNORECASE),
    # Version 0.1.0 wrote "pulse".
    "pulse": re.compile(r"(?:take-up|pulse) ([XYZ]) (\d*\.?\d+) (mm|inch)", re.IGNORECASE),
    "edits": re.compile(r"(\d+) stops?, (\d+) dips?", re.IGNORECASE),
    "dwell": re.compile(
        r"dwell ([-+.\de]+) s, decimals (\d+), chord tolerance ([-+.\de]+) mm, block time ([-+.\de]+) ms.*",
        re.IGNORECASE,
    ),
    "dwells": re.compile(r"dwells up to ([.\d]+) s, ([.\d]+) s in all", re.IGNORECASE),
    "units": re.compile(r"units (mm|inch)", re.IGNORECASE),
    "dialect": re.compile(r"dialect (\S+)", re.IGNORECASE),
    "command": re.compile(r"command (M425 F0)"),
    "note": re.compile(r"note.*", re.IGNORECASE),
}


class DeclaredLength(msgspec.Struct, frozen=True, kw_only=True):
    """A declared length: the exact number, as it is written, and the unit [m]."""

    number: Decimal
    unit: float

    @property
    def metres(self) -> float:
        """In SI."""
        return float(self.number) * self.unit


class DeclaredChanges(msgspec.Struct, frozen=True, kw_only=True):
    """The declarations of the header.

    `first`, `last` its lines, `tail` the first of the undo lines at the end (the number of lines where there
    are none). `offsets` and `pulses` by axis; `dwell` [s], where they are not all alike with the
    `longest` and their sum `dwelt` [s]; `block_time` [s]; `decimals` of lengths;
    `chord` tolerance [m]; `stops`, `dips` their numbers. `faults` what could not be read, with its line.
    """

    first: int
    last: int
    tail: int
    original: str = ""
    machine: str = ""
    machine_digest: str = ""
    offsets: Mapping[str, DeclaredLength] = {}
    pulses: Mapping[str, DeclaredLength] = {}
    stops: int | None = None
    dips: int | None = None
    dwell: float | None = None
    longest: float | None = None
    dwelt: float | None = None
    decimals: int | None = None
    chord: float | None = None
    block_time: float | None = None
    faults: tuple[tuple[int, str], ...] = ()


def read_declared(original: PartProgram, compensated: PartProgram) -> DeclaredChanges | None:
    """Read the header of a compensated program and find its undo lines; None where there is no header."""
    first = _find_header(compensated)
    if first is None:
        return None
    facts, last = _read_facts(original, compensated, first)
    fields, wrong = _fields(facts, first)
    if _declared_commands(facts) and not _commands(compensated, facts, last - len(_declared_commands(facts))):
        wrong.append((first, "the commands that the header declares do not follow it"))
    tail, more = _read_tail(compensated, last)
    return DeclaredChanges(first=first, last=last, tail=tail, faults=(*wrong, *more), **fields)


def comment_of(program: PartProgram, line: int) -> bytes:
    """Text of a line; one that is a comment behind a semicolon as if it stood in parentheses."""
    text = program.text(line)
    if not text.startswith(_SEMICOLON):
        return text
    return b"(" + text[len(_SEMICOLON) :].rstrip() + b")"


def _find_header(program: PartProgram) -> int | None:
    for number in range(min(program.blocks, _LEADING)):
        if _COMPENSATED.fullmatch(comment_of(program, number)):
            return number
        if not _BEFORE.fullmatch(program.text(number)):
            return None
    return None


def _read_facts(original: PartProgram, compensated: PartProgram, first: int) -> tuple[list[tuple[int, str]], int]:
    """Facts of the header with their lines, and the line behind it."""
    facts: list[tuple[int, str]] = []
    last, open_lines = first + 1, 0
    while last < compensated.blocks:
        text = comment_of(compensated, last)
        fact, more = _FACT.fullmatch(text), _MORE.fullmatch(text)
        if fact is not None and not _UNDO.fullmatch(text):
            facts.append((last, fact[1].decode("latin-1")))
        elif more is not None and facts:
            facts[-1] = (facts[-1][0], f"{facts[-1][1]} {more[1].decode('latin-1').strip()}")
        else:
            break
        open_lines = open_lines + 1 if fact is None else 0
        last += 1
    if commands := _commands(compensated, facts, last):
        return facts, last + commands
    # Comments with which the original begins may look as if the last fact went on in them.
    own = 0
    while own < open_lines and first + own < original.blocks and _MORE.fullmatch(comment_of(original, first + own)):
        own += 1
    return facts, last - own


def _commands(compensated: PartProgram, facts: list[tuple[int, str]], last: int) -> int:
    """Count the lines behind the header that hold its declared commands, in order; 0 where they do not."""
    commands = _declared_commands(facts)
    lines = range(last, min(last + len(commands), compensated.blocks))
    return len(commands) if [compensated.text(line).strip().decode("latin-1") for line in lines] == commands else 0


def _declared_commands(facts: list[tuple[int, str]]) -> list[str]:
    return [words.split(" ", 1)[1] for _, words in facts if _KNOWN["command"].fullmatch(words)]


def _fields(facts: list[tuple[int, str]], first: int) -> tuple[dict[str, Any], list[tuple[int, str]]]:
    """Values of the declaration, and its duplicate, missing or unknown lines."""
    fields: dict[str, Any] = {"offsets": {}, "pulses": {}}
    faults: list[tuple[int, str]] = []
    seen: set[str] = set()
    for number, words in facts:
        name = next((name for name, pattern in _KNOWN.items() if pattern.fullmatch(words)), None)
        if name is None:
            faults.append((number, f"the header has an unknown line: {words[:40]}"))
            continue
        match = _KNOWN[name].fullmatch(words)
        assert match is not None
        key = f"{name} {match[1]}" if name in ("offset", "pulse") else name
        if key in seen and name != "note":
            faults.append((number, f"the header declares {key} twice"))
        seen.add(key)
        _set_fact(fields, name, match)
    missing = [name for name in ("original", "edits", "dwell") if name not in seen]
    return fields, faults + [(first, f"the header does not declare {name}") for name in missing]


def _set_fact(fields: dict[str, Any], name: str, match: re.Match[str]) -> None:
    """Put one line of the header into the declaration's fields."""
    if name == "original":
        fields["original"] = match[1].lower()
    elif name == "machine":
        fields["machine"], fields["machine_digest"] = match[1], match[2].lower()
    elif name in ("offset", "pulse"):
        unit = float(LENGTHS[match[3].lower()])
        fields[f"{name}s"][match[1].upper()] = DeclaredLength(number=Decimal(match[2]), unit=unit)
    elif name == "edits":
        fields["stops"], fields["dips"] = int(match[1]), int(match[2])
    elif name == "dwell":
        fields["dwell"], fields["decimals"] = float(match[1]), int(match[2])
        fields["chord"], fields["block_time"] = float(match[3]) * MM, float(match[4]) * MS

    elif name == "dwells":
        fields["longest"], fields["dwelt"] = float(match[1]), float(match[2])


def _read_tail(program: PartProgram, last: int) -> tuple[int, list[tuple[int, str]]]:
    """First of the undo lines at the end, and what is wrong with their numbers."""
    tail, lines = program.blocks, program.blocks
    while tail > last and _UNDO.fullmatch(comment_of(program, tail - 1)):
        tail -= 1
    faults = []
    for place, number in enumerate(range(tail, lines), 1):
        match = _UNDO.fullmatch(comment_of(program, number))
        assert match is not None
        if (int(match[1]), int(match[2])) != (place, lines - tail):
            numbers = f"undo {int(match[1])}/{int(match[2])} where {place}/{lines - tail} belongs"
            faults.append((number, f"the undo lines are not in order: {numbers}"))
    return tail, faults


_MARKER = re.compile(rb"\(ph-post: \+(\d+) -(\d+)( [^)]*)?\)\s*", re.IGNORECASE)
_BEGINS = re.compile(rb"(?:\(|; )ph-post: \+", re.IGNORECASE)

NO_CHANGE = -1
"""The change of a line outside all of them."""


class ChangedLines(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The changed stretches: lines ``[new_first, new_last)`` in place of ``[old_first, old_last)``, all (h,).

    `marker` is the comment line that announces it, the one before `new_first`.
    """

    marker: IntArray
    new_first: IntArray
    new_last: IntArray
    old_first: IntArray
    old_last: IntArray

    @property
    def number(self) -> int:
        """Number of changes."""
        return self.marker.size


class LinePairs(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Lines that belong together.

    `old`, `new` (k,) the lines outside changes, pair by pair, in order. `old_change`, `new_change` the change of each
    line, :data:`NO_CHANGE` outside (markers and the header belong to none). `ends` whether the original's last
    line has got a line end, so that the undo lines can follow it.
    """

    changes: ChangedLines
    old: PlaceArray
    new: PlaceArray
    old_change: PlaceArray
    new_change: PlaceArray
    ends: bool


def pair_lines(
    original: PartProgram, compensated: PartProgram, declared: DeclaredChanges, findings: Findings
) -> LinePairs | None:
    """Pair the lines as header and marks declare; None where the numbers of lines do not allow it."""
    markers = _markers(original, compensated, declared)
    rows: list[tuple[int, int, int, int, int]] = []
    old, new = declared.first, declared.last
    for line, added, removed in markers:
        if line < new:
            findings.add("lines", "a change begins inside another one", compensated=line)
            return None
        old += line - new
        new = line + 1 + added
        rows.append((line, line + 1, new, old, old + removed))
        old += removed
        if new > declared.tail or old > original.blocks:
            findings.add(
                "lines",
                "a change reaches over the end of the program",
                compensated=line,
                got=quoted(compensated.text(line)),
            )
            return None
    found = _line_pairs(original, compensated, declared, rows)
    missing = (original.blocks - old) - (declared.tail - new)
    if missing:
        _report_count(original, compensated, found, missing, findings)
    return None if missing else found


def _markers(original: PartProgram, compensated: PartProgram, declared: DeclaredChanges) -> list[tuple[int, int, int]]:
    """Lines that begin a change, with the numbers of lines added and removed.

    A line of the same bytes that the original has in that place is the original's.
    """
    found: list[tuple[int, int, int]] = []
    begins = np.array([match.start() for match in _BEGINS.finditer(compensated.data)], dtype=np.int32)
    lines = np.searchsorted(compensated.lines, begins, side="right") - 1
    behind, shift = declared.last, declared.last - declared.first
    for line in lines[compensated.lines[lines] == begins].tolist():
        match = _MARKER.fullmatch(comment_of(compensated, line)) if line >= behind else None
        if match is None:
            continue
        old = line - shift
        if 0 <= old < original.blocks and original.text(old) == compensated.text(line):
            continue
        added, removed = int(match[1]), int(match[2])
        found.append((line, added, removed))
        behind, shift = line + 1 + added, shift + 1 + added - removed
    return found


def _line_pairs(
    original: PartProgram,
    compensated: PartProgram,
    declared: DeclaredChanges,
    rows: list[tuple[int, int, int, int, int]],
) -> LinePairs:
    columns = np.array(rows, dtype=np.int64).reshape(-1, 5).T
    changes = ChangedLines(
        marker=columns[0],
        new_first=columns[1],
        new_last=columns[2],
        old_first=columns[3],
        old_last=columns[4],
    )
    old_change = _change_of_lines(original.blocks, changes.old_first, changes.old_last)
    new_change = _change_of_lines(compensated.blocks, changes.new_first, changes.new_last)
    apart = np.zeros(compensated.blocks, dtype=bool)
    apart[declared.first : declared.last] = True
    apart[declared.tail :] = True
    apart[changes.marker] = True
    old, new = (
        np.flatnonzero(outside).astype(np.int32)
        for outside in (old_change == NO_CHANGE, (new_change == NO_CHANGE) & ~apart)
    )
    shared = min(old.size, new.size)
    ends = declared.tail < compensated.blocks and original.blocks > 0 and not original.data.endswith((b"\n", b"\r"))
    return LinePairs(
        changes=changes, old=old[:shared], new=new[:shared], old_change=old_change, new_change=new_change, ends=ends
    )


def _change_of_lines(lines: int, first: IntArray, last: IntArray) -> PlaceArray:
    change = np.full(lines, NO_CHANGE, dtype=np.int32)
    inside, number = expand(first, last)
    change[inside] = number
    return change


def _report_count(
    original: PartProgram, compensated: PartProgram, found: LinePairs, missing: int, findings: Findings
) -> None:
    """Name the first pair of lines that are plainly not the same, where lines are missing or too many."""
    same = np.fromiter(
        (
            _shape(original.text(old)) == _shape(compensated.text(new))
            for old, new in zip(found.old.tolist(), found.new.tolist(), strict=True)
        ),
        dtype=bool,
    )
    place = int(np.argmin(same)) if same.size and not same.all() else None
    what = f"{missing} lines of the original are missing" if missing > 0 else f"{-missing} lines too many"
    if place is None:
        findings.add("lines", f"{what} at the end")
        return
    old, new = int(found.old[place]), int(found.new[place])
    findings.add(
        "lines",
        f"{what}, here or before",
        original=old,
        compensated=new,
        expected=quoted(original.text(old)),
        got=quoted(compensated.text(new)),
    )


def _shape(line: bytes) -> bytes:
    """Return a line without its digits: what an offset never changes."""
    return line.translate(None, b"0123456789.+-")


def as_mask(size: int, places: IntArray) -> BoolArray:
    """Return a mask that is true at the places."""
    mask = np.zeros(size, dtype=bool)
    mask[places] = True
    return mask


class VerifyCase(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A program, what was made of it, and what is known about both.

    `bound` [m] is how far the way may be off, `band` [m] the longest move of an axis that need not be
    compensated. Every check adds what it finds to `findings`.
    """

    original: PartProgram
    compensated: PartProgram
    declared: DeclaredChanges
    lines: LinePairs
    bound: float
    band: float
    findings: Findings
