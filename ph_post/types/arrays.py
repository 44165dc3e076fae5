"""Arrays of the records: float64, read-only."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

Sealed = TypeVar("Sealed", bound=NDArray[Any])


def frozen(values: Any) -> Array:
    """Return `values` as a read-only float64 array (records hold no other)."""
    return sealed(np.array(values, dtype=np.float64))


def sealed(array: Sealed) -> Sealed:
    """Return an array that nobody else holds, from now on read-only: :func:`frozen` without a copy."""
    array.setflags(write=False)
    return array
