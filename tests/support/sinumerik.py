"""An independent reading of SINUMERIK programs in exact numbers, as far as they are written here."""

from __future__ import annotations

import re
from collections.abc import Iterator
from fractions import Fraction

import mpmath
import msgspec

Point = dict[str, Fraction]

_LIST = re.compile(r"PO\[(\w*)\]=\(([^)]*)\)|\b(\w)=PO\(([^)]*)\)")
_PROFILE = re.compile(r"F=FPO\(([^)]*)\)")
_WORD = re.compile(r"([A-Z])(-?[\d.]+)")


class Block(msgspec.Struct, frozen=True, kw_only=True):
    """A block that moves [mm, mm/min]: `above` the power coefficients by axis, `below` the denominator's.

    `feed` has the cubic of the feed over the share of the length; None for a G0. An arc has a `center`
    and the sense of its turn, and no coefficients.
    """

    word: str
    start: Point
    end: Point
    above: dict[str, list[Fraction]]
    below: list[Fraction]
    feed: list[Fraction] | None
    center: Point | None = None
    turn: int = 0

    def at(self, p: Fraction) -> list[Fraction]:
        """Point at a parameter from 0 to 1 of a block that is no arc."""
        under = _value(self.below, p)
        return [_value(row, p) / under for row in self.above.values()]

    def length(self) -> mpmath.mpf:
        """Length [mm], to 20 digits."""
        return self.length_to(mpmath.mpf(1))

    def length_to(self, p: mpmath.mpf) -> mpmath.mpf:
        """Length [mm] up to a parameter."""
        if self.center is not None:
            return p * self.radius() * self.angle()
        return mpmath.quad(self.speed, [0, p])

    def speed(self, p: mpmath.mpf) -> mpmath.mpf:
        """Length of the derivative with respect to the parameter."""
        under, slope = _mp(self.below, p), _mp(_derived(self.below), p)
        total = mpmath.mpf(0)
        for row in self.above.values():
            over = _mp(row, p)
            total += ((_mp(_derived(row), p) * under - over * slope) / under**2) ** 2
        return mpmath.sqrt(total)

    def radius(self) -> mpmath.mpf:
        assert self.center is not None
        return mpmath.sqrt(sum((mpmath.mpf(1) * _f(self.start[a] - self.center[a])) ** 2 for a in "XY"))

    def angle(self) -> mpmath.mpf:
        assert self.center is not None
        first, last = (
            mpmath.atan2(_f(place["Y"] - self.center["Y"]), _f(place["X"] - self.center["X"]))
            for place in (self.start, self.end)
        )
        swept = (self.turn * (last - first)) % (2 * mpmath.pi)
        return swept or 2 * mpmath.pi

    def feed_at(self, share: mpmath.mpf) -> mpmath.mpf:
        """Feed [mm/min] where so much of the length is done."""
        assert self.feed is not None
        return _mp(self.feed, share)


def read_blocks(text: str) -> Iterator[Block]:
    """Blocks of a program as it is written here; anything else fails."""
    at: Point = {}
    feed = Fraction(0)
    for line in text.splitlines():
        words = line.split(";")[0].split()
        if not words or words[0][0] not in "GP" or words[0] in ("G60", "G641", "G710"):
            continue
        if words[0] == "G4":
            continue
        word, body = words[0], " ".join(words[1:])
        lists = {
            old + new: [Fraction(one) for one in (below + above).split(",")]
            for old, below, new, above in _LIST.findall(body)
        }
        assert all(len(found[1].split(",")) <= 3 for found in _LIST.findall(body) if found[0])
        profile = _PROFILE.search(body)
        plain = dict(_WORD.findall(_PROFILE.sub("", _LIST.sub("", body)).replace("PL=1", "")))
        ends = {
            axis: lists[axis][0] if axis in lists else Fraction(plain[axis])
            for axis in "XYZ"
            if axis in lists or axis in plain
        }
        end = {**at, **ends}
        course: list[Fraction] | None = None
        if word != "G0":
            if profile:
                last, quad, cub = (Fraction(one) for one in profile[1].split(","))
                course = [feed, last - feed - quad - cub, quad, cub]
                feed = last
            else:
                feed = Fraction(plain.get("F", feed))
                course = [feed]
        start = at or end
        below = [Fraction(1)]
        if "" in lists:
            last, *rest = lists[""]
            below = [Fraction(1), last - 1 - sum(rest), *rest]
        above = {}
        for axis, place in end.items():
            rest = lists.get(axis, [Fraction(0)])[1:]
            first = start.get(axis, place)
            above[axis] = [first, place * sum(below) - first - sum(rest), *rest]
        center, turn = None, 0
        if word in ("G2", "G3"):
            center = {"X": start["X"] + Fraction(plain["I"]), "Y": start["Y"] + Fraction(plain["J"])}
            turn = 1 if word == "G3" else -1
        whole = {axis: start.get(axis, place) for axis, place in end.items()}
        yield Block(word=word, start=whole, end=end, above=above, below=below, feed=course, center=center, turn=turn)
        at = end


def _value(power: list[Fraction], p: Fraction) -> Fraction:
    return sum((one * p**k for k, one in enumerate(power)), Fraction(0))


def _derived(power: list[Fraction]) -> list[Fraction]:
    return [k * one for k, one in enumerate(power)][1:] or [Fraction(0)]


def _mp(power: list[Fraction], p: mpmath.mpf) -> mpmath.mpf:
    return mpmath.polyval([_f(one) for one in reversed(power)], p)


def _f(value: Fraction) -> mpmath.mpf:
    return mpmath.mpf(value.numerator) / value.denominator
