"""Read a part program without loss: words, modal state, motions, notes and breaks."""

from __future__ import annotations

import hashlib
import re
from functools import partial
from typing import Any, Final

import msgspec
import numpy as np

from ph_post.bounds import MANY_LINES
from ph_post.compiling import read_only
from ph_post.errors import InputError
from ph_post.gcode import codes, splinewords
from ph_post.gcode.arcs import RADII_DIFFER, RADIUS_TOO_SMALL, solve_arcs
from ph_post.gcode.language import RS274, Language
from ph_post.gcode.modes import resolve_modes
from ph_post.gcode.motions import choose_tasks, find_anchors, trace_motions
from ph_post.gcode.program import (
    CUBIC,
    NURBS,
    Break,
    BreakKind,
    ByteArray,
    FeedRuns,
    Motions,
    Note,
    NurbsData,
    PartProgram,
    PlaceArray,
    WordSource,
    WordTable,
    feed_runs,
    make_modal,
    narrowed,
    number_text,
    span_of,
)
from ph_post.gcode.words import (
    NOT_UNDERSTOOD,
    Lexed,
    ProgramFault,
    excerpt,
    fault_error,
    fault_text,
    fault_words,
    find_stretches,
    lines_of,
    read_words,
)
from ph_post.types import Array, BoolArray, sealed, unwritten
from ph_post.units import INCH, MM

_TEXTS: Final = {
    codes.PARAMETER: "parameter",
    codes.EXPRESSION: "value that is computed",
    codes.O_WORD: "O-word",
    codes.POLAR: "polar coordinates",
    codes.COMPENSATED: "cutter compensation",
    codes.CYCLE: "canned cycle",
    codes.FURTHER_AXIS: "axis other than X, Y and Z",
    codes.UNKNOWN_G: "unknown G word",
    codes.UNKNOWN_M: "unknown M word",
    codes.USER_M: "M word of a program of the machine's own",
    codes.DELETED: "block delete",
    codes.SUBPROGRAM: "subprogram",
    codes.ARC_FROM_NOWHERE: "arc from an unknown position",
    codes.SPLINE_FROM_NOWHERE: "spline from an unknown position",
    codes.UNUSED_WORD: "word that no other on the line uses",
    codes.NO_MOTION_MODE: "axis words without a motion mode",
    codes.UNSURE_MODE: "motion under modes that something not understood may have changed",
    codes.CONTROLLER_LINE: "line for the controller itself",
    codes.OTHER_FRAME: "motion in a turned, scaled, polar or diameter frame, or under other kinematics",
    codes.THREAD: "motion tied to the spindle",
    codes.COMMA: "word of one controller, or of more digits than are kept",
    codes.DWELL_AXES: "dwell with axis words",
    codes.SPLINE_PLANE: "spline in another plane than G17",
    codes.SAVED_STATE: "modal state brought back",
    codes.LONE_SPLINE: "spline that is not whole",
    codes.STAYING_G: "G word of other controllers, which moves nothing",
    codes.STAYING_M: "M word of other controllers, which moves nothing",
    codes.ROTARY_PAIR: "cut in which several rotary axes turn, perhaps about the tip of the tool",
}
_LETTERS: Final = {
    codes.FURTHER_AXIS: "ABCUVW",
    codes.ROTARY_PAIR: "ABC",
    codes.UNUSED_WORD: "ABCDEHIJKLPQRUVW",
    codes.CYCLE: "GXYZ",
    codes.THREAD: "GXYZ",
    codes.COMPENSATED: "GXYZ",
    codes.NO_MOTION_MODE: "XYZABCUVW",
    codes.UNSURE_MODE: "GXYZABCUVW",
    codes.DWELL_AXES: "XYZABCUVW",
}
"""Letters of the words that are meant where the letter decides."""
_SHOWN: Final = 40
"""Characters of a word that a note shows."""
_KINDS: Final[tuple[tuple[int, BreakKind], ...]] = (
    (codes.TOOL_CHANGE, "tool change"),
    (codes.PROBE, "probe"),
    (codes.HOME, "home"),
    (codes.MACHINE, "machine coordinates"),
    (codes.FRAME_CHANGE, "frame"),
)
_NOT_UNDERSTOOD: Final = len(_KINDS)
_UNITS: Final = _NOT_UNDERSTOOD + 1


def find_notes(lexed: Lexed, data: bytes, found: _Blocks) -> tuple[Note, ...]:
    """Make a note for each stretch of blocks that are passed through, or not known in all, for one reason."""
    whys = found.whys
    blocks = np.flatnonzero(whys)
    if not blocks.size:
        return ()
    spoken = lexed.traits != 0
    spoken[lexed.words.block] = True
    spoken[blocks] = True
    rank = np.cumsum(spoken)[blocks]
    new = np.flatnonzero(np.r_[True, (np.diff(rank) > 1) | (np.diff(whys[blocks]) != 0)])
    last = np.r_[new[1:] - 1, blocks.size - 1]
    return tuple(
        _note(lexed, data, int(blocks[low]), int(blocks[high]), found) for low, high in zip(new, last, strict=True)
    )


def _note(lexed: Lexed, data: bytes, first: int, last: int, found: _Blocks) -> Note:
    """Name a stretch by the word on its first line for which it is passed through."""
    why = int(found.whys[first])
    if why >= codes.FAULT:
        fault = _fault_at(lexed, first, found)
        behind = _word_end(lexed, fault)
        start, end = fault.place, behind or int(lexed.lines[first + 1])
        what, refusal = fault_text(fault.code), fault_words(data, fault, behind)
    else:
        refusal = None
        start, end = find_place(lexed, data, first, why)
        what = _TEXTS[why]
    text = data[start:end].decode("utf-8", "replace").strip()
    column = len(data[int(lexed.lines[first]) : start].decode("utf-8", "replace")) + 1
    return Note(first=first, last=last, column=column, what=f"{what}: {shortened(text)}", refusal=refusal, why=why)


def shortened(text: str) -> str:
    """Return as much of a text as a note shows."""
    return text if len(text) <= _SHOWN else text[:_SHOWN] + "..."


def find_place(lexed: Lexed, data: bytes, block: int, why: int) -> tuple[int, int]:
    """Return the first byte of the word, or else of the line, that a note is about, and the byte behind its last."""
    words = lexed.words
    rows = range(*span_of(words.block, block))
    named = [row for row in rows if _is_meant(chr(words.letter[row]), float(words.value[row]), why)]
    if named:
        return int(words.start[named[0]]), int(words.end[named[0]])
    low, high = int(lexed.lines[block]), int(lexed.lines[block + 1])
    line = data[low:high]
    return low + len(line) - len(line.lstrip()), high


def _is_meant(letter: str, value: float, why: int) -> bool:
    """Return True if a block is passed through because of this word."""
    if why in (codes.EXPRESSION, codes.O_WORD):
        return np.isnan(value) if why == codes.EXPRESSION else letter == "O"
    if why in (codes.UNKNOWN_G, codes.STAYING_G):
        known = 0.0 <= value < 99.9 and codes.GROUP[round(10 * value)] >= 0
        return letter == "G" and not (known and abs(10.0 * value - round(10.0 * value)) < 1e-6)
    if why in (codes.CYCLE, codes.THREAD) and letter == "G":
        # Words of planes and of where to return stand on such lines, too: group 1 has the motions.
        return 0.0 <= value < 99.9 and codes.GROUP[round(10 * value)] == 1
    if why == codes.SUBPROGRAM and letter == "G":
        return 0.0 <= value < 99.9 and codes.G_EFFECT[round(10 * value)] == codes.CALLS
    if why in (codes.UNKNOWN_M, codes.USER_M, codes.STAYING_M, codes.SUBPROGRAM, codes.SAVED_STATE):
        return letter == "M" and not (value in range(codes.M_GROUP.size) and codes.M_GROUP[int(value)] >= 0)
    return letter in _LETTERS.get(why, "")


def find_breaks(
    motion_block: PlaceArray, marks: ByteArray, whys: ByteArray, switched: BoolArray, end: int
) -> tuple[Break, ...]:
    """Put the breaks in order, from the beginning to the `end` of the program.

    Those of one kind without a motion between them are one: its block is the first. Units are `switched` at blocks.
    """
    marked = (marks & (codes.END - 1)) | whys
    blocks = np.flatnonzero(marked | switched)
    kind = np.where(marked[blocks], _NOT_UNDERSTOOD, _UNITS)
    for number in range(len(_KINDS) - 1, -1, -1):
        kind[(marks[blocks] & _KINDS[number][0]) != 0] = number
    motion = np.searchsorted(motion_block, blocks.astype(np.int32))
    keep = np.r_[True, (np.diff(motion) != 0) | (np.diff(kind) != 0)][: blocks.size]
    names: tuple[BreakKind, ...] = (*(name for _, name in _KINDS), "not understood", "units")
    inner = tuple(
        Break(block=int(b), motion=int(m), kind=names[k])
        for b, m, k in zip(blocks[keep], motion[keep], kind[keep], strict=True)
    )
    first = Break(block=0, motion=0, kind="beginning")
    return (first, *inner, Break(block=end, motion=motion_block.size, kind="end"))


def _switched_units(motion_block: PlaceArray, found: _Blocks) -> BoolArray:
    """Mark the first block behind a motion at which the units are no longer those of it, where the next has others."""
    switched, units = np.zeros(found.states.size, dtype=np.bool_), found.table[:, codes.UNITS]
    if (units == units[0]).all():
        return switched
    used = units[found.states[motion_block]]
    for row in np.flatnonzero(used[1:] != used[:-1]).tolist():
        first, last = motion_block[row] + 1, motion_block[row + 1]
        switched[first + np.argmax(units[found.states[first : last + 1]] != used[row])] = True
    return switched


_OPENED: Final = re.compile(rb"\s*%")
"""A program between two percent signs."""

BEHIND_THE_END: Final = "behind the program's end"
_BEHIND: Final = re.compile(rb"^[ \t]*(?:N[ \t]*\d+[ \t]*)?(?:[O:]\d|G\d|[XYZ][-+.\d])", re.MULTILINE | re.IGNORECASE)
"""A line of another program."""


class _Blocks(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Findings on each block: its state, F, task, breaks, why it is not understood, and where.

    `spots` is the byte of a fault in the text, from 1, or the word, as -2 - number (-1: none); `gots` what an error
    says of it.
    """

    states: PlaceArray
    feeds: FeedRuns
    tasks: ByteArray
    marks: ByteArray
    whys: ByteArray
    spots: PlaceArray
    table: Array
    end: int
    last: int
    gots: dict[int, str]


def read_program(
    data: bytes, name: str, *, strict: bool = False, language: Language = RS274, sided: bool = False
) -> PartProgram:
    r"""Read a part program.

    Parameters
    ----------
    data : bytes
        All of it; every byte is kept.
    name : str
        For messages: the file's name.
    strict : bool
        Refuse what would be passed through with a note.
    language : Language, optional
        Language of the controller; RS274/NGC by default.
    sided : bool, optional
        Whether the cutter may be brought to a side of its contour by what is no word of this text.

    Raises
    ------
    InputError
        If the text is no program; if `strict`, also if it is ambiguous or meaningless to controllers.

    Examples
    --------
    >>> program = read_program(b"G21 G90\nG0 X0 Y0\nG1 X10 F600\nM2\n", "a.ngc")
    >>> program.blocks, program.motions.end[1].tolist(), program.motions.feed[1].item()
    (4, [0.01, 0.0, nan], 0.01)
    """
    if language.read is not None:
        program = language.read(data, name)
        own = program.language
        language = msgspec.structs.replace(language, diameters=own.diameters, head=own.head)
        program = msgspec.structs.replace(program, language=language)
        if strict:
            refuse_notes(program)
        return program
    program = _read(data, name, language, strict=strict, sided=sided)
    if not strict and codes.ARC_ABSOLUTE not in language.fixed and _misses_centres(program):
        # Some controllers are set so; the others refuse such a program, and no run of it is changed.
        placed = _read(data, name, language.placing_centres(), strict=False, sided=sided)
        if not _misses_centres(placed) and placed.motions.kind.size > program.motions.kind.size:
            return placed
    return program


def _misses_centres(program: PartProgram) -> bool:
    """Return whether an arc does not end about its centre, and no line says what I and J are."""
    missed = {codes.FAULT + RADII_DIFFER, codes.FAULT + codes.MISSING_CENTER}
    if not any(note.why in missed for note in program.notes):
        return False
    return not program.commands.g_words(90.1, 91.1).any()


def _read(data: bytes, name: str, language: Language, *, strict: bool, sided: bool) -> PartProgram:
    """Read a program of words."""
    lines = lines_of(data, name, strict=strict)
    plain = language.hidden(data)
    lexed = _lexed(plain, lines, language)
    if not language.diameters and _tells_diameters(lexed.words):
        language = msgspec.structs.replace(language, diameters=True)
    placed = _in_radii(lexed) if language.diameters else lexed
    placed = _with_skips(placed) if language.skips else placed
    source = WordSource(lexed.words, partial(_words_again, data, lines, language, lexed.end))
    if lines.size > MANY_LINES:
        source.let_go()
        lexed, placed = _unplaced(lexed), _unplaced(placed)
    blocks = _resolve(placed, plain, language, sided=sided)
    del plain  # as large as the program
    motions = _make_motions(placed, blocks)
    del placed
    if blocks.whys.any():
        lexed = msgspec.structs.replace(lexed, words=source.get())
    notes = find_notes(lexed, data, blocks)
    if strict and notes:
        raise _refusal(name, data, lexed, notes[0], blocks)
    if blocks.end == lines.size - 1 and not notes and _OPENED.match(data):
        # What is passed through may hold the end; without an opening % many programs have none.
        what, end = "the program breaks off", "the end of the file"
        refusal = (what, "M2, M30 or the % that belongs to the first one", end)
        if strict:
            raise InputError(f"{name}:{blocks.end}", what, expected=refusal[1], got=end)
        last = blocks.end - 1
        notes = (Note(first=last, last=last, column=1, what=f"{what}: {end}", refusal=refusal),)
    behind = None if strict else _BEHIND.search(data, int(lines[min(blocks.end + 1, lines.size - 1)]))
    if behind is not None:
        first = int(np.searchsorted(lines, np.int32(behind.start()), "right")) - 1
        text = data[behind.start() : lines[first + 1]].decode("utf-8", "replace").strip()
        what = f"{BEHIND_THE_END}: {shortened(text)}"
        notes = (*notes, Note(first=first, last=lines.size - 2, column=1, what=what))
    rests = np.isin(blocks.whys, (codes.STAYING_G, codes.STAYING_M)) & (blocks.tasks == codes.REST)
    lost = np.where((blocks.whys < codes.QUIET) & ~rests, blocks.whys, 0)
    breaks = find_breaks(motions.block, blocks.marks, lost, _switched_units(motions.block, blocks), blocks.end)
    number = narrowed(np.arange(len(breaks) - 1))
    chain = np.repeat(number, np.diff([one.motion for one in breaks]))
    return PartProgram(
        name=name,
        data=data,
        digest=hashlib.sha256(data).hexdigest(),
        lines=lines,
        source=source,
        motions=msgspec.structs.replace(motions, chain=chain),
        modal=tuple(make_modal(row) for row in blocks.table),
        state=sealed(narrowed(blocks.states)),
        feeds=blocks.feeds,
        breaks=breaks,
        notes=notes,
        language=language,
    )


def reread(program: PartProgram, data: bytes, name: str | None = None) -> PartProgram:
    """Read what was made of a program, or what it was made of, in the language that it was read in itself."""
    return read_program(data, program.name if name is None else name, language=program.language)


def _lexed(plain: bytes, lines: PlaceArray, language: Language) -> Lexed:
    """Read the words of a text of which all is hidden that is to be, with the numbers that the controller reads."""
    lexed = read_words(plain, lines)
    if language.lengths is None:
        return lexed
    return msgspec.structs.replace(lexed, words=language.lengths(lexed.words, plain))


def _words_again(
    data: bytes, lines: PlaceArray, language: Language, end: int, first: int, last: int | None
) -> WordTable:
    """Read the words of some lines once more, or all where `last` is None; behind line `end` there are none."""
    if last is None:
        return _lexed(language.hidden(data), lines, language).words
    if language.lengths is not None:
        # Lines before them may decide what their numbers mean.
        words = _words_again(data, lines, language, end, 0, None)
        rows = words.rows(first, last)
        return words.take(np.arange(rows.start, rows.stop))
    last = max(min(last, end), first)
    # With a byte before them, so that they are not taken for the beginning of a file.
    base = max(int(lines[first]) - 1, 0)
    own = lines[first : last + 1] - np.int32(base)
    words = read_words(language.hidden(data[base : int(lines[last])]), own).words
    place = np.int32(base)
    return msgspec.structs.replace(
        words, block=words.block + np.int32(first), start=words.start + place, end=words.end + place
    )


def with_contours(program: PartProgram) -> PartProgram:
    """Return a program in which what is cut with cutter compensation moves as its contours say, and threads move.

    It is the program itself where there are none.
    """
    threads = program.language.threads
    there = any(modal.compensation not in (None, "G40") for modal in program.modal) or (threads and program.tied.any())
    if program.language.contours or not there:
        return program
    found = read_program(program.data, program.name, language=program.language.contoured())
    if threads and _misses_threads(found):
        # Half of a thread is none.
        language = msgspec.structs.replace(program.language, threads=False)
        return with_contours(msgspec.structs.replace(program, language=language))
    return msgspec.structs.replace(found, origins=program.origins)


def _misses_threads(program: PartProgram) -> bool:
    """Return whether a line under G33 is passed through."""
    tied = program.tied
    return any(tied[program.state[note.first : note.last + 1]].any() for note in program.notes)


def _resolve(lexed: Lexed, data: bytes, language: Language, *, sided: bool) -> _Blocks:
    """Find each block's modal state and task; after the program's end nothing changes any more."""
    count = lexed.lines.size - 1
    states, feeds, tasks = np.zeros(count, np.int32), np.full(count, np.nan), np.zeros(count, np.uint8)
    motions, zeros = np.full(count, -1, np.int16), np.full(count, -1, np.int16)
    flags, marks = np.zeros(count, np.uint8), unwritten(count, np.uint8)
    columns = (states, feeds, motions, zeros, flags, marks, lexed.whys, lexed.spots)
    text = (lexed.words.block, lexed.words.letter, lexed.words.value)
    stretches = find_stretches(lexed, data)
    parts = (*text, language.m_effect())
    stop, table = resolve_modes(parts, lexed.traits, stretches, lexed.end, columns, language.start())
    last = stop + 1 if stop < lexed.end else stop
    if 0 < last < count:
        states[last:], feeds[last:] = states[last - 1], feeds[last - 1]
    lexed.whys[last + (stop == lexed.end) :] = 0
    further = codes.letter_bits(language.further)
    choose_tasks(
        parts,
        table,
        columns,
        lexed.traits,
        last,
        further,
        (language.contours, language.contours and language.threads, sided),
        tasks,
    )
    return _Blocks(
        states=states,
        feeds=feed_runs(feeds),
        tasks=tasks,
        marks=marks,
        whys=lexed.whys,
        spots=lexed.spots,
        table=table,
        end=int(stop),
        last=int(last),
        gots={},
    )


def _fault_at(lexed: Lexed, block: int, blocks: _Blocks) -> ProgramFault:
    """Make the fault of a block: of a byte, of a word, of the word that sets its motion, or of its first word."""
    words, spot = lexed.words, int(blocks.spots[block])
    place, word = spot - 1, -2 - spot
    if spot <= 0:
        if word < 0:
            low, high = span_of(words.block, block)
            motions = [k for k in range(low, high) if chr(words.letter[k]) == "G" and words.value[k] < 6]
            axes = [k for k in range(low, high) if chr(words.letter[k]) in "XYZ"]
            word = [*motions, *axes, low][0]
        place = int(words.start[word])
    code = int(blocks.whys[block]) % codes.FAULT
    return ProgramFault(block=block, place=place, code=code, got=blocks.gots.get(block, ""))


def _word_end(lexed: Lexed, fault: ProgramFault) -> int | None:
    """Return the place behind the word that a fault is about, None if it is about no word."""
    word = int(np.searchsorted(lexed.words.start, np.int32(fault.place)))
    if word < lexed.words.start.size and lexed.words.start[word] == fault.place:
        return int(lexed.words.end[word])
    return None


def _refusal(name: str, data: bytes, lexed: Lexed, note: Note, blocks: _Blocks) -> InputError:
    """Make the error of a note where nothing may be passed through."""
    why = int(blocks.whys[note.first])
    if why >= codes.FAULT:
        fault = _fault_at(lexed, note.first, blocks)
        return fault_error(name, data, lexed.lines, fault, _word_end(lexed, fault))
    start, end = find_place(lexed, data, note.first, why)
    fault = ProgramFault(block=note.first, place=start, code=NOT_UNDERSTOOD, got=note.what)
    return fault_error(name, data, lexed.lines, fault, end)


def refuse_notes(program: PartProgram) -> None:
    """Refuse a program with a note.

    Raises
    ------
    InputError
        For the first note.
    """
    if program.notes:
        note = program.notes[0]
        text = program.text(note.first)
        if note.refusal is not None:
            # Found in a translation: the words of the line may be others.
            what, expected, got = note.refusal
            line = text.rstrip(b"\r\n").decode("utf-8", "replace")
            where, found = f"{program.name}:{note.first + 1}", got if got in line or " " in got else ""
            raise InputError(where, what, expected=expected, got=found, excerpt=excerpt(line, 1, len(line)))
        place = int(program.lines[note.first]) + len(text.decode("utf-8", "replace")[: note.column - 1].encode())
        end = int(program.lines[note.first]) + len(text.rstrip())
        fault = ProgramFault(block=note.first, place=place, code=NOT_UNDERSTOOD, got=note.what)
        raise fault_error(program.name, program.data, program.lines, fault, max(end, place + 1))


def _tells_diameters(words: WordTable) -> bool:
    """Return whether a program tells X in diameters from its first X on: G7, and never G8."""
    begun = words.block[words.g_words(7.0)]
    if not begun.size or words.g_words(8.0).any():
        return False
    return bool((words.block[words.letter == ord("X")] >= begun[0]).all())


def _in_radii(lexed: Lexed) -> Lexed:
    """Return words of which those of X have the places of the axis: half of the diameters that are written.

    A G7, which says so, is a G8 then.
    """
    words = lexed.words
    value = np.where(words.letter == ord("X"), 0.5 * words.value, words.value)
    value = np.where((words.letter == ord("G")) & (value == 7.0), 8.0, value)
    return msgspec.structs.replace(lexed, words=msgspec.structs.replace(words, value=sealed(value)))


def _with_skips(lexed: Lexed) -> Lexed:
    """Return words in which a G31 is the one of :data:`ph_post.gcode.codes.SKIP`."""
    words, skips = lexed.words, lexed.words.g_words(31.0)
    if not skips.any():
        return lexed
    value = sealed(np.where(skips, codes.SKIP / 10.0, words.value))
    return msgspec.structs.replace(lexed, words=msgspec.structs.replace(words, value=value))


def _unplaced(lexed: Lexed) -> Lexed:
    """Return words without their places and decimals, which are read again where they are asked for."""
    words, nothing = lexed.words, np.zeros(0, dtype=np.int32)
    bare = msgspec.structs.replace(words, start=nothing, end=nothing, decimals=nothing.astype(np.int16))
    return msgspec.structs.replace(lexed, words=bare)


def _make_motions(lexed: Lexed, blocks: _Blocks) -> Motions:
    """Make the motions; what cannot be drawn is passed through."""
    while True:
        columns, curves, count = _trace(lexed, blocks)
        drawn = _splines(lexed, blocks, [column[:count] for column in columns])
        if drawn is None:
            continue
        *own, duration, exact = columns
        block, kind, start, end, plane, feed = (_cut(column, count) for column in own)
        # Copies of these would be written to.
        duration, exact, center, angle, turns = (column[:count] for column in (duration, exact, *curves))
        inch = blocks.table[:, codes.UNITS] == INCH
        inches = inch[blocks.states[block]] if inch.any() else unwritten(count, np.bool_)
        faults, radii = unwritten(block.size, np.uint8), unwritten((block.size, 2))
        if not solve_arcs(start, end, plane, turns, inches, center, angle, faults, radii):
            break
        for row in np.flatnonzero(faults).tolist():
            if faults[row] in (RADII_DIFFER, RADIUS_TOO_SMALL):
                texts = [f"{number_text(round(radius / MM, 4))} mm" for radius in radii[row].tolist()]
                blocks.gots[int(block[row])] = " and ".join(texts)
            _pass_through(blocks, int(block[row]), codes.FAULT + int(faults[row]))
    control, nurbs = drawn
    whole: dict[str, Any] = {
        "block": block,
        "kind": kind,
        "chain": kind,
        "start": start,
        "end": end,
        "plane": plane,
        "center": center,
        "angle": angle,
        "duration": duration,
        "exact": exact,
    }
    for part in whole.values():
        part.setflags(write=False)
    return Motions(**whole, feeds=feed_runs(feed), control=control, nurbs=nurbs)


def _trace(lexed: Lexed, blocks: _Blocks) -> tuple[tuple[Any, ...], tuple[Any, ...], int]:
    """Follow the program; its motions have their starts and ends in one array if each begins where the last ends."""
    words = lexed.words
    room = int(np.count_nonzero((blocks.tasks & (codes.FORGET_FIRST - 1)) % codes.FORGET))
    begins = np.zeros(0, np.int32) if blocks.feeds.first is None else blocks.feeds.first
    feeds = read_only(blocks.feeds.value), read_only(begins)
    modal = (blocks.table, blocks.states, feeds, blocks.tasks, blocks.whys)
    text, anchors = (words.block, words.letter, words.value), np.zeros(blocks.tasks.size + 1, np.uint8)
    find_anchors(text, modal, blocks.last, anchors)
    for shared in (True, False):
        places = np.empty((room + 1, 3))
        columns = (
            np.empty(room, np.int32),
            np.empty(room, np.int8),
            places[:-1],
            places[1:] if shared else np.empty((room, 3)),
            np.empty(room, np.int8),
            np.empty(room),
            unwritten(room),
            unwritten(room, np.int8),
        )
        curves = (unwritten((room, 2)), unwritten(room), unwritten(room, np.int16))
        count = int(trace_motions(text, modal, blocks.last, anchors, columns, curves, shared))
        if count >= 0:
            break
    if shared and count < room:
        places = places[: count + 1].copy()
        columns = (*columns[:2], places[:-1], places[1:], *columns[4:])
    return columns, curves, count


Splines = tuple[dict[int, Array], dict[int, NurbsData]]


def _splines(lexed: Lexed, blocks: _Blocks, columns: list[Any]) -> Splines | None:
    """Control points of splines by motion; None where one is not whole: its block then is passed through."""
    block, kind, start, end = columns[:4]
    control: dict[int, Array] = {}
    nurbs: dict[int, NurbsData] = {}
    view = splinewords.SplineBlocks(tasks=blocks.tasks, table=blocks.table, states=blocks.states)
    for row in np.flatnonzero(kind == CUBIC).tolist():
        task = int(blocks.tasks[block[row]]) & (codes.FORGET_FIRST - 1)
        units = float(blocks.table[blocks.states[block[row]], codes.UNITS])
        words = splinewords.letters_of(lexed, int(block[row]))
        if task == codes.CUBIC:
            points = splinewords.cubic(words, units, start[row], end[row], control.get(row - 1))
        else:
            points = splinewords.quadratic(words, units, start[row], end[row])
        if points is None:
            _pass_through(blocks, int(block[row]))
            return None
        control[row] = points
    for row in np.flatnonzero(kind == NURBS).tolist():
        drawn = splinewords.nurbs(lexed, view, int(block[row]), start[row])
        if drawn is None:
            _pass_through(blocks, int(block[row]))
            return None
        nurbs[row] = drawn
    return control, nurbs


def _pass_through(blocks: _Blocks, block: int, why: int = codes.LONE_SPLINE) -> None:
    blocks.tasks[block] = codes.FORGET
    blocks.whys[block], blocks.spots[block] = why, -1


def _cut(column: Any, count: int) -> Any:
    return column if count == column.shape[0] else column[:count].copy()
