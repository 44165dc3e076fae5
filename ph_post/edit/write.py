"""Write edits into the text of a program; every byte that they do not touch stays."""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterable
from fractions import Fraction
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from ph_post.bounds import in_parts
from ph_post.dialects.base import Dialect
from ph_post.dialects.declaration import Declaration, declaration_lines, has_marks, marked
from ph_post.edit.block_words import COMMENT, line_end, longest_line
from ph_post.edit.changes import Change, ChangeWriter
from ph_post.edit.edits import EditOptions, Edits, dwell_time, no_offsets
from ph_post.edit.motion_edits import schedule, stops_written
from ph_post.edit.preconditions import in_other_units, own_setting, program_units, word_decimals
from ph_post.edit.undo import Payload, payload_lines, restores, without_payload
from ph_post.edit.word_shifts import (
    LONGEST,
    MOST_DECIMALS,
    ShiftedWords,
    assemble,
    motion_offsets,
    number_codes,
    shift_numbers,
    shifted_words,
)
from ph_post.errors import InputError
from ph_post.gcode.lexer import split_lines
from ph_post.gcode.program import ByteArray, PartProgram, PlaceArray
from ph_post.gcode.working import working_motions
from ph_post.types import ROTARY_AXES, IntArray, Machine, sealed
from ph_post.units import MM
from ph_post.version import package_version

_O_NUMBER: Final = re.compile(rb"^\s*[Oo]\s*\d+\s*(\([^)]*\)\s*)*$")
_PATH: Final = re.compile(rb"^\s*;\s*\$PATH=")
"""The folder of a SINUMERIK program, which stands right behind its name."""

_WIDEST: Final = 10**7
"""Offsets, in steps, that are counted in a table of their own."""

HELD: Final = "holds where friction holds the axes"
CUT: Final = f"{HELD} against the cut"
"""Notes in the head of programs with offsets, the other one for cutters."""

UNTURNED: Final = "holds for work offsets that are not rotated, mirrored or scaled"
"""Note in the head of every compensated program: reversals are those of the machine's axes."""

FIXED: Final = "holds where rotary axes do not move X, Y and Z, nor hold the tip of the tool in its place"
"""Note in the head of programs with words of rotary axes: their kinematics are the controller's affair."""

_LARGEST: Final = 10**13
"""Numbers of more digits than this would not survive the sum with an offset."""

FINEST: Final = 9
"""Decimals of a number of more digits that stay: a millionth of a micrometre."""


class LongLinesError(InputError):
    """Lines of a compensated program that come out too long for its controller.

    Parameters
    ----------
    where, what, expected, got : str
        As of :class:`~ph_post.errors.InputError`.
    text : bytes
        The program, without what restores the original.
    lines : tuple of int
        The lines of it, from 0.
    """

    def __init__(self, where: str, what: str, *, expected: str, got: str, text: bytes, lines: tuple[int, ...]) -> None:
        super().__init__(where, what, expected=expected, got=got)
        self.text, self.lines = text, lines


class ShiftedNumbers(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Shifted numbers by word: their new text in `pool`, `bounds` in it, and the data that the inverse needs."""

    word: PlaceArray
    number: ByteArray
    pool: ByteArray
    bounds: IntArray | PlaceArray
    style: NDArray[np.uint16]
    odd: ByteArray
    delta: tuple[tuple[int, int], ...]

    def text(self, program: PartProgram, block: int) -> dict[int, str]:
        """Return the new text of the changed words of a line."""
        own = program.words_of(block)
        low, high = self.word.searchsorted(np.array([own.start, own.stop], dtype=self.word.dtype))
        return {
            int(self.word[n]): chr(program.data[program.words.start[self.word[n]]])
            + self.pool[self.bounds[n] : self.bounds[n + 1]].tobytes().decode("latin-1")
            for n in range(int(low), int(high))
        }


def apply_edits(program: PartProgram, edits: Edits, dialect: Dialect, declaration: Declaration) -> bytes:
    """Write edits into a program.

    Parameters
    ----------
    program : PartProgram
    edits : Edits
    dialect : Dialect
        Words of the new lines, and their decimals.
    declaration : Declaration
        Declaration in the header.

    Returns
    -------
    bytes
        The program's own bytes where there is nothing to change.

    Raises
    ------
    InputError
        Where the program was compensated before, or a change cannot be written in the dialect.
    LongLinesError
        Where lines come out too long for the dialect.
    """
    if edits.empty:
        return program.data
    _refuse_marks(program)
    text = _write_text(program, edits, dialect, declaration)
    if restores(text, program.name, program.data):
        return text
    return _with_payload(program, without_payload(text, program.name), Payload(whole=program.data), dialect)


def apply_changes(program: PartProgram, changes: Iterable[Change], dialect: Dialect, declaration: Declaration) -> bytes:
    """Write changes of whole lines into a program that carries no offsets.

    Parameters
    ----------
    program : PartProgram
        Without marks of an earlier compensation.
    changes : iterable of Change
    dialect : Dialect
    declaration : Declaration
        Declaration in the header.

    Raises
    ------
    InputError
        As of :func:`apply_edits`.
    """
    _refuse_marks(program)
    step = next(iter(program_units(program)), MM) * 10.0 ** -word_decimals(dialect, MM)
    found = motion_offsets(no_offsets(program.motions.kind.size), [], step)
    numbers = shifted_numbers(program, shifted_words(program, found), 0, int(dialect.numbers.point))
    ordered = sorted(changes, key=lambda change: change.block)
    pieces, payload = _pieces_of(program, numbers, ordered, dialect, declaration)
    del numbers
    text = _with_payload(program, _put_together(program, pieces, dialect), payload, dialect)
    if restores(text, program.name, program.data):
        return text
    return _with_payload(program, without_payload(text, program.name), Payload(whole=program.data), dialect)


def _refuse_marks(program: PartProgram) -> None:
    if has_marks(program.data):
        raise InputError(
            program.name,
            "the program holds the marks of an earlier compensation",
            expected="the original (see --undo)",
        )


def _write_text(program: PartProgram, edits: Edits, dialect: Dialect, declaration: Declaration) -> bytes:
    """Write the new text, with the payload that undo needs."""
    units = program_units(program)
    if len(units) > 1 and np.any(edits.offset[in_other_units(program)]):
        raise InputError(program.name, "the program moves in both mm and inches: one of them can have offsets")
    decimals = word_decimals(dialect, units[0])
    step = units[0] * 10.0**-decimals
    numbers, changes = _numbers_and_changes(program, edits, dialect, declaration, decimals, step)
    if declaration.closing:
        label = "own compensation"
        changes.append(Change(block=program.blocks, removed=0, lines=[declaration.closing], label=[label]))
    pieces, payload = _pieces_of(program, numbers, changes, dialect, declaration)
    del numbers, changes  # as large as the text
    return _with_payload(program, _put_together(program, pieces, dialect), payload, dialect)


def _numbers_and_changes(
    program: PartProgram, edits: Edits, dialect: Dialect, declaration: Declaration, decimals: int, step: float
) -> tuple[ShiftedNumbers, list[Change]]:
    """Return the numbers that offsets change, and the lines that are written anew, in order."""
    tasks = schedule(edits, program.motions, step)
    found = motion_offsets(edits.runs, tasks, step)
    numbers = shifted_numbers(program, shifted_words(program, found), decimals, int(dialect.numbers.point))
    writer = ChangeWriter(
        program,
        dialect,
        found,
        decimals,
        declaration.chord_tolerance,
        edits.rounding,
        lambda block: numbers.text(program, block),
    )
    changes = list(writer.write(tasks))
    return numbers, sorted([*changes, *writer.centres(changes)], key=lambda change: change.block)


def shifted_numbers(program: PartProgram, changed: ShiftedWords, decimals: int, least: int) -> ShiftedNumbers:
    """Add to every number the shift of its word, with at least `least` decimals."""
    words, word = program.words, changed.word
    table, number = _distinct(changed.delta)
    del changed  # as large as what is made of it
    delta = np.array([_trimmed(count, decimals, least) for count in table.tolist()], dtype=np.int64).reshape(-1, 2)
    data = np.frombuffer(program.data, np.uint8)
    # What is not written of it takes no memory.
    pool = np.empty(LONGEST * word.size, np.uint8)
    bounds: IntArray | PlaceArray = np.zeros(word.size + 1, np.int32)
    if pool.size > np.iinfo(np.int32).max:
        bounds = bounds.astype(np.int64)
    style, odd = np.empty(word.size, np.uint16), np.zeros(word.size, np.uint8)
    for part in in_parts(word.size):
        own, first = word[part], part.start
        digits, places, many = _rounded_digits(program, own)
        columns = words.start[own], words.end[own], digits, places
        texts = pool, bounds[first : first + own.size + 1]
        shift_numbers(data, columns, number[part], delta, texts, (style[part], odd[part]))
        odd[first + many] = 1
    pool = pool[: bounds[-1]]
    pairs = tuple((int(steps), int(places)) for steps, places in delta.tolist())
    return ShiftedNumbers(word=word, number=number, pool=pool, bounds=bounds, style=style, odd=odd, delta=pairs)


def _rounded_digits(program: PartProgram, word: PlaceArray) -> tuple[IntArray, NDArray[np.int16], IntArray]:
    """Digits and decimals of words, and those of so many that no offset can be added: without the last ones."""
    digits, decimals = program.words.digits_of(word), program.words.decimals[word]
    many = np.flatnonzero((np.abs(digits) > _LARGEST) | (decimals > MOST_DECIMALS))
    for one in many.tolist():
        places = FINEST if decimals[one] > FINEST else int(decimals[one])
        count = round(Fraction(int(digits[one]), 10 ** (int(decimals[one]) - places)))
        if abs(count) > _LARGEST:
            where = f"{program.name}:{program.line_number(program.words.block[word[one]])}"
            expected = f"<= {len(str(_LARGEST)) - 1} digits"
            raise InputError(where, "the number has too many digits to add an offset", expected=expected)
        digits[one], decimals[one] = count, places
    return digits, decimals, many


def _distinct(delta: PlaceArray) -> tuple[PlaceArray, ByteArray]:
    """Distinct values, of which there are few, and the number of each value among them."""
    if delta.size == 0:
        return delta, np.zeros(0, dtype=np.uint8)
    low = int(delta.min())
    if int(delta.max()) - low > _WIDEST:
        table, number = np.unique(delta, return_inverse=True)
        return table, number.astype(np.uint8)
    counts, which = np.zeros(int(delta.max()) - low + 1, dtype=np.int64), np.empty(delta.size, dtype=np.uint8)
    for part in in_parts(delta.size):
        counts += np.bincount(delta[part] - low, minlength=counts.size)
    found = np.flatnonzero(counts)
    place = np.zeros(counts.size, dtype=np.uint8)
    place[found] = np.arange(found.size)
    for part in in_parts(delta.size):
        which[part] = place[delta[part] - low]
    return (found + low).astype(np.int32), which


def _trimmed(count: int, decimals: int, least: int) -> tuple[int, int]:
    """Write a number of steps with no more decimals than it needs, but `least`."""
    while decimals > least and count % 10 == 0:
        count, decimals = count // 10, decimals - 1
    return count, decimals


def _pieces_of(
    program: PartProgram, numbers: ShiftedNumbers, changes: list[Change], dialect: Dialect, declaration: Declaration
) -> tuple[list[Any], Payload]:
    """Return the pieces of the new text, for :func:`assemble`, and the payload that undoes it."""
    words = program.words
    block, letter, start, end = words.block, words.letter, words.start, words.end
    # The words are several times as large as the text, of which there will be three: each column goes when it is used.
    del words
    program.source.let_go()
    ending, line = line_end(program), head_line(program)
    data = program.data if program.data.endswith((b"\n", b"\r")) else program.data + ending.encode()
    lines = np.append(program.lines[:-1], len(data))
    head = declaration_lines(declaration, dialect.syntax.max_line, dialect.syntax.comments)
    head += declaration.commands
    texts = [join_lines(head, ending), *(join_lines(_change_lines(change, dialect), ending) for change in changes)]
    places = [(line, line), *((change.block, change.block + change.removed) for change in changes)]
    outside = np.ones(program.blocks + 1, dtype=np.bool_)
    for first, last in places:
        outside[first:last] = False
    sizes = np.append(0, np.cumsum([len(text) for text in texts]))
    spans = np.column_stack([lines[np.array(places)], sizes[:-1], sizes[1:]]).astype(np.int64)
    kept = outside[block[numbers.word]]
    odd = np.flatnonzero(numbers.odd[kept])
    payload = Payload(
        head=(line, len(head)),
        bare=len(data) > len(program.data),
        removed=b"".join(data[lines[a] : lines[b]] for a, b in places),
        delta=numbers.delta,
        code=number_codes(letter, block, outside, numbers.word, numbers.number).tobytes(),
        style=numbers.style[kept].astype("<u2").tobytes(),
        odd={
            n: program.data[start[word] + 1 : end[word]]
            for n, word in zip(odd.tolist(), numbers.word[kept][odd].tolist(), strict=True)
        },
    )
    del block, letter, kept
    start, end = start[numbers.word] + 1, end[numbers.word]
    text = np.frombuffer(b"".join(texts), np.uint8)
    return [np.frombuffer(data, np.uint8), start, end, sealed(numbers.pool), numbers.bounds, spans, text], payload


def _put_together(program: PartProgram, pieces: list[Any], dialect: Dialect) -> bytes:
    """Put the new text together; the list of its pieces, which are larger, is emptied."""
    out: ByteArray = assemble(*pieces)
    pieces.clear()
    check_lines(program, out, dialect)
    return out.tobytes()


def _change_lines(change: Change, dialect: Dialect) -> list[str]:
    """Return the lines of a change behind its mark, whose words are cut to the length of a line."""
    words, style = list(dict.fromkeys(change.label)), dialect.syntax.comments
    head = f"+{len(change.lines)} -{change.removed} "
    line = marked(head + style.text(", ".join(words)), style)
    while len(line) > dialect.syntax.max_line:
        words.pop()
        line = marked(head + style.text(", ".join([*words, "and more"])), style)
    return [line, *change.lines]


def join_lines(lines: list[str], end: str) -> bytes:
    """Return lines with their line ends, as bytes."""
    return "".join(line + end for line in lines).encode("latin-1")


def head_line(program: PartProgram) -> int:
    """Return the line before which the header goes: behind a leading percent sign and a program number.

    A byte order mark stays the first of all.
    """
    line, first, begins = 0, program.text(0), program.begin_line
    if begins is not None:
        line = begins + 1
    elif first.startswith(codecs.BOM_UTF8) or first.strip().startswith(b"%"):
        line = 1
    if line < program.blocks and _O_NUMBER.match(program.text(line).rstrip()):
        line += 1
    if line < program.blocks and _PATH.match(program.text(line)):
        line += 1
    return line


def check_lines(program: PartProgram, out: ByteArray, dialect: Dialect) -> None:
    """Refuse lines longer than both the dialect's limit and the program's longest.

    Comments do not count where the program's own lines are longer than the limit, or the controller throws them away.

    Raises
    ------
    LongLinesError
        For the first of them.
    """
    limit, most = dialect.syntax.max_line, longest_line(program, dialect)
    counts = dialect.syntax.counts_comments and most == limit + len("\r\n")
    lines = split_lines(sealed(out))
    long: dict[int, str] = {}
    for line in np.flatnonzero(np.diff(lines) > most).tolist():
        text = out[lines[line] : lines[line + 1]].tobytes().decode("latin-1").strip()
        if counts or len(COMMENT.sub("", text)) > limit:
            long[line] = text
    if long:
        raise LongLinesError(
            program.name,
            f"a line comes out too long for {dialect.name}",
            expected=f"<= {limit} characters",
            got=next(iter(long.values())),
            text=out.tobytes(),
            lines=tuple(long),
        )


def _with_payload(program: PartProgram, body: bytes, payload: Payload, dialect: Dialect) -> bytes:
    """Append the payload lines, by which undo restores the original, but before a last line that closes it."""
    lines = payload_lines(payload, dialect.syntax.max_line, dialect.syntax.comments)
    closing = program.language.closing
    last = None if closing is None else closing.search(body)
    at = len(body) if last is None else last.start()
    return body[:at] + join_lines(lines, line_end(program)) + body[at:]


HASH_DIGITS: Final = 16
"""Digits of hashes in the head of a program."""


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

    `options_digest` is the hash of all that the user asked for; `path_mode` and `notes` go into the header.
    """
    units = next(iter(program_units(program)), MM)
    decimals = word_decimals(dialect, units)
    tasks = schedule(edits, program.motions, units * 10.0**-decimals)
    count, stops = stops_written(tasks, program.motions)
    asked = (pause for stop in stops for pause in (stop.pause, *(shifts[-1].pause for shifts in stop.moves)))
    held = (CUT if working_motions(program, machine.tool).tool == "cutter" else HELD,) if edits.amplitude else ()
    own = set(program.language.further) & set(ROTARY_AXES)
    rotary = np.isin(program.commands.letter, [ord(letter) for letter in own])
    turning = (FIXED,) if rotary.any() else ()
    digits = dialect.numbers.feed_digits
    pauses = [dialect.syntax.dwell.written(dwell_time(pause), digits) for pause in asked if pause > 0.0]
    return Declaration(
        version=package_version(),
        digest=program.digest,
        machine=machine.name,
        machine_digest=machine.digest[:HASH_DIGITS],
        options_digest=options_digest[:HASH_DIGITS],
        units=units,
        offset=dict(edits.amplitude),
        one_sided=dict(edits.one_sided),
        crossings=len(edits.crossings) + sum(one.crosses_in(shift.axis) for one in edits.stops for shift in one.shifts),
        crossing_length=max((one.length for one in edits.crossings), default=0.0),
        crossing_error=max((one.error for one in edits.crossings), default=0.0),
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
        commands=dialect.notices.guard if machine.own_correction is not None else (),
        closing=dialect.notices.closing(machine.own_correction) if machine.own_correction is not None else "",
        # Only firmware that a program can tell so is told it in the head as well.
        notes=(
            UNTURNED,
            *turning,
            *held,
            *program.language.head,
            *(own_setting(dialect, machine) if dialect.notices.guard else ()),
            *notes,
        ),
    )
