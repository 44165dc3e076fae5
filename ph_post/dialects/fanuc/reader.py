"""Read Fanuc programs: RS274 with a dozen words of its own, and NURBS by G06.2.

The words are documented in :mod:`ph_post.dialects.fanuc.dialect`. A length without a decimal point counts in
increments, or in millimetres (parameter 3401, bit 0), as the dialect says, and a note says so once; where all of them
are so small that mm are meant more likely, they are not known. Custom macros
(``#1=``, ``IF``, ``WHILE``, ``GOTO``, G65 to G67) are not run: the lines that they may repeat, skip or move are passed
through. NURBS become the rational Bézier curves between knots.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from fractions import Fraction
from functools import partial
from typing import Final, NamedTuple

import msgspec
import numpy as np

from ph_post.dialects.fanuc.lines import (
    MACRO,
    PROGRAM_END,
    TURNED,
    Editor,
    PassedLines,
    corners_of,
    frames_begun,
    jumps_and_loops,
    unmeasured,
    words_of,
)
from ph_post.dialects.reading import (
    FORGOTTEN,
    NOT_UNDERSTOOD,
    Remark,
    motion_rows,
    read_translated,
    text_of,
)
from ph_post.expand.macro import COUNTED, SMALL, is_doubtful
from ph_post.expand.turning import TURNED_NOTE, has_feeds_per_turn, has_increments_by_words, is_turned, shapes_of
from ph_post.gcode.codes import ABSOLUTE, COMPENSATION, EXPRESSION, FEED_MODE, PLANE, QUIET, STAYS, UNITS, UNKNOWN
from ph_post.gcode.language import Language
from ph_post.gcode.numbers import masked
from ph_post.gcode.program import AXES, NURBS, Note, NurbsData, PartProgram, PlaceArray, WordSource, WordTable
from ph_post.gcode.words import lines_of, read_words
from ph_post.geometry.exact_polynomials import floats
from ph_post.geometry.nurbs import bezier_spans
from ph_post.types import frozen, sealed
from ph_post.units import INCH, MM

_MODE: Final = re.compile(rb"G(20|21|90|91)(?![\d.])")
_ENDS: Final = re.compile(rb"[GMSTO%#]")
"""Nothing but points and knots stands between the first block and the last."""
_ORDERS: Final = range(2, 5)


class NurbsBlocks(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A NURBS and its lines: `lines[j]` is that of span j, `curves` (order, control (k, 3) [m], weights).

    `why` is the reason why it is not understood. `feed` is its F word, `first` and `last` are all its lines.
    """

    first: int
    last: int
    lines: tuple[int, ...] = ()
    curves: tuple[NurbsData, ...] = ()
    feed: bytes = b""
    units: float = MM
    why: str = ""

    @classmethod
    def gather(
        cls, bare: bytes, lines: PlaceArray, number: int, modes: tuple[float, bool], *, calculator: bool
    ) -> NurbsBlocks:
        """Read the blocks from the one with G06.2, line `number`, to the last knot.

        `modes` are the units [m], and whether positions are absolute.
        """
        found: list[tuple[int, dict[str, bytes]]] = []
        last = number
        for line in range(number, lines.size - 1):
            text = bare[lines[line] : lines[line + 1]]
            if line > number and _ENDS.search(text):
                break
            words = {letter.decode(): value for letter, value, _, _ in words_of(text)}
            words.pop("N", None)
            if words:
                found.append((line, words))
                last = line
        units, absolute = modes
        why = _fault(found, absolute=absolute, calculator=calculator)
        if why:
            return cls(first=number, last=last, why=why)
        return _cut(found, number, last, units)

    def write(self, texts: list[bytes], remarks: dict[int, Remark]) -> None:
        """Put straight moves to the ends of the spans in the place of the lines; the curves follow later."""
        for number in range(self.first, self.last + 1):
            if self.why and texts[number].strip():
                texts[number] = f"{FORGOTTEN} F#1".encode() if number == self.first else FORGOTTEN.encode()
                remarks[number] = Remark(what=self.why)
            elif not self.why:
                texts[number] = b""
        if self.why:
            return
        texts[self.first] = b"G1" + self.feed
        for line, (_, control, _) in zip(self.lines, self.curves, strict=True):
            named = [(axis, value) for axis, value in zip(AXES, control[-1], strict=True) if not np.isnan(value)]
            places = " ".join(f"{axis}{value / self.units:.12f}" for axis, value in named)
            texts[line] = f"G1 {places}".encode()


def find_nurbs(bare: bytes, lines: PlaceArray, numbers: Sequence[int], *, calculator: bool) -> list[NurbsBlocks]:
    """Read the NURBS that begin on lines `numbers`, which rise, each in the modes in force there."""
    found = []
    units, absolute, done = MM, True, 0
    for number in numbers:
        end = int(lines[number + 1])
        for code in _MODE.findall(bare, done, end):
            units = {b"20": INCH, b"21": MM}.get(code, units)
            absolute = {b"90": True, b"91": False}.get(code, absolute)
        done = end
        found.append(NurbsBlocks.gather(bare, lines, number, (units, absolute), calculator=calculator))
    return found


def _fault(found: Sequence[tuple[int, dict[str, bytes]]], *, absolute: bool, calculator: bool) -> str:
    """Return why blocks are no NURBS that is understood, empty where they are."""
    if not absolute:
        return "NURBS in incremental positions: G06.2 under G91"
    order = float(found[0][1].get("P", b"4"))
    if order not in _ORDERS:
        return f"NURBS of an order that is none: P{order:g}"
    axes = {axis for axis in AXES if axis in found[0][1]}
    points = [words for _, words in found if axes & words.keys()]
    allowed = [{*"GPKRF", *axes}, *({*"KR", *axes} for _ in points[1:]), *("K" for _ in found)]
    whole = len(found) == len(points) + order and points == [words for _, words in found[: len(points)]]
    if len(axes) < 2 or not whole or len(points) < order:
        return "NURBS that is not whole"
    for (_, words), letters in zip(found, allowed, strict=False):
        if not words.keys() <= {*letters} or "K" not in words or (axes & words.keys()) not in (axes, set()):
            return "NURBS that is not whole"
        bare = [w for letter, w in words.items() if letter in "XYZKR" and b"." not in w and float(w) != 0.0]
        if bare and not calculator:
            return f"number without a decimal point in a NURBS: {bare[0].decode()}"
    return _knot_fault([float(words["K"]) for _, words in found], points, int(order))


def _knot_fault(knots: list[float], points: Sequence[dict[str, bytes]], order: int) -> str:
    if sorted(knots) != knots or len({*knots[:order]}) > 1 or len({*knots[-order:]}) > 1:
        return "NURBS whose knots fall, or do not stand as often as its order at both ends"
    if any(knots.count(knot) > order - 1 for knot in knots[order:-order]) or knots[0] == knots[-1]:
        return "NURBS with a knot that stands too often"
    if min(float(words.get("R", b"1")) for words in points) <= 0.0:
        return "NURBS with a weight that is not positive"
    return ""


def _cut(found: Sequence[tuple[int, dict[str, bytes]]], first: int, last: int, units: float) -> NurbsBlocks:
    """Cut a NURBS at its knots; each curve belongs to a line of its own."""
    order = int(float(found[0][1].get("P", b"4")))
    points = [words for _, words in found[: len(found) - order]]
    axes = [axis for axis in AXES if axis in points[0]]
    weights = [_exact(words.get("R", b"1")) for words in points]
    lifted = tuple(
        (*(_exact(words[axis]) * weight for axis in axes), weight)
        for words, weight in zip(points, weights, strict=True)
    )
    knots = tuple(_exact(words["K"]) for _, words in found)
    curves = []
    for _, span in bezier_spans(order - 1, knots, lifted):
        values = floats(span)
        control = np.full((order, len(AXES)), np.nan)
        control[:, [AXES.index(axis) for axis in axes]] = values[:, :-1] / values[:, -1:] * units
        curves.append((order, frozen(control), frozen(values[:, -1])))
    lines = tuple(found[order + j][0] for j in range(len(curves)))
    given = found[0][1].get("F", b"")
    feed = b" F" + given if given else b""
    return NurbsBlocks(first=first, last=last, lines=lines, curves=tuple(curves), units=units, feed=feed)


def _exact(number: bytes) -> Fraction:
    return Fraction(number.decode())


def with_nurbs(program: PartProgram, nurbs: Sequence[NurbsBlocks]) -> PartProgram:
    """Put the curves in the place of the straight moves that stand for them."""
    spans = {line: curve for one in nurbs for line, curve in zip(one.lines, one.curves, strict=True)}
    if not spans:
        return program
    motions = program.motions
    kind, start = motions.kind.copy(), motions.start.copy()
    drawn = dict(motions.nurbs)
    for line, row in motion_rows(motions, spans):
        order, control, weights = spans[line]
        place = np.where(np.isnan(control), start[row], control)
        start[row] = np.where(np.isnan(start[row]), place[0], start[row])
        kind[row], drawn[row] = NURBS, (order, frozen(place), weights)
    changed = msgspec.structs.replace(motions, kind=sealed(kind), start=sealed(start), nurbs=drawn)
    return msgspec.structs.replace(program, motions=changed)


_ODD: Final = re.compile(
    rb"G0*[45789](?!\d)|G\d+\.\d|G1(?:0[0137]?|87)(?!\d)|G11[23](?!\d)|G2(?:34|5[45]|6[89])(?!\d)|G2[2356](?!\d)"
    rb"|G6[567](?!\d)|G0*[23](?!\d)[^\n\r]*P|M198|^[ \t]*:|<"
    rb"|M0*99[ \t]*P|#[^\n\r]*/|[\d. \t]/|G9[01](?!\d)[^\n\r]*G9[01](?!\d)|T[ \t]*\d[^\n\r]*T[ \t]*\d|" + MACRO,
    re.MULTILINE,
)
"""What a line has that RS274 reads otherwise or not at all, or may have."""

_TURNED: Final = re.compile(TURNED)
_FEED_MODES: Final = re.compile(rb"G9[3458](?![\d.])|G99(?![\d.])")
_INVERSE: Final = re.compile(rb"G93(?![\d.])")
_SIDE: Final = re.compile(rb"G[ \t]*0*(4[012])(?!\d|\.[1-9])")
_WAYS: Final = re.compile(rb"IF|WHILE|GOTO|M0*99[ \t]*P|^[ \t]*/[^\n\r]*G[ \t]*0*4[012]|G[ \t]*[\[#]", re.MULTILINE)
"""Ways on which a G40 may not be met, and words that may be one."""
_OTHER_PLANES: Final = re.compile(rb"G1[79](?!\d)")

_NO_CALL: Final = re.compile(rb"G67(?!\d)")


_LENGTHS: Final = np.isin(np.arange(256), [ord(letter) for letter in "XYZIJKRUVWABC"])
"""Letters of lengths and angles."""


_WITH_K: Final = frozenset(("G1", "G2", "G3", "G33"))

UNMEASURED: Final = "subprogram without G90 or G91: what its places mean is set by the program that calls it"
FURTHER: Final = "ABC"
"""Axes of their own; U, V and W may be increments of X, Y and Z."""


_ON_LATHES: Final = frozenset((23, 24))
"""M words of lathes that move nothing: threads end in a chamfer from M23 to M24 (Haas, Machinist's CNC Reference Guide,
"Haas Lathe M-Codes": thread chamfer on, off)."""


def in_increments(words: WordTable, data: bytes, *, decimals: int) -> WordTable:
    """Return words whose lengths without a decimal point count in increments.

    Parameters
    ----------
    words : WordTable
    data : bytes
        Their text.
    decimals : int
        Those of a mm and of a degree; an inch has one more (increment system IS-B: 0.001 mm, 0.0001 inch).

    Examples
    --------
    >>> from ph_post.gcode.words import lines_of, read_words
    >>> data = b"G1 X100 Y1. Z0"
    >>> in_increments(read_words(data, lines_of(data, "a")).words, data, decimals=3).value.tolist()
    [1.0, 0.1, 1.0, 0.0]
    """
    bare = _without_point(words, data)
    units = words.g_words(20.0, 21.0)
    inches = np.append(0.0, words.value[units])[np.cumsum(units)] == 20.0
    own = inches & np.isin(words.block, words.block[units])  # G20 holds for the whole of its block
    turns = np.isin(words.letter, [ord(letter) for letter in FURTHER])
    places = np.where(bare, decimals + ((inches | own) & ~turns), 0)
    value = np.where(bare, words.value / 10.0**places, words.value)
    return msgspec.structs.replace(
        words, value=sealed(value), decimals=sealed((words.decimals + places).astype(np.int16))
    )


def in_doubt(words: WordTable, data: bytes, *, decimals: int) -> WordTable:
    """Return words whose small lengths without a decimal point are not known.

    Parameters
    ----------
    words, data, decimals
        As of :func:`in_increments`, by which larger ones count.

    Examples
    --------
    >>> from ph_post.gcode.words import lines_of, read_words
    >>> data = b"G1 X25 Y1. Z0"
    >>> in_doubt(read_words(data, lines_of(data, "a")).words, data, decimals=3).value.tolist()
    [1.0, nan, 1.0, 0.0]
    """
    small = _without_point(words, data) & (np.abs(words.value) < SMALL)
    found = in_increments(words, data, decimals=decimals)
    return msgspec.structs.replace(
        found,
        value=sealed(np.where(small, np.nan, found.value)),
        decimals=sealed(np.where(small, -1, found.decimals).astype(np.int16)),
    )


def _without_point(words: WordTable, data: bytes) -> np.ndarray:
    """Lengths other than 0 that have no decimal point, shape (w,)."""
    text = np.frombuffer(data, np.uint8)
    plain = _LENGTHS[words.letter] & (words.decimals == 0) & (words.value != 0.0)
    return np.asarray(plain & (text[np.maximum(words.end - 1, 0)] != ord(".")))


def read_fanuc(
    data: bytes,
    name: str,
    *,
    calculator: bool = False,
    decimals: int = 3,
    contours: bool = False,
    lathe: bool = False,
    resting: frozenset[int] = frozenset(),
) -> PartProgram:
    """Read a Fanuc program.

    That of a lathe tells X in diameters and is in G18, and the shapes of its cycles are passed through.

    Parameters
    ----------
    data, name
        As for :func:`ph_post.gcode.read.read_program`.
    calculator : bool
        Whether a length without a decimal point is in millimetres (parameter 3401, bit 0).
    decimals : int
        Decimals of a mm in increments.
    contours : bool
        See :meth:`ph_post.gcode.language.Language.contoured`.
    lathe : bool
        Whether it is the program of a lathe, also where no word of it says so.
    resting : frozenset of int
        M words of the machine that move nothing.

    Raises
    ------
    InputError
        As there.
    """
    lines = lines_of(data, name)
    bare = masked(data)
    asked, lathe = lathe, lathe or is_turned(data, bare)
    by_words = lathe and has_increments_by_words(bare)
    text = _translated(data, bare, lines, calculator=calculator, lathe=lathe, by_words=by_words)
    doubtful = not calculator and is_doubtful(data, bare)
    rule = partial(in_doubt if doubtful else in_increments, decimals=decimals)
    language = Language(
        lengths=None if calculator else rule,
        further=FURTHER,
        shortest=True,
        # The skip function: B-64484EN, 4.18.
        skips=True,
        # Canned cycles are group 09, straight motions 01 (B-64484EN-2, "G code list").
        cycles_apart=True,
        contours=contours,
        diameters=lathe,
        head=(TURNED_NOTE,) if lathe else (),
        fixed=_begun_modes(bare, lathe=lathe, by_words=by_words),
        lost=_left_modes(bare),
        effects=dict.fromkeys(sorted(resting | (_ON_LATHES if lathe else frozenset())), STAYS),
    )
    found = read_translated(data, lines, name, text.lines, text.remarks, in_place=True, language=language)
    found = _in_seconds(with_nurbs(found, text.nurbs), text.dwells)
    found = _say_diameters(found) if lathe and not asked else found
    if doubtful:
        return _say_doubts(found, text.lines)
    return found if calculator else _say_increments(found, text.lines, decimals)


class _Translated(NamedTuple):
    """Lines in words that :func:`ph_post.gcode.read.read_program` knows, and what they do not say.

    `dwells` are the powers of ten of the seconds in lines' P words.
    """

    lines: list[bytes]
    remarks: dict[int, Remark]
    dwells: dict[int, int]
    nurbs: list[NurbsBlocks]


def _translated(
    data: bytes, bare: bytes, lines: PlaceArray, *, calculator: bool, lathe: bool, by_words: bool
) -> _Translated:
    """Translate the words that are Fanuc's own, line by line, and pass through what is not understood."""
    texts = [text_of(data, lines, number) for number in range(lines.size - 1)]
    places = [found.start() for found in _ODD.finditer(bare)]
    places += [found.start() for found in _TURNED.finditer(bare)] if lathe else []
    odd = np.unique(np.searchsorted(lines, places, "right") - 1)
    bares = {int(number): bare[lines[number] : lines[number + 1]].rstrip(b"\r\n") for number in odd}
    remarks: dict[int, Remark] = {}
    dwells: dict[int, int] = {}
    curved: list[int] = []
    frames: dict[float, set[bytes]] = {}
    for stretch in jumps_and_loops(bares, bare, lines):
        _pass(stretch, texts, remarks, bare, lines, frames)
    if lathe:
        _pass_shapes(bare, texts, remarks)
    cut = _give_up_corners(bare, lines, texts, remarks, lathe=lathe, by_words=by_words)
    for number in sorted(bares):
        if number in remarks:
            continue
        editor = Editor(texts[number], bares[number], calculator=calculator, turned=lathe, by_words=by_words)
        editor.translate(frames)
        texts[number] = editor.text
        if editor.remark is not None:
            remarks[number] = editor.remark
        if editor.dwell is not None:
            dwells[number] = editor.dwell
        if editor.calls:
            _pass(_modal_call(number, bare, lines), texts, remarks, bare, lines, frames)
        if editor.begins_nurbs:
            curved.append(number)
    remarks = cut | remarks
    unsaid = None if by_words else unmeasured(bare, lines)
    if unsaid is not None and texts[unsaid].strip() != NOT_UNDERSTOOD.encode():
        # Of two words of a group the reader knows that either may hold.
        texts[unsaid] = b"G90 G91 " + texts[unsaid]
        remarks[unsaid] = Remark(what=UNMEASURED)
    nurbs = find_nurbs(bare, lines, curved, calculator=calculator)
    for one in nurbs:
        one.write(texts, remarks)
    return _Translated(texts, remarks, dwells, nurbs)


def _begun_modes(bare: bytes, *, lathe: bool, by_words: bool) -> dict[int, float]:
    """Modes in which a program begins, by column of a state, where they are others than RS274's.

    A lathe begins with feeds a turn (B-64484EN-1; parameter 3402, bit 4), and so does whatever has only such feeds.
    """
    unsaid = has_feeds_per_turn(bare) and not _FEED_MODES.search(bare)
    found = {FEED_MODE: 95.0} if lathe or unsaid else {}
    found |= {PLANE: 18.0} if lathe and not _OTHER_PLANES.search(bare) else {}
    end = PROGRAM_END.search(bare)
    if end is not None and end[1] == b"99" and _SIDE.search(bare):
        found[COMPENSATION] = UNKNOWN  # a subprogram is called on whichever side the cutter is
    return found | ({ABSOLUTE: 1.0} if by_words else {})


def _left_modes(bare: bytes) -> dict[int, float]:
    """Modes behind what may set any, by column of a state, infinite where it leaves what the program has said.

    No program may change from inches to mm or back (B-64484EN, "Inch/metric conversion"). Where none of its own lines
    says G93, under which a block without F is refused (B-64484EN-2, "Inverse time feed"), F is one a minute or a turn.
    Where each of its programs ends in G40 what it has begun, calls leave the cutter where it was.
    """
    found = {UNITS: np.inf} | ({} if _INVERSE.search(bare) else {FEED_MODE: 95.0})
    return found | ({COMPENSATION: np.inf} if _ends_sides(bare) else {})


def _ends_sides(bare: bytes) -> bool:
    """Return whether each program of a text ends the cutter compensation that it begins, whatever its way."""
    if _WAYS.search(bare):
        return False
    begins = [0, *(end.end() for end in PROGRAM_END.finditer(bare))]
    last = [_SIDE.findall(bare, *span) for span in zip(begins, [*begins[1:], len(bare)], strict=True)]
    return all(not sides or sides[-1] == b"40" for sides in last)


def _say_diameters(program: PartProgram) -> PartProgram:
    """Note the first X, which is a diameter."""
    words = program.words
    rows = np.flatnonzero((words.letter == ord("X")) & (words.block <= program.breaks[-1].block))
    if not rows.size:
        return program
    block = int(words.block[rows[0]])
    start, end = int(words.start[rows[0]]), int(words.end[rows[0]])
    word, column = program.data[start:end].decode("ascii", "replace"), start - int(program.lines[block]) + 1
    what = f"X is taken for a diameter, as lathes have it (fanuc+lathe says so): {word}"
    return _with_note(program, Note(first=block, last=block, column=column, what=what, why=QUIET))


def _with_note(program: PartProgram, note: Note) -> PartProgram:
    notes = sorted([*program.notes, note], key=lambda one: one.first)
    return msgspec.structs.replace(program, notes=tuple(notes))


def _first_without_point(program: PartProgram, texts: Sequence[bytes]) -> tuple[int, int, str] | None:
    """Return line, column and text of the first length that has no decimal point, None where all have.

    K is one beside lines, arcs and threads alone: elsewhere it counts how often a cycle is repeated.
    """
    translated = b"\n".join([*texts, b""])
    lines = lines_of(translated, program.name)
    words = read_words(translated, lines).words
    plain = _without_point(words, translated) & (words.block <= program.breaks[-1].block)
    lengths = np.array([modal.motion in _WITH_K for modal in program.modal])[program.state[words.block]]
    rows = np.flatnonzero(plain & ((words.letter != ord("K")) | lengths))
    if not rows.size:
        return None
    block = int(words.block[rows[0]])
    text = translated[words.start[rows[0]] : words.end[rows[0]]].decode("ascii", "replace")
    return block, int(words.start[rows[0]] - lines[block]) + 1, text


def _say_doubts(program: PartProgram, texts: Sequence[bytes]) -> PartProgram:
    """Note what nobody knows of lengths without a decimal point, in the place of what such lines are named for."""
    found = _first_without_point(program, texts)
    if found is None:
        return program
    block, column, text = found
    what = (
        "lengths without a decimal point are mm or 0.001 mm, as the control is set: none of them is changed"
        f" (fanuc+calculator reads them in mm): {text}"
    )
    kept = [note for note in program.notes if note.why != EXPRESSION or b"#" in texts[note.first]]
    program = msgspec.structs.replace(program, notes=tuple(kept))
    return _with_note(program, Note(first=block, last=block, column=column, what=what, why=EXPRESSION))


def _say_increments(program: PartProgram, texts: Sequence[bytes], decimals: int) -> PartProgram:
    """Note the first length that counts in increments, which the head of what is written repeats."""
    found = _first_without_point(program, texts)
    if found is None:
        return program
    block, column, text = found
    program = msgspec.structs.replace(program, language=msgspec.structs.replace(program.language, head=(COUNTED,)))
    step = f"1e-{decimals} mm or 1e-{decimals + 1} inch (fanuc+calculator: 1)"
    what = f"lengths without a decimal point count {step}: {text}"
    return _with_note(program, Note(first=block, last=block, column=column, what=what, why=QUIET))


def _pass(
    stretch: PassedLines,
    texts: list[bytes],
    remarks: dict[int, Remark],
    bare: bytes,
    lines: PlaceArray,
    frames: dict[float, set[bytes]],
) -> None:
    """Pass a stretch of lines through as it is; a frame that may begin in it is not the machine's behind it."""
    for number in range(stretch.first, stretch.last + 1):
        if texts[number].strip():
            begun = frames_begun(bare[lines[number] : lines[number + 1]], frames)
            texts[number] = (begun + NOT_UNDERSTOOD.encode()).ljust(len(texts[number]))
            remarks[number] = Remark(what=stretch.what)


def _pass_shapes(bare: bytes, texts: list[bytes], remarks: dict[int, Remark]) -> None:
    """Pass the shapes of cycles through, behind which neither the place nor F is known."""
    for first, last in shapes_of(bare):
        for number in range(first, last + 1):
            if texts[number].strip():
                what = f"{FORGOTTEN} F#1" if number == last else FORGOTTEN
                texts[number] = what.encode().ljust(len(texts[number]))
                remarks[number] = Remark(what="shape of a turning cycle")


def _give_up_corners(
    bare: bytes, lines: PlaceArray, texts: list[bytes], remarks: dict[int, Remark], *, lathe: bool, by_words: bool
) -> dict[int, Remark]:
    """Let no place be known behind corners that the control makes, nor behind the moves that follow; name them.

    Nothing may come between the two, and a corner has to fit into the second: both stay as they are.
    """
    found: dict[int, Remark] = {}
    corners = corners_of(bare, lines, lathe=lathe, by_words=by_words)
    named = {one.line for one in corners}
    for one in corners:
        if one.word:
            found[one.line] = Remark(what=f"chamfer, corner or angle of a drawing: {one.word}", column=one.column)
        found |= dict.fromkeys(set(one.behind) - named, Remark(what="move behind a rounded or chamfered corner"))
    for number in found.keys() - remarks.keys():
        end = len(bare[lines[number] : lines[number + 1]].rstrip())
        texts[number] = texts[number][:end] + b",R0" + texts[number][end:]
    return found


def _modal_call(number: int, bare: bytes, lines: np.ndarray) -> PassedLines:
    """Find the lines from a G66, which calls a macro after every motion, to its G67."""
    end = _NO_CALL.search(bare, int(lines[number]))
    last = lines.size - 2 if end is None else int(np.searchsorted(lines, end.start(), "right")) - 1
    return PassedLines(first=number, last=last, what="macro called by every motion: G66")


def _in_seconds(program: PartProgram, dwells: dict[int, int]) -> PartProgram:
    """Give dwells their times in seconds, NaN where its power of ten is below 0: it is not known."""
    if not dwells:
        return program
    words = program.words
    value, places = words.value.copy(), words.decimals.copy()
    for number, power in dwells.items():
        rows = np.flatnonzero((words.block == number) & (words.letter == ord("P")))
        value[rows] = np.nan if power < 0 else value[rows] / 10.0**power
        places[rows] = -1 if power < 0 else places[rows] + power
    changed = msgspec.structs.replace(words, value=value, decimals=places)
    return msgspec.structs.replace(program, source=WordSource(changed))
