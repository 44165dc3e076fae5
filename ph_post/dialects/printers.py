"""Read programs for printer firmware: words of slicers beside those that move.

Printer firmware takes one command a line; where a line has several, some obeys the first and some all of them.
E words drive the extruder, which is no part of the path: they are skipped, and a G0 with one that is not 0 is
read as a G1, as it lays a bead. Commands that neither move nor change a mode, by the firmware's documents, are
skipped too; all others may move: no position is known after them.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np

from ph_post.gcode.lexer import DOUBTED
from ph_post.gcode.numbers import LINE_START, blanked, line_fed

_LINE: Final = re.compile(rb"[^\r\n]+")
_COMMAND: Final = re.compile(
    rb"[ \t]*(?:[Nn]\d+[ \t]*)?([GMTgmt])[ \t]*(\d+(?:\.\d+)?)(?![\d.])(?=\W|$|[A-Za-z][ \t]*[-+]?[\d.])"
)
_NAME: Final = re.compile(rb"[ \t]*([A-Za-z_][A-Za-z0-9_]*)")
_EXTRUDED: Final = re.compile(rb"[Ee][ \t]*[-+]?[0-9.]*")
_PUSHES: Final = re.compile(rb"[Ee][ \t]*[-+]?[\d.]*[1-9]")
_MOVE: Final = re.compile(rb"(?:[ \t]*[A-Za-z][ \t]*[-+]?(?:\d+(?:\.\d*)?|\.\d+))*[ \t]*(?:\*\d+[ \t]*)?")
_SECOND: Final = re.compile(rb"[GMTgmt][ \t]*\d")
_SECOND_BESIDE_T: Final = re.compile(rb"[GMgm][ \t]*\d")
_SETS: Final = re.compile(rb"F|G[ \t]*0*(?:2[01]|9[0-2])(?!\d)")
_BLANK: Final = re.compile(rb"([ \t])")

_PLAIN_COMMENT: Final = re.compile(rb"^[ \t]*\([^()]*\)[ \t]*$|\([^()A-Z]*\)[ \t]*$")
"""Text in parentheses that Marlin skips, built with PAREN_COMMENTS or without (parser.cpp): no command begins with one,
and no parameter of a command is a small letter."""

_TEXT_BEHIND: Final = re.compile(rb"\([^()Ff]*\)[ \t]*$")
"""Text in parentheses behind a command. Where Marlin takes its letters for parameters the axes may go anywhere, but no
mode changes: a command begins the line, and no feed is named."""

_MARKER: Final = re.compile(LINE_START + rb"M[ \t]*0*808(?!\d)")
"""Markers of loops, M808 L5 to M808 (Marlin, "M808 - Repeat Marker")."""

_KEPT, _BROUGHT_BACK = (re.compile(LINE_START + rb"M[ \t]*0*%d(?!\d)" % number) for number in (120, 121))
"""Words by which RepRapFirmware keeps its modes and brings them back (Duet3D, "M120"); Marlin's are for endstops."""

_LOOP: Final = re.compile(LINE_START + rb"while\b")
"""A loop of RepRapFirmware (Duet3D, "GCode Meta Commands"), whose programs are read as Marlin's."""

_FIRST_TOOL: Final = re.compile(rb"(?m:^)[ \t]*T0+[ \t]*(?=[;\r\n]|\Z)")
"""The first tool, without more words. Marlin has it from the start, and a tool that it has already is not changed
(tool_change.cpp); in Klipper T0 is whatever a macro of that name does."""

_OTHER_TOOL: Final = re.compile(LINE_START + rb"[Tt][ \t]*(?!0+(?!\d))[\w?]")
"""Any other tool, after which the first one is changed to."""

_READ: Final = frozenset((b"G0", b"G1", b"G2", b"G3", b"G4", b"G17", b"G20", b"G21", b"G90", b"G91", b"G92", b"G28"))
"""Words that are read as RS274/NGC's, with the differences below. G17 says no more than what holds anyway: where it is
unknown, in Klipper without [gcode_arcs] and in Marlin without planes, nothing happens."""

_STOPS: Final = frozenset((b"M0", b"M1", b"M3", b"M4", b"M5", b"M7", b"M8", b"M9"))

STILL: Final = frozenset(
    b"M17 M20 M21 M27 M31 M42 M73 M75 M76 M77 M78 M82 M83 M101 M102 M103 M104 M105 M106 M107 M108 M109 M110 M111"
    b" M113 M114 M115 M116 M117 M118 M119 M122 M123 M126 M127 M128 M129 M140 M141 M145 M150 M154 M155 M190 M191 M200"
    b" M201 M203 M204 M205 M207 M208 M221 M250 M256 M280 M300 M301 M302 M304 M355 M380 M381 M400 M412 M413 M425 M486"
    b" M500 M501 M503 M555 M568 M569 M572 M592 M593 M900 M906 M907 M911 M912".split()
)
"""Commands that neither move nor change where coordinates are or at which feed they are gone to:
temperatures, fans, limits, messages, progress, the extruder's own settings, objects' names, drivers' currents. M101
to M103 switch the motor of an old extruder, which ran at a speed of its own (RepRap wiki, "G-code"); others do not
know them. M116 waits for temperatures, and M568 sets a tool's (Duet3D)."""

_QUIET: Final = STILL | frozenset(b"M862.%d" % check for check in range(1, 7))
"""With Prusa's checks of the printer, nozzle and firmware (Prusa-Firmware-Buddy, "M862")."""

_NAMED_STILL: Final = frozenset(
    b"EXCLUDE_OBJECT EXCLUDE_OBJECT_DEFINE EXCLUDE_OBJECT_START EXCLUDE_OBJECT_END RESPOND SET_FAN_SPEED"
    b" SET_HEATER_TEMPERATURE SET_INPUT_SHAPER SET_LED SET_PIN SET_PRESSURE_ADVANCE SET_PRINT_STATS_INFO"
    b" SET_TEMPERATURE_FAN_TARGET SET_VELOCITY_LIMIT TEMPERATURE_WAIT SET_RETRACTION".split()
)
"""Extended commands that Klipper's docs/G-Codes.md describes without motion or change of the coordinates; Marlin does
not know them, for which slicers' programs for Klipper are often taken. All others may be macros, which do anything:
what stands behind one shows whether it left G90 in force, see :func:`_shows_modes`."""

_RETURNING: Final = frozenset((b"TIMELAPSE_TAKE_FRAME",))
"""Macros of Klipper that everyone has alike, and that may park the head and then bring it back to its place, with all
modes and the feed as they were (moonraker-timelapse, `klipper_macro/timelapse.cfg`): slicers write it at each layer."""

_UNDERSTOOD: Final = _NAMED_STILL | _RETURNING

NO_MACHINE: Final = 3000.0
"""Way along X [mm] that no printer has."""

ON_CIRCLE: Final = 0.02
OFF_CIRCLE: Final = 0.05
"""Differences of an arc's radii [mm] that are rounding, and that are none."""

SHOWING: Final = 3
"""Arcs that show their plane."""

_DISTANCES: Final = re.compile(rb"[ \t]*(?:[Nn]\d+[ \t]*)?[Gg][ \t]*0*9([01])(?![\d.])")
_MOVING: Final = re.compile(rb"[ \t]*(?:N\d+[ \t]*)?G[ \t]*0*[0-3](?![\d.])(.*)")
_ARC: Final = re.compile(LINE_START + rb"G[ \t]*0*[23](?![\d.])", re.IGNORECASE)
_PLANE: Final = re.compile(rb"[ \t]*(?:N\d+[ \t]*)?G[ \t]*0*1[789](?![\d.])")
_PLACED: Final = re.compile(rb"([XYZIJF])[ \t]*([-+]?(?:\d{1,9}(?:\.\d*)?|\.\d+))")

_FOR_HOST: Final = re.compile(rb"[ \t]*@object(?:stop)?(?![^\s])", re.IGNORECASE)
"""Names of objects for a plugin of OctoPrint, which obeys lines with @ itself (OctoPrint, "@ Commands"); firmware
that gets them says that it knows none of that name."""

_TEXTS: Final = frozenset((b"M117", b"M118", b"M486"))
"""Those behind which text stands."""


def reader_of(arcs: bytes, foreign: bytes, *, small: bool) -> Callable[[bytes], bytes]:
    """Return the function that hides what is no motion.

    Parameters
    ----------
    arcs : bytes
        Letters that an arc may have, in capitals.
    foreign : bytes
        What stands at the beginning of a line with any other extended command.
    small : bool
        Whether small letters mean what capitals mean.
    """
    change = partial(_hidden, arcs=arcs, small=small)

    def hide(data: bytes) -> bytes:
        data = line_fed(data)
        first, last = _repeated(data)
        if not small and _OTHER_TOOL.search(data) is None:
            data = blanked(_FIRST_TOOL, data)
        plain = _without_beads(data)
        relative = lost = False
        for found in _BEADS.finditer(data):
            begin, end = found.span(1)
            if begin == end:
                continue
            mark = foreign
            if (named := _DISTANCES.match(found[1])) is not None:
                relative = named[1] == b"1"
            elif foreign == b"$" and _is_macro(found[1]):
                shown = _shows_modes(data, end, relative=relative)
                if lost:
                    # A macro before has lost the modes: they are those of the beginning again, the plane as well.
                    shown = shown and (_ARC.search(data, end) is None or _shows_plane(data, end))
                mark, lost = (b"$=" if lost else b"$@") if shown else mark, not shown
            plain[begin:end] = change(found[1], foreign=mark)
        for line in _LINE.finditer(data, first):
            if line.start() >= last:
                break
            plain[line.start() : line.end()] = _passed(line[0])
        for line in brought_back(data):
            plain[line.start() : line.end()] = _marked(line[0].partition(b";")[0], b"$").ljust(len(line[0]))
        return bytes(plain)

    return hide


def brought_back(data: bytes) -> list[re.Match[bytes]]:
    r"""Return the lines behind which modes, feed and what E words are may be those of an earlier line, as text.

    Examples
    --------
    >>> [line[0] for line in brought_back(b"M121\nM120\nG91\nM121 ; back\n")]
    [b'M121 ; back']
    """
    data = line_fed(data)
    kept = _KEPT.search(data)
    found = () if kept is None else _BROUGHT_BACK.finditer(data, kept.end())
    return [line for one in found if (line := _LINE.match(data, one.start())) is not None]


def returns(line: bytes) -> bool:
    """Return whether a line is a macro that leaves all modes as they were.

    Examples
    --------
    >>> returns(b"TIMELAPSE_TAKE_FRAME"), returns(b"PARK_HEAD")
    (True, False)
    """
    name = _NAME.match(line)
    return name is not None and name[1].upper() in _RETURNING


def _is_macro(line: bytes) -> bool:
    """Return whether a line is an extended command of which nobody knows what it leaves."""
    name = _NAME.match(line)
    return name is not None and _COMMAND.match(line) is None and name[1].upper() not in _UNDERSTOOD


def _shows_modes(data: bytes, begin: int, *, relative: bool) -> bool:
    """Return whether coordinates from a place of the text on show the modes in force, `relative` before it or not.

    Without a G90 they can only be places where as steps they leave any machine. It is X that is looked at: Y or Z may
    be a belt without an end. Behind a G90 arcs show their plane. Before anything moves a feed has to be named, as a
    macro may leave any. The places end where a line says how coordinates count, or behind moves is another macro.
    """
    way, fed, moved, told = 0.0, False, False, False
    for line in _LINE.finditer(data, begin):
        code = line[0].partition(b";")[0].upper()
        macro, named = _is_macro(code), _DISTANCES.match(code)
        if (named is not None and (moved or named[1] == b"1")) or (macro and moved):
            return False
        told, fed = (told and not macro) or named is not None, fed and not macro
        move = _MOVING.match(code)
        if move is None:
            continue
        words = dict(_PLACED.findall(move[1]))
        fed, moved = fed or b"F" in words, moved or bool(words.keys() & {b"X", b"Y", b"Z"})
        if moved and (told or not fed):
            return fed and _shows_plane(data, line.start())
        way += float(words.get(b"X", 0.0))
        if not relative and abs(way) > NO_MACHINE:
            return True
    return False


def _shows_plane(data: bytes, begin: int) -> bool:
    """Return whether the first arcs from a place of the text on lie in XY: in no other plane they end on their circles.

    They end where a line says how coordinates count, or names a plane, or is another macro.
    """
    shown = 0
    at: tuple[float, float] | None = None
    if _ARC.search(data, begin) is None:
        return False
    for line in _LINE.finditer(data, begin):
        code = line[0].partition(b";")[0].upper()
        if _DISTANCES.match(code) is not None or _PLANE.match(code) is not None or _is_macro(code):
            return False
        move = _MOVING.match(code)
        words = {} if move is None else {key: float(value) for key, value in _PLACED.findall(move[1])}
        if b"X" not in words or b"Y" not in words:
            at = at if not words.keys() & {b"X", b"Y"} else None
            continue
        start, at = at, (words[b"X"], words[b"Y"])
        if start is None or not words.keys() & {b"I", b"J"}:
            continue
        center = [start[axis] + words.get(letter, 0.0) for axis, letter in enumerate((b"I", b"J"))]
        first, last = ([place - middle for place, middle in zip(one, center, strict=True)] for one in (start, at))
        if abs(math.hypot(*first) - math.hypot(*last)) > ON_CIRCLE:
            return False
        shown += all(abs(abs(one) - abs(other)) > OFF_CIRCLE for one, other in zip(first, last, strict=True))
        if shown == SHOWING:
            return True
    return False


def why_bound(line: bytes) -> str:
    """Return why the motion of a line cannot be divided, in words; empty where it can."""
    words = _EXTRUDED.findall(line.partition(b";")[0])
    if len(words) > 1:
        return "has two E words, and is not divided"
    return "extrudes (E), and is not divided without M82 or M83 before it" if words else ""


def _repeated(data: bytes) -> tuple[int, int]:
    """Return from where to where lines may run again: between the markers of Marlin's loops, and of RepRapFirmware's.

    A loop of RepRapFirmware ends where no line is indented any more: that is not looked for.
    """
    markers = [found.start() for found in _MARKER.finditer(data)]
    loop = _LOOP.search(data)
    if loop is not None:
        return min([loop.start(), *markers]), len(data)
    return (markers[0], markers[-1] + 1) if markers else (0, 0)


def _passed(line: bytes) -> bytes:
    """Return a line of which nobody knows how often it runs."""
    code, mark, comment = line.partition(b";")
    return (_marked(code, b"$@") if code.strip() else code) + mark + comment


_BEADS: Final = re.compile(
    rb"(?:G(?:1|0(?![^\r\n]*E))(?: (?:[XYZ][-+]?(?:\d+(?:\.\d*)?|\.\d+)|E[-+]?(?:\d{1,15}(?:\.\d{0,15})?|\.\d{1,15})"
    rb"|F[1-9]\d*(?:\.\d*)?))+(?:[\r\n]+|\Z))*([^\r\n]*)[\r\n]*"
)
"""Lines of which all but E is read as it stands, as nearly all of a print, and the line behind them, which takes a
hundred times as long."""

_EXTRUSION: Final = 32
"""Most bytes of an E word in such a line."""


def _without_beads(data: bytes) -> bytearray:
    """Return a text without E words that have a blank before them."""
    plain = bytearray(data)
    text = np.frombuffer(plain, np.uint8)
    places = np.flatnonzero((text[1:] == ord("E")) & (text[:-1] == ord(" "))) + 1
    for _ in range(_EXTRUSION):
        text[places] = ord(" ")
        places = places[places < text.size - 1] + 1
        places = places[text[places] > ord(" ")]
    return plain


def _hidden(line: bytes, arcs: bytes, foreign: bytes, *, small: bool) -> bytes:
    """Return one line as RS274/NGC has it, of the same length."""
    code, mark, comment = line.partition(b";")
    if _FOR_HOST.match(code) is not None:
        return b" " * len(code) + mark + comment
    if not code.strip() or code.lstrip().startswith(b"#"):
        # No command begins with that: Marlin and Klipper say so, and go on (gcode.cpp, gcode.py: unknown command).
        return line
    if not small:
        code = blanked(_PLAIN_COMMENT, code)
        if not code.strip():
            return code + mark + comment
    found = _COMMAND.match(code)
    if found is None:
        name = _NAME.match(code)
        quiet = name is not None and name[1].upper() in _NAMED_STILL
        mode = b"$@" if returns(code) else foreign
        return (b" " * len(code) if quiet else _marked(code, mode)) + mark + comment
    word = found[1].upper() + (found[2].lstrip(b"0") or b"0")
    if not small and word in _READ and code != code.upper():
        return _doubted(code) + mark + comment
    return _command(code, word, found.end(), arcs) + mark + comment


def _command(code: bytes, word: bytes, end: int, arcs: bytes) -> bytes:
    """Return the command of a line, whose parameters begin at `end`."""
    rest = code[end:]
    if _has_second(word, rest):
        return _doubted(code)
    if word in _QUIET or _says_nothing(word, rest):
        return b" " * len(code)
    if word in _RELEASES:
        # Nobody knows where the axes are then, until they are homed: as behind a G28.
        begin = max(code[:end].upper().rfind(b"M"), 0)
        return code[:begin] + b"G28".ljust(len(code) - begin)
    if word in _STOPS or word == b"G28":
        kept = word in _STOPS and _letters(rest) <= set(b"SP") and _MOVE.fullmatch(rest)
        return code[:end] + (rest if kept else b" " * len(rest))
    if word not in _READ:
        return _marked(code, b"$@")
    plain = blanked(_EXTRUDED, rest)
    plain = blanked(_NO_FEED, plain)
    if word in (b"G2", b"G3"):
        plain = blanked(_NO_CENTRE, plain)
        if not _letters(plain) & set(b"XY"):
            plain = blanked(_TURNS, plain)
    foreign = word in (b"G2", b"G3") and _letters(plain) - set(arcs)
    if word == b"G0" and _PUSHES.search(rest) is not None:
        # G0 moves at F as G1 does, and this is no way through the air.
        code = code[: end - 1] + b"1" + code[end:]
    return code[:end] + plain if _MOVE.fullmatch(plain) and not foreign else _marked(code, b"$@")


_NO_CENTRE: Final = re.compile(rb"[Kk][ \t]*[-+]?0*\.?0*(?![\d.])[ \t]*")
"""A distance of an arc's centre across its plane that is nothing, as FreeCAD writes it: whatever the plane, none
is taken where it is not told."""

_TURNS: Final = re.compile(rb"[Pp][ \t]*\d+(?![\d.])[ \t]*")
"""How often a circle is gone round (Marlin, "G2-G3"; Klipper passes over it): back where it began it leads to the same
place. Slicers lift the nozzle so, with P1."""


def once_round(line: str) -> str:
    """Return the text of a line without the number of times that its circle is gone round.

    Examples
    --------
    >>> once_round("G3 X8.4 Y1.2 Z.8 I-.4 J1.1 P1 F900 ; P1")
    'G3 X8.4 Y1.2 Z.8 I-.4 J1.1 F900 ; P1'
    """
    command, mark, comment = line.partition(";")
    return _TURNS.sub(b"", command.encode("latin-1")).decode("latin-1") + mark + comment


_NO_FEED: Final = re.compile(rb"[Ff][ \t]*\+?(?:0+\.?0*|\.0+)(?![\d.])")
"""A feed of 0, which Marlin passes over (gcode.cpp, get_destination_from_command); Klipper ends the program there."""

_WHOLE_SPEED: Final = re.compile(rb"[ \t]*[Ss][ \t]*100(?:\.0*)?[ \t]*")

_RELEASES: Final = frozenset((b"M18", b"M84"))
"""Commands that switch the motors off."""


def _has_second(word: bytes, rest: bytes) -> bool:
    """Return True if another command stands behind one that is understood.

    T is a parameter of heaters and fans; M0 may have text behind it.
    """
    if word in _QUIET:
        return word not in _TEXTS and _SECOND_BESIDE_T.search(rest) is not None
    if word in _STOPS:
        return _SECOND.search(rest) is not None and _MOVE.fullmatch(rest) is not None
    return (word in _READ or word in _RELEASES) and _SECOND.search(rest) is not None


def _says_nothing(word: bytes, rest: bytes) -> bool:
    """Return True if a command does not concern the path.

    G4 that only waits for moves, G92 of the extruder, retraction by the firmware (G10, G11), which moves E and Z and
    takes both back by itself, the temperatures of a tool (G10 with P, R and S: Duet3D, "G10"), M84 of the extruder or
    after a time, and M220 of all of the speed, as it is anyway.
    """
    if word == b"G4":
        return not _letters(rest) & set(b"PS")
    if word in (b"G10", b"G11"):
        return _letters(rest) <= set(b"PRS")
    if word in _RELEASES:
        # A time after which they are switched off where nothing moves, or the extruder's motor alone.
        return bool(_letters(rest)) and _letters(rest) <= set(b"SE")
    if word == b"M220":
        return _WHOLE_SPEED.fullmatch(rest) is not None
    return word == b"G92" and _letters(rest) == set(b"E")


def _letters(rest: bytes) -> set[int]:
    """Letters of parameters, in capitals."""
    return {letter for letter in rest.upper() if 65 <= letter <= 90}


def _doubted(code: bytes) -> bytes:
    """Return a line that may be obeyed or not, or what one does to the modes at worst.

    Its words stay where they are, but for those before the first blank, in whose place stands the mark: no feed.
    """
    sets = _SETS.search(code.upper()) is not None
    words = blanked(_EXTRUDED, code)
    if sets:
        words = blanked(_TEXT_BEHIND, words)
    first, blank, rest = _BLANK.split(words, maxsplit=1) if _BLANK.search(words) else (words, b"", b"")
    if blank and b"F" not in first.upper() and b"(" not in words:
        return bytes([DOUBTED]) + first + rest
    return _marked(code, b"$ " if sets else b"$@")


def _marked(code: bytes, mark: bytes) -> bytes:
    """Return a line for the controller itself, as long as the text; of one character only the first fits."""
    return mark[: len(code)] + b" " * (len(code) - len(mark))
