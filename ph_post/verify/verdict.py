"""The verdict on a compensated program: every failure with its place, and what was checked."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Literal

import msgspec

FailureKind = Literal[
    "header",
    "original",
    "undeclared",
    "lines",
    "text",
    "comment",
    "offset",
    "return",
    "direction",
    "jog",
    "pulse",
    "dwell",
    "crossing",
    "path",
    "feed",
    "limits",
    "state",
    "command",
    "break",
    "count",
    "machine",
    "thread",
]
"""Kinds of failures.

`header` the declaration is damaged; `original` it names another program; `undeclared` there is none, yet
the bytes differ; `lines` lines are missing, too many, or not where the changes say; `text` a line differs from
the original's; `comment` a comment or a block delete of a replaced line is lost; `offset` an axis is shifted
by something else than what is declared; `return` a shift is not taken back where it must be; `direction` an
axis carries the offset of the other direction of travel; `jog`, `pulse`, `dwell` a stop is not as declared;
`crossing` a crossing on the fly is not as declared, or stands where none may; `path` the tool goes elsewhere;
`feed` a feed is above the original's; `limits` a jog is faster than the machine; `state` the modal state after
a block differs; `command` a command other than a motion is lost, added, or out of order; `break` a tool change,
home, probe, … differs; `count` the numbers of stops, dips or crossings are not those declared; `machine` the
program was made for another machine; `thread` moves tied to the spindle are not shifted as a whole.
"""

KEPT = 1000
"""Most failures of one kind that are kept; the others are counted."""


class Failure(msgspec.Struct, frozen=True, kw_only=True):
    """A failure, and its lines, from 1; None where there is no line."""

    kind: FailureKind
    original: int | None
    compensated: int | None
    what: str
    expected: str = ""
    got: str = ""

    def sentence(self) -> str:
        """One line: where, what, expected and got."""
        places = ((self.original, "original line"), (self.compensated, "compensated line"))
        where = ", ".join(f"{name} {line}" for line, name in places if line is not None)
        parts = [f"{self.kind}: {where}: {self.what}" if where else f"{self.kind}: {self.what}"]
        parts += [f"expected {self.expected}"] if self.expected else []
        parts += [f"got {self.got}"] if self.got else []
        return "; ".join(parts)


class Verdict(msgspec.Struct, frozen=True, kw_only=True):
    """Result of a check: `failures` in order, at most :data:`KEPT` of a kind; `found` counts all.

    `checked` counts what was looked at: lines, words, motions, changes, jogs, stops. `crossings` are the numbers of
    crossings that were found in the changes whose marks name some, by the line of the mark, from 1.
    """

    failures: tuple[Failure, ...]
    found: int
    checked: Mapping[str, int]
    crossings: Mapping[int, int] = {}

    @property
    def ok(self) -> bool:
        """True where there is no failure."""
        return self.found == 0


class Findings:
    """Failures as they are found, and counts of what was looked at."""

    def __init__(self) -> None:
        self._failures: list[Failure] = []
        self._kinds: Counter[FailureKind] = Counter()
        self.checked: Counter[str] = Counter()
        self.crossings: dict[int, int] = {}

    def add(
        self,
        kind: FailureKind,
        what: str,
        *,
        original: int | None = None,
        compensated: int | None = None,
        expected: str = "",
        got: str = "",
    ) -> None:
        """Add a failure; lines are counted from 0 here, as programs do."""
        self._kinds[kind] += 1
        if self._kinds[kind] <= KEPT:
            places = (None if line is None else int(line) + 1 for line in (original, compensated))
            first, second = places
            self._failures.append(
                Failure(kind=kind, original=first, compensated=second, what=what, expected=expected, got=got)
            )

    def count(self, name: str, number: int) -> None:
        """Count what was looked at."""
        self.checked[name] += int(number)

    @property
    def found(self) -> int:
        """Number of all failures so far."""
        return self._kinds.total()

    def verdict(self) -> Verdict:
        """Return the verdict on all findings."""
        return Verdict(
            failures=tuple(self._failures), found=self.found, checked=dict(self.checked), crossings=self.crossings
        )


def quoted(line: bytes, width: int = 60) -> str:
    r"""Show a line of a program in a message, without its line end; what is no plain text is escaped.

    Examples
    --------
    >>> quoted(b"G1 X10\r\n")
    "'G1 X10'"
    """
    text = repr(line.rstrip(b"\r\n"))[1:]
    return text if len(text) <= width else f"{text[: width - 3]}..."
