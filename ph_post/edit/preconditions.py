"""Preconditions of an edit, and reasons why a program, a chain or a motion does not meet them."""

from __future__ import annotations

import codecs
import math
import re
from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import Final

import numpy as np
from msgspec.structs import replace

from ph_post.bounds import HOUR
from ph_post.dialects.base import Dialect
from ph_post.drive.axes import side_offsets
from ph_post.drive.cascade import response_time
from ph_post.edit.block_words import words_by_letter
from ph_post.edit.extrusion import filament_of
from ph_post.edit.lagging_crossings import SHORT_LAG
from ph_post.edit.reversals import chain_spans
from ph_post.errors import InputError
from ph_post.files.check import counted
from ph_post.gcode.codes import FAULT
from ph_post.gcode.further import further_lines
from ph_post.gcode.lexer import BAD_CHARACTER, NO_LETTER, NO_NUMBER, TEXT
from ph_post.gcode.motion_parts import chord_lengths, split_cubic
from ph_post.gcode.numbers import LINE_START, line_fed
from ph_post.gcode.paths import without_feed
from ph_post.gcode.program import ARC, AXES, CUBIC, NURBS, PLANE_AXES, RAPID, PartProgram, feed_runs
from ph_post.gcode.read import shortened
from ph_post.gcode.working import tool_in_words, working_motions
from ph_post.post.moves import FINEST
from ph_post.types import ROTARY_AXES, Array, Axis, BoolArray, Machine, sealed
from ph_post.units import MM, MM_PER_MIN

LONG_DWELL: Final = 30.0
MANY_DWELLS: Final = 5
"""So many dwells of so many seconds [s] in a program are hardly meant: a pen or a torch waits for a second at most."""


def why_indivisible(program: PartProgram, dialect: Dialect, motion: int, share: float) -> str:
    """Return the reason why a motion cannot be divided at a share of it; empty where it can."""
    motions = program.motions
    line, own = program.line_number(motions.block[motion]), words_by_letter(program, int(motions.block[motion]))
    if motions.kind[motion] in (RAPID, NURBS):
        return f"line {line} is a {'rapid' if motions.kind[motion] == RAPID else 'NURBS'} and cannot be divided"
    unknown = np.isnan(motions.start[motion]) | np.isnan(motions.end[motion])
    nowhere = _from_nowhere(program)[motion]
    for axis, name in enumerate(AXES):
        if (unknown[axis] and name in own) or nowhere[axis]:
            return f"line {line} begins where {name} is not known and cannot be divided"
    if why := why_kept_whole(program, motion):
        return f"line {line} {why}"
    if motions.kind[motion] == CUBIC:
        return _why_indivisible_cubic(program, dialect, motion, share)
    return ""


@lru_cache(maxsize=2)
def _from_nowhere(program: PartProgram) -> BoolArray:
    """Mark the axes (m, 3) of arcs, as of a whole circle, that no word in absolute positions has placed so far.

    Their places are read as if they began at 0: no word could be written for them.
    """
    motions = program.motions
    absolute = np.array([one.absolute for one in program.modal], dtype=np.bool_)[program.state]
    understood = absolute.copy()
    for note in program.notes:
        understood[note.first : note.last + 1] = False
    curved = absolute[motions.block] & np.isin(motions.kind, (ARC, CUBIC))
    if not curved.any():
        return np.broadcast_to(False, (motions.block.size, len(AXES)))
    found = np.zeros((motions.block.size, len(AXES)), dtype=np.bool_)
    words = program.words
    for axis, name in enumerate(AXES):
        own = words.block[words.letter == ord(name)]
        first = own[understood[own]].min(initial=program.blocks)
        within = motions.plane != next(plane for plane, axes in PLANE_AXES.items() if axes[2] == axis)
        found[:, axis] = curved & within & (motions.block < first)
    return sealed(found)


def why_kept_whole(program: PartProgram, motion: int, *, shared: bool = True) -> str:
    """Return the reason why a motion's line is kept whole; empty where it is not.

    That is what the program's language says of it, a move of another axis beside X, Y and Z, and the spindle's turn.
    Where what is extruded may be `shared` between the parts, that is no reason.
    """
    bound, block = program.language.bound, int(program.motions.block[motion])
    if program.modal_after(block).motion == "G33":
        return "is tied to the spindle"
    if letters := further_lines(program).get(block):
        return f"moves {' and '.join(letters)} too"
    return "" if bound is None or (shared and block in filament_of(program)) else bound(program.text(block))


def _why_indivisible_cubic(program: PartProgram, dialect: Dialect, motion: int, share: float) -> str:
    line = program.line_number(program.motions.block[motion])
    if dialect.abilities.cubic is None:
        return f"line {line} would have to be divided, and {dialect.name} has no G5"
    parts = np.array(split_cubic(program.motions.control[motion], [0.0, share, 1.0]))[:, :, :2]
    if np.isfinite(dialect.abilities.cubic.deviation(parts)).all():
        return ""
    return f"the parts of the G5 in line {line} could not be trusted to {dialect.name}"


FINE: Final = 4
"""Most decimals of a mm in an edited program: 0.1 µm, so that half of a backlash known to a micrometre is exact."""


def word_decimals(dialect: Dialect, units: float) -> int:
    """Return the number of decimals of a length in a program whose unit is `units` [m].

    A dialect's decimals are those of a mm, no more than :data:`FINE`; of an inch, 25 times as long, one more is taken.

    Examples
    --------
    >>> from ph_post.dialects.registry import find_dialect
    >>> word_decimals(find_dialect("grbl"), 1e-3), word_decimals(find_dialect("grbl"), 25.4e-3)
    (4, 5)
    """
    return min(dialect.numbers.decimals, FINE) + (units > MM)


def written_offsets(axis: Axis, dialect: Dialect, units: float) -> tuple[float, float]:
    """Lasting offsets of an axis while it moves to minus and to plus [m], rounded to the program's decimals.

    Parameters
    ----------
    axis : Axis
    dialect : Dialect
        Its decimals count, in the program's `units` [m].
    units : float

    Raises
    ------
    InputError
        Where the decimals are too few for the backlash.
    """
    step = units * 10.0 ** -word_decimals(dialect, units)
    exact = side_offsets(axis)
    minus, plus = (float(round(one / step) * step) for one in exact)
    lost = axis.gap.lost_motion
    if plus == minus or max(abs(minus - exact[0]), abs(plus - exact[1])) > lost / FINEST:
        raise InputError(
            "--dialect",
            f"the decimals of {dialect.name} are too few for an offset of axis {axis.name}",
            expected=f">= {FINEST * step / MM:g} mm",
            got=f"{lost / MM:.3g} mm",
        )
    return minus, plus


_WORK_SYSTEMS: Final = (2.0, 20.0)
"""L words with which G10 sets a work offset."""

_COMMENT: Final = re.compile(rb"\([^)\r\n]*\)|;[^\r\n]*")

_OWN_ON: Final = re.compile(LINE_START + rb"M[ \t]*0*425\b(?![^;\r\n]*F0*\.?0*(?:[^.\d]|\Z))", re.IGNORECASE)
"""M425 of Marlin, but for the one that switches it off."""


_LIFT: Final = re.compile(LINE_START + rb"M[ \t]*0*207(?!\d)[^;\r\n]*Z[ \t]*\+?[\d.]*[1-9]")
_RETRACTED: Final = re.compile(LINE_START + rb"G[ \t]*0*10(?![\d.])(?![^;\r\n]*[PR])")


def why_lifted(program: PartProgram) -> str:
    """Return why Z is on no side that a print's words show, as the firmware lifts it by itself; empty where it is.

    G10 lifts it by Z of M207, and G11 comes down (Marlin, "M207").
    """
    if program.language.bound is None or b"207" not in program.data:
        return ""
    data = line_fed(program.data)
    lift = _LIFT.search(data)
    if lift is None or _RETRACTED.search(data, lift.end()) is None:
        return ""
    line = int(np.searchsorted(program.lines, np.int32(lift.end() - 1), side="right")) - 1
    return f"by M207 in {program.line_words(line)} the firmware lifts it at each G10 and comes down at G11"


def cutting_feed(program: PartProgram, times: Array) -> Array:
    """Feed of every motion [m/s], shape (m,); from chord and time [s] in inverse time; NaN where unknown."""
    motions, found = program.motions, np.array(program.motions.feed)
    timed = np.flatnonzero(motions.duration > 0.0).astype(np.int32)
    time = times[timed]
    found[timed] = np.where(time > 0.0, chord_lengths(motions, timed) / np.where(time > 0.0, time, 1.0), 0.0)
    return found


ASSUMED_FEED: Final = 1000.0 * MM_PER_MIN
"""Feed [m/s] with which motions of a cutter are reckoned that have none which is known."""


def reckoned_feeds(program: PartProgram, machine: Machine) -> PartProgram:
    """Return the program with a feed to reckon with where none is known; itself where that would not do.

    New lines carry no F there: they have the feed in force. That will do in chains of one feed mode, where no motor
    lags: then backlash is crossed over the same length of path at any feed. Of a beam it is the fastest that X and Y
    can: a crossing burns a corner that is passed slowly less than twice as long, and one that is passed fast most. So
    it is of a print that never says one.
    """
    motions = program.motions
    unknown = without_feed(program)
    lags = any(response_time(axis.servo) >= SHORT_LAG for axis in machine.axes.values())
    if not unknown.any():
        return program
    tool, speeds = working_motions(program, machine.tool).tool, [axis.limits.velocity for axis in machine.axes.values()]
    if lags or (tool == "extruder" and not unknown[motions.kind != RAPID].all()):
        return _parted_behind(program, unknown)
    assumed = ASSUMED_FEED if tool == "cutter" else max(speeds)
    low, high = chain_spans(motions)
    for first, end in zip(low.tolist(), high.tolist(), strict=True):
        states = np.unique(program.state[motions.block[first:end]])
        if len({program.modal[state].feed_mode for state in states.tolist()}) > 1:
            unknown[first:end] = False
    return replace(program, motions=replace(motions, feeds=feed_runs(np.where(unknown, assumed, motions.feed))))


def _parted_behind(program: PartProgram, unknown: BoolArray) -> PartProgram:
    """Return the program with chains that end behind cuts whose feed is not known, so that these alone are left.

    A print that begins with a move without F, before all that have one, would be left whole.
    """
    behind = np.append(False, unknown[:-1] & ~unknown[1:])[: unknown.size]
    return replace(program, motions=replace(program.motions, chain=sealed(program.motions.chain + np.cumsum(behind))))


def warn_reckoned(program: PartProgram, reckoned: PartProgram) -> list[str]:
    """Return a warning of feeds that are not known, and were reckoned with."""
    found = np.flatnonzero(np.isnan(program.motions.feed) & ~np.isnan(reckoned.motions.feed))
    if not found.size:
        return []
    lines, feed = program.motions.block[found[[0, -1]]].tolist(), reckoned.motions.feeds.at(found[0])
    return [
        f"the feed in {program.line_words(*lines)} is not known (G95, units of the control's own, or no F yet): the"
        f" time is reckoned with {feed / MM_PER_MIN:g} mm/min, and new lines have the feed in force"
    ]


def warn_dwells(program: PartProgram) -> list[str]:
    """Return a warning of dwells so long that milliseconds may be meant where the controller counts seconds."""
    lines, seconds = program.dwells()
    long = np.flatnonzero(seconds >= LONG_DWELL)
    if long.size < MANY_DWELLS:
        return []
    hours, first = float(seconds[long].sum()) / HOUR, program.line_number(int(lines[long[0]]))
    return [
        f"{long.size} dwells of {LONG_DWELL:g} s and more take {hours:.3g} h, the first in line {first}: where"
        " milliseconds are meant, the program lasts far less, and is slowed down by more of its time than is said"
    ]


def warn_centres(program: PartProgram) -> list[str]:
    """Return a warning of centres that are taken for places though no line says so."""
    if not program.language.places_centres:
        return []
    return [
        "I, J and K are taken for the places of the arcs' centres, as under G90.1: about centres from their starts the"
        " arcs do not end where they should. The controller has to be set so"
    ]


def blocked_chains(program: PartProgram) -> dict[str, BoolArray]:
    """Return masks (c,) of the chains that cannot be offset, by reason; chains without a cut need no offset."""
    motions = program.motions
    low, _ = chain_spans(motions)
    several = np.append(motions.block[1:] == motions.block[:-1], False)[: motions.block.size]
    found: dict[str, BoolArray] = {
        "a line's feed changes on its way, or it moves more than once": several,
        "the feed is not known (G95, units of the control's own, or no F yet)": without_feed(program),
        "contains a NURBS (G5.2)": motions.kind == NURBS,
        "its units are not those of most of the program": in_other_units(program) & (motions.kind != RAPID),
        "contains an arc from a place that is not known": np.asarray(_from_nowhere(program).any(axis=1)),
        "contains a G5 that continues the one before it, without I and J": _continued(program),
    }
    if low.size == 0:
        return {}
    return {why: np.logical_or.reduceat(marks, low) for why, marks in found.items() if marks.any()}


def why_blocked(program: PartProgram) -> dict[int, str]:
    """Return the reasons of :func:`blocked_chains` by the number of the chain."""
    low, _ = chain_spans(program.motions)
    number = program.motions.chain[low]
    return {int(number[k]): why for why, marks in blocked_chains(program).items() for k in np.flatnonzero(marks)}


_PROSE: Final = (NO_NUMBER, BAD_CHARACTER, NO_LETTER, TEXT)
"""Faults of lines that are no words at all."""

_MARKUP: Final = re.compile(rb"(?:\xef\xbb\xbf)?\s*<[!?A-Za-z]")
"""How a page of the web begins, and a drawing: no part program of any controller does."""


def require_words(program: PartProgram) -> None:
    """Refuse a text of which no line is understood: a page of the web or a letter that is named like a part program.

    What another controller might know, as a call or a macro, stays what it is: something that is passed through.

    Raises
    ------
    InputError
    """
    notes = program.notes
    if program.motions.kind.size or not notes:
        return
    prose = all(note.why >= FAULT and note.why % FAULT in _PROSE for note in notes)
    if not (prose or _MARKUP.match(program.data)):
        return
    inside = np.zeros(program.blocks, dtype=np.bool_)
    for note in notes:
        inside[note.first : note.last + 1] = True
    if inside[program.words.block].all():
        first = next(line for line in range(program.blocks) if program.text(line).strip())
        raise InputError(
            f"{program.name}:{program.line_number(first)}",
            "not a part program, as no line of it is understood",
            expected="words, such as G1 X10",
            got=shortened(program.text(first).decode("utf-8", "replace").strip()),
        )


def require_tool(program: PartProgram, machine: Machine) -> None:
    """Refuse a program of another tool than the machine file states, and one that extrudes where nothing can.

    Raises
    ------
    InputError
    """
    words = program.commands
    pushed = words.block[(words.letter == ord("E")) & (words.value != 0.0)]
    if pushed.size and program.language.read is None and program.language.hide is None:
        others, every = words.block[words.letter == ord("M")], program.words
        moves = every.block[every.g_words(0.0, 1.0, 2.0, 3.0)]
        extrudes = pushed[np.isin(pushed, moves) & ~np.isin(pushed, others)]
        if extrudes.size:
            raise InputError(
                f"{program.name}:{program.line_number(extrudes[0])}",
                f"the line extrudes (E), for which {machine.dialect} has no words",
                expected="a machine file with the dialect marlin or klipper",
            )
    found = tool_in_words(program)
    if found is None or machine.tool is None or found[0] == machine.tool:
        return
    if found[0] == "extruder" or machine.tool in ("cutter", "extruder"):
        nozzle = found[0] == "extruder"
        raise InputError(
            f"{program.name}:{program.line_number(found[1])}",
            "the line extrudes (E)" if nozzle else "the program is a laser's or a torch's: S or M3 switches the beam",
            expected='a machine file with tool = "extruder"'
            if nozzle
            else 'one with tool = "laser", "plasma" or "pen"',
            got=f'"{machine.tool}"',
        )


def why_not_editable(program: PartProgram, *, mixed: bool = False) -> list[str]:
    """Return the reasons why nothing in a program can be offset; empty where it can.

    What needs one unit in all of a program cannot be `mixed`.
    """
    troubles = []
    if _checksummed(program):
        troubles.append("its lines carry checksums, so no line can be added")
    words, moving = program.commands, program.motions.block
    if moving.size and moving[0] == 0 and program.data.startswith(codecs.BOM_UTF8):
        troubles.append("its first line moves, behind a byte order mark, so that there is no room for a head")
    turned = (words.letter == ord("G")) & (words.value == 10.0) & (words.decimals == 0)
    for block in words.block[turned].tolist():
        rows = words.rows(block, block + 1)
        own = dict(zip(map(chr, words.letter[rows]), words.value[rows].tolist(), strict=True))
        # With other L words G10 sets tools (R is a radius then) and parameters; a computed L may be any.
        systems = math.isnan(own.get("L", math.nan)) or own["L"] in _WORK_SYSTEMS
        if systems and own.get("R", 0.0) != 0.0:
            troubles.append(f"{program.line_words(block)} turns the work system (G10 with R) away from the axes")
    if program.language.stays is not None and (why := program.language.stays(program.data)):
        troubles.append(why)
    if not mixed and len(program_units(program)) > 1:
        troubles.append("it moves in mm and in inches")
    return troubles


def in_other_units(program: PartProgram) -> BoolArray:
    """Mask of the motions (m,) whose numbers have another unit than most cuts of the program."""
    units = program_units(program)
    if len(units) <= 1:
        return np.zeros(program.motions.kind.size, dtype=np.bool_)
    return np.asarray(_motion_units(program) != units[0])


def _motion_units(program: PartProgram) -> Array:
    """Return the unit of the numbers of every motion, shape (m,) [m]."""
    return np.asarray(np.array([one.units for one in program.modal])[program.state[program.motions.block]])


def program_units(program: PartProgram) -> list[float]:
    """Units [m] in which a program moves, linear axes beside X, Y and Z too; that of most cuts comes first."""
    words, letters = program.commands, [ord(name) for name in program.language.further if name not in ROTARY_AXES]
    used = np.unique(program.state[np.append(program.motions.block, words.block[np.isin(words.letter, letters)])])
    found = sorted({program.modal[number].units for number in used.tolist()})
    if len(found) > 1:
        cuts = _motion_units(program)[program.motions.kind != RAPID]
        found.sort(key=lambda unit: -np.count_nonzero(cuts == unit))
    return found


def double_compensation(program: PartProgram, dialect: Dialect, machine: Machine) -> list[str]:
    """Return warnings of a controller that compensates the backlash too."""
    words = program.commands
    found = words.block[(words.letter == ord("M")) & (words.value == 425.0)]
    twice = "the backlash would be compensated twice"
    said = []
    if found.size:
        said = [
            f"{program.line_words(found[0])} switches the controller's own backlash compensation on (M425): {twice}"
        ]
    if program.language.hide is not None and (own := _OWN_ON.search(line_fed(program.data))):
        line = int(np.searchsorted(program.lines, np.int32(own.start()), side="right"))
        said = [f"{program.line_words(line - 1)} sets the controller's own backlash compensation (M425): {twice}"]
    return [*said, *own_setting(dialect, machine)]


def own_setting(dialect: Dialect, machine: Machine) -> list[str]:
    """Return the sentence that the controller's own compensation has to be off; none where the program sees to that."""
    said = dialect.notices.own_compensation
    if not said or (dialect.notices.guard and machine.own_correction is not None):
        return []
    return [f"{said} must be 0 for the compensated axes, or their backlash is compensated twice"]


def _checksummed(program: PartProgram) -> bool:
    """Return true where a line ends with a checksum.

    Printers number their lines, each one more than the last, and check them (reprap.org/wiki/G-code, Checking): no
    line can be changed or added without all that follow.
    """
    if program.language.read is not None or b"*" not in program.data:
        return False
    data = np.frombuffer(program.data, dtype=np.uint8)
    stars = np.flatnonzero(data == ord("*")).astype(np.int32)
    blocks = np.unique(np.searchsorted(program.lines, stars, side="right") - 1)
    return any(
        re.search(rb"\*\s*\d+\s*$", _COMMENT.sub(b"", program.text(block)).strip()) and b"[" not in program.text(block)
        for block in blocks.tolist()
    )


def _continued(program: PartProgram) -> BoolArray:
    """G5 blocks without I and J, which a split of the G5 before them would change."""
    motions = program.motions
    marks = np.zeros(motions.kind.size, dtype=np.bool_)
    for motion in np.flatnonzero(motions.kind == CUBIC).tolist():
        letters = {int(program.words.letter[word]) for word in program.words_of(int(motions.block[motion]))}
        marks[motion] = not letters & {ord("I"), ord("J")}
    return marks


_CLIMBS: Final = re.compile(rb"(?:\([^)\r\n]*|;[^\r\n]*)\bclimb\b", re.IGNORECASE)
"""A comment in which CAM says that the cutter turns with the feed."""


def warn_climbing(program: PartProgram) -> list[str]:
    """Return a warning of cuts that CAM names climb cuts: the cutter can pull the table through its backlash."""
    found = _CLIMBS.search(program.data)
    if found is None:
        return []
    line = int(np.searchsorted(program.lines, found.start(), side="right"))
    return [
        f"{program.line_words(line - 1)} speaks of climb milling: such a cutter can pull the table, which friction"
        " alone holds, across its backlash; conventional milling does not"
    ]


def warn_unknown(program: PartProgram, axes: Iterable[str]) -> list[str]:
    """Return warnings of axes that move from unknown places, as under G91 from the machine's first position."""
    motions, warnings = program.motions, []
    for name in axes:
        lost = motions.block[np.isnan(motions.end[:, AXES.index(name)])]
        if lost.size:
            words = program.words
            lost = lost[np.isin(lost, words.block[words.letter == ord(name)])]
        if lost.size:
            warnings.append(
                f"axis {name} not compensated at {lost.size} motions, the first in line"
                f" {program.line_number(lost[0])}: they begin where its position is not known"
            )
    return warnings


_MOST_PLACES: Final = 12
"""Places that are named for a reason."""


def warn_blocked(program: PartProgram, blocked: Mapping[str, BoolArray]) -> list[str]:
    """Return warnings of chains that are not compensated, at most :data:`_MOST_PLACES` for each reason."""
    low, high = chain_spans(program.motions)
    block = program.motions.block
    warnings = []
    for why, marks in blocked.items():
        for chain in np.flatnonzero(marks)[:_MOST_PLACES].tolist():
            where = program.line_words(int(block[low[chain]]), int(block[high[chain] - 1]))
            warnings.append(f"not compensated in {where}: {why}")
        if marks.sum() > _MOST_PLACES:
            warnings.append(f"{counted(int(marks.sum()) - _MOST_PLACES, 'more place')} not compensated: {why}")
    return warnings
