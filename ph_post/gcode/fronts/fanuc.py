"""Fanuc part programs: RS274 with a dozen words of its own, hidden or translated where they stand.

What the words mean is told in :mod:`ph_post.gcode.dialects.fanuc`. A number of a length without a decimal
point may be millimetres or increments (parameter 3401): its motion is not understood, unless the dialect
says that such numbers are millimetres. Custom macros (``#1=``, ``IF``, ``WHILE``, ``GOTO``, G65 to G67) are
not run: what they may repeat, skip or move is passed through.
"""

from __future__ import annotations

import re
from typing import Final

import msgspec
import numpy as np

from ph_post.gcode.fronts.fanuclines import MACRO, Editor, Stretch, jumps_and_loops, masked
from ph_post.gcode.fronts.fanucnurbs import find_nurbs, with_nurbs
from ph_post.gcode.fronts.translated import NOT_UNDERSTOOD, Remark, lines_of, read_translated, text_of
from ph_post.gcode.reader.record import PartProgram

_ODD: Final = re.compile(
    rb"[XYZIJKR][ \t]*[-+]?[ \t]*\d+(?![\d.])"
    rb"|G0*[45789](?!\d)|G\d+\.\d|G2[2356](?!\d)|G6[567](?!\d)|G0*[23](?!\d)[^\n\r]*P|M198|^[ \t]*:|<|"
    + MACRO,
    re.MULTILINE,
)
"""What a line has that RS274 reads otherwise or not at all, or may have."""

_NO_CALL: Final = re.compile(rb"G67(?!\d)")


def read_fanuc(data: bytes, name: str, *, calculator: bool = False) -> PartProgram:
    """Read a Fanuc program.

    Parameters
    ----------
    data, name
        As for :func:`ph_post.gcode.reader.read.read_program`.
    calculator : bool
        Whether a length without a decimal point is in millimetres (parameter 3401, bit 0).

    Raises
    ------
    InputError
        As that, and for a jump whose target is not in the program.
    """
    lines = lines_of(data, name)
    texts = [text_of(data, lines, number) for number in range(lines.size - 1)]
    bare = masked(data)
    odd = np.unique(np.searchsorted(lines, [found.start() for found in _ODD.finditer(bare)], "right") - 1)
    bares = {int(number): bare[lines[number] : lines[number + 1]].rstrip(b"\r\n") for number in odd}
    remarks: dict[int, Remark] = {}
    dwells: dict[int, int] = {}
    curved: list[int] = []
    for stretch in jumps_and_loops(bares, bare, lines, data, name):
        _pass(stretch, texts, remarks)
    for number in sorted(bares):
        if number in remarks:
            continue
        editor = Editor(texts[number], bares[number], calculator=calculator)
        editor.translate()
        texts[number] = editor.text
        if editor.remark is not None:
            remarks[number] = editor.remark
        if editor.dwell is not None:
            dwells[number] = editor.dwell
        if editor.calls:
            _pass(_modal_call(number, bare, lines), texts, remarks)
        if editor.begins_nurbs:
            curved.append(number)
    nurbs = find_nurbs(bare, lines, curved, calculator=calculator)
    for one in nurbs:
        one.write(texts, remarks)
    found = read_translated(data, lines, name, texts, remarks, in_place=True)
    return _in_seconds(with_nurbs(found, nurbs), dwells)


def _pass(stretch: Stretch, texts: list[bytes], remarks: dict[int, Remark]) -> None:
    """Pass a stretch of lines through as it is."""
    for number in range(stretch.first, stretch.last + 1):
        if texts[number].strip():
            texts[number] = NOT_UNDERSTOOD.encode().ljust(len(texts[number]))
            remarks[number] = Remark(what=stretch.what)


def _modal_call(number: int, bare: bytes, lines: np.ndarray) -> Stretch:
    """Find the lines from a G66, which calls a macro after every motion, to its G67."""
    end = _NO_CALL.search(bare, int(lines[number]))
    last = lines.size - 2 if end is None else int(np.searchsorted(lines, end.start(), "right")) - 1
    return Stretch(first=number, last=last, what="macro called by every motion: G66")


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
    return msgspec.structs.replace(program, words=changed)
