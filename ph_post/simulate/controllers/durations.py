"""Estimate how long a program runs, before it is run."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ph_post.bounds import check_samples
from ph_post.gcode.program import PartProgram
from ph_post.types import Array, IntArray

REMEDY: Final = "a higher feed, shorter dwells or a longer controller.servo_period_ms"
"""What makes a run shorter."""


def check_duration(
    program: PartProgram, motion: Array | IntArray | NDArray[np.int32], took: Array, period: float
) -> None:
    """Refuse moves that take too many servo periods.

    Parameters
    ----------
    program : PartProgram
    motion, took : Array, shape (n,)
        The program's motion that each move belongs to, and how long it takes at least, with the rest before it [s].
    period : float
        Servo period [s].

    Raises
    ------
    TooLargeError
    """
    if took.size:
        check_samples(program.name, float(took.sum()), period, REMEDY, _line(program, motion[took.argmax()]))


def refuse_run(program: PartProgram, motion: float, period: float) -> None:
    """Refuse a run that has come to a motion and takes longer than estimated, as accelerations may make it."""
    check_samples(program.name, math.inf, period, REMEDY, _line(program, motion))


def _line(program: PartProgram, motion: float) -> str:
    return program.line_words(int(program.motions.block[int(motion)]))
