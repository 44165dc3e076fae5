"""What was passed through, told once a stretch, and what separates the chains of motions."""

from __future__ import annotations

from typing import Final

import numpy as np

from ph_post.gcode.reader import codes
from ph_post.gcode.reader.record import Break, BreakKind, ByteArray, Note, PlaceArray, span_of
from ph_post.gcode.reader.words import Lexed

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
    codes.DELETED: "block delete",
    codes.SUBPROGRAM: "subprogram",
    codes.ARC_FROM_NOWHERE: "arc from an unknown position",
    codes.SPLINE_FROM_NOWHERE: "spline from an unknown position",
    codes.UNUSED_WORD: "word that no other on the line uses",
    codes.NO_MOTION_MODE: "axis words without a motion mode",
    codes.UNSURE_MODE: "motion under modes that something not understood may have changed",
    codes.CONTROLLER_LINE: "line for the controller itself",
    codes.OTHER_FRAME: "motion in a turned, scaled, polar or diameter frame",
    codes.THREAD: "motion tied to the spindle",
    codes.COMMA: "word of one controller, or of more digits than are kept",
    codes.DWELL_AXES: "dwell with axis words",
    codes.SPLINE_PLANE: "spline in another plane than G17",
    codes.SAVED_STATE: "modal state brought back",
    codes.LONE_SPLINE: "spline that is not whole",
}
_LETTERS: Final = {
    codes.FURTHER_AXIS: "ABCUVW",
    codes.UNUSED_WORD: "ABCDEHIJKLPQRUVW",
    codes.CYCLE: "GXYZ",
    codes.THREAD: "GXYZ",
    codes.COMPENSATED: "GXYZ",
    codes.NO_MOTION_MODE: "XYZABCUVW",
    codes.UNSURE_MODE: "GXYZABCUVW",
    codes.DWELL_AXES: "XYZABCUVW",
}
"""Letters of the words that are meant where the letter tells."""
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


def find_notes(lexed: Lexed, data: bytes, whys: ByteArray) -> tuple[Note, ...]:
    """One note for each stretch of blocks that are passed through for the same reason."""
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
        _note(lexed, data, int(blocks[low]), int(blocks[high]), int(whys[blocks[low]]))
        for low, high in zip(new, last, strict=True)
    )


def _note(lexed: Lexed, data: bytes, first: int, last: int, why: int) -> Note:
    """Name a stretch by the word on its first line for which it is passed through."""
    start, end = find_place(lexed, data, first, why)
    text = data[start:end].decode("utf-8", "replace").strip()
    column = len(data[int(lexed.lines[first]) : start].decode("utf-8", "replace")) + 1
    return Note(first=first, last=last, column=column, what=f"{_TEXTS[why]}: {shortened(text)}")


def shortened(text: str) -> str:
    """Return as much of a text as a note shows."""
    return text if len(text) <= _SHOWN else text[:_SHOWN] + "..."


def find_place(lexed: Lexed, data: bytes, block: int, why: int) -> tuple[int, int]:
    """Bytes of the word that a note is about; of the line where it is about no word."""
    words = lexed.words
    rows = range(*span_of(words.block, block))
    named = [row for row in rows if _is_meant(chr(words.letter[row]), float(words.value[row]), why)]
    if named:
        return int(words.start[named[0]]), int(words.end[named[0]])
    low, high = int(lexed.lines[block]), int(lexed.lines[block + 1])
    line = data[low:high]
    return low + len(line) - len(line.lstrip()), high


def _is_meant(letter: str, value: float, why: int) -> bool:
    """Whether a word is one for which a block is passed through."""
    if why in (codes.EXPRESSION, codes.O_WORD):
        return np.isnan(value) if why == codes.EXPRESSION else letter == "O"
    if why == codes.UNKNOWN_G:
        known = 0.0 <= value < 99.9 and codes.GROUP[round(10 * value)] >= 0
        return letter == "G" and not (known and abs(10.0 * value - round(10.0 * value)) < 1e-6)
    if why in (codes.UNKNOWN_M, codes.SUBPROGRAM, codes.SAVED_STATE):
        return letter == "M" and not (value in range(codes.M_GROUP.size) and codes.M_GROUP[int(value)] >= 0)
    return letter in _LETTERS.get(why, "")


def find_breaks(motion_block: PlaceArray, marks: ByteArray, whys: ByteArray, end: int) -> tuple[Break, ...]:
    """Put the breaks in order, from the beginning to the `end` of the program.

    Those of one kind without a motion between them are one: its block is the first.
    """
    blocks = np.flatnonzero((marks & (codes.END - 1)) | whys)
    kind = np.full(blocks.size, _NOT_UNDERSTOOD)
    for number in range(len(_KINDS) - 1, -1, -1):
        kind[(marks[blocks] & _KINDS[number][0]) != 0] = number
    motion = np.searchsorted(motion_block, blocks.astype(np.int32))
    keep = np.r_[True, (np.diff(motion) != 0) | (np.diff(kind) != 0)][: blocks.size]
    names: tuple[BreakKind, ...] = (*(name for _, name in _KINDS), "not understood")
    inner = tuple(
        Break(block=int(b), motion=int(m), kind=names[k])
        for b, m, k in zip(blocks[keep], motion[keep], kind[keep], strict=True)
    )
    first = Break(block=0, motion=0, kind="beginning")
    return (first, *inner, Break(block=end, motion=motion_block.size, kind="end"))
