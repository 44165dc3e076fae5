"""Arrays of the records: float64, read-only."""

from __future__ import annotations

import math
import mmap
from collections.abc import Sequence
from typing import Any, Final, TypeVar

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


_LARGE: Final = 1 << 16
"""Bytes from which :func:`unwritten` has pages of its own."""


def unwritten(shape: int | tuple[int, ...], dtype: Any = np.float64) -> NDArray[Any]:
    """Return zeros that take no memory where nothing is written to them, however often they are read.

    `np.zeros` takes what was freed before, where there is such memory, and fills it.
    """
    size = np.dtype(dtype).itemsize * math.prod(shape if isinstance(shape, tuple) else (shape,))
    # Pages that processes share would be taken by reading.
    flags = getattr(mmap, "MAP_PRIVATE", 0) | getattr(mmap, "MAP_ANONYMOUS", 0)
    if size < _LARGE or not flags:
        return np.zeros(shape, dtype)
    return np.frombuffer(mmap.mmap(-1, size, flags=flags), dtype).reshape(shape)


def take(record: Columns, rows: NDArray[Any]) -> Columns:
    """Return a record of columns, arrays of one length, with the rows chosen by number or by a mask."""
    return type(record)(**{name: getattr(record, name)[rows] for name in record.__struct_fields__})


def join_rows(records: Sequence[Columns]) -> Columns:
    """Put records of columns one behind the other; at least one."""
    names = records[0].__struct_fields__
    return type(records[0])(**{name: np.concatenate([getattr(one, name) for one in records]) for name in names})
