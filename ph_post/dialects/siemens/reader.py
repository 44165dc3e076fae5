"""Read programs in Siemens language in translation, as far as their motion goes.

The words are documented in :mod:`ph_post.dialects.siemens.dialect`. R parameters are worked out where
lines run in their order. Other computed values (system variables, functions), cycles, subprograms, splines through
points, frames, and the lines that a jump or a loop may skip or repeat are passed through and named.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from msgspec.structs import replace

from ph_post.dialects.reading import XYZ_ONLY, Remark, read_translated, text_of
from ph_post.dialects.siemens import words as tables
from ph_post.dialects.siemens.jumps import find_stretches
from ph_post.dialects.siemens.motions import with_extras
from ph_post.dialects.siemens.translator import Translator
from ph_post.dialects.siemens.words import without_comment
from ph_post.expand.turning import has_feeds_per_turn
from ph_post.gcode.codes import FEED_MODE
from ph_post.gcode.program import PartProgram, PlaceArray, narrowed
from ph_post.gcode.words import lines_of
from ph_post.types import sealed

_TURNED: Final = re.compile(r"\b(?:G96[12]?|LIMS)\b|\bCYCLE9(?:[3-8]|[3-5]\d)\b", re.IGNORECASE)
"""Words of lathes: a constant cutting speed and its limit (SINUMERIK 840D sl, Fundamentals, 6FC5398-1BP40-3BA1, 5.2),
and the turning cycles, 93 to 98 and 930 to 952."""
_DIAMETERS: Final = re.compile(r"\bDIAM(?:ON|OF|90)\b", re.IGNORECASE)
_PLACED: Final = re.compile(rb"\bCIP\b|\bPOLY\b|\bI\s*=\s*AC\b")
"""Circles and polynomials whose other places are diameters, too, and are not read as such."""
_X: Final = re.compile(r"(?<![A-Z_$])X\s*(?:=\s*)?[-+.\d(A-Z]", re.IGNORECASE)
_UNMEASURED: Final = "X may be a diameter, as a lathe's setting has it: DIAMON or DIAMOF says which"
_FEED_MODES: Final = re.compile(rb"G9(?:[3-7]|6[12]|7[13])(?!\d)")
_STRING: Final = re.compile(r'"[^"]*"')


def read_siemens(
    data: bytes, name: str, *, contours: bool = False, resting: frozenset[int] = frozenset()
) -> PartProgram:
    r"""Read a program in Siemens language.

    Parameters
    ----------
    data, name
        As for :func:`ph_post.gcode.read.read_program`.
    contours : bool
        See :meth:`ph_post.gcode.language.Language.contoured`.
    resting : frozenset of int
        M words of the machine that move nothing.

    X is in diameters where DIAMON says so before the first one, but not where the centre of an arc is a place.

    Raises
    ------
    InputError
        As there.

    Examples
    --------
    >>> program = read_siemens(b"G0 X0 Y0\nPOLY PO[X]=(1) PO[Y]=(1,1) F60\nM30\n", "a.mpf")
    >>> program.motions.nurbs[1][1][:, :2].tolist()
    [[0.0, 0.0], [0.0005, 0.0], [0.001, 0.001]]
    """
    lines = lines_of(data, name)
    whole = [text_of(data, lines, number).decode("latin-1") for number in range(lines.size - 1)]
    bare = [_STRING.sub('""', without_comment(text)) for text in whole]
    joined = "\n".join(bare)
    text = joined.encode("latin-1").upper()
    turned = has_feeds_per_turn(text) and not _FEED_MODES.search(text)
    stretches, measured = find_stretches(bare), _unmeasured(joined, bare, turned=turned)
    language = replace(XYZ_ONLY, contours=contours, fixed={FEED_MODE: 95.0} if turned else {})
    hidden = {"DIAMON": tables.UNREAD_MEASURE} if _PLACED.search(text) else {}
    forced: dict[int, str] = {}
    while True:
        translator = Translator(
            computes=not stretches, forced=forced, diameters={**tables.DIAMETERS, **hidden}, resting=resting
        )
        texts = _translated(whole, lines, stretches, translator)
        table, remarks = translator.rows.table(), translator.extras.remarks
        if measured is not None:
            texts[measured] = tables.UNREAD_MEASURE.encode() + b" " + texts[measured]
            remarks.setdefault(measured, Remark(what=_UNMEASURED))
        program = read_translated(data, lines, name, texts, remarks, in_place=False, language=language, words=table)
        program, refused = with_extras(program, translator.extras)
        tangents = dict.fromkeys(translator.tangents - {*forced}, "block before a tangential one")
        if not (refused or tangents):
            centred = np.unique(np.array(translator.rows.centred, dtype=np.int32))
            return with_own_modes(replace(program, centred=sealed(centred)), translator.motions)
        forced |= refused | tangents


def _unmeasured(text: str, bare: Sequence[str], *, turned: bool) -> int | None:
    """Return the first line that moves X where none says whether X is a diameter, None in the program of a mill.

    That of a lathe has words of its own, or feeds a turn (`turned`). `text` is all the lines.
    """
    if (not turned and _TURNED.search(text) is None) or _DIAMETERS.search(text) is not None:
        return None
    return next((number for number, line in enumerate(bare) if _X.search(line)), None)


def _translated(
    whole: Sequence[str], lines: PlaceArray, stretches: Mapping[int, str], translator: Translator
) -> list[bytes]:
    """Translate all lines; those that may be skipped or run again are passed through, by line with the reason."""
    texts: list[bytes] = []
    for number, text in enumerate(whole):
        base = int(lines[number])
        if number in stretches:
            found = translator.pass_unread(number, text, base, stretches[number])
        else:
            found = translator.translate(number, text, base)
        texts.append(found.encode("latin-1"))
    return texts


def with_own_modes(program: PartProgram, motions: Mapping[int, str]) -> PartProgram:
    """Return a program whose modes name the motion by the program's own word, by line."""
    if not motions:
        return program
    modal, state = list(program.modal), program.state.astype(np.int32)
    known: dict[tuple[int, str], int] = {}
    for line, word in motions.items():
        key = int(state[line]), word
        if key not in known:
            known[key] = len(modal)
            modal.append(replace(modal[key[0]], motion=word or None))
        state[line] = known[key]
    return replace(program, modal=tuple(modal), state=sealed(narrowed(state)))
