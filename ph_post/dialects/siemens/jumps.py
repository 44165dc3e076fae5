"""Lines of a Siemens program that may run more than once, or not at all."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

JUMPED: Final = "lines of a jump"
BRANCHED: Final = "program with branches of CL 800"
REPEATED: Final = "repeated part"
CALLED: Final = "call of another program"
UNMEASURED: Final = "subprogram without G90 or G91: what its places mean is set by the program that calls it"

_SKIP: Final = r"^\s*(?:(?:/\d?|\d)\s*)?"
"""Block delete. No two blanks are beside each other: many of them would be tried in every way they can be shared."""

_LEAD: Final = _SKIP + r"(?:[N:]\d+\s*)?"
_JUMP: Final = re.compile(r"\bGOTO([BFCS]?)\b\s*([A-Z_$\"]\w*|N\d+|:\d+|\d+)?", re.IGNORECASE)
_BRANCH: Final = re.compile(r"(?<![A-Z_$\d\"])@\s*1\d\d(?!\d)", re.IGNORECASE)
"""A jump or a loop of SINUMERIK 810 to 850, whose lines CL 800 numbers (Programming Guide CL 800, "Main group 1/
Program branching": @100 to @161). Where it leads may be computed: all lines are marked."""

_REPEAT: Final = re.compile(
    r"\bREPEAT(B?)\b\s+(?!UNTIL)([A-Z_]\w*|N\d+)(?:\s+([A-Z_]\w*|N\d+)(?!\w|\s*=))?", re.IGNORECASE
)
_CALL: Final = re.compile(r"\b(?:CALL|PCALL|EXTCALL|ISOCALL|CASE)\b", re.IGNORECASE)
_LABEL: Final = re.compile(r"^\s*(?:[N:]\d+\s*)?([A-Z_]\w+)\s*:(?!=)", re.IGNORECASE)
_NUMBER: Final = re.compile(_SKIP + r"(N\d+|:\d+)", re.IGNORECASE)
_OPENS: Final = re.compile(_LEAD + r"(IF|WHILE|FOR|LOOP|REPEAT)\b", re.IGNORECASE)
_CLOSES: Final = re.compile(_LEAD + r"(ENDIF|ENDWHILE|ENDFOR|ENDLOOP|UNTIL)\b", re.IGNORECASE)

_MEASURE: Final = re.compile(r"\bG9[01]\b", re.IGNORECASE)
_PLACE: Final = re.compile(r"(?<![A-Z_$\d])[XYZ]\s*(?:=|[-+\d.])", re.IGNORECASE)
_END: Final = re.compile(_LEAD + r".*?\b(M0*(?:2|17|30)(?!\d)|RET\b)", re.IGNORECASE)


def find_stretches(lines: Sequence[str]) -> dict[int, str]:
    """Return why a line may run more than once, or not at all, by line.

    Parameters
    ----------
    lines : sequence of str
        The lines without comments, strings empty.

    Examples
    --------
    >>> sorted(find_stretches(["X1", "IF R1>0 GOTOF DONE", "X2", "DONE:", "X3"]))
    [1, 2, 3]
    """
    found: dict[int, str] = {}
    places: dict[str, int] = {}
    for number, text in enumerate(lines):
        for pattern in (_LABEL, _NUMBER):
            if label := pattern.match(text):
                places.setdefault(label[1].upper(), number)
    branch = _BRANCH.search("\n".join(lines))
    if branch is not None:
        return dict.fromkeys(range(len(lines)), f"{BRANCHED}: {branch[0]}")
    depth, opened = 0, ""
    for number, text in enumerate(lines):
        jump, repeat = _JUMP.search(text), _REPEAT.search(text)
        opens = _OPENS.match(text) if jump is None and repeat is None else None
        opened = opens[1].upper() if opens and not depth else opened
        depth += opens is not None
        if depth:
            found.setdefault(number, opened)
        depth = max(0, depth - (_CLOSES.match(text) is not None))
        if jump is not None:
            targets = [one[2].upper() if one[2] else "" for one in _JUMP.finditer(text)]
            ends = [places.get(target, -1) for target in targets]
            _mark(found, number, ends, len(lines), f"{JUMPED}: {jump[0].strip()}")
        elif repeat is not None:
            names = [name.upper() for name in repeat.groups()[1:] if name]
            ends = [places.get(name, -1) for name in names]
            if repeat[1] or len(names) > 1:
                found[number] = REPEATED
                _mark(found, max(ends), ends, len(lines), REPEATED)
            else:
                _mark(found, number, ends, len(lines), REPEATED)
        elif _CALL.search(text):
            found[number] = CALLED
    for number in _unmeasured(lines):
        found.setdefault(number, UNMEASURED)
    return found


def _unmeasured(lines: Sequence[str]) -> range:
    """Return the lines from the first with places up to the first G90 or G91 of what ends as a subprogram."""
    first = next((number for number, text in enumerate(lines) if _MEASURE.search(text) or _PLACE.search(text)), None)
    if first is None or _MEASURE.search(lines[first]):
        return range(0)
    end = next((found for text in lines[first:] if (found := _END.match(text)) is not None), None)
    if end is None or re.fullmatch(r"M0*17|RET", end[1], re.IGNORECASE) is None:
        return range(0)
    behind = (number for number in range(first, len(lines)) if _MEASURE.search(lines[number]))
    return range(first, next(behind, len(lines)))


def _mark(found: dict[int, str], number: int, targets: Sequence[int], count: int, what: str) -> None:
    """Mark the lines between a line and those it leads to; all where one of these is not known."""
    known = bool(targets) and min(targets) >= 0
    low, high = (min(number, *targets), max(number, *targets)) if known else (0, count - 1)
    for line in range(low, high + 1):
        found.setdefault(line, what)
