"""What a hypothesis is: a name, and how its numbers change a plant.

To add one for an effect of one's own: make a :class:`Hypothesis` and put it into the list of its module. What
it changes is a pure function of plant and numbers; where it starts may look at the residual.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final

import msgspec

from ph_post.diagnose.model import Problem
from ph_post.diagnose.record import Channel
from ph_post.drive.plant import Plant
from ph_post.types import Array

Residuals = Mapping[Channel, Array]
Numbers = tuple[float, ...]

MICRON: Final = 1e-6
"""The step from which a length is told apart from zero [m]."""


class Number(msgspec.Struct, frozen=True, kw_only=True):
    """One number of a hypothesis: its bounds, its natural `scale`, and whether the reading is linear in it.

    `linear` numbers start at what a straight fit to the residual gives; of a `logarithm` only the scale tells
    how far a slope reaches, not its size.
    """

    name: str
    low: float
    high: float
    scale: float
    linear: bool = False
    logarithm: bool = False


def always(_problem: Problem) -> str:
    """Find nothing against a hypothesis on any axis."""
    return ""


class Hypothesis(msgspec.Struct, frozen=True, kw_only=True):
    """A named effect that may be missing.

    Parameters
    ----------
    name : str
        Its name in the catalogue.
    variant : str
        What tells two hypotheses of one name apart.
    numbers : tuple of Number
    apply : callable
        Plant and numbers to plant.
    starts : callable
        Problem and residuals to numbers to start from; of a linear one the value is a size worth trying.
    values : callable
        Numbers to the values of the effect's parameters [SI], the leading one first.
    bars : callable
        Why it cannot act on an axis, or cannot show in its record; empty where it can.
    within : tuple of str
        Names whose effect is a special case of this one, or as good as one where the record is poor.
    replaces : tuple of str
        Base values ("b", "c", "gap") that it sets free of their prior.
    excludes : tuple of str
        Names beside which its numbers mean nothing, as both do the same.
    """

    name: str
    numbers: tuple[Number, ...]
    apply: Callable[[Plant, Numbers], Plant]
    starts: Callable[[Problem, Residuals], Sequence[Numbers]]
    values: Callable[[Problem, Numbers], dict[str, float]]
    variant: str = ""
    bars: Callable[[Problem], str] = always
    within: tuple[str, ...] = ()
    replaces: tuple[str, ...] = ()
    excludes: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """Name and variant."""
        return f"{self.name}/{self.variant}" if self.variant else self.name
