"""New blocks in place of a program's own: parts of motions, stops and jogs, in the order of the motion."""

from __future__ import annotations

import math
import re
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence

import msgspec
import numpy as np

from ph_post.dialects.base import Dialect
from ph_post.dialects.printers import once_round
from ph_post.edit import block_words
from ph_post.edit.block_words import PartWords, fine_decimals
from ph_post.edit.edits import SYNCHRONISED, StopEdit, dwell_time
from ph_post.edit.extrusion import filament_of, with_filament
from ph_post.edit.motion_edits import MotionEdit, MotionPart
from ph_post.edit.preconditions import why_kept_whole
from ph_post.edit.word_shifts import MotionOffsets, stop_label
from ph_post.errors import InputError
from ph_post.gcode.language import Spelling
from ph_post.gcode.motion_parts import part_length
from ph_post.gcode.paths import without_feed
from ph_post.gcode.program import AXES, RAPID, Modal, PartProgram
from ph_post.simulate.controllers.moves import linking_of
from ph_post.types import BoolArray, IntArray
from ph_post.units import MINUTE, MM

_FEED_DIGITS = 4
"""Digits of the feeds of crossings and jogs, which are so within a thousandth; blocks of known time have more."""


def _lowered(feed: float, decimals: int | None) -> float:
    """Return a feed rounded down to the digits that matter, and to the decimals that a dialect writes.

    Examples
    --------
    >>> _lowered(1209.345, None), _lowered(47.6189, None), _lowered(8.4182, 2)
    (1209.0, 47.61, 8.41)
    """
    most = _FEED_DIGITS - 1 - math.floor(math.log10(feed))
    scale = 10.0 ** (most if decimals is None else min(most, decimals))
    return math.floor(feed * scale + 1e-9) / scale


def _goes_on(before: MotionEdit, task: MotionEdit) -> bool:
    """Return true where a crossing on a motion goes on over the joint to the next one."""
    both = (before.parts[-1].crossing, task.parts[0].crossing)
    return before.motion + 1 == task.motion and None not in both


_CENTRE = re.compile(r"\s*(?:N?\d+\s+)?(?:CC\b|[IJK][-+.\d])")
"""A block that sets the centre of circles."""


def _unfed(program: PartProgram) -> BoolArray:
    """Mask of the motions (m,) beside which new lines carry no F: cuts at an unknown feed, and the rapids beside them.

    No F could set back there what was in force.
    """
    motions = program.motions
    found = without_feed(program)
    if not found.any():
        return found
    cuts = np.flatnonzero(motions.kind != RAPID)
    behind = np.searchsorted(cuts, np.arange(found.size))
    beside = np.zeros(found.size, dtype=np.bool_)
    for near in (cuts[np.maximum(behind - 1, 0)], cuts[np.minimum(behind, cuts.size - 1)]):
        beside |= found[near] & (motions.chain[near] == motions.chain)
    return np.asarray(found | ((motions.kind == RAPID) & beside))


class Change(msgspec.Struct, kw_only=True):
    """New `lines` in place of `removed` lines of the original from `block` on; `label` says what for."""

    block: int
    removed: int
    lines: list[str]
    label: list[str]


class ChangeWriter:
    """Writes the changed stretches of a program.

    Parameters
    ----------
    program : PartProgram
    dialect : Dialect
    carried : MotionOffsets
        Offsets of the motions.
    decimals : int
        Of new lengths, in the program's units.
    tolerance, rounding : float
        Largest rounding of joints in blocks of known time, and in crossings [m].
    numbers : callable
        ``numbers(block)``: new text of the shifted words of a line, by word.
    """

    def __init__(
        self,
        program: PartProgram,
        dialect: Dialect,
        carried: MotionOffsets,
        decimals: int,
        tolerance: float,
        rounding: float,
        numbers: Callable[[int], dict[int, str]],
    ) -> None:
        self._program, self._dialect, self._carried = program, dialect, carried
        self._decimals, self._numbers = decimals, numbers
        self._tolerance, self._rounding = tolerance, rounding
        self._fine = fine_decimals(program, decimals)
        self._room = block_words.longest_line(program, dialect)
        self._feeds = block_words.FeedWords(program)
        self._unfed = _unfed(program)
        self._change: Change | None = None
        self._mode: str | None = None
        self._feed: str | None = None
        self._path: str | None = None
        self._stale = False
        self._poles, self._users = sorted(program.poles), sorted(program.centre_users)

    def write(self, tasks: list[MotionEdit]) -> Iterator[Change]:
        """Write the changes of all tasks, which come in the order of travel."""
        for before, task in zip([None, *tasks], tasks, strict=False):
            block = int(self._program.motions.block[task.motion])
            if before is not None and _goes_on(before, task):
                self._take_in(block)
            if not task.whole or 0.0 in task.stops:
                yield from self._move_to(block)
            offset = self._before(task, block)
            late = task.stops[1.0].behind if 1.0 in task.stops else None
            if not task.whole:
                self._replaced(task, block, offset)
                if late is not None:
                    yield from self._move_to(late + 1)
                    self._behind(task, late, offset)
            elif 1.0 in task.stops and task.stops[1.0].approach:
                # The rapid that ends beyond stands in the change with the move that follows it.
                yield from self._move_to(block)
                self._replaced(task, block, offset)
            elif 1.0 in task.stops and block_words.ends_program(self._program, block):
                # Between two stops of one change a short move could not be told from a jog.
                yield from self._move_to(block, apart=True)
                self._replaced(task, block, offset)
            elif 1.0 in task.stops:
                last = block if late is None else late
                yield from self._move_to(last + 1)
                self._behind(task, last, self._carried.word_of(task.motion))
        yield from self._move_to(self._program.blocks + 1)

    def _take_in(self, block: int) -> None:
        """Take the lines up to one into the change, as they are: a crossing goes on behind them."""
        change = self._change
        if change is None:
            return
        for line in range(change.block + change.removed, block):
            change.lines.append(block_words.line_text(self._program, line))
            change.removed += 1
            if "F" in block_words.words_by_letter(self._program, line):
                self._feed = self._feeds.after(line)
            if block_words.motion_word(self._program, line) is not None:
                self._mode = self._program.modal_after(line).motion

    def _move_to(self, block: int, apart: bool = False) -> Iterator[Change]:
        """End the change before a line unless it goes on there, and name the mode where a line needs it.

        One that is to stand `apart` does not go on.
        """
        change, self._stale = self._change, False
        if change is None or (change.block + change.removed == block and not apart):
            return
        last = change.block + change.removed - 1
        self._restore(last)
        change.lines = self._ended(change.lines)
        yield change
        self._change = None
        wanted = self._program.modal_after(last).motion
        relying = block_words.next_relying(self._program, last + 1) if wanted != self._mode else None
        if relying is None:
            return
        self._stale = relying >= block
        if wanted is None:
            raise InputError(
                f"{self._program.name}:{self._program.line_number(relying)}",
                "a move in a mode that is not known, which a stop before it would change",
                expected="a G word on this line",
            )
        if not self._stale:
            line = block_words.edited_line(self._program, relying, self._numbers(relying), [], first=wanted)
            yield Change(block=relying, removed=1, lines=self._ended([line]), label=["mode"])

    def _ended(self, lines: list[str]) -> list[str]:
        """Return new lines as the program ends its own."""
        spelling = self._program.language.spelling
        return lines if spelling is None else [spelling.ended(line, self._program.data) for line in lines]

    def _restore(self, block: int) -> None:
        """Write what has to be as it was after a line."""
        assert self._change is not None
        self._restore_pole(block)
        modal, lines = self._program.modal_after(block), self._change.lines
        if self._path != modal.path and modal.path is not None:
            lines.append(self._program.language.path_words.get(modal.path, modal.path))
            self._path = modal.path
        feed = self._feeds.after(block)
        if modal.feed_mode == 94 and feed is not None and feed != self._feed:
            if self._dialect.syntax.modal_motion:
                lines.append(f"F{feed}")
            else:
                self._add("G1", f"F{feed}")
                self._mode = "G1"
            self._feed = feed
        relying = block_words.next_relying(self._program, block + 1)
        alone = self._program.language.lone_modes
        if modal.motion in alone and self._mode != modal.motion and relying is not None:
            lines.append(modal.motion)
            self._mode = modal.motion

    def _behind(self, task: MotionEdit, block: int, offset: IntArray) -> None:
        """Write the stop at the end of a motion, up to which the offset lasts, behind its line or another."""
        self._open(block + 1, 0, block)
        self._stop(task.stops[1.0], self._wording(task.motion, block, offset), 1.0, offset)

    def _before(self, task: MotionEdit, block: int) -> IntArray:
        """Write the stop at the start of a motion, if there is one, and return the offset behind it."""
        offset = self._carried.before(task.motion)
        if 0.0 in task.stops:
            self._open(block, 0, block - 1)
            self._stop(task.stops[0.0], self._wording(task.motion, block - 1, offset), 0.0, offset)
        return offset

    def _replaced(self, task: MotionEdit, block: int, offset: IntArray) -> None:
        """Write a motion and its stops in place of its line."""
        self._open(block, 0, block - 1)
        assert self._change is not None
        self._change.removed += 1
        if self._program.motions.kind[task.motion] == RAPID and not task.whole:
            raise InputError(f"{self._program.name}:{self._program.line_number(block)}", "a rapid cannot be divided")
        why = why_kept_whole(self._program, task.motion)
        if why and not task.whole:
            raise InputError(f"{self._program.name}:{self._program.line_number(block)}", f"this line {why}")
        here = task.whole or 1.0 not in task.stops or task.stops[1.0].behind is None
        stops = {share: stop for share, stop in task.stops.items() if 0.0 < share < 1.0 or (share == 1.0 and here)}
        self._divided(task, stops, block, offset)

    def _open(self, block: int, removed: int, before: int) -> None:
        """Go on with the change at a line, or begin one with the modes in force after the line `before`."""
        if self._change is not None:
            return
        self._change = Change(block=block, removed=removed, lines=[], label=[])
        modal = self._program.modal_after(before)
        self._mode = self._mode if self._stale else modal.motion
        self._feed, self._path = self._feeds.after(before), modal.path

    def _wording(self, motion: int, block: int, offset: IntArray) -> PartWords:
        modal = self._program.modal_after(block)
        length = self._dialect.numbers.length
        words = PartWords(self._program, motion, modal, self._decimals, self._fine, length)
        words.begin(offset)
        return words

    def _divided(self, task: MotionEdit, stops: dict[float, StopEdit], block: int, offset: IntArray) -> None:
        """Write the parts of a motion, and the stops between them."""
        assert self._change is not None
        words = self._wording(task.motion, block, offset)
        self._change.label += task.labels
        for number, part in enumerate(task.parts):
            self._path_mode(task, part, words.modal)
            if part.crossing is not None:
                offset[:] = np.rint(part.crossing.added / (words.modal.units * 10.0**-self._decimals))
            spelling = self._program.language.spelling
            if number == 0 and spelling is not None and self._program.motions.kind[task.motion] != RAPID:
                self._first_spelled(spelling, block, words, part, offset)
            elif number == 0 and task.whole:
                self._first(block, self._numbers(block), [], words, part)
            elif number == 0:
                new = words.part(part, offset)
                straight = part.crossing is not None and part.crossing.line
                exchange, add = block_words.exchange_words(self._program, block, new, "G1" if straight else words.mode)
                self._first(block, exchange, add, words, part)
            else:
                self._line(words, part, offset)
            if self._program.motions.kind[task.motion] == RAPID:
                # A rapid has changed the offset by its own word.
                offset[:] = self._carried.word_of(task.motion)
                words.begin(offset)
            if part.duration is not None and "feed" not in self._change.label:
                self._change.label.append("feed")
            if part.high in stops:
                self._stop(stops[part.high], words, part.high, offset)
        last = block_words.text_after_motion(self._program, block)
        if last:
            self._restore(block)
            self._change.lines.append(last)

    def _first(self, block: int, exchange: dict[int, str], add: list[str], words: PartWords, part: MotionPart) -> None:
        """Write the block itself with its first part's words."""
        assert self._change is not None
        exchange |= dict.fromkeys(block_words.words_after_motion(self._program, block), "")
        feed = self._feed_of(words, part)
        own = block_words.words_by_letter(self._program, block).get("F")
        cuts = self._program.motions.kind[words.motion] != RAPID or self._dialect.syntax.rapid_feed
        if own is not None:
            if feed != self._feeds.after(block) or words.modal.feed_mode == 93:
                exchange[own] = f"F{feed}"
        elif cuts and feed is not None and feed != self._feed:
            add = [*add, f"F{feed}"]
        named = block_words.motion_word(self._program, block)
        mode = self._program.modal_after(block).motion if part.low == 0.0 and part.high == 1.0 else words.mode
        if part.crossing is not None and part.crossing.line:
            mode = "G1"
        first = "" if named is not None or mode == self._mode else mode or ""
        line = block_words.edited_line(self._program, block, exchange, add, first=first)
        # Blanks behind a semicolon belong to the comment.
        line = line if ";" in line else line.rstrip()
        if self._program.language.bound is not None and words.mode in ("G2", "G3"):
            line = once_round(line)
        if part.low > 0.0 or part.high < 1.0:
            line = with_filament(self._program, block, line, part.low, part.high)
        if len(line) + len("\r\n") > self._room and not line.startswith("/"):
            # A comment is read before its line is executed: it may as well stand on the line before.
            self._change.lines += block_words.COMMENT.findall(line)
            line = block_words.COMMENT.sub("", line).rstrip()
        self._change.lines.append(line)
        self._mode = mode
        self._feed = feed if cuts or own is not None else self._feed

    def _first_spelled(
        self, spelling: Spelling, block: int, words: PartWords, part: MotionPart, offset: IntArray
    ) -> None:
        """Write the first part of a motion in the place of its line, in a language of other words."""
        assert self._change is not None
        body, mode = self._body(words, part, offset)
        feed = self._feed_of(words, part)
        if feed is not None and (feed != self._feed or "F" in block_words.words_by_letter(self._program, block)):
            body.append(f"F{feed}")
            self._feed = feed
        later = self._program.language.after_motion
        self._change.lines += spelling.first(block_words.line_text(self._program, block), mode, body, later)
        self._mode = mode

    def _body(self, words: PartWords, part: MotionPart, offset: IntArray) -> tuple[list[str], str]:
        """Return the words of a part, and the mode in which it is written."""
        body = [text for text in words.part(part, offset).values() if text]
        straight = part.crossing is not None and part.crossing.line
        radius = "" if straight else words.radius(part)
        if radius:
            body = [text for text in body if text[0] not in "IJK"] + [radius]
        return body, "G1" if straight else words.mode

    def centres(self, changes: Sequence[Change]) -> Iterator[Change]:
        """Write the centre anew before each line that turns about one with another shift than it has there.

        `changes` are all others. A line that is passed through turns about the centre without a shift.
        """
        program, spelling = self._program, self._program.language.spelling
        if spelling is None or not program.centre_users:
            return
        ordered = sorted(changes, key=lambda one: one.block)
        replaced = {line for one in ordered for line in range(one.block, one.block + one.removed)}
        setting = [one.block + one.removed for one in ordered if any(_CENTRE.match(line) for line in one.lines)]
        motion_of = {int(block): motion for motion, block in enumerate(program.motions.block.tolist())}
        at: dict[int, tuple[int, IntArray]] = {}
        owners, nothing = program.centre_lines, np.zeros(3, dtype=np.int64)
        for line in sorted(program.centre_users):
            pole, arc = program.centre_users[line]
            wanted = self._carried.word_of(int(motion_of[line])) if arc else nothing
            before, now = at.get(pole, (pole, wanted if owners.get(pole) == line and pole not in replaced else nothing))
            if bisect_right(setting, line) > bisect_right(setting, before):
                now = wanted
            if line not in replaced and (now != wanted).any():
                place = self._centre_place(program.poles[pole], wanted)
                yield Change(block=line, removed=0, lines=self._ended([spelling.centre(place)]), label=["centre"])
                now = wanted
            at[pole] = line, now

    def _centre_place(self, pole: Sequence[float | None], shift: IntArray) -> list[str]:
        """Words of a centre with a shift, in steps of the coarse decimals."""
        scale = 10**self._fine
        return [
            AXES[axis] + self._dialect.numbers.length(round(value * scale) + int(shift[axis]) * self._grid, self._fine)
            for axis, value in enumerate(pole)
            if value is not None
        ]

    def _restore_pole(self, block: int) -> None:
        """Set the centre of circles again where the change has set others, as the next arc about it needs it."""
        assert self._change is not None
        program, spelling = self._program, self._program.language.spelling
        set_before = bisect_right(self._poles, block)
        if spelling is None or set_before == 0 or not any(_CENTRE.match(line) for line in self._change.lines):
            return
        pole = program.poles[self._poles[set_before - 1]]
        behind = self._poles[set_before] if set_before < len(self._poles) else program.blocks
        users = self._users[bisect_right(self._users, block) : bisect_right(self._users, behind - 1)]
        nothing = np.zeros(3, dtype=np.int64)
        shift = nothing
        if users and program.centre_users[users[0]][1]:
            motion = int(np.searchsorted(program.motions.block, np.int32(users[0])))
            shift = self._carried.word_of(motion)
        self._change.lines.append(spelling.centre(self._centre_place(pole, shift)))

    @property
    def _grid(self) -> int:
        """Finest steps in one step of new lengths."""
        return int(10 ** (self._fine - self._decimals))

    def _add(self, mode: str, *words: str) -> None:
        """Add a block with a motion mode."""
        assert self._change is not None
        spelling = self._program.language.spelling
        self._change.lines += [self._joined(mode, *words)] if spelling is None else spelling.lines(mode, words)

    def _line(self, words: PartWords, part: MotionPart, offset: IntArray) -> None:
        """Write a further part on a line of its own."""
        assert self._change is not None
        body, mode = self._body(words, part, offset)
        filament = filament_of(self._program).get(words.block)
        if filament is not None:
            body.append(filament.word(part.low, part.high))
        feed = self._feed_of(words, part)
        if feed is not None and (feed != self._feed or words.modal.feed_mode == 93):
            body.append(f"F{feed}")
            self._feed = feed
        self._add(mode, *body)
        self._mode = mode

    def _feed_of(self, words: PartWords, part: MotionPart) -> str | None:
        """Digits of the F word of a part."""
        motions, k = self._program.motions, words.motion
        if part.crossing is not None and part.crossing.feed is not None and not self._unfed[k]:
            return self._crossing_feed(words, part, part.crossing.feed)
        if words.modal.feed_mode == 93:
            whole = float(motions.duration[k]) * (part.high - part.low)
            if motions.kind[k] == RAPID or (part.high - part.low == 1.0 and part.duration is None):
                return self._feeds.after(words.block)
            return self._inverse(MINUTE / (part.duration or whole))
        if part.feed < motions.feeds.at(k):
            return self._crossing_feed(words, part, part.feed)
        if part.duration is None or self._unfed[k]:
            return self._feeds.after(words.block)
        speed = part_length(motions, k, part.low, part.high) / part.duration
        # An arc whose radii disagree by their last digit is longer than the one that was planned.
        own = motions.feeds.at(k)
        return self._digits((min(speed, own) if own > 0.0 else speed) / words.modal.units * MINUTE)

    def _crossing_feed(self, words: PartWords, part: MotionPart, feed: float) -> str:
        """Digits of the F word of a block of a crossing."""
        if words.modal.feed_mode == 93:
            length = part_length(self._program.motions, words.motion, part.low, part.high)
            own = float(self._program.motions.duration[words.motion]) / part_length(
                self._program.motions, words.motion, 0.0, 1.0
            )
            return self._inverse(MINUTE / max(own * length, length / feed))
        return self._digits(self._apart(feed / words.modal.units * MINUTE, words.block))

    def _apart(self, feed: float, block: int) -> float:
        """Return a feed below, never the program's own, so that no controller joins blocks of the two."""
        found = self._below(feed)
        if found == self._program.feed_after(block):
            found = self._below(found * (1.0 - 10.0**-_FEED_DIGITS * 5.0))
        return found

    def _path_mode(self, task: MotionEdit, part: MotionPart, modal: Modal) -> None:
        """Let the controller blend blocks of known time, and of crossings, in an exact-stop program, and no others."""
        assert self._change is not None
        wanted, tolerance = modal.path, 0.0
        if part.duration is not None:
            tolerance = self._tolerance
        elif task.crossed and part.high < 1.0 and part.high not in task.stops:
            tolerance = self._rounding
        if tolerance > 0.0 and self._program.motions.exact[task.motion]:
            if self._dialect.syntax.path_mode is None:
                number = self._program.line_number(self._program.motions.block[task.motion])
                where = f"{self._program.name}:{number}"
                raise InputError(where, f"{self._dialect.name} cannot leave exact-stop mode for a feed dip")
            wanted = self._dialect.syntax.path_mode(tolerance * MM / modal.units)
        if wanted is not None and wanted != self._path:
            self._change.lines.append(wanted)
            self._path = wanted

    def _stop(self, stop: StopEdit, words: PartWords, share: float, offset: IntArray) -> None:
        """Write a dwell, and a jog and a dwell for each shift; `offset` is carried on."""
        assert self._change is not None
        modal = words.modal
        step = modal.units * 10.0**-self._decimals
        self._change.label += stop_label(stop, offset, step)
        self._rest(stop.pause)
        # Each sum is rounded, not each step: what is out and back again then comes back.
        base, moved = offset.copy(), np.zeros(3)
        unfed = bool(self._unfed[words.motion])
        # Where rapids take the feed in force and none is known yet, nothing could set it back behind a jog.
        rapid = stop.rapid or (self._dialect.syntax.rapid_feed and self._feeds.after(words.block) is None and not unfed)
        # The first F of a chain without a known feed may stand behind its first rapid. A feed a turn moves nothing
        # while the spindle stands, as it may in the air.
        in_air = stop.approach or self._program.motions.kind[words.motion] == RAPID or modal.spindle == "M5"
        rapid |= unfed and in_air
        for shifts in stop.moves:
            for shift in shifts:
                axis = AXES.index(shift.axis)
                moved[axis] += shift.travel
                offset[axis] = base[axis] + round(moved[axis] / step)
            places = [words.jog(AXES.index(shift.axis), offset, share) for shift in shifts]
            if rapid or unfed:
                self._mode = "G0" if rapid else "G1"
                self._add(self._mode, *places)
                self._rest(shifts[-1].pause)
                continue
            rate = 1.0 / max(abs(shift.travel) / shift.velocity for shift in shifts)
            if modal.feed_mode != 93:
                rate *= math.hypot(*(shift.travel for shift in shifts)) / modal.units
            # A jog with the feed of the lines beside it LinuxCNC makes one with them, as far as its path mode allows.
            joins = linking_of(modal.path, modal.units) > 0.0
            below = self._apart(rate * MINUTE, words.block) if joins else self._below(rate * MINUTE)
            feed = self._inverse(rate * MINUTE) if modal.feed_mode == 93 else self._digits(below)
            new = [] if feed == self._feed and modal.feed_mode != 93 else [f"F{feed}"]
            self._feed, self._mode = feed, "G1"
            self._add("G1", *places, *new)
            self._rest(shifts[-1].pause)

    def _rest(self, pause: float) -> None:
        """Write a dwell, if there is one."""
        assert self._change is not None
        if pause >= SYNCHRONISED:
            words = self._dialect.dwell_words(dwell_time(pause))
            self._change.lines += self._joined(*words).split("\n")

    def _digits(self, value: float) -> str:
        return self._dialect.numbers.feed(value)

    def _below(self, feed: float) -> float:
        return _lowered(feed, self._dialect.numbers.feed_decimals)

    def _inverse(self, value: float) -> str:
        """Digits of an F under G93, a time."""
        return self._dialect.numbers.inverse_time(value)

    def _joined(self, *words: str) -> str:
        return ("" if self._dialect.syntax.terse else " ").join(words)
