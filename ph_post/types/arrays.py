"""Arrays of the records: float64, read-only."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

Sealed = TypeVar("Sealed", bound=NDArray[Any])
Columns = TypeVar("Columns", bound=msgspec.Struct)


def frozen(values: Any) -> Array:
    """Return `values` as a read-only float64 array (records hold no other)."""
    return sealed(np.array(values, dtype=np.float64))


def sealed(array: Sealed) -> Sealed:
    """Return an array that nobody else holds, from now on read-only: :func:`frozen` without a copy."""
    array.setflags(write=False)
    return array


def take(record: Columns, rows: NDArray[Any]) -> Columns:
    """Return a record of columns, arrays of one length, with the rows chosen by number or by a mask."""
    return type(record)(**{name: getattr(record, name)[rows] for name in record.__struct_fields__})


def join_rows(records: Sequence[Columns]) -> Columns:
    """Put records of columns one behind the other; at least one."""
    names = records[0].__struct_fields__
    return type(records[0])(**{name: np.concatenate([getattr(one, name) for one in records]) for name in names})
