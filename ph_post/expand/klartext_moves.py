"""Moves of Heidenhain's conversational language: the words of a block, and what of them is written anew."""

from __future__ import annotations

import re
from typing import Final

import msgspec

from ph_post.expand.corners import Element
from ph_post.expand.klartext_lines import NUMBER, KlartextBlock, tnc_number

_MOVE: Final = re.compile(r"(CR|CT|CP|C|LP|L)(?![A-Z]|\s*=)|L(?=I?[XYZ])")
_WORD: Final = re.compile(
    rf"\s*(?:(I?)(P[RA]|[XYZ])\s*({NUMBER})|R([LR]|0(?![\d.,]))|R\s*({NUMBER})|DR\s*([-+])|F\s*(MAX|{NUMBER})|M\s*(\d+))"
)
AT_THE_BEGIN: Final = frozenset((3, 4, 8, 13, 14))
AT_THE_END: Final = frozenset((0, 1, 2, 5, 9, 30))
"""M functions that act at the beginning of a block, and at its end."""
DECIMALS: Final = 4
"""Of places in mm."""


class KlartextMove(msgspec.Struct, kw_only=True):
    """A block that moves: its word, what it says, and whether that was changed."""

    block: KlartextBlock
    word: str
    places: dict[str, tuple[str, str]]
    radius: str = ""
    sense: str = ""
    side: str = ""
    feed: str = ""
    functions: tuple[int, ...] = ()
    element: Element | None = None

    def text(self) -> str:
        """Return the block's words."""
        parts = [f"{step}{axis}{number}" for axis, (step, number) in self.places.items()]
        parts += [f"R{self.radius}"] * bool(self.radius) + [f"DR{self.sense}"] * bool(self.sense)
        parts += [f"R{self.side}"] * bool(self.side) + [f"F{self.feed}"] * bool(self.feed)
        return " ".join([self.word, *parts, *(f"M{number}" for number in self.functions)])

    def goes_to(self, end: complex) -> None:
        """Let it end elsewhere in the plane."""
        own = {axis: ("", tnc_number(value, DECIMALS, sign=True)) for axis, value in (("X", end.real), ("Y", end.imag))}
        self.places = {**own, **{axis: place for axis, place in self.places.items() if axis not in own}}


def read_move(block: KlartextBlock) -> KlartextMove | None:
    """Read a block that moves in X, Y and Z alone; None of others.

    Examples
    --------
    >>> from ph_post.expand.klartext_lines import read_blocks
    >>> [block] = read_blocks(["7 C X+5 IY-2 DR+ RL F200 M8"])
    >>> move = read_move(block)
    >>> move.places, move.side, move.text()
    ({'X': ('', '+5'), 'Y': ('I', '-2')}, 'L', 'C X+5 IY-2 DR+ RL F200 M8')
    """
    word = _MOVE.match(block.words)
    if word is None:
        return None
    found = KlartextMove(block=block, word=word[1] or "L", places={})
    at = word.end()
    while at < len(block.words):
        part = _WORD.match(block.words, at)
        if part is None:
            return None
        step, axis, number, side, radius, sense, feed, function = part.groups()
        if axis:
            found.places[axis] = (step, number)
        found.side, found.radius = side or found.side, radius or found.radius
        found.sense, found.feed = sense or found.sense, feed or found.feed
        found.functions += (int(function),) if function else ()
        at = part.end()
    return found


def center_words(words: str) -> list[tuple[str, str, str]]:
    """Return the places of a CC block: I of an increment, axis and number.

    Examples
    --------
    >>> center_words("CC X+5 IY-2")
    [('', 'X', '+5'), ('I', 'Y', '-2')]
    """
    return re.findall(rf"(I?)([XYZ])\s*({NUMBER})", words)
