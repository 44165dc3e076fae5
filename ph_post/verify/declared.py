"""Declarations of a compensated program, read independently of the writer."""

from __future__ import annotations

import re
from collections.abc import Mapping
from decimal import Decimal
from typing import Any

import msgspec
import numpy as np

from ph_post.gcode.program import PartProgram
from ph_post.units import LENGTHS, MM, MS

_COMPENSATED = re.compile(rb"\(ph-post \S.* compensated this program\)\s*", re.IGNORECASE)
_FACT = re.compile(rb"\(ph-post: ([^+].*)\)\s*", re.IGNORECASE)
_MORE = re.compile(rb"\(  (.*)\)\s*")
"""A fact that is too long for its line goes on in lines that begin with two blanks."""

_BEFORE = re.compile(rb"\xef\xbb\xbf.*\s*|\s*(?:%.*|O\d+\b.*|;\s*\$PATH=.*|\d*\s*BEGIN\s+PGM\b.*)?\s*", re.IGNORECASE)
"""Lines that may come before the header: one with a byte order mark, blank lines, ``%``, an O-number, a folder, BEGIN
PGM."""

_ENDING = re.compile(rb"\s*(?:\d+\s+)?END\s+PGM\b.*\s*|\s*N\s*9999\d*\s*%.*\s*|\s*", re.IGNORECASE)
"""Lines that may come behind the undo lines: the one that closes a program, and blank ones."""

_UNDO = re.compile(rb"\(ph-post: undo (\d+)/(\d+) ([A-Za-z0-9+/=]*)\)\s*", re.IGNORECASE)
_SEMICOLON = b"; "
"""Some languages have comments to the end of the line only."""

_LEADING = 8
"""The header begins on one of the first lines."""

_ANY = r"([-+]?\d*\.?\d+(?:e[-+]?\d+)?)"
"""A number in any notation."""

_KNOWN = {
    "original": re.compile(r"original sha256 ([0-9a-f]{64})", re.IGNORECASE),
    "machine": re.compile(r"machine (.*), sha256 ?([0-9a-f]*)", re.IGNORECASE),
    "options": re.compile(r"options sha256 ([0-9a-f]*)", re.IGNORECASE),
    "offset": re.compile(r"offset ([XYZ]) ([-+]?\d*\.?\d+) (mm|inch)", re.IGNORECASE),
    # Version 0.1.0 wrote "pulse".
    "pulse": re.compile(r"(?:take-up|pulse) ([XYZ]) (\d*\.?\d+) (mm|inch)", re.IGNORECASE),
    "edits": re.compile(r"(\d+) stops?, (\d+) dips?", re.IGNORECASE),
    "crossings": re.compile(r"(\d+) crossings?, up to (\d*\.?\d+) mm long, within (\d*\.?\d+) mm", re.IGNORECASE),
    "led": re.compile(r"(\d+) stretches led, up to (\d*\.?\d+) mm from the path", re.IGNORECASE),
    "dwell": re.compile(
        rf"dwell {_ANY} s, decimals (\d+), chord tolerance {_ANY} mm, block time {_ANY} ms.*",
        re.IGNORECASE,
    ),
    "dwells": re.compile(r"dwells up to (\d*\.?\d+) s, (\d*\.?\d+) s in all", re.IGNORECASE),
    "units": re.compile(r"units (mm|inch)", re.IGNORECASE),
    "dialect": re.compile(r"dialect (\S+)", re.IGNORECASE),
    "command": re.compile(r"command (M425 F0)"),
    "closing": re.compile(r"closing (M425 F(?:0|1|0\.\d+))"),
    "note": re.compile(r"note.*", re.IGNORECASE),
}


class DeclaredLength(msgspec.Struct, frozen=True, kw_only=True):
    """A declared length: the exact number, as it is written, and the unit [m].

    `side` +1 or -1 where an axis carries nothing or this offset to that side only, 0 where to either side.
    """

    number: Decimal
    unit: float
    side: int = 0

    @property
    def metres(self) -> float:
        """In SI."""
        return float(self.number) * self.unit


class DeclaredChanges(msgspec.Struct, frozen=True, kw_only=True):
    """The declarations of the header.

    `first`, `last` its lines, `tail` the first of the undo lines at the end, `behind` the line behind them (both the
    number of lines where there are none). `offsets` and `pulses` by axis; `dwell` [s], where they are not all alike
    with the `longest` and their sum `dwelt` [s]; `block_time` [s]; `decimals` of lengths; `chord` tolerance [m];
    `stops`, `dips`, `crossings` their numbers; `crossing_length` [m] of the longest stretch that a crossing replaces,
    `within` [m] how far the table may be from the original there;
    `led` the number of stretches with the lead of the servos, `lead` [m] how far they may be from the original.
    `faults` what could not be read, with its line.
    """

    first: int
    last: int
    tail: int
    behind: int
    original: str = ""
    machine: str = ""
    machine_digest: str = ""
    offsets: Mapping[str, DeclaredLength] = {}
    pulses: Mapping[str, DeclaredLength] = {}
    stops: int | None = None
    dips: int | None = None
    crossings: int = 0
    crossing_length: float = 0.0
    within: float = 0.0
    led: int = 0
    lead: float = 0.0
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
    tail, behind, more = _read_tail(compensated, last)
    wrong += _closing_faults(compensated, facts, last, tail)
    return DeclaredChanges(first=first, last=last, tail=tail, behind=behind, faults=(*wrong, *more), **fields)


def comment_of(program: PartProgram, line: int) -> bytes:
    """Text of a line; one that is a comment behind a semicolon as if it stood in parentheses."""
    text = program.text(line)
    if not text.startswith(_SEMICOLON):
        return text
    return b"(" + text[len(_SEMICOLON) :].rstrip() + b")"


def _find_header(program: PartProgram) -> int | None:
    first = program.begin_line or 0
    for number in range(first, min(program.blocks, first + _LEADING)):
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


_CLOSING = b"own compensation"
_CLOSES = re.compile(rb"\(ph-post: \+1 -0 " + _CLOSING + rb"\)\s*")


def _closing_faults(
    compensated: PartProgram, facts: list[tuple[int, str]], last: int, tail: int
) -> list[tuple[int, str]]:
    """Find what is wrong with the command that the header declares for the end, which stands there and nowhere else."""
    found = [match[1] for _, words in facts if (match := _KNOWN["closing"].fullmatch(words))]
    places = [one.start() for one in re.finditer(_CLOSING, compensated.data)]
    lines = np.unique(np.searchsorted(compensated.lines, places, side="right") - 1)
    marks = [
        line for line in lines.tolist() if last <= line < tail and _CLOSES.fullmatch(comment_of(compensated, line))
    ]
    if not found:
        return [(line, "the header declares no command for the end") for line in marks]
    there = compensated.text(tail - 1).strip().decode("latin-1") if tail else ""
    right = marks == [tail - 2] and there == found[0]
    return [] if right else [(tail - 1, "the command that the header declares for the end is not there")]


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
        side = (match[2][0] == "+") - (match[2][0] == "-")
        fields[f"{name}s"][match[1].upper()] = DeclaredLength(number=abs(Decimal(match[2])), unit=unit, side=side)
    elif name == "edits":
        fields["stops"], fields["dips"] = int(match[1]), int(match[2])
    elif name == "crossings":
        fields["crossings"] = int(match[1])
        fields["crossing_length"], fields["within"] = float(match[2]) * MM, float(match[3]) * MM
    elif name == "led":
        fields["led"], fields["lead"] = int(match[1]), float(match[2]) * MM
    elif name == "dwell":
        fields["dwell"], fields["decimals"] = float(match[1]), int(match[2])
        fields["chord"], fields["block_time"] = float(match[3]) * MM, float(match[4]) * MS

    elif name == "dwells":
        fields["longest"], fields["dwelt"] = float(match[1]), float(match[2])


def _read_tail(program: PartProgram, last: int) -> tuple[int, int, list[tuple[int, str]]]:
    """First of the undo lines at the end, the line behind them, and what is wrong with their numbers."""
    lines = program.blocks
    while program.language.closing is not None and lines > last and _ENDING.fullmatch(program.text(lines - 1)):
        lines -= 1
    if lines == last or not _UNDO.fullmatch(comment_of(program, lines - 1)):
        lines = program.blocks
    tail = lines
    while tail > last and _UNDO.fullmatch(comment_of(program, tail - 1)):
        tail -= 1
    faults = []
    for place, number in enumerate(range(tail, lines), 1):
        match = _UNDO.fullmatch(comment_of(program, number))
        assert match is not None
        if (int(match[1]), int(match[2])) != (place, lines - tail):
            numbers = f"undo {int(match[1])}/{int(match[2])} where {place}/{lines - tail} belongs"
            faults.append((number, f"the undo lines are not in order: {numbers}"))
    return tail, lines, faults
