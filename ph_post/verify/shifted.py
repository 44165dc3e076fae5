"""Check the offsets of axes beside X, Y and Z, and of holes, which a program has from before those of X, Y and Z."""

from __future__ import annotations

import math
import re
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from decimal import Decimal
from itertools import product

import msgspec
import numpy as np

from ph_post.gcode.further import FurtherMoves, further_moves
from ph_post.gcode.holes import ACROSS, goes_on, hole_runs, place_before
from ph_post.gcode.program import PartProgram
from ph_post.types import Machine
from ph_post.units import DEGREE, LENGTHS
from ph_post.verify.states import INVERSE_TIME, StateNumbering
from ph_post.verify.verdict import Findings, Verdict, quoted

_COMMENT = re.compile(rb"(?:\(|; )(.*?)\)?\s*")
_MARK = "ph-post-axes: "
_HEAD = re.compile(r"\S+ compensated (?:axes beside X, Y and Z|(?:axes beside X, Y and Z and )?X and Y of holes)", re.I)
_OFFSET = re.compile(r"offset ([ABCUVWXY]) ([-+]?\d*\.?\d+) (deg|mm|inch)", re.IGNORECASE)
_ORIGINAL = re.compile(r"original sha256 ([0-9a-f]{64})", re.IGNORECASE)
_MACHINE = re.compile(r"machine (.*), sha256 ?([0-9a-f]*)", re.IGNORECASE)
_OTHERS = re.compile(r"options sha256 [0-9a-f]*|take-up [ABCUVW] [.\d]+ (?:deg|mm|inch)|\d+ short moves", re.IGNORECASE)
_BESIDE = re.compile(r"take-up ([XY]) ([.\d]+) (mm|inch)", re.IGNORECASE)
_ADDED = re.compile(r"\+(\d+) -0 (.*)", re.IGNORECASE)
_UNDO = re.compile(r"undo \d+/\d+ [A-Za-z0-9+/=]+", re.IGNORECASE)
_MORE = re.compile(rb"(?:\(|; ) {2}(.*?)\)?\s*")
_BAND = 0.1
"""Part of its backlash by which an axis may turn back and be left where it is."""

_SAME = 1e-9
"""Angles [rad] and lengths [m] that differ by no more are the same."""


class ShiftedAxis(msgspec.Struct, frozen=True, kw_only=True):
    """Declared offset of an axis: its number, 0 to either side or the side that alone has it, its unit [rad, m]."""

    number: Decimal
    side: int
    unit: float

    @property
    def offsets(self) -> set[Decimal]:
        """What the axis may carry, as the numbers of its words have it."""
        one = self.number
        return {Decimal(0), one * self.side} if self.side else {Decimal(0), one, -one}

    @property
    def reach(self) -> tuple[float, float]:
        """How far below and above its motor the table may be, as its places are referred."""
        way = float(self.number) * self.unit
        return (way if self.side >= 0 else 0.0, way if self.side <= 0 else 0.0)


class _Layer(msgspec.Struct, kw_only=True):
    """What a program declares, and which of its lines are the original's and which were added, by label."""

    axes: dict[str, ShiftedAxis]
    original: str
    machine: str
    own: list[int]
    added: dict[int, str]
    beside: dict[str, float]


def verify_shifted(original: PartProgram, shifted: PartProgram, machine: Machine | None = None) -> Verdict:
    """Check that a program is its original but for declared offsets of axes beside X, Y and Z.

    Every axis is followed with an ideal backlash: at all places at which something is cut the table is where the
    original names it, or as far off as in the original; X, Y and Z, modes, feeds and commands are the same.

    Parameters
    ----------
    original, shifted : PartProgram
    machine : Machine, optional
        The declaration is held to its lost motion.
    """
    findings = Findings()
    layer = _read(shifted, findings)
    if layer.original.lower() != original.digest:
        findings.add("original", "the header names another original", expected=original.digest, got=layer.original)
    if len(layer.own) != original.blocks:
        what = f"{len(layer.own)} lines are not added, in place of the {original.blocks} lines of the original"
        findings.add("lines", what)
    if findings.verdict().found:
        return findings.verdict()
    if machine is not None:
        _check_machine(layer, machine, findings)
    _check_lines(original, shifted, layer, findings)
    _check_rest(original, shifted, layer, findings)
    for letter, axis in layer.axes.items():
        if letter in ACROSS:
            _follow_holes(original, shifted, layer, letter, findings)
        else:
            _Follower(original, shifted, layer, letter, axis, findings).check()
    return findings.verdict()


def _fact(program: PartProgram, line: int) -> str:
    """Words of a comment line of the header or of a mark; empty where it is none."""
    found = _COMMENT.fullmatch(program.text(line))
    text = "" if found is None else found[1].decode("latin-1")
    return text[len(_MARK) :] if text.lower().startswith(_MARK) else ""


def _read(shifted: PartProgram, findings: Findings) -> _Layer:
    """Tell the lines of the original from those of the header, of marks and of what they add."""
    layer = _Layer(axes={}, original="", machine="", own=[], added={}, beside={})
    line, counted = 0, 0
    while line < shifted.blocks:
        fact, first = _fact(shifted, line), line
        line += 1
        if not fact:
            layer.own.append(first)
            continue
        if mark := _ADDED.fullmatch(fact):
            layer.added |= dict.fromkeys(range(line, line + int(mark[1])), mark[2])
            line += int(mark[1])
            counted += int(mark[1])
            continue
        taken = _take_fact(layer, fact)
        # What is too long for its line goes on in the next one.
        while (not taken or fact.lower().endswith("sha256")) and line < shifted.blocks:
            more = _MORE.fullmatch(shifted.text(line))
            if more is None:
                break
            fact += " " + more[1].decode("latin-1").strip()
            taken, line = _take_fact(layer, fact), line + 1
        if not taken:
            findings.add("header", f"the header has an unknown line: {fact[:40]}", compensated=first)
    findings.count("moves of further axes", counted)
    return layer


def _take_fact(layer: _Layer, fact: str) -> bool:
    """Take a line of the header; False where it is none."""
    if found := _OFFSET.fullmatch(fact):
        unit = DEGREE if found[3].lower() == "deg" else float(LENGTHS[found[3].lower()])
        side = (found[2][0] == "+") - (found[2][0] == "-")
        layer.axes[found[1].upper()] = ShiftedAxis(number=abs(Decimal(found[2])), side=side, unit=unit)
    elif found := _BESIDE.fullmatch(fact):
        layer.beside[found[1].upper()] = float(found[2]) * float(LENGTHS[found[3].lower()])
    elif found := _ORIGINAL.fullmatch(fact):
        layer.original = found[1]
    elif found := _MACHINE.fullmatch(fact):
        layer.machine = found[2].lower()
    else:
        return any(pattern.fullmatch(fact) for pattern in (_HEAD, _OTHERS, _UNDO))
    return True


def _check_machine(layer: _Layer, machine: Machine, findings: Findings) -> None:
    if layer.machine and machine.digest and not machine.digest.startswith(layer.machine):
        what = "the axes beside X, Y and Z were compensated for another machine"
        findings.add("machine", what, expected=machine.name, got=layer.machine)
    for letter, declared in layer.axes.items():
        axis = (machine.axes if letter in ACROSS else machine.further).get(letter)
        lost = 0.0 if axis is None or axis.loop.encloses_backlash else axis.gap.lost_motion
        side = 0 if axis is None else -axis.reference_side
        way = float(declared.number) * declared.unit * (1.0 if declared.side else 2.0)
        places = -int(declared.number.as_tuple().exponent)
        if side != declared.side or abs(way - lost) > 2.0 * declared.unit * 10.0 ** -max(places, 3):
            findings.add("machine", f"the offset of {letter} is not that of its lost motion", got=str(declared.number))


def _changed_numbers(
    first: Sequence[bytes], second: Sequence[bytes]
) -> Iterator[tuple[str, tuple[int, int], tuple[bytes, bytes]]]:
    """Return the letters of numbers that differ in a line, where their words begin in both, and the numbers.

    `first` and `second` are text, letter and number in turn.
    """
    one = other = 0
    for text, name, before, after in zip(first[0::3], first[1::3], first[2::3], second[2::3], strict=False):
        one, other = one + len(text), other + len(text)
        if before != after:
            yield name[:1].decode().upper(), (one, other), (before, after)
        one, other = one + len(name + before), other + len(name + after)


def _value(program: PartProgram, block: int, at: int, number: bytes) -> Decimal:
    """Return the number of a word that stands `at` bytes behind the begin of its line, as its controller counts it."""
    words, start = program.words, int(program.lines[block]) + at
    found = [word for word in program.words_of(block) if words.start[word] == start and words.decimals[word] > 0]
    if b"." in number or not found:
        return Decimal(number.decode())
    # Without a point it counts in increments.
    return Decimal(number.decode()).scaleb(-int(words.decimals[found[0]]))


def _check_lines(original: PartProgram, shifted: PartProgram, layer: _Layer, findings: Findings) -> None:
    """Demand the same bytes but for numbers of declared axes, which differ by an offset or a change of it, exactly."""
    letters = "".join(layer.axes).encode()
    holes = {hole.block for run in hole_runs(original) if not run.why for hole in run.holes}
    number = re.compile(rb"([%s][ \t]*)([-+]?(?:\d+\.?\d*|\.\d+))" % letters, re.IGNORECASE) if letters else None
    carried = {letter: (axis.offsets, _changes(axis)) for letter, axis in layer.axes.items()}
    for old, new in enumerate(layer.own):
        one, other = original.text(old), shifted.text(new)
        if not one.endswith((b"\n", b"\r")):
            other = other.rstrip(b"\r\n")  # the comments behind the last line need its end
        if one == other:
            continue
        # Text, letter and number in turn.
        first, second = ([one], [other]) if number is None else (number.split(one), number.split(other))
        if first[0::3] != second[0::3] or first[1::3] != second[1::3]:
            what = "the line differs outside what is declared"
            findings.add("text", what, original=old, compensated=new, expected=quoted(one), got=quoted(other))
            continue
        relative = not shifted.modal_after(new).absolute
        for letter, at, (before, after) in _changed_numbers(first, second):
            if letter in ACROSS and old not in holes:
                what = f"{letter} is shifted beside the holes of drilling cycles"
                findings.add("offset", what, original=old, compensated=new, expected=quoted(one), got=quoted(other))
            change = _value(shifted, new, at[1], after) - _value(original, old, at[0], before)
            if change not in carried[letter][relative]:
                what = f"{letter} is shifted by something other than the declared offset"
                findings.add("offset", what, original=old, compensated=new, expected=str(layer.axes[letter].number))
    for line in layer.added:
        own = {chr(shifted.words.letter[word]) for word in shifted.words_of(line)}
        if own & {*ACROSS}:
            behind = next((own for own in layer.own if own > line and shifted.words_of(own)), line)
            if not _is_empty_cycle(shifted, line) or _plane(shifted, line) != _plane(shifted, behind):
                findings.add("text", "an added line is more than a cycle from R to R", compensated=line)
            continue
        if not (own & layer.axes.keys() and own <= {*layer.axes, "G", "F"}):
            findings.add("text", "an added line is more than a move of such an axis", compensated=line)


def _is_empty_cycle(program: PartProgram, line: int) -> bool:
    """Return whether a line is a cycle that drills nothing: from the plane R to R."""
    words = program.words
    own = [(chr(words.letter[word]), float(words.value[word])) for word in program.words_of(line)]
    values = dict(own)
    modes = {value for letter, value in own if letter == "G"}
    whole = {"G", "R", "Z"} <= values.keys() <= {*"FGRXYZ"} and 81.0 in modes <= {81.0, 90.0, 98.0, 99.0}
    return whole and values["R"] == values["Z"]


def _plane(program: PartProgram, line: int) -> float | None:
    """Return the R of a line."""
    words = program.words
    found = [float(words.value[word]) for word in program.words_of(line) if words.letter[word] == ord("R")]
    return found[0] if found else None


def _changes(axis: ShiftedAxis) -> set[Decimal]:
    """By what an increment may differ: a change of the offset."""
    return {a - b for a, b in product(axis.offsets, axis.offsets)}


def _check_rest(original: PartProgram, shifted: PartProgram, layer: _Layer, findings: Findings) -> None:
    """Demand the same motions of X, Y and Z, and behind each line the same modes and F."""
    place = np.full(shifted.blocks, -1, dtype=np.int64)
    place[layer.own] = np.arange(original.blocks)
    one, other = original.motions, shifted.motions
    same = np.array_equal(one.block, place[other.block])
    for name in ("kind", "start", "end", "plane", "center", "angle", "feed", "duration", "exact"):
        same = same and np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True)
    if not same:
        findings.add("path", "X, Y and Z do not move as in the original")
    known = StateNumbering()
    unlike = known.number(shifted)[shifted.state[layer.own]] != known.number(original)[original.state]
    timed = np.array([modal.feed_mode == INVERSE_TIME for modal in original.modal])[original.state]
    feeds = np.isclose(
        shifted.feeds.of(np.array(layer.own, dtype=np.int64)), original.feed_word, rtol=0.0, atol=0.0, equal_nan=True
    )
    for old in np.flatnonzero(unlike | ~(feeds | timed))[:1].tolist():
        what = "the modal state after the block is another one"
        findings.add("state", what, original=old, compensated=layer.own[old])


def _follow_holes(  # noqa: C901, PLR0912
    original: PartProgram, shifted: PartProgram, layer: _Layer, letter: str, findings: Findings
) -> None:
    """Demand that an axis is where the original names it at every hole of a run that carries its offset.

    Nobody knows on which side of its backlash it is before such a run. No offset lasts into what goes on from there.
    """
    (below, above), words = layer.axes[letter].reach, shifted.words
    line, back = {new: old for old, new in enumerate(layer.own)}, layer.own
    for run in hole_runs(original):
        first = back[run.first - 1] + 1 if run.first else 0
        place, table, wrong, carries = place_before(original, run.first, letter), None, None, False
        beside = list[tuple[float, int]]()
        motor = place
        for block in range(first, back[run.last] + 1):
            old = line.get(block)
            if old is None and block not in layer.added:
                continue
            own = {chr(words.letter[word]): word for word in shifted.words_of(block)}
            if not own:
                continue
            if table is None and not math.isnan(motor):
                table = motor - below, motor + above
            if letter in own:
                motor = float(words.value[own[letter]]) * shifted.modal_after(block).units
                low, high = (motor - below, motor + above) if table is None else table
                table = min(max(low, motor - below), motor + above), min(max(high, motor - below), motor + above)
            if old is None:
                carries = True
                beside.append((motor, block))
                continue
            named = {chr(original.words.letter[word]): word for word in original.words_of(old)}
            if letter in named:
                place = float(original.words.value[named[letter]]) * original.modal_after(old).units
            carries |= not abs(motor - place) <= _SAME and not math.isnan(place)
            band = _BAND * (below + above) + _SAME
            for one, added in beside:
                if abs(one - place) > layer.beside.get(letter, 0.0) + below + above + _SAME:
                    findings.add("offset", f"{letter} goes farther beside a hole than declared", compensated=added)
            beside.clear()
            if table is not None and any(abs(one - place) > band for one in table):
                wrong = block if wrong is None else wrong
        if carries and wrong is not None:
            findings.add("offset", f"{letter} is beside its place at a hole", compensated=wrong)
        if carries and goes_on(original, run.last, frozenset(letter)) is not None and motor != place:
            findings.add("return", f"the offset of {letter} lasts into what goes on from there", compensated=wrong)


class _Follower:
    """Follows the table of one axis through both programs."""

    def __init__(
        self,
        original: PartProgram,
        shifted: PartProgram,
        layer: _Layer,
        letter: str,
        axis: ShiftedAxis,
        findings: Findings,
    ) -> None:
        self._layer, self._letter, self._findings = layer, letter, findings
        self._new, self._old = further_moves(shifted).get(letter), further_moves(original).get(letter)
        self._line = {new: old for old, new in enumerate(layer.own)}
        self._below, self._above = axis.reach
        self._table: tuple[float, float] | None = None
        self._carries = False

    def check(self) -> None:
        """Compare the places of the table with those that the original names."""
        old, new = self._old, self._new
        if old is None or new is None:
            self._say("is declared, and does not move", 0)
            return
        row = {int(block): n for n, block in enumerate(old.block)}
        chain, wanted, before = -1, math.nan, -1
        for k in range(new.block.size):
            line = int(new.block[k])
            n = row.get(self._line.get(line, -1))
            if n is None and line not in self._layer.added:
                self._say("moves where the original does not", line)
                return
            if n is not None and int(old.chain[n]) != chain:
                self._ends(new, k, wanted)
                self._table, self._carries, chain = None, False, int(old.chain[n])
            if n is None:
                self._added(new, k, before)
                continue
            self._own(old, new, n, k)
            wanted, before = float(old.end[n]), k
        self._ends(new, new.block.size, wanted)

    def _say(self, what: str, line: int) -> None:
        self._findings.add("offset", f"{self._letter} {what}", compensated=line)

    def _ends(self, new: FurtherMoves, k: int, wanted: float) -> None:
        """Demand that nothing lasts beyond a chain."""
        if k and not abs(new.end[k - 1] - wanted) <= _SAME and not math.isnan(wanted):
            self._findings.add(
                "return", f"the offset of {self._letter} is not taken back", compensated=int(new.block[k - 1])
            )

    def _go(self, motor: float) -> None:
        """Take the table along to where the motor is."""
        below, above = motor - self._below, motor + self._above
        low, high = (below, above) if self._table is None else self._table
        self._table = min(max(low, below), above), min(max(high, below), above)

    def _is_at(self, place: float) -> bool:
        band = _BAND * (self._below + self._above) + _SAME
        return self._table is not None and all(abs(one - place) <= band for one in self._table)

    def _added(self, new: FurtherMoves, k: int, before: int) -> None:
        """Follow a move of its own: its table rests, but behind a rapid of this axis, where it comes from beyond."""
        line, table = int(new.block[k]), self._table
        if self._layer.added[line].lower().endswith("approach"):
            last = self._layer.own[bisect_left(self._layer.own, line) - 1]
            if before < 0 or new.block[before] != last or not (new.rapid[before] and new.rapid[k]):
                self._say("comes from beyond where it did not just move in a rapid", line)
            self._go(float(new.end[k]))
            return
        self._go(float(new.end[k]))
        if table is None or self._table is None or not np.allclose(self._table, table, rtol=0.0, atol=_SAME):
            self._say("leaves its place on a move of its own", line)

    def _own(self, old: FurtherMoves, new: FurtherMoves, n: int, k: int) -> None:
        """Follow a move of the original's."""
        line, begin, end = int(new.block[k]), float(old.start[n]), float(old.end[n])
        if math.isnan(end) and math.isnan(new.end[k]):
            self._table = None
            return
        if self._table is None and not math.isnan(begin):
            self._go(float(new.start[k]))
        beside = not (old.alone[n] or old.rapid[n])
        plain = math.isnan(begin) or abs(new.start[k] - begin) <= _SAME
        if beside and not plain and not self._is_at(begin):
            self._say("begins a cut beside its place", line)
        self._go(float(new.end[k]))
        self._carries |= not abs(new.end[k] - end) <= _SAME
        # In the air it may be elsewhere: before it comes from beyond, and behind the last cut.
        last = k + 1 == new.block.size or self._layer.added.get(int(new.block[k + 1]), "").lower().endswith("approach")
        near = -self._above - _SAME <= new.end[k] - end <= self._below + _SAME
        free = not self._carries or (bool(new.rapid[k]) and last and near)
        if not (free or self._is_at(end)):
            self._say("ends beside its place", line)
