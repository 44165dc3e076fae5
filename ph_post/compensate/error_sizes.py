"""Sizes of the contour error of a command."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from ph_post.types import Array

MOST: Final = 0.95
"""Part of the time at which the error is within its percentile that is kept."""


class Sizes(NamedTuple):
    """Largest size of an error, its root mean square and 95th percentile [m], and the row of the largest."""

    max: float
    rms: float
    most: float
    row: int


def sizes_of(error: Array) -> Sizes:
    """Return the sizes of an error (n,) [m]; none where no rows count."""
    if error.size == 0:
        return Sizes(0.0, 0.0, 0.0, 0)
    size = np.abs(error)
    row = int(np.argmax(size))
    return Sizes(float(size[row]), float(np.sqrt(np.mean(size * size))), float(np.quantile(size, MOST)), row)
