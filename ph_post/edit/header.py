"""The header of a compensated program, its marks and the payload from which the original is restored."""

from __future__ import annotations

import base64
import binascii
import re
import zlib
from collections.abc import Iterable, Mapping
from typing import Any, Final

import msgspec

from ph_post.dialects.base import Dialect
from ph_post.dialects.registry import find_dialect
from ph_post.edit.edits import EditOptions, Edits, StopEdit, schedule, stops_written
from ph_post.edit.preconditions import program_units, word_decimals
from ph_post.errors import InputError
from ph_post.gcode.numbers import PARENTHESES, Comments, comment_lines, decimal_text
from ph_post.gcode.program import RS274, Language, PartProgram
from ph_post.post.remarks import package_version
from ph_post.types import Machine
from ph_post.units import INCH, MM, MS

MARK: Final = "ph-post: "
"""Begins each of these comments."""

_STYLES: Final = ("(", "; ")


def marked(words: str, style: Comments) -> str:
    """Write a comment line that is read back; a language of capitals has it in capitals."""
    text = MARK + words
    return style.line(text.upper() if style.upper else text)


def comment_pattern(words: str, *, alone: bool = False) -> re.Pattern[bytes]:
    """Pattern of a comment of either style, whose groups :func:`mark_text` returns.

    Parameters
    ----------
    words : str
        Pattern of what it says.
    alone : bool
        Whether it has to be all of its line, the end of which belongs to it.
    """
    either = rf"\({words}\)|; {words}(?=[ \t]*(?:[\r\n]|\Z))"
    if alone:
        either = rf"(?:\A|(?<=[\r\n]))(?:{either})[ \t]*(?:\r\n|\r|\n|\Z)"
    return re.compile(either.encode(), re.IGNORECASE)


def mark_text(found: re.Match[bytes]) -> list[bytes]:
    """Return the groups of the pattern of words, which stands in that of a comment once a style.

    Examples
    --------
    >>> [mark_text(comment_pattern(r"(a+)").fullmatch(text)) for text in (b"(aa)", b"; a")]
    [[b'aa'], [b'a']]
    """
    return [text for text in found.groups() if text is not None]


def find_last(data: bytes, words: str) -> int:
    """Place of the last comment that begins with these words behind the mark, -1 where there is none."""
    begins = [f"{before}{MARK}{words}" for before in _STYLES]
    return max(data.rfind(text.encode()) for one in begins for text in (one, one.upper()))


def has_marks(data: bytes) -> bool:
    """Return true where a text contains such comments."""
    return find_last(data, "") >= 0


_DIGITS: Final = 16
_DIGEST: Final = 64
_PLACES: Final = 9
_UNITS: Final = {"mm": MM, "inch": INCH}


class Declaration(msgspec.Struct, frozen=True, kw_only=True):
    """The head of a compensated program.

    `version` of this package; `digest` the SHA-256 of the original; `machine` its name, and `machine_digest`
    and `options_digest` the beginnings of the hashes of both. `offset` and `pulse` [m] by axis, `units` [m]
    of the program; numbers of `stops` and `dips`; `dwell` [s], `decimals`, `chord_tolerance` [m],
    `block_time` [s] and `path_mode` as they were chosen for the dialect; `dialect` its name where it is read
    otherwise than RS274/NGC; `commands` that stand behind the head; `notes` in free text.
    """

    version: str = ""
    digest: str = ""
    machine: str = ""
    machine_digest: str = ""
    options_digest: str = ""
    units: float = MM
    offset: Mapping[str, float] = {}
    pulse: Mapping[str, float] = {}
    stops: int = 0
    dips: int = 0
    dwell: float = 0.0
    longest: float = 0.0
    dwelt: float = 0.0
    decimals: int = 0
    chord_tolerance: float = 0.0
    block_time: float = 0.0
    path_mode: str = ""
    dialect: str = ""
    commands: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def same_job(self, other: Declaration) -> bool:
        """Return true for the same version, machine and options: a second run has nothing to do."""
        return all(
            getattr(self, name) == getattr(other, name) for name in ("version", "machine_digest", "options_digest")
        )


def declare(
    program: PartProgram,
    edits: Edits,
    machine: Machine,
    dialect: Dialect,
    options: EditOptions,
    *,
    options_digest: str,
    path_mode: str = "",
    notes: tuple[str, ...] = (),
) -> Declaration:
    """Make the declaration of a program with these edits.

    `options_digest` is the hash of all that the user asked for; `path_mode` and `notes` as the head is to
    have them.
    """
    units = next(iter(program_units(program)), MM)
    decimals = word_decimals(dialect, units)
    tasks = schedule(edits, program.motions, units * 10.0**-decimals)
    count, stops = stops_written(tasks, program.motions)
    pauses = _pauses(stops, dialect)
    return Declaration(
        version=package_version(),
        digest=program.digest,
        machine=machine.name,
        machine_digest=machine.digest[:_DIGITS],
        options_digest=options_digest[:_DIGITS],
        units=units,
        offset=dict(edits.amplitude),
        pulse=dict(edits.pulse),
        stops=count,
        dips=len(edits.dips),
        dwell=min(pauses, default=0.0),
        longest=max(pauses, default=0.0),
        dwelt=sum(pauses),
        decimals=decimals,
        chord_tolerance=options.chord_tolerance,
        block_time=options.block_time,
        path_mode=path_mode,
        dialect=program.language.name,
        commands=dialect.notices.guard,
        notes=notes,
    )


def declaration_lines(declaration: Declaration, max_line: int, style: Comments = PARENTHESES) -> list[str]:
    """Write a declaration as comment lines; long ones go on in lines that begin with two blanks."""
    one = declaration
    name = next(name for name, size in _UNITS.items() if size == one.units)
    mode = f", path mode {one.path_mode}" if one.path_mode else ""
    facts = [
        f"original sha256 {one.digest}",
        f"machine {one.machine}, sha256 {one.machine_digest}",
        f"options sha256 {one.options_digest}",
        *([f"dialect {one.dialect}"] if one.dialect else []),
        *(f"offset {axis} {_length(size, one.units)} {name}" for axis, size in sorted(one.offset.items())),
        *(f"take-up {axis} {_length(size, one.units)} {name}" for axis, size in sorted(one.pulse.items())),
        f"{one.stops} stops, {one.dips} dips",
        f"dwell {_seconds(one.dwell)} s, decimals {one.decimals},"
        f" chord tolerance {one.chord_tolerance / MM:g} mm, block time {one.block_time / MS:g} ms{mode}",
        *(
            [f"dwells up to {_seconds(one.longest)} s, {_seconds(one.dwelt)} s in all"]
            if one.longest > one.dwell
            else []
        ),
        *(f"command {command}" for command in one.commands),
        *(f"note {note}" for note in one.notes),
    ]
    head = comment_lines(f"ph-post {one.version} compensated this program", max_line, style)
    return head + [line for fact in facts for line in comment_lines(MARK + fact, max_line, style)]


def read_declaration(data: bytes) -> Declaration | None:
    """Return what a program declares, None where it was not compensated by this package.

    Raises
    ------
    InputError
        Where its head is damaged.
    """
    head = _HEAD.search(data)
    if head is None:
        return None
    facts: list[str] = []
    for line in data[head.end() :].splitlines():
        text = line.strip()
        if found := _FACT.fullmatch(text):
            facts.append(_words(found))
        elif facts and (found := _FURTHER.fullmatch(text)):
            facts[-1] += " " + _words(found).strip()
        else:
            break
    fields: dict[str, Any] = {
        "version": _words(head),
        "offset": {},
        "pulse": {},
        "commands": (),
        "notes": (),
    }
    for fact in facts:
        _read_fact(fact, fields)
    if len(str(fields.get("digest", ""))) != _DIGEST:
        raise InputError("", "the head of the compensated program is damaged", expected="original sha256")
    return Declaration(**fields)


def declared_language(data: bytes) -> Language:
    """Return the language of a compensated program; RS274/NGC where it declares none, and of other programs.

    Raises
    ------
    InputError
        Where its head is damaged, or nobody knows the dialect.
    """
    found = read_declaration(data)
    return RS274 if found is None or not found.dialect else find_dialect(found.dialect).language


def _read_fact(fact: str, fields: dict[str, Any]) -> None:
    """Read one line of the head; lines of a later version are ignored."""
    for pattern, names in _FACTS:
        found = pattern.fullmatch(fact)
        if found:
            fields.update(zip(names, map(_value, names, found.groups()), strict=True))
    if found := _LENGTH.fullmatch(fact):
        kind, axis, size, unit = found.groups()
        fields["offset" if kind.lower() == "offset" else "pulse"][axis.upper()] = float(size) * _UNITS[unit.lower()]
        fields["units"] = _UNITS[unit.lower()]
    elif found := _COMMAND.fullmatch(fact):
        fields["commands"] += (found.group(1),)
    elif found := _NOTE.fullmatch(fact):
        fields["notes"] += (found.group(1),)


def _value(name: str, text: str | None) -> Any:
    if name in ("stops", "dips", "decimals"):
        return int(str(text))
    if name in ("digest", "machine_digest", "options_digest", "dialect"):
        return str(text).lower()
    scale = {"dwell": 1.0, "longest": 1.0, "dwelt": 1.0, "chord_tolerance": MM, "block_time": MS}.get(name)
    return (text or "") if scale is None else float(str(text)) * scale


def _pauses(stops: Iterable[StopEdit], dialect: Dialect) -> list[float]:
    """Return every dwell [s] as the dialect's digits have it."""
    pauses = (pause for stop in stops for pause in (stop.pause, *(one.pause for one in stop.shifts)))
    return [dialect.syntax.dwell.written(pause, dialect.numbers.feed_digits) for pause in pauses if pause > 0.0]


def _words(found: re.Match[bytes]) -> str:
    """Return the one group of a comment."""
    return mark_text(found)[0].decode("latin-1")


def _seconds(time: float) -> str:
    return decimal_text(round(time * 10**_PLACES), _PLACES)


def _length(size: float, units: float) -> str:
    return decimal_text(round(size / units * 10**_PLACES), _PLACES)


_HEAD = comment_pattern(r"ph-post (\S[^\r\n]*?) compensated this program", alone=True)
_FACT = comment_pattern(rf"{MARK}((?!\+).*)")
_FURTHER = comment_pattern("  (.*)")
_COMMAND = re.compile("command (.*)", re.IGNORECASE)
_NOTE = re.compile("note (.*)", re.IGNORECASE)
_NUMBER = r"(\d+(?:\.\d+)?(?:e[-+]\d+)?)"
# Version 0.1.0 wrote "pulse" for "take-up".
_LENGTH = re.compile(rf"(offset|take-up|pulse) ([XYZ]) {_NUMBER} (mm|inch)", re.IGNORECASE)
_FACTS = (
    (re.compile(r"original sha256 ([0-9a-f]{64})", re.IGNORECASE), ("digest",)),
    (re.compile(r"machine (.*), sha256 ([0-9a-f]*)", re.IGNORECASE), ("machine", "machine_digest")),
    (re.compile(r"options sha256 ([0-9a-f]*)", re.IGNORECASE), ("options_digest",)),
    (re.compile(r"dialect (\S+)", re.IGNORECASE), ("dialect",)),
    (re.compile(r"(\d+) stops, (\d+) dips", re.IGNORECASE), ("stops", "dips")),
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


_LEVEL: Final = 6
_WIDTH: Final = 120
_LINE = comment_pattern(rf"{MARK}(undo) (\d+)/(\d+) ([A-Za-z0-9+/=]+)")
_CAPITALS: Final = b"UNDO"
"""Lines in capitals hold base 32, which has no small letters; others base 64."""


class Payload(msgspec.Struct, frozen=True, kw_only=True, array_like=True):
    """Data that undo needs and cannot compute from the compensated program.

    `whole` is the original where nothing less would do. `head` the line of the first comment of the head, and
    their number; `bare` whether the original has no line end at its end; `removed` the lines that changes stand
    in place of. Of the numbers of X, Y, Z, I, J and K outside changes, in order: `code` 0 where the number is
    the original's, else one more than the row of `delta` (steps, decimals of a step) that was added to it. Of
    those changed, in order: `style` of the original (two bytes), and the text of `odd` ones by their number.
    """

    whole: bytes | None = None
    head: tuple[int, int] = (0, 0)
    bare: bool = False
    removed: bytes = b""
    delta: tuple[tuple[int, int], ...] = ()
    code: bytes = b""
    style: bytes = b""
    odd: dict[int, bytes] = {}


def payload_lines(payload: Payload, max_line: int, style: Comments = PARENTHESES) -> list[str]:
    """Write a payload as numbered comment lines."""
    packed = zlib.compress(msgspec.msgpack.encode(payload), _LEVEL)
    text = (base64.b32encode(packed) if style.upper else base64.b64encode(packed)).decode("ascii")
    room, figures = min(max_line, _WIDTH) - len(f"{MARK}undo / ") - style.extra, 1
    while len(str(-(-len(text) // (room - 2 * figures)))) > figures:
        figures += 1
    width = room - 2 * figures
    count = -(-len(text) // width)
    rows = (text[n * width : (n + 1) * width] for n in range(count))
    return [marked(f"undo {n}/{count} {row}", style) for n, row in enumerate(rows, 1)]


def payload_start(data: bytes) -> int:
    """Place at which the lines of the payload begin, -1 where there are none."""
    return find_last(data, "undo 1/")


def read_payload(data: bytes, name: str) -> tuple[Payload, int]:
    """Return the payload of a program, and the place where its lines begin.

    Raises
    ------
    InputError
        Where lines are missing or damaged.
    """
    begin = payload_start(data)
    if begin < 0:
        raise InputError(name, "the lines at the end that undo the compensation are missing")
    rows = [mark_text(row) for row in _LINE.finditer(data, begin)]
    if not rows or [int(row[1]) for row in rows] != list(range(1, int(rows[0][2]) + 1)):
        raise InputError(name, "lines that undo the compensation are missing")
    try:
        decode = base64.b32decode if rows[0][0] == _CAPITALS else base64.b64decode
        packed = decode(b"".join(row[3] for row in rows))
        return msgspec.msgpack.decode(zlib.decompress(packed), type=Payload), begin
    except (binascii.Error, zlib.error, msgspec.DecodeError) as error:
        raise InputError(name, "lines that undo the compensation are damaged") from error
