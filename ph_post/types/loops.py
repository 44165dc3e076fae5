"""Kinds of control loops: everything that differs between a scale, an encoder and no feedback, but the equations.

A further kind is a name in :data:`Feedback` and a record in :data:`LOOPS`; its equations of motion, where they
are new, stand in :data:`ph_post.drive.loops.EQUATIONS`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Literal, TypeVar

import msgspec

Feedback = Literal["load", "motor", "none"]
"""Names of the loops in machine files."""

T = TypeVar("T")


class Loop(msgspec.Struct, frozen=True, kw_only=True):
    """The loop of an axis.

    Parameters
    ----------
    name : {"load", "motor", "none"}
    encloses_backlash : bool
        True where the loop closes over the table: the controller sees and crosses the backlash, and masses and
        damping of motor and table are needed to predict how. False where the table hangs behind the motor by a
        play.
    has_controller : bool
        False where nothing is read: there are no gains, no torque to saturate, and b = c = 0 is allowed.
    label : str
        Where the loop closes, for reports.
    comment : str
        The same for a new machine file, and what it means.
    model : str
        The shipped machine that stands for the loop where nothing is known.
    synonyms : tuple of str
        Further words for it in an interview.
    """

    name: Feedback
    encloses_backlash: bool
    has_controller: bool
    label: str
    comment: str
    model: str
    synonyms: tuple[str, ...]

    def closed_over(self, table: T, motor: T) -> T:
        """Return the side that the controller sees, or would see: that of the table or that of the motor."""
        return table if self.encloses_backlash else motor

    @property
    def own_channel(self) -> Literal["act", "motor"] | None:
        """Channel of a log that the loop itself can record; None where nothing is read."""
        return self.closed_over("act", "motor") if self.has_controller else None


_ALL: Final = (
    Loop(
        name="load",
        encloses_backlash=True,
        has_controller=True,
        label="scale on the table",
        comment="glass scale on the table: the play is inside the loop",
        model="mill",
        synonyms=("scale", "scales", "glass", "table"),
    ),
    Loop(
        name="motor",
        encloses_backlash=False,
        has_controller=True,
        label="encoder on the motor",
        comment="encoder on the motor: the play is outside the loop",
        model="router",
        synonyms=("encoder", "servo"),
    ),
    Loop(
        name="none",
        encloses_backlash=False,
        has_controller=False,
        label="no feedback",
        comment="stepper without encoder: no loop",
        model="stepper",
        synonyms=("neither", "stepper", "steppers"),
    ),
)

LOOPS: Final[Mapping[Feedback, Loop]] = {loop.name: loop for loop in _ALL}
"""Loops by name."""

EVERY_LOOP: Final[frozenset[Feedback]] = frozenset(LOOPS)
ENCLOSING_LOOPS: Final[frozenset[Feedback]] = frozenset(loop.name for loop in _ALL if loop.encloses_backlash)
CONTROLLED_LOOPS: Final[frozenset[Feedback]] = frozenset(loop.name for loop in _ALL if loop.has_controller)
