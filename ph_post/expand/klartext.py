"""Run a conversational program of Heidenhain, and write out what it does: Q parameters, jumps, labels and cycles.

HEIDENHAIN, iTNC 530 User's Manual, Conversational (340 49x): "Subprograms and Program Section Repeats", "Q Parameters";
TNC 620 User's Manual (81760x): "Programming: Q parameters", formulas entered directly. What a control has in Q100 to
Q199, and what no line has set, is never guessed.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import partial
from typing import ClassVar, Final

from ph_post.expand.faults import ExpandError, NotExpandableError
from ph_post.expand.klartext_cycles import OF_THEIR_OWN, KlartextCycle, values_of
from ph_post.expand.klartext_lines import (
    ENDS,
    IN_INCHES,
    OWN_FEED,
    SIDE,
    KlartextBlock,
    KlartextStore,
    parameter_of,
    read_blocks,
    tnc_number,
    value_of,
)
from ph_post.expand.lines import Source
from ph_post.expand.progress import Progress, WrittenLines, check_turn

_NESTED: Final = 19
"""Subprograms that may call each other (TNC 620; 8 of an iTNC 530)."""

_NAME: Final = r"(\"[^\"]*\"|[^\s\"]+)"
_CALL: Final = re.compile(rf"CALL\s+LBL\s*{_NAME}(?:\s+REP\s*(?:(\d+)\s*(?:/\s*\d+)?)?)?$")
"""The second number of a repeat is how many are left, as the control shows it. REP without a number repeats nothing:
posts for old controls write it where they call a subprogram."""
_LABEL: Final = re.compile(rf"LBL\s*{_NAME}$")
_JUMP: Final = re.compile(rf"FN\s*(?:9|10|11|12)\s*:\s*IF\s+(\S+)\s+(EQU|NE|GT|LT)\s+(\S+)\s+GOTO\s+LBL\s*{_NAME}$")
_SET: Final = re.compile(r"(?:FN\s*(?:[0-8]|13)\s*:\s*)?(Q[LR]?\d+)\s*=\s*(.*)$")
_OWN_CYCLE: Final = re.compile(r"CYCL\s+DEF\s+(?:[3-9]|1\d)\d\d")
"""Cycles of machine builders, and those that measure: they may set parameters."""
_QUIET: Final = re.compile(r"$|\*|(?:BLK\s+FORM|TOOL\s+DEF|STOP|BEGIN\s+PGM|END\s+PGM)\b|QS\d+\s*=")
"""Blocks that set nothing and call nothing."""
_WITH_VALUES: Final = re.compile(r"(?:TOOL\s+CALL|CYCL\s+CALL|FUNCTION|PLANE)\b|M\s*\d")
_ODD_FLOW: Final = re.compile(r"CALL\s+LBL|FN\s*(?:9|10|11|12)\s*:|GOTO\b")
_ASSIGNED: Final = re.compile(r"(?<![A-Z])(Q[LR]?\d+)\s*=")
_MOVES: Final = re.compile(r"(?:LP|LN|L|CTP|CT|CC|CR|CP|C|APPR|DEP|RND|CHF)(?![A-Z]|\s*=)|L(?=I?[XYZ]\s*[-+\d.Q])")
_FEED: Final = re.compile(r"(?<![A-Z])F\s*(MAX|AUTO|[ZTU]?\s*[-+]?(?:[\d.,]+|Q[LR]?\d+))")
_CORNER: Final = re.compile(r"(?:RND|CHF)(?![A-Z])")
"""A corner, whose feed is its own."""
_PER_TURN: Final = re.compile(r"(?<![A-Z\d])M\s*136(?!\d)")
_PER_MINUTE: Final = re.compile(r"(?<![A-Z\d])M\s*137(?!\d)")
_TOOL: Final = re.compile(r"TOOL\s+CALL\b\s*(?:\"[^\"]*\"|Q[LRS]?\d+|[\d.]+)?\s*([XYZ])\b")
_USED: Final = re.compile(r"(I?[XYZABCUVW]|I?P[AR]|(?<![A-Z])[A-Z]{1,2})?(\s*)([-+]?)Q([LR]?)(\d+)(?!\d|\s*=)")
_PLACED: Final = frozenset("XYZABCUVW")
_CYCLE_CALL: Final = re.compile(r"CYCL\s+CALL\b(?!\s+(?:POS|PAT))|(?<![A-Z\d])M\s*99(?!\d)")
_CYCLE: Final = re.compile(r"CYCL\s+DEF\s+(\d+)(?:\.(\d+))?")
_MODAL_CALL: Final = re.compile(r"(?<![A-Z\d])M\s*89(?!\d)")
_AT_THE_END: Final = re.compile(r"(?<![A-Z\d])M\s*0*(?:0|1|2|5|9|30)(?!\d)")
_COMPARED: Final[dict[str, Callable[[float], bool]]] = {
    "EQU": lambda difference: difference == 0.0,
    "NE": lambda difference: difference != 0.0,
    "GT": lambda difference: difference > 0.0,
    "LT": lambda difference: difference < 0.0,
}
_CLOSE: Final = 1e-7


class KlartextRunner:
    """Runs a program.

    Parameters
    ----------
    source : Source
        The main program; what stands behind its end stays.
    """

    begun: ClassVar[None] = None

    def __init__(self, source: Source) -> None:
        self.store = KlartextStore()
        self.notes: list[str] = []
        self.changed = False
        self.lines: list[str] = []
        self._source, self._name = source, source.name
        self._blocks = read_blocks(source.texts)
        self._labels: dict[str, int] = {}
        for index, block in enumerate(self._blocks):
            found = _LABEL.match(block.words)
            if found is not None and found[1] != "0":
                self._labels.setdefault(found[1], index)
        self._at = 0
        self._calls: list[int] = []
        self._entered = 0
        self._left: dict[int, int] = {}
        self._heads: dict[int, object] = {}
        self._seen: set[int] = set()
        self._cycle: KlartextCycle | None = None
        self._axis = "Z"
        self._feed: str | None = ""
        self._side = "0"
        self._per_turn = False
        self._modal = any(_MODAL_CALL.search(block.words) for block in self._blocks)
        self._inch = any(IN_INCHES.match(block.words) for block in self._blocks[:3])
        self._rest: dict[str, float] = {}

    def run(self) -> WrittenLines:
        """Return the lines that the program comes to.

        Raises
        ------
        ExpandError
            Where it cannot be written out, with its file and line.
        """
        progress = Progress(self._source)
        while self._at < len(self._blocks):
            block = self._blocks[self._at]
            place = self._name, block.first + 1, len(self.lines), len(block.lines)
            if progress.step(partial(self._step, self._at), *place):
                break
        behind = self._blocks[self._at].first if self._at < len(self._blocks) else len(self._source.texts)
        return progress.written(self.lines, behind)

    def _step(self, index: int) -> bool:
        block = self._blocks[index]
        self._at = index + 1
        words = block.words
        if self._flows(index, block):
            return False
        ends = ENDS.search(words) is not None
        if words.startswith("END PGM") and self._calls:
            raise ExpandError("the program ends within a subprogram", expected="LBL 0")
        given = _SET.match(words)
        if given is not None:
            self._set(index, block, given)
        elif block.slash:
            self._pass(index, block)
            self._lose()
        elif _QUIET.match(words):
            self._keep(index, block)
        elif words.startswith("CYCL DEF") and not _OWN_CYCLE.match(words):
            self._define(index, block)
        elif _MOVES.match(words) or _WITH_VALUES.match(words):
            self._write(index, block)
        else:
            self._pass(index, block)
            if re.match(r"FN\s*\d+\s*:", words) is None:
                self.store.forget()
                self._lose()
                self._cycle = None
        return ends

    # ------------------------------------------------------------------ flow

    def _flows(self, index: int, block: KlartextBlock) -> bool:
        """Follow a label, a call or a jump; return False where a block is none."""
        words = block.words
        label, call, jump = _LABEL.match(words), _CALL.match(words), _JUMP.match(words)
        if label or call or jump:
            if block.slash:
                raise NotExpandableError("a line with a slash runs or not as the control's switch says")
            self.changed = True
            if label is not None and label[1] == "0" and self._calls:
                self._at = self._calls.pop()
            elif call is not None:
                self._call(index, call[1], call[2])
            elif jump is not None and self._holds(jump[1], jump[2], jump[3]):
                self._jump(index, jump[4])
            return True
        if _ODD_FLOW.search(words):
            raise NotExpandableError(f"a part of the program's flow that is not followed: {words[:40]}")
        return False

    def _call(self, index: int, name: str, times: str | None) -> None:
        target = self._find(name)
        if times is None:
            if len(self._calls) == _NESTED:
                raise ExpandError(f"subprograms that call each other more than {_NESTED} deep")
            self._calls.append(index + 1)
            self._entered += 1
            self._at = target
            return
        if target > index:
            raise NotExpandableError("a repeat of a part that is not whole")
        left = self._left.pop(index, int(times))
        if left > 0:
            self._left[index] = left - 1
            self._at = target

    def _jump(self, index: int, name: str) -> None:
        self._at = self._find(name)
        if self._at <= index:
            state = (self.store.version, self._entered, tuple(self._left.items()))
            check_turn(self._heads, index, state)

    def _find(self, name: str) -> int:
        if re.match(r"Q[LRS]?\d", name):
            raise NotExpandableError("a label that is computed")
        found = self._labels.get(name)
        if found is None:
            raise ExpandError("the label is not there", got=f"LBL {name}")
        return found

    def _holds(self, left: str, sign: str, right: str) -> bool:
        difference = self._value(left) - self._value(right)
        self.store.require(difference, "a condition")
        if 0.0 < abs(difference) < _CLOSE:
            raise NotExpandableError("a condition of two numbers that are equal but for rounding")
        return _COMPARED[sign](difference)

    # ------------------------------------------------------------------ values

    def _value(self, text: str) -> float:
        return value_of(text, self.store)

    def _set(self, index: int, block: KlartextBlock, given: re.Match[str]) -> None:
        key = parameter_of(given[1])
        if block.slash:
            self.store.forget_one(key)
            self._keep(index, block)
            return
        value = self._value(given[2])
        self.store.put(key, value)
        plain = re.fullmatch(r"[-+]?[\d.,]+", given[2]) is not None
        text = None if math.isnan(value) or plain else f"FN 0: {given[1]} = {tnc_number(value, 7, sign=True)}"
        self._keep(index, block, text)

    def _pass(self, index: int, block: KlartextBlock) -> None:
        """Keep a line that is not followed, or that runs or not as a switch says; it may set what it names."""
        for found in _ASSIGNED.finditer(block.words):
            self.store.forget_one(parameter_of(found[1]))
        self._keep(index, block)

    def _lose(self) -> None:
        """Forget what holds for cycles: feed, radius compensation and the tool's axis."""
        self._feed, self._side, self._axis = None, "", ""

    def _write(self, index: int, block: KlartextBlock) -> None:
        """Write a block with the values of its parameters, and the cycle that it calls."""
        words = block.words
        text = self._with_values(words)
        tool, side = _TOOL.match(words), SIDE.search(words)
        self._axis = tool[1] if tool else self._axis
        self._side = side[1] if side else self._side
        self._per_turn = bool(_PER_TURN.search(words)) or (self._per_turn and not _PER_MINUTE.search(words))
        for feed in () if _CORNER.match(words) else _FEED.finditer(OWN_FEED.sub(" ", text)):
            if feed[1] != "MAX":
                self._feed = None if "Q" in feed[1] else feed[0]
        written = self._drilled(block) if _CYCLE_CALL.search(words) else None
        if written is None:
            self._keep(index, block, None if text == words else text)
            return
        text = " ".join(_CYCLE_CALL.sub(" ", text).split())
        self.changed = True
        if text not in ("", "L"):
            self._keep(index, block, text)
        self.lines += written
        if self._feed:
            self.lines.append(f"L {self._feed}")

    def _with_values(self, words: str) -> str:
        def put(found: re.Match[str]) -> str:
            """Put the value of a parameter in its place; the parameter stays where its value is not known."""
            value = self.store.number(parameter_of(f"Q{found[4]}{found[5]}"))
            if math.isnan(value):
                return found[0]
            value = -value if found[3] == "-" else value
            letters = found[1] or ""
            decimals = 5 if self._inch else 4
            placed = bool(found[3]) or letters.lstrip("I")[:1] in _PLACED or letters.lstrip("I") in ("PA", "PR")
            if letters[:1] == "I" and letters[1:] in _PLACED:
                # What is rounded off an increment goes into the next one.
                value += self._rest.get(letters[1:], 0.0)
                self._rest[letters[1:]] = value - round(value, decimals)
            elif letters in _PLACED:
                self._rest.pop(letters, None)
            return f"{letters}{found[2]}{tnc_number(value, decimals, sign=placed)}"

        return _USED.sub(put, words)

    # ------------------------------------------------------------------ cycles

    def _define(self, index: int, block: KlartextBlock) -> None:
        """Keep the definition of a cycle, with values; old ones stand in several blocks."""
        text = self._with_values(block.words)
        begin = _CYCLE.match(text)
        number, part = (int(begin[1]), begin[2] or "") if begin is not None else (-1, "")
        if part in ("", "0") and number not in OF_THEIR_OWN:
            self._cycle = KlartextCycle(number=number)
        ours = self._cycle if self._cycle is not None and self._cycle.number == number else None
        if ours is not None and part:
            ours.add(int(part), text)
        for key, value in values_of(text):
            self.store.put(key, math.nan if math.isinf(value) else value)
            if ours is not None:
                ours.values[key] = value
        self._keep(index, block, None if text == block.words else text)

    def _drilled(self, block: KlartextBlock) -> list[str] | None:
        """Return the moves of the cycle that is called; None where its call stays, with a note why."""
        if self._cycle is None:
            self._note(block, "no cycle is known that it calls")
            return None
        try:
            if self._modal:
                raise NotExpandableError("whether M89 calls cycles is a setting of the control")
            if self._side != "0" or self._feed is None or not self._axis:
                raise NotExpandableError("feed, radius compensation or the tool's axis are not known, or it is on")
            if self._inch:
                raise NotExpandableError("the program is in inches")
            if self._per_turn:
                raise NotExpandableError("F is for a turn of the spindle (M136)")
            if _AT_THE_END.search(block.words):
                raise NotExpandableError("an M function at the end of the block that calls it")
            for key, value in self._cycle.values.items():
                now = self.store.number(key)
                if now != value and not (math.isnan(now) and math.isinf(value)):
                    raise NotExpandableError(f"Q{key} is not known, or was set behind the definition")
            return self._cycle.moves(self._axis)
        except NotExpandableError as error:
            self._note(block, error.what)
            return None

    def _note(self, block: KlartextBlock, why: str) -> None:
        number = "" if self._cycle is None else f" {self._cycle.number}"
        said = f"{self._name}:{block.first + 1}: the call of cycle{number} stays as it is: {why}"
        if said not in self.notes:
            self.notes.append(said)

    # ------------------------------------------------------------------ lines

    def _keep(self, index: int, block: KlartextBlock, text: str | None = None) -> None:
        """Write a block: as it stands, or with other words; one that runs again without its number."""
        again = index in self._seen
        self._seen.add(index)
        lines = block.lines if text is None else block.with_words(text)
        if again:
            lines = ["/" * block.slash + lines[0][len(block.lead) :], *lines[1:]]
        self.changed |= text is not None or again
        self.lines += lines
