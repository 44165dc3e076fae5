"""Drilling cycles of Heidenhain's controls, as far as they only move: 1, 200, 201, 203, 205 and 240.

HEIDENHAIN, iTNC 530 (340 49x) and TNC 620 (81760x), User's Manuals for Cycle Programming, "Drilling"; TNC 426, User's
Manual, "Pecking (Cycle 1)". A call stays where controls do it differently (chip breaking, a dwell at each of several
infeeds, stop distances that change), and where a cycle turns the spindle (202, 204, 206, 207, 209) or mills (208).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Final

import msgspec

from ph_post.expand.faults import NotExpandableError
from ph_post.expand.klartext_lines import tnc_number, tnc_value

OF_THEIR_OWN: Final = frozenset((7, 8, 9, 10, 11, 12, 13, 14, 19, 20, 26, 27, 28, 29, 32, 39, 220, 221, 247))
"""Cycles that no call runs: the machining cycle stays the one from before."""

_EXPECTED: Final = {
    200: (200, 201, 206, 202, 203),
    201: (200, 201, 206, 203, 208),
    203: (200, 201, 206, 202, 203, 208),
    205: (200, 201, 206, 202, 203, 258, 259, 208),
    240: (200, 201, 206, 203),
}
"""Values that a cycle needs."""

_OTHERS: Final = {
    200: (210, 204, 211),
    201: (211, 204),
    203: (210, 204, 212, 213, 205, 211, 256),
    205: (204, 212, 205, 257, 256, 211, 253),
    240: (211, 204, 344),
}
"""Values that are 0 where they are not given; any other one has to be 0."""

_VALUE: Final = re.compile(r"(?<![A-Z+-])Q(\d+)\s*=\s*([-+]?[\d.,]+|F?MAX\b)?")
_MOST_PECKS: Final = 10_000
_STOP: Final = (0.6, 50.0, 7.0)
"""Cycle 1 stops before the last depth by 0.6 mm, or the hole's depth over 50, at most 7 mm."""
_DECIMALS: Final = 4


class KlartextCycle(msgspec.Struct, kw_only=True):
    """A cycle that is called: its number, and its values by Q parameter, or by the part of an old one."""

    number: int
    values: dict[int, float] = {}
    parts: dict[int, float] = {}

    def add(self, part: int, text: str) -> None:
        """Take a part of an old cycle."""
        found = re.search(r"(?<![\dQ.,])([-+]?[\d.,]+)$", text.partition(".")[2].lstrip("0123456789"))
        self.parts[part] = tnc_value(found[1]) if found else math.nan

    def moves(self, axis: str) -> list[str]:
        """Return the blocks of a call, along the tool's axis.

        Raises
        ------
        NotExpandableError
            Where it does more than move, or controls differ.
        """
        if self.number == 1:
            return self._pecking(axis)
        if self.number not in _EXPECTED:
            raise NotExpandableError("it is not one of those that are written out")
        value = self._checked()
        top, bottom = value[203] + value[200], value[203] + value[201]
        away = value[203] + max(value[200], value.get(204, 0.0))
        plunge, out = _feed(value[206]), "FMAX"
        if 208 in self.values:
            out = _feed(value[208] or value[206])
        lines = [_to(axis, top, "FMAX")]
        depths = _depths(value) if self.number in (200, 203, 205) else [-value[201]]
        self._check_infeeds(value, len(depths))
        stop = value[258] if self.number == 205 else value[200]
        back = out if self.number == 203 else "FMAX"
        for depth in depths[:-1]:
            lines += [_to(axis, value[203] - depth, plunge), _to(axis, top, back)]
            lines += _dwell(value.get(210, 0.0))
            lines.append(_to(axis, value[203] - depth + stop, "FMAX"))
        lines += [_to(axis, bottom, plunge), *_dwell(value.get(211, 0.0))]
        if out != "FMAX":
            lines.append(_to(axis, top, out))
        return lines if out != "FMAX" and away == top else [*lines, _to(axis, away, "FMAX")]

    def _checked(self) -> dict[int, float]:
        expected, others = _EXPECTED[self.number], _OTHERS[self.number]
        for key in expected:
            if math.isnan(self.values.get(key, math.nan)):
                raise NotExpandableError(f"Q{key} is not known")
        strange = [key for key, one in self.values.items() if key not in (*expected, *others) and one != 0.0]
        if strange:
            raise NotExpandableError(f"Q{strange[0]} changes what it does")
        value = {**dict.fromkeys(others, 0.0), **self.values}
        if any(math.isnan(one) for one in value.values()):
            raise NotExpandableError("a value is not known")
        if value[201] >= 0.0 or value[200] < 0.0 or value[206] <= 0.0 or value.get(208, 0.0) < 0.0:
            raise NotExpandableError("its depth is not below the surface, or a clearance or feed is none")
        return value

    def _check_infeeds(self, value: dict[int, float], count: int) -> None:
        if count > 1 and value[211] and self.number == 200:
            raise NotExpandableError("controls differ in whether each infeed ends in the dwell of Q211")
        if count > 1 and self.number == 203 and value[213]:
            raise NotExpandableError("it breaks chips, at a feed that is not said")
        if self.number == 205 and 0.0 < value[257] < -value[201]:
            raise NotExpandableError("it breaks chips, at a feed that is not said")
        if self.number == 205 and value[258] != value[259]:
            raise NotExpandableError("the stop distances Q258 and Q259 differ")
        if self.number == 240 and value[344]:
            raise NotExpandableError("Q344 gives a diameter")

    def _pecking(self, axis: str) -> list[str]:
        """Return the blocks of cycle 1, which begins at the place of the tool."""
        clear, depth, peck, rest = (self.parts.get(part, math.nan) for part in (1, 2, 3, 4))
        feed = self.parts.get(5, math.nan)
        if math.isnan(clear + depth + peck + rest + feed) or depth == 0.0 or peck == 0.0 or feed <= 0.0:
            raise NotExpandableError("a value is not known, or none")
        clear, hole, sense = abs(clear), abs(depth), math.copysign(1.0, depth)
        stop = _STOP[0] if hole <= _STOP[1] * _STOP[0] else min(hole / _STOP[1], _STOP[2])
        depths = _depths({201: -hole, 202: abs(peck)})
        lines, at = [], 0.0
        for last, below in enumerate(depths, 1 - len(depths)):
            lines.append(_by(axis, sense * (clear + below - at), _feed(feed)))
            if not last:
                lines += _dwell(rest)
            lines.append(_by(axis, -sense * (clear + below), "FMAX"))
            at = max(0.0, round(clear + below - stop, _DECIMALS))
            if last:
                lines.append(_by(axis, sense * at, "FMAX"))
        return lines


def values_of(text: str) -> Iterator[tuple[int, float]]:
    """Return the parameters that a definition sets; NaN where a value is not known, infinite where it is FMAX.

    Examples
    --------
    >>> list(values_of("CYCL DEF 201 REAMING Q200=+2 Q208= MAX Q206=+Q7"))
    [(200, 2.0), (208, inf), (206, nan)]
    """
    for key, value in _VALUE.findall(text):
        yield int(key), math.inf if value.endswith("MAX") else tnc_value(value)


def _depths(value: dict[int, float]) -> list[float]:
    """Return the depths of the infeeds, below the surface."""
    depth, step, less = -value[201], value[202], value.get(212, 0.0)
    least = value.get(205, 0.0)
    if least > step or less < 0.0:
        raise NotExpandableError("its smallest infeed is above the first one")
    found: list[float] = []
    at = 0.0
    while depth - at > 1e-9:
        if step <= 0.0 or len(found) == _MOST_PECKS:
            raise NotExpandableError("its infeeds do not come to its depth")
        at = min(at + step, depth)
        found.append(at)
        step = max(step - less, least)
    return found


def _feed(value: float) -> str:
    return "FMAX" if math.isinf(value) else f"F{tnc_number(value, 3, sign=False)}"


def _to(axis: str, place: float, feed: str) -> str:
    return f"L {axis}{tnc_number(place, _DECIMALS, sign=True)} R0 {feed}"


def _by(axis: str, way: float, feed: str) -> str:
    return f"L I{axis}{tnc_number(way, _DECIMALS, sign=True)} R0 {feed}"


def _dwell(seconds: float) -> list[str]:
    time = tnc_number(seconds, 3, sign=False)
    return [] if seconds == 0.0 else ["CYCL DEF 9.0 DWELL TIME", f"CYCL DEF 9.1 DWELL {time}"]
