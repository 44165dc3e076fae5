"""Run a SINUMERIK program, and write out what it does: parameters, variables, repeats, loops, choices and jumps.

SINUMERIK 840D sl / 828D, Programming Manual, Job Planning, 07/2010, 6FC5398-2BP40-2BA0: arithmetic parameters,
operations and their order, check structures, program jumps, program part repetition.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import ClassVar, Final

import msgspec

from ph_post.expand.expressions import Functions, Levels, Parser
from ph_post.expand.faults import ExpandError, NotExpandableError
from ph_post.expand.lines import Source
from ph_post.expand.macro import MacroParser
from ph_post.expand.progress import Progress, WrittenLines, check_turn
from ph_post.expand.values import UNKNOWN, NumberStore
from ph_post.expand.writing import DECIMALS, number_text

_HIDDEN: Final = re.compile(r';.*|"[^"]*"')
_LEAD: Final = re.compile(r"\s*(/\d?)?\s*(?:([N:]\d+)\s*)?(?:([A-Z_]\w+)\s*:(?!=))?\s*", re.IGNORECASE)
_JUMP: Final = re.compile(r"(?:IF\b(.*?))?\bGOTO([BFC]?)\s+([A-Z_]\w*|N\d+)\s*$", re.IGNORECASE)
_REPEAT: Final = re.compile(
    r"REPEAT(B?)\s+([A-Z_]\w*)(?:\s+([A-Z_]\w*)(?!\w|\s*=))?(?:\s*P\s*(?:=\s*)?(.+))?$", re.IGNORECASE
)
_BLOCK: Final = re.compile(r"(IF|ELSE|ENDIF|WHILE|ENDWHILE|FOR|ENDFOR|LOOP|ENDLOOP|REPEAT|UNTIL)\b(.*)$", re.IGNORECASE)
_DEFINES: Final = re.compile(r"DEF\s+(?:CHAN\s+)?(REAL|INT)\s+(.*)$", re.IGNORECASE)
_DEFINED: Final = re.compile(r"([A-Z_]\w+)\s*(?:=(.*))?$", re.IGNORECASE)
_FIRST_NAME: Final = 1_000_000
"""Key of the first variable that the program defines, above all R parameters."""
_ANY_SETTING: Final = re.compile(r"\bR\s*\[.*?\]\s*=(?!=)", re.IGNORECASE)
_ODD_FLOW: Final = re.compile(r"\b(?:GOTO\w*|CASE|SETINT)\b|\bREPEATB?\b", re.IGNORECASE)
_END: Final = re.compile(r"\bM0*(?:2|17|30)\b(?!\s*=)|^RET\b", re.IGNORECASE)
_CALL: Final = re.compile(
    r"\b(?:P?CALL|EXTCALL|ISOCALL)\b|^L\d+\b|"
    r"^(?!(?:MSG|CYCLE\d+|POCKET\d|SLOT\d|HOLES\d)(?!\w))[A-Z_]{2,}\w*\s*(?:\(|$|P\s*=?\d)",
    re.IGNORECASE,
)
_MODAL_CALL: Final = re.compile(r"MCALL\b(?:\s+(?!(?:CYCLE\d+|POCKET\d|SLOT\d|HOLES\d)(?!\w))(\w+))?", re.IGNORECASE)
_STILL: Final = re.compile(
    r"^(?:SOFT|BRISK|DRIVE|COMP\w+|FFWO[NF]|STOPRE|A?TRANS|A?ROT|A?SCALE|A?MIRROR|SUPA|DIAM\w+|CUT2D\w*|CF\w+|NORM|KONT|"
    r"MCALL|UPATH|SPATH|FIFOCTRL|ORI\w+|F(?:NORM|LIN|CUB)|DYN\w+|WALIMO[NF]|CDO[NF]|RTLIO[NF]|WORKPIECE|"
    r"GROUP_(?:BEGIN|END|ADDEND)|SETMS|FGROUP)\b",
    re.IGNORECASE,
)
"""Words that stand alone, and are no subprograms."""
SYNCHRONIZED: Final = re.compile(r"\s*(?:IDS?\s*=\s*\d+\s*)?(?:WHEN|WHENEVER|EVERY|FROM|DO)\b", re.IGNORECASE)
"""A synchronized action: the control works it out while it moves, and it belongs to the next block."""
_WORD: Final = re.compile(r"(?<![\w$])([A-QS-Z][A-Z]{0,4}\d?)\s*=\s*", re.IGNORECASE)
_BLANKS: Final = re.compile(r"\s+")
_SIGN_AHEAD: Final = re.compile(r"[-+*/<>=()]|(?:MOD|DIV|AND|OR|XOR|NOT)\b|B_", re.IGNORECASE)
_SIGN_BEHIND: Final = re.compile(r"(?:[-+*/<>=(]|\b(?:MOD|DIV|AND|OR|XOR|NOT))$", re.IGNORECASE)
_WAYS: Final = re.compile(r"(AC|IC|DC|ACP|ACN)\s*\((.*)\)$", re.IGNORECASE)
_ENDS: Final = {"ENDIF": "IF", "ENDWHILE": "WHILE", "ENDFOR": "FOR", "ENDLOOP": "LOOP", "UNTIL": "REPEAT"}
_COMPARED: Final = {"==": "eq", "<>": "ne", ">=": "ge", "<=": "le", ">": "gt", "<": "lt", "(": "[", ")": "]"}


class SinumerikStore(NumberStore):
    """R parameters and variables; what the program did not set is NaN. `names` are those of variables by their key."""

    def __init__(self, names: Mapping[int, str]) -> None:
        super().__init__()
        self._names = names

    def number(self, index: float) -> float:
        """Return an R parameter or a variable."""
        found = self.numbers.get(round(index), UNKNOWN) if not math.isnan(index) else UNKNOWN
        if math.isnan(found):
            self.doubt = self._names.get(round(index), f"R{index:g}") if not math.isnan(index) else "R"
        return found


def calls_subprogram(rest: str) -> bool:
    """Return whether a line, without slash, number and label, calls a subprogram that may set anything.

    Examples
    --------
    >>> [calls_subprogram(line) for line in ("SIDE_2", "L10", "SLOT1_OWN(5)", "SLOT1(5)", "SOFT", "G0 X5")]
    [True, True, True, False, False, False]
    """
    return _CALL.search(rest) is not None and _STILL.match(rest) is None


def definitions(text: str) -> list[tuple[str, str, str | None]]:
    """Return the variables of one number that a line defines: name, REAL or INT, and the text of its value.

    Examples
    --------
    >>> definitions("DEF REAL HEIGHT=5.5, Depth, A[3]"), definitions("X5")
    ([('HEIGHT', 'REAL', '5.5'), ('DEPTH', 'REAL', None)], [])
    """
    found = _DEFINES.match(text)
    if found is None:
        return []
    parts = [_DEFINED.match(part.strip()) for part in re.split(r",(?![^(\[]*[)\]])", found[2])]
    return [(one[1].upper(), found[1].upper(), one[2] and one[2].strip()) for one in parts if one is not None]


class ParameterPatterns:
    """Finds R parameters and the variables that a program defines, and tells their keys.

    Parameters
    ----------
    names : sequence of str
        Of the variables, in capitals.
    """

    def __init__(self, names: Sequence[str] = ()) -> None:
        self.keys = {name: _FIRST_NAME + number for number, name in enumerate(dict.fromkeys(names))}
        self.names = {key: name for name, key in self.keys.items()}
        one = "|".join([r"R\d+", *map(re.escape, sorted(self.keys, key=len, reverse=True))])

        def compiled(text: str) -> re.Pattern[str]:
            return re.compile(text, re.IGNORECASE)

        self.counted = compiled(rf"\s*({one})\s*=(.*)\bTO\b(.*)$")
        self.setting = compiled(rf"({one})\s*=\s*(.*?)\s*(?=(?<!\w)(?:{one})\s*=|$)")
        self.settings = compiled(rf"(?:(?:{one})\s*=[^=]*)+$")
        self.set_anywhere = compiled(rf"\b({one})\s*=")
        self.used = compiled(rf"(?<!\w)(?:{one})(?!\w)")
        self.token = compiled(rf"==|<>|>=|<=|>|<|\(|\)|(?<![\w$.])({one})(?!\w)|\s+")

    def key(self, name: str) -> int:
        """Return the key of a parameter or a variable."""
        upper = name.upper()
        return self.keys[upper] if upper in self.keys else int(upper[1:])


def _divided(left: float, right: float) -> float:
    if right == 0.0:
        raise ExpandError("division by zero")
    return float(math.trunc(left / right)) if not math.isnan(left + right) else math.nan


class SinumerikParser(Parser):
    """Reads expressions that were put in brackets and signs of the other languages."""

    levels: ClassVar[Levels] = (
        MacroParser.levels[0],
        *({name: Parser.levels[0][name]} for name in ("or", "xor", "and")),
        Parser.levels[2],
        {**Parser.levels[3], "div": _divided},
    )
    functions: ClassVar[Functions] = {
        **{name: Parser.functions[name] for name in ("sin", "cos", "tan", "asin", "acos", "sqrt", "abs", "exp", "ln")},
        "round": Parser.functions["round"],
        "trunc": lambda x: float(math.trunc(x)),
        "pot": lambda x: x * x,
    }


class SinumerikLine(msgspec.Struct, frozen=True, kw_only=True):
    """A line: its text, what stands of it behind slash, number and label, and what it does.

    `slash` is that with the level of its skip, empty where there is none; `order` is "", "set", "jump", "repeat" or the
    word of a check structure; `match` what its pattern found.
    """

    text: str
    rest: str
    begin: int
    slash: str
    number: str
    label: str
    order: str = ""
    match: re.Match[str] | None = None


def read_sinumerik_line(text: str, patterns: ParameterPatterns) -> SinumerikLine:
    """Read a line."""
    bare = _HIDDEN.sub(lambda found: " " * len(found[0]), text).rstrip()
    lead = _LEAD.match(bare)
    assert lead is not None
    rest = bare[lead.end() :]
    order, match = "", None
    for name, pattern in (("jump", _JUMP), ("repeat", _REPEAT), ("block", _BLOCK), ("set", patterns.settings)):
        match = pattern.match(rest)
        if match is not None:
            order = match[1].upper() if name == "block" else name
            break
    if not order and _ODD_FLOW.search(rest):
        order = "odd"
    return SinumerikLine(
        text=text,
        rest=rest,
        begin=lead.end(),
        slash="" if not lead[1] else lead[1] if len(lead[1]) == 1 else f"{lead[1]} ",
        number=(lead[2] or "").upper(),
        label=(lead[3] or "").upper(),
        order=order,
        match=match,
    )


def _lead_of(text: str) -> int:
    """Return the place behind slash, number and label of a line."""
    lead = _LEAD.match(text)
    return lead.end() if lead else 0


def _end_of_value(text: str, at: int) -> int:
    """Return the place behind an expression, which has blanks in brackets and about its signs."""
    depth = 0
    while at < len(text):
        gap = _BLANKS.match(text, at)
        if gap is not None and not depth and not (_SIGN_AHEAD.match(text, gap.end()) or _SIGN_BEHIND.search(text[:at])):
            break
        at = at if gap is None else gap.end()
        if at < len(text):
            depth += (text[at] == "(") - (text[at] == ")")
            at += 1
    return at


class RepeatedPart(msgspec.Struct, kw_only=True):
    """A part that runs again: its first line and the one behind its last, how often yet, and where it goes on."""

    first: int
    last: int
    left: int
    back: int


class SinumerikRunner:
    """Runs a program.

    Parameters
    ----------
    source : Source
        The main program; what stands behind its end stays.
    """

    begun: ClassVar[None] = None

    def __init__(self, source: Source) -> None:
        bare = [_HIDDEN.sub("", text) for text in source.texts]
        defined = [one for text in bare for one in definitions(text[_lead_of(text) :].strip())]
        self._patterns = ParameterPatterns([name for name, _, _ in defined])
        self._whole = {self._patterns.key(name) for name, kind, _ in defined if kind == "INT"}
        self.store = SinumerikStore(self._patterns.names)
        self.lines: list[str] = []
        self.changed = False
        self._source = source
        self._at = 0
        self._read = [read_sinumerik_line(text, self._patterns) for text in source.texts]
        names = [k for k, line in enumerate(self._read) if line.rest.startswith("%")]
        self._last = names[1] if len(names) > 1 else len(self._read)
        self._parts: list[RepeatedPart] = []
        self._seen: set[int] = set()
        self._heads: dict[int, object] = {}
        self._modal_call = False
        self._pairs = self._structures()

    def _structures(self) -> dict[int, int]:
        """Return the other line of each check structure: of IF its ELSE or ENDIF, of ELSE its ENDIF."""
        pairs: dict[int, int] = {}
        opened: list[int] = []
        for index in range(self._last):
            order = self._read[index].order
            if order in _ENDS.values():
                opened.append(index)
            elif order in _ENDS or order == "ELSE":
                begin = opened.pop() if opened else -1
                had = self._read[begin].order if begin >= 0 else ""
                if had != _ENDS.get(order, "IF") and not (had == "ELSE" and order == "ENDIF"):
                    raise ExpandError(f"{order} without its beginning").at(self._source.name, index + 1)
                pairs[begin], pairs[index] = index, begin
                if order == "ELSE":
                    opened.append(index)
        if opened:
            order = self._read[opened[-1]].order
            raise ExpandError(f"{order} without its end").at(self._source.name, opened[-1] + 1)
        return pairs

    def run(self) -> WrittenLines:
        """Return the lines that the program comes to.

        Raises
        ------
        ExpandError
            Where it cannot be written out, with its file and line.
        """
        progress = Progress(self._source)
        while self._at < self._last:
            if progress.step(partial(self._step, self._at), self._source.name, self._at + 1, len(self.lines)):
                break
        return progress.written(self.lines, self._at)

    def _step(self, index: int) -> bool:
        line = self._read[index]
        self._at = index + 1
        if line.order and line.slash:
            raise NotExpandableError("a line with a slash runs or not as the control's switch says")
        if line.order == "odd":
            raise NotExpandableError(f"a part of the program's flow that is not followed: {line.rest.strip()[:40]}")
        ends = False
        if SYNCHRONIZED.match(line.rest):
            self._write(index)
            self.store.numbers.clear()
        elif line.order == "set":
            self._set(line)
            self._write(index)
        elif line.order:
            self.changed = True
            self._obey(index, line)
        elif _DEFINES.match(line.rest):
            self._define(line)
            self._write(index)
        else:
            ends = _END.search(line.rest) is not None
            self._forget_set(line.rest)
            self._write(index)
            self._forget_called(line)
        while self._parts and self._at == self._parts[-1].last:
            part = self._parts[-1]
            part.left -= 1
            self._at = part.first if part.left > 0 else part.back
            if part.left <= 0:
                self._parts.pop()
        return ends

    def _forget_set(self, rest: str) -> None:
        """Forget what a line sets that is not read here: words beside it may have either value."""
        if _ANY_SETTING.search(rest):
            self.store.numbers.clear()
        for found in self._patterns.set_anywhere.finditer(rest):
            self.store.numbers.pop(self._patterns.key(found[1]), None)

    def _forget_called(self, line: SinumerikLine) -> None:
        """Forget what another program may have set: one that a line calls, or every motion (MCALL)."""
        modal = _MODAL_CALL.match(line.rest)
        if modal is not None:
            self._modal_call = modal[1] is not None or (self._modal_call and line.slash != "")
        if self._modal_call or calls_subprogram(line.rest):
            self.store.numbers.clear()

    # ------------------------------------------------------------------ values

    def _value(self, text: str) -> float:
        """Return the value of an expression, NaN where it has what is not known here."""
        key = self._patterns.key
        texts = self._patterns.token.sub(
            lambda found: f"#{key(found[1])}" if found[1] else _COMPARED.get(found[0], ""), text
        ).lower()
        parser = SinumerikParser(f"[{texts}]")
        try:
            value = parser.expression()
        except ExpandError:
            self.store.doubt = text.strip()[:40]
            return UNKNOWN
        return value(self.store) if parser.at == len(parser.text) else UNKNOWN

    def _set(self, line: SinumerikLine) -> None:
        """Set R parameters; a value that needs another one of its line is not known, as is which comes first."""
        settings = [(self._patterns.key(one[1]), one[2]) for one in self._patterns.setting.finditer(line.rest)]
        known, keys, values = self.store.numbers, [key for key, _ in settings], []
        for key, text in settings:
            others = [*keys]
            others.remove(key)
            self.store.numbers = {had: value for had, value in known.items() if had not in others}
            values.append(self._value(text))
        self.store.numbers = known
        for key, value in zip(keys, values, strict=True):
            self._put(key, value)

    def _put(self, key: int, value: float) -> None:
        """Give a parameter a value; an INT takes the nearest whole number, and below 0 nobody says which."""
        if key in self._whole and not math.isnan(value) and value != math.trunc(value):
            value = math.floor(value + 0.5) if value > 0.0 else UNKNOWN
        self.store.put(key, value)

    def _define(self, line: SinumerikLine) -> None:
        """Give variables that are defined their values, or 0."""
        for name, _, text in definitions(line.rest.strip()):
            self._put(self._patterns.key(name), 0.0 if text is None else self._value(text))

    def _write(self, index: int) -> None:
        """Write a line with the values of its words; one that runs again without its number and label."""
        line = self._read[index]
        text = line.text
        changed = self._with_values(line)
        again = index in self._seen
        if again or changed != text[line.begin :]:
            lead = line.slash if again else text[: line.begin]
            text = lead + changed
            self.changed = True
        self._seen.add(index)
        if text.strip() or not line.text.strip():
            self.lines.append(text)

    def _with_values(self, line: SinumerikLine) -> str:
        text, rest = line.text[line.begin :], line.rest
        if line.order == "set":
            return self._with_settings(line)
        if self._patterns.used.search(rest) is None or "=" not in rest or SYNCHRONIZED.match(rest):
            return text
        parts, at = [], 0
        for found in _WORD.finditer(rest):
            end = _end_of_value(rest, found.end())
            chunk = rest[found.end() : end]
            value = self._word_text(chunk)
            if found.start() < at or value is None:
                continue
            parts += [text[at : found.end()], value]
            at = end
        return "".join([*parts, text[at:]])

    def _with_settings(self, line: SinumerikLine) -> str:
        found = []
        settings = list(self._patterns.setting.finditer(line.rest))
        if not any(self._patterns.used.search(one[2]) for one in settings):
            return line.text[line.begin :]
        for one in settings:
            value = self.store.numbers.get(self._patterns.key(one[1]), UNKNOWN)
            found.append(one[0].strip() if math.isnan(value) else f"{one[1]}={number_text(value, DECIMALS)}")
        return " ".join(found) + line.text[line.begin + len(line.rest) :]

    def _word_text(self, chunk: str) -> str | None:
        way = _WAYS.match(chunk)
        inner = way[2] if way else chunk
        if self._patterns.used.search(inner) is None:
            return None
        value = self._value(inner)
        if math.isnan(value):
            return None
        return f"{way[1].upper()}({number_text(value, DECIMALS)})" if way else number_text(value, DECIMALS)

    # ------------------------------------------------------------------ flow

    def _obey(self, index: int, line: SinumerikLine) -> None:
        match = line.match
        assert match is not None
        orders: dict[str, Callable[[], None]] = {
            "jump": partial(self._jump, index, match),
            "repeat": partial(self._repeat, index, match),
            "FOR": partial(self._for, index, match),
        }
        if line.order in orders:
            orders[line.order]()
            return
        pair = self._pairs.get(index, index)
        if line.order == "IF":
            if not self.store.holds(self._value(match[2])):
                self._at = pair + 1
        elif line.order == "WHILE":
            if not self._again(index, holds=self.store.holds(self._value(match[2]))):
                self._at = pair + 1
        elif line.order == "ELSE":
            self._at = pair + 1
        elif line.order == "ENDWHILE" or (line.order == "ENDLOOP" and self._again(index, holds=True)):
            self._at = pair
        elif line.order == "ENDFOR":
            begins = self._read[pair].match
            found = None if begins is None else self._patterns.counted.match(begins[2])
            assert found is not None
            self._count(found[1], self.store.number(self._patterns.key(found[1])) + 1.0, found[3], pair)
        elif line.order == "UNTIL" and self._again(index, holds=not self.store.holds(self._value(match[2]))):
            self._at = pair + 1

    def _again(self, index: int, *, holds: bool) -> bool:
        """Return whether a loop goes on; refuse one that comes back with nothing changed."""
        if not holds:
            self._heads.pop(index, None)
            return False
        check_turn(self._heads, index, self.store.version)
        return True

    def _for(self, index: int, match: re.Match[str]) -> None:
        found = self._patterns.counted.match(match[2])
        if found is None:
            raise NotExpandableError("FOR that counts neither an R parameter nor a variable of the program")
        self._count(found[1], self._value(found[2]), found[3], index)

    def _count(self, name: str, value: float, end: str, begin: int) -> None:
        self._put(self._patterns.key(name), value)
        last = self.store.require(self._value(end), "the end of FOR")
        self.lines.append(f"{name}={number_text(self.store.require(value, 'FOR'), DECIMALS)}")
        self._at = begin + 1 if value <= last else self._pairs[begin] + 1

    def _jump(self, index: int, match: re.Match[str]) -> None:
        if match[1] is not None and not self.store.holds(self._value(match[1])):
            return
        if self._parts:
            raise NotExpandableError("a jump in a part that is repeated")
        self._at = self._find(match[3].upper(), index, match[2].upper())
        if self._at <= index:
            self._again(index, holds=True)

    def _find(self, target: str, index: int, way: str) -> int:
        """Return the line of a label or number: forwards, backwards, or first one and then the other."""
        ahead, back = range(index + 1, self._last), range(index - 1, -1, -1)
        order = ahead if way == "F" else back if way == "B" else [*ahead, *back]
        found = next((k for k in order if target in (self._read[k].label, self._read[k].number)), None)
        if found is None:
            raise ExpandError("the target of the jump or repeat is not there", got=target)
        return found

    def _repeat(self, index: int, match: re.Match[str]) -> None:
        times = 1 if match[4] is None else round(self.store.require(self._value(match[4]), "P"))
        first = self._find(match[2].upper(), index, "")
        if match[1]:
            last = first + 1
        elif match[3] is not None:
            last = self._find(match[3].upper(), index, "") + 1
        else:
            ends = [k for k in range(first, self._last) if self._read[k].label == "ENDLABEL"]
            last = ends[0] + 1 if ends and (ends[0] < index or first > index) else index
        if last <= first or first <= index < last:
            raise NotExpandableError("a repeat of a part that is not whole, or holds itself")
        if times > 0:
            self._parts.append(RepeatedPart(first=first, last=last, left=times, back=index + 1))
            self._at = first
