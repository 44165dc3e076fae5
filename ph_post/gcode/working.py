"""Where the tool of a program works: a beam that is on, a nozzle that extrudes, a cutter in everything but rapids.

Where the facts are from. Grbl 1.1, `doc/markdown/laser_mode.md`: in laser mode the beam is on in G1, G2 and G3 only, at
S; with M3 at constant power also while the axes stand, with M4 at a power of S times the speed over F, so none at rest.
A torch (plasma) is on from M3 or M4 to M5, in rapids too. Printer firmware extrudes where a line has an E word.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Final

import msgspec
import numpy as np

from ph_post.gcode.numbers import LINE_START, line_fed
from ph_post.gcode.program import LINE, RAPID, PartProgram
from ph_post.types import BoolArray, Tool, sealed, unwritten

_EXTRUDES, _PULLS_BACK = (
    re.compile(LINE_START + rb"G[ \t]*0*[0-3](?![\d.])[^\r\n;E]*E[ \t]*" + sign + rb"[\d.]*[1-9]", re.IGNORECASE)
    for sign in (rb"[-+]?", b"-")
)

_PEN: Final = re.compile(rb"M0*[345](?![\d.])[^\r\n(;]*[(;][^\r\n)]*\bpen\b", re.IGNORECASE)
"""A pen that is let down or lifted, by the comment beside the word."""

_PEN_TIME: Final = 0.05
"""The least time [s] for which a program waits for a servo to move a pen. A beam is on or off at once."""

_TURNED_ON: Final = 2
"""A program that cuts at one height and turns its spindle on as often as this moves a beam."""


class WorkingMotions(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Where the `tool` works.

    `on` (m,) while it moves; `stays` (m,) where a straight move of an axis right behind the motion would work too;
    `burns` (m,) where it goes on while the axes stand there. `follows` (m,) where a beam's power is in proportion to
    the speed, with all of it at F.
    """

    tool: Tool
    on: BoolArray
    stays: BoolArray
    burns: BoolArray
    follows: BoolArray


def tool_in_words(program: PartProgram) -> tuple[Tool, int] | None:
    """Return the tool that a program's own words show, and the line; None where they could be a cutter's.

    A line of printer firmware with E extrudes. A laser's program sets S in the lines that cut, or turns the spindle on
    again and again, while no cut moves Z, unless it says there that it lets down a pen, or waits for one each time:
    where that stands it burns nothing. Nor does what has or changes a tool.
    """
    blocks = _lines_with(program, _EXTRUDES)
    if blocks.size:
        return "extruder", int(blocks[0])
    motions, words = program.motions, program.commands
    cuts = motions.kind != RAPID
    if not cuts.any() or np.any(motions.end[cuts, 2] != motions.start[cuts, 2], where=_known(program)[cuts]):
        return None
    orders = words.letter == ord("M")
    if np.any((words.letter == ord("T")) | (orders & (words.value == 6.0))) or _PEN.search(program.data):
        return None
    starts = words.block[orders & np.isin(words.value, (3.0, 4.0))]
    power = words.block[(words.letter == ord("S")) & np.isin(words.block, motions.block[cuts])]
    power = power[~np.isin(power, starts)]
    if power.size:
        return "laser", int(power[0])
    fresh = np.unique(np.searchsorted(motions.block[cuts], starts))
    return ("laser", int(starts[0])) if fresh.size >= _TURNED_ON and not _waits_for_pen(program) else None


def _waits_for_pen(program: PartProgram) -> bool:
    """Return whether a dwell is behind every order between two motions that switches the spindle on or off."""
    modal = [(one.spindle, one.speed) for one in program.modal]
    number = np.array([modal.index(one) for one in modal])[program.state]
    lines, seconds = program.dwells()
    lines = lines[seconds >= _PEN_TIME]
    # By line, the last one up to there that switches something, and the first dwell from there on.
    switched = np.maximum.accumulate(np.where(np.diff(number, prepend=number[:1]) != 0, np.arange(number.size), -1))
    blocks = np.unique(program.motions.block)
    before, after = blocks[:-1], blocks[1:]
    here = switched[after] > before
    waits = np.append(lines, program.blocks)[np.searchsorted(lines, switched[after[here]])]
    return bool(here.any() and (waits < after[here]).all())


def _known(program: PartProgram) -> BoolArray:
    motions = program.motions
    return np.asarray(np.isfinite(motions.end[:, 2]) & np.isfinite(motions.start[:, 2]))


def _lines_with(program: PartProgram, words: re.Pattern[bytes]) -> np.ndarray:
    """Lines that begin with some words of printer firmware, (n,)."""
    if program.language.bound is None:
        return np.zeros(0, dtype=np.int64)
    starts = np.array([match.start() for match in words.finditer(line_fed(program.data))], dtype=np.int64)
    return np.searchsorted(program.lines, starts.astype(program.lines.dtype), side="right") - 1


@lru_cache(maxsize=4)
def travels(program: PartProgram) -> BoolArray:
    """Mask (m,) of the straight motions of a print without E, which are in the air; none where nothing extrudes."""
    motions, lines = program.motions, _lines_with(program, _EXTRUDES)
    found = (motions.kind == LINE) & ~np.isin(motions.block, lines) & (lines.size > 0)
    return sealed(found)


@lru_cache(maxsize=4)
def working_motions(program: PartProgram, stated: Tool | None) -> WorkingMotions:
    """Return the tool of a program, and where it works.

    Parameters
    ----------
    program : PartProgram
    stated : str or None
        Tool of the machine file; where it states none the program's own words show it.
    """
    motions = program.motions
    tool: Tool = stated or (tool_in_words(program) or ("cutter", 0))[0]
    # A pen may rest and go slowly as a cutter may, whatever M3 and S say to its servo.
    tool = "cutter" if tool == "pen" else tool
    cuts = motions.kind != RAPID
    nowhere = unwritten(cuts.size, np.bool_)
    burns = follows = nowhere
    if tool == "cutter":
        on = stays = cuts
    elif tool == "extruder":
        on = cuts & np.isin(motions.block, _lines_with(program, _EXTRUDES))
        # Behind what pulls filament back nothing is laid where the nozzle rests, nor before a wipe, which lays nothing.
        pulls = _lines_with(program, _PULLS_BACK)
        before, through = (np.searchsorted(pulls, motions.block, side=side) for side in ("left", "right"))
        stays = on & np.append(on[1:] & (through[1:] == before[:-1]), False)[: on.size]
    else:
        modes = program.modal
        lit = np.array([one.spindle in ("M3", "M4") and one.speed != 0.0 for one in modes], dtype=np.bool_)
        scaled = np.array([one.spindle == "M4" for one in modes], dtype=np.bool_)
        state = program.state[motions.block]
        stays = lit[state] if state.size else nowhere
        follows = stays & scaled[state] & (tool == "laser") if state.size else nowhere
        on = stays if tool == "plasma" else stays & cuts
        burns = stays & ~follows
    return WorkingMotions(tool=tool, on=sealed(on), stays=sealed(stays), burns=sealed(burns), follows=sealed(follows))
