"""Declaration in the header of a compensated program, and the marks of the comments that ph-post writes."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np

from ph_post.dialects.registry import find_dialect
from ph_post.errors import InputError
from ph_post.expand.writing import SHIFTED
from ph_post.gcode.language import RS274, Language
from ph_post.gcode.lexer import split_lines
from ph_post.gcode.numbers import PARENTHESES, Comments, comment_lines, decimal_text
from ph_post.gcode.program import PartProgram, PlaceArray
from ph_post.types import BoolArray, IntArray
from ph_post.units import INCH, MM, MS

MARK: Final = "ph-post: "
"""First characters of the comments that ph-post writes and reads back."""


_STYLES: Final = ("(", "; ")


def marked(words: str, style: Comments) -> str:
    """Write a comment line of ph-post, in capitals where the language has no small letters."""
    text = MARK + words
    return style.line(text.upper() if style.upper else text)


def comment_pattern(words: str, *, alone: bool = False) -> re.Pattern[bytes]:
    """Compile the pattern of a comment in parentheses or behind a semicolon; :func:`mark_text` returns its groups.

    Parameters
    ----------
    words : str
        Pattern of the comment's text.
    alone : bool
        Match only a comment that fills its line, and include the line's end.
    """
    either = rf"\({words}\)|; {words}(?=[ \t]*(?:[\r\n]|\Z))"
    if alone:
        either = rf"(?:\A|(?<=[\r\n]))(?:{either})[ \t]*(?:\r\n|\r|\n|\Z)"
    return re.compile(either.encode(), re.IGNORECASE)


def mark_text(found: re.Match[bytes]) -> list[bytes]:
    """Return the groups of a comment matched by :func:`comment_pattern`, whichever style it has.

    Examples
    --------
    >>> [mark_text(comment_pattern(r"(a+)").fullmatch(text)) for text in (b"(aa)", b"; a")]
    [[b'aa'], [b'a']]
    """
    return [text for text in found.groups() if text is not None]


def find_last(data: bytes, words: str) -> int:
    """Return the place of the last comment that begins with :data:`MARK` and these words, -1 where there is none."""
    begins = [f"{before}{MARK}{words}" for before in _STYLES]
    return max(data.rfind(text.encode()) for one in begins for text in (one, one.upper()))


_WRITTEN: Final = re.compile(
    rb"[(;] ?ph-post(?: [^\r\n]{1,40}(?:, strategy| compensated this program)|-(?:axes|expand): )", re.IGNORECASE
)
"""How what this package writes says so, within the first lines."""

_FIRST: Final = 1 << 16


def is_written_here(data: bytes) -> bool:
    """Whether this package wrote or changed a program.

    Examples
    --------
    >>> is_written_here(b"(ph-post 0.2.0 compensated this program)"), is_written_here(b"G0 X1")
    (True, False)
    """
    return _WRITTEN.search(data[:_FIRST]) is not None


def has_marks(data: bytes) -> bool:
    """Return true where a program contains comments of ph-post."""
    return find_last(data, "") >= 0


_DIGEST: Final = 64


_PLACES: Final = 9


_CROSSING_PLACES: Final = 4
"""Length and error of crossings are bounds: they are rounded up to 0.1 µm."""


_UNITS: Final = {"mm": MM, "inch": INCH}


_SIGNS: Final = {0: "", 1: "+", -1: "-"}
"""An offset to either side is written without a sign."""


CORRECTED: Final = "cutter compensation holds for"
"""How the note of a program begins in which contours with cutter compensation are shifted."""


THREADS: Final = "threads keep their turn of the spindle"
"""How the note of a program begins in which threads are shifted."""


class Declaration(msgspec.Struct, frozen=True, kw_only=True):
    """Declaration in the header of a compensated program.

    `version` of this package; `digest` the SHA-256 of the original; `machine` its name, and `machine_digest`
    and `options_digest` the beginnings of the hashes of both. `offset` and `pulse` [m] by axis, never negative,
    `units` [m] of the program; `one_sided` by axis +1 or -1: such an axis carries 0 or its offset to that
    side, and the offset is the whole lost motion, where others carry it to either side; numbers of `stops`,
    `dips` and `crossings`; `crossing_length` [m] of the longest stretch of the original that a crossing
    replaces, `crossing_error` [m] the largest distance by which an axis with ideal backlash leaves the
    original there, both rounded up as they are written; `led` the number of stretches with the lead of the servos, and
    `lead` [m] how far they leave the original at most, rounded up like those; `dwell` [s], `decimals`,
    `chord_tolerance` [m], `block_time` [s] and `path_mode` as they were chosen for the dialect; `dialect` its name
    where it is read otherwise than RS274/NGC; `commands` that stand behind the header, and one for the `closing`,
    empty for none; `notes` in free text.
    """

    version: str = ""
    digest: str = ""
    machine: str = ""
    machine_digest: str = ""
    options_digest: str = ""
    units: float = MM
    offset: Mapping[str, float] = {}
    one_sided: Mapping[str, int] = {}
    pulse: Mapping[str, float] = {}
    stops: int = 0
    dips: int = 0
    crossings: int = 0
    crossing_length: float = 0.0
    crossing_error: float = 0.0
    led: int = 0
    lead: float = 0.0
    dwell: float = 0.0
    longest: float = 0.0
    dwelt: float = 0.0
    decimals: int = 0
    chord_tolerance: float = 0.0
    block_time: float = 0.0
    path_mode: str = ""
    dialect: str = ""
    commands: tuple[str, ...] = ()
    closing: str = ""
    notes: tuple[str, ...] = ()

    @property
    def corrected(self) -> bool:
        """True where contours with cutter compensation, or threads, are shifted."""
        return any(note.lower().startswith((CORRECTED, THREADS)) for note in self.notes)


CHANGE_MARK: Final = comment_pattern(rf"{MARK}\+(\d+) -(\d+)[^)\r\n]*")
"""Comment line before a changed stretch."""

_SIGN: Final = b": +"
_BEFORE: Final = tuple(len(f"{style}{MARK}") - len(": ") for style in _STYLES)
"""Bytes of such a comment that few others have, and how many stand before them."""


def change_marks(data: bytes, end: int) -> Iterator[re.Match[bytes]]:
    """Yield the matches of :data:`CHANGE_MARK` before a place, faster than looking for all of it does."""
    behind, sign = 0, data.find(_SIGN, 0, end)
    while sign >= 0:
        for begin in (sign - before for before in _BEFORE):
            found = CHANGE_MARK.match(data, begin, end) if begin >= behind else None
            if found is not None:
                yield found
                behind = found.end()
        sign = data.find(_SIGN, sign + 1, end)


_OWN_LINE: Final = comment_pattern(r"ph-post[ :][^)\r\n]*", alone=True)
_OWN_FURTHER: Final = comment_pattern(r"  [^)\r\n]*", alone=True)
_SHIFTED_LINE: Final = comment_pattern(rf"{SHIFTED.mark}[^)\r\n]*", alone=True)
_SHIFTED_MARK: Final = comment_pattern(rf"{SHIFTED.mark}\+(\d+) -(\d+)[^)\r\n]*")


class LineOrigins(NamedTuple):
    """Lines of its original that each line of a program stands for, each of shape (n,).

    `first` of them, and `end` behind the last: the same where a line was only added. `changed` where a mark says so.
    """

    first: IntArray
    end: IntArray
    changed: BoolArray


def line_origins(program: PartProgram, original: PartProgram) -> LineOrigins | None:
    """Return which lines of its original each line of a compensated program stands for.

    None where the program does not declare this original, or has other lines than its marks tell of.
    """
    try:
        declaration = read_declaration(program.data)
    except InputError:
        return None
    if declaration is None or declaration.digest.lower() != original.digest:
        return None
    return _origins(program.data, program.lines, original.blocks, (_OWN_LINE, CHANGE_MARK))


def shifted_origins(data: bytes, original: bytes) -> IntArray | None:
    """Return the line (n,) of its original that each line of a program stands for whose further axes, or holes, shift.

    What was added stands for the line behind it. None where it has other lines than its marks tell of.
    """
    lines, count = (split_lines(np.frombuffer(text, np.uint8)) for text in (data, original))
    found = _origins(data, lines, count.size - 1, (_SHIFTED_LINE, _SHIFTED_MARK))
    return None if found is None else np.minimum(found.first, count.size - 2)


def _origins(
    data: bytes, lines: PlaceArray, count: int, patterns: tuple[re.Pattern[bytes], re.Pattern[bytes]]
) -> LineOrigins | None:
    """Tell the lines of a text from those that comments and marks, by their patterns, say were added to `count`."""
    own, mark = patterns
    taken, replaced = np.ones(lines.size - 1, dtype=np.int64), np.zeros(lines.size - 1, dtype=np.int64)
    changed = np.zeros(lines.size - 1, dtype=np.bool_)
    for pattern in (own, _OWN_FURTHER):
        for line, _ in _lines_with(pattern, data, lines):
            if pattern is own or (line and not taken[line - 1]):
                taken[line] = 0
    for line, found in _lines_with(mark, data, lines):
        added, old = map(int, mark_text(found))
        taken[line], taken[line + 1 : line + 1 + added] = old, 0
        replaced[line + 1 : line + 1 + added] = old
        changed[line : line + 1 + added] = True
    end = np.cumsum(taken)
    if end[-1] != count:
        return None
    return LineOrigins(end - np.maximum(taken, replaced), end, changed)


def _lines_with(pattern: re.Pattern[bytes], data: bytes, lines: PlaceArray) -> list[tuple[int, re.Match[bytes]]]:
    """Return where a pattern is found in a text, with the number of the line."""
    found = list(pattern.finditer(data))
    places = np.array([one.start() for one in found], dtype=lines.dtype)
    own = np.searchsorted(lines, places, side="right") - 1
    return list(zip(own.tolist(), found, strict=True))


def declaration_lines(declaration: Declaration, max_line: int, style: Comments = PARENTHESES) -> list[str]:
    """Write a declaration as comment lines; a long one continues on lines that begin with two blanks."""
    one = declaration
    name = next(name for name, size in _UNITS.items() if size == one.units)
    mode = f", path mode {one.path_mode}" if one.path_mode else ""
    facts = [
        f"original sha256 {one.digest}",
        f"machine {one.machine}, sha256 {one.machine_digest}",
        f"options sha256 {one.options_digest}",
        *([f"dialect {one.dialect}"] if one.dialect else []),
        *(
            f"offset {axis} {_SIGNS[one.one_sided.get(axis, 0)]}{_length(size, one.units)} {name}"
            for axis, size in sorted(one.offset.items())
        ),
        *(f"take-up {axis} {_length(size, one.units)} {name}" for axis, size in sorted(one.pulse.items())),
        f"{one.stops} stops, {one.dips} dips",
        *(
            [
                f"{one.crossings} crossings, up to {_bound(one.crossing_length)} mm long,"
                f" within {_bound(one.crossing_error)} mm"
            ]
            if one.crossings
            else []
        ),
        *([f"{one.led} stretches led, up to {_bound(one.lead)} mm from the path"] if one.led else []),
        f"dwell {_seconds(one.dwell)} s, decimals {one.decimals},"
        f" chord tolerance {one.chord_tolerance / MM:g} mm, block time {one.block_time / MS:g} ms{mode}",
        *(
            [f"dwells up to {_seconds(one.longest)} s, {_seconds(one.dwelt)} s in all"]
            if one.longest > one.dwell
            else []
        ),
        *(f"command {command}" for command in one.commands),
        *([f"closing {one.closing}"] if one.closing else []),
        *(f"note {note}" for note in one.notes),
    ]
    head = comment_lines(f"ph-post {one.version} compensated this program", max_line, style)
    return head + [line for fact in facts for line in comment_lines(MARK + fact, max_line, style)]


def _seconds(time: float) -> str:
    return decimal_text(round(time * 10**_PLACES), _PLACES)


def _length(size: float, units: float) -> str:
    return decimal_text(round(size / units * 10**_PLACES), _PLACES)


def _bound(size: float) -> str:
    """Write a length [m] in mm, rounded up."""
    return decimal_text(math.ceil(size / MM * 10**_CROSSING_PLACES - 1e-6), _CROSSING_PLACES)


_COMPENSATED: Final = b"compensated this program"
_HEAD = comment_pattern(rf"ph-post (\S[^\r\n]*?) {_COMPENSATED.decode()}", alone=True)


_FURTHER = comment_pattern("  (.*)")


_COMMAND = re.compile("command (.*)", re.IGNORECASE)


_NOTE = re.compile("note (.*)", re.IGNORECASE)


_NUMBER = r"(\d+(?:\.\d+)?(?:e[-+]\d+)?)"


# Version 0.1.0 wrote "pulse" for "take-up".
_LENGTH = re.compile(rf"(offset|take-up|pulse) ([XYZ]) ((?<=^offset . )[-+]|){_NUMBER} (mm|inch)", re.IGNORECASE)


_FACTS = (
    (re.compile(r"original sha256 ([0-9a-f]{64})", re.IGNORECASE), ("digest",)),
    (re.compile(r"machine (.*), sha256 ?([0-9a-f]*)", re.IGNORECASE), ("machine", "machine_digest")),
    (re.compile(r"options sha256 ([0-9a-f]*)", re.IGNORECASE), ("options_digest",)),
    (re.compile(r"dialect (\S+)", re.IGNORECASE), ("dialect",)),
    (re.compile(r"closing (.*)", re.IGNORECASE), ("closing",)),
    (re.compile(r"(\d+) stops, (\d+) dips", re.IGNORECASE), ("stops", "dips")),
    (
        re.compile(rf"(\d+) crossings, up to {_NUMBER} mm long, within {_NUMBER} mm", re.IGNORECASE),
        ("crossings", "crossing_length", "crossing_error"),
    ),
    (re.compile(rf"(\d+) stretches led, up to {_NUMBER} mm from the path", re.IGNORECASE), ("led", "lead")),
    (
        re.compile(
            rf"dwell {_NUMBER} s, decimals (\d+), chord tolerance {_NUMBER} mm, block time {_NUMBER} ms"
            r"(?:, path mode (.*))?",
            re.IGNORECASE,
        ),
        ("dwell", "decimals", "chord_tolerance", "block_time", "path_mode"),
    ),
    (re.compile(rf"dwells up to {_NUMBER} s, {_NUMBER} s in all", re.IGNORECASE), ("longest", "dwelt")),
)


def read_declaration(data: bytes) -> Declaration | None:
    """Read the declaration of a program; None where ph-post did not compensate it.

    Raises
    ------
    InputError
        Where its header is damaged.
    """
    head = _HEAD.search(data) if _may_be_compensated(data) else None
    if head is None:
        return None
    fields: dict[str, Any] = {
        "version": _words(head),
        "offset": {},
        "one_sided": {},
        "pulse": {},
        "commands": (),
        "notes": (),
    }
    for fact in read_facts(data, head.end()):
        _read_fact(fact, fields)
    if len(str(fields.get("digest", ""))) != _DIGEST:
        raise InputError("", "the head of the compensated program is damaged", expected="original sha256")
    return Declaration(**fields)


def _may_be_compensated(data: bytes) -> bool:
    """Return false where the head of a compensated program stands nowhere in a text."""
    step, more = 1 << 20, len(_COMPENSATED)
    return any(_COMPENSATED in data[low : low + step + more].lower() for low in range(0, len(data), step))


_ROW: Final = re.compile(rb"([^\r\n]*)(?:\r\n|[\r\n]|\Z)")


def read_facts(data: bytes, first: int = 0, mark: str = MARK) -> list[str]:
    r"""Read what the comment lines from byte `first` on say behind a mark, each with the lines in which it goes on.

    Examples
    --------
    >>> read_facts(b"(ph-post: machine the old)\n(  mill)\n(ph-post: 2 stops)\nG0 X1\n")
    ['machine the old mill', '2 stops']
    """
    pattern, facts = comment_pattern(rf"{mark}((?!\+).*)"), list[str]()
    for line in _ROW.finditer(data, first):
        text = line[1].strip()
        if found := pattern.fullmatch(text):
            facts.append(_words(found))
        elif facts and (found := _FURTHER.fullmatch(text)):
            facts[-1] += " " + _words(found).strip()
        else:
            break
    return facts


def _words(found: re.Match[bytes]) -> str:
    """Return the one group of a comment."""
    return mark_text(found)[0].decode("latin-1")


def _read_fact(fact: str, fields: dict[str, Any]) -> None:
    """Read one line of the header; lines of later versions are ignored."""
    for pattern, names in _FACTS:
        found = pattern.fullmatch(fact)
        if found:
            fields.update(zip(names, map(_value, names, found.groups()), strict=True))
    if found := _LENGTH.fullmatch(fact):
        kind, axis, sign, size, unit = found.groups()
        fields["offset" if kind.lower() == "offset" else "pulse"][axis.upper()] = float(size) * _UNITS[unit.lower()]
        if sign:
            fields["one_sided"][axis.upper()] = -1 if sign == "-" else 1
        fields["units"] = _UNITS[unit.lower()]
    elif found := _COMMAND.fullmatch(fact):
        fields["commands"] += (found.group(1),)
    elif found := _NOTE.fullmatch(fact):
        fields["notes"] += (found.group(1),)


_SCALES: Final = {
    "dwell": 1.0,
    "longest": 1.0,
    "dwelt": 1.0,
    "chord_tolerance": MM,
    "block_time": MS,
    "crossing_length": MM,
    "crossing_error": MM,
    "lead": MM,
}


def _value(name: str, text: str | None) -> Any:
    if name in ("stops", "dips", "decimals", "crossings", "led"):
        return int(str(text))
    if name in ("digest", "machine_digest", "options_digest", "dialect"):
        return str(text).lower()
    scale = _SCALES.get(name)
    return (text or "") if scale is None else float(str(text)) * scale


def declared_language(data: bytes) -> Language:
    """Return the language that a program declares; RS274/NGC where it declares none or is not compensated.

    Raises
    ------
    InputError
        Where its header is damaged, or its dialect is not registered.
    """
    found = read_declaration(data)
    return RS274 if found is None or not found.dialect else find_dialect(found.dialect).language
