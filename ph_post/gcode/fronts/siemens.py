"""Part programs in Siemens language, as far as their motion goes, read in translation.

What the words mean is told in :mod:`ph_post.gcode.dialects.siemens`. Values that are computed (R parameters,
expressions, system variables), cycles, subprograms, splines through points, and frames are passed through and
named; a program that jumps is refused, as what it does does not follow from the order of its lines.
"""

from __future__ import annotations

import re
from typing import Final

from ph_post.errors import InputError
from ph_post.gcode.fronts.siemenslines import Translator
from ph_post.gcode.fronts.siemensmotions import with_extras
from ph_post.gcode.fronts.siemenswords import without_comment
from ph_post.gcode.fronts.translated import NOT_UNDERSTOOD, lines_of, read_translated, refuse_line, text_of
from ph_post.gcode.reader.record import PartProgram, PlaceArray

_JUMP: Final = re.compile(r"\b(GOTO[BFCS]?|CASE|REPEATB?|UNTIL|CALL|PCALL|EXTCALL)\b", re.IGNORECASE)
_OPENS: Final = re.compile(r"^\s*(?:N\d+\s*)?(IF|WHILE|FOR|LOOP)\b", re.IGNORECASE)
_CLOSES: Final = re.compile(r"^\s*(?:N\d+\s*)?(ENDIF|ENDWHILE|ENDFOR|ENDLOOP)\b", re.IGNORECASE)
_STRING: Final = re.compile(r'"[^"]*"')


def read_siemens(data: bytes, name: str) -> PartProgram:
    r"""Read a program in Siemens language.

    Parameters
    ----------
    data, name
        As for :func:`ph_post.gcode.reader.read.read_program`.

    Raises
    ------
    InputError
        As that, and for jumps, circles in space, and feeds or denominators that are not positive.

    Examples
    --------
    >>> program = read_siemens(b"G0 X0 Y0\nPOLY PO[X]=(1) PO[Y]=(1,1) F60\nM30\n", "a.mpf")
    >>> program.motions.nurbs[1][1][:, :2].tolist()
    [[0.0, 0.0], [0.0005, 0.0], [0.001, 0.001]]
    """
    lines = lines_of(data, name)
    translator = Translator()
    texts = _translated(data, lines, name, translator)
    program = read_translated(data, lines, name, texts, translator.extras.remarks, in_place=False)
    return with_extras(program, translator.extras)


def _translated(data: bytes, lines: PlaceArray, name: str, translator: Translator) -> list[bytes]:
    """Translate all lines; what stands between IF, WHILE, FOR, LOOP and their ends is passed through."""
    texts: list[bytes] = []
    depth, opened = 0, ""
    for number in range(lines.size - 1):
        text = text_of(data, lines, number).decode("latin-1")
        bare = _STRING.sub('""', without_comment(text))
        jump = _JUMP.search(bare)
        if jump is not None:
            wanted = "a program that runs line by line"
            raise refuse_line(data, lines, name, number, "jump or call", wanted, jump[0])
        found = _OPENS.match(bare)
        opened = found[1].upper() if found and not depth else opened
        depth += found is not None
        if depth:
            texts.append(translator.passed(number, opened, 1, NOT_UNDERSTOOD).encode())
        else:
            texts.append(translator.translate(number, text).encode("latin-1"))
        depth = max(0, depth - (_CLOSES.match(bare) is not None))
    if depth:
        raise InputError(
            name, f"{opened} without its end", expected=f"END{opened}", got="the end of the file"
        )
    return texts
