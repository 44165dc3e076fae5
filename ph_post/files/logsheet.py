"""The columns of a log by name, and how they are read from arrays: ``.mat``, ``.npz`` or ``.parquet``."""

from __future__ import annotations

import collections
import hashlib
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import msgspec
import numpy as np

from ph_post.errors import InputError
from ph_post.files.arrays import ARRAY_FORMATS, read_arrays
from ph_post.files.matlab import mat_variables
from ph_post.files.storage import SourceBytes
from ph_post.types import Array


class Sheet(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Columns of a file, which are read when asked for.

    `names` are its columns; `named` is False where the file does not name them and they are numbered from 1.
    `load` reads some of them, as they stand in the file, and `where` gives the place of a row. `header` is where
    the names are. `remarks` are what stands beside the columns. `lost` is the first row before which the
    recorder says that it lost samples, None where it says nothing.
    """

    name: str
    stem: str
    digest: str
    names: tuple[str, ...]
    rows: int
    load: Callable[[Sequence[str]], dict[str, Array]]
    where: Callable[[int], str]
    header: str
    named: bool = True
    remarks: Mapping[str, str] = {}
    lost: int | None = None
    warnings: tuple[str, ...] = ()

    @property
    def listed(self) -> str:
        """The columns in words."""
        if self.named:
            return ", ".join(self.names) or "no columns"
        return f"columns 1 to {len(self.names)}, without names"


STORED_FORMATS: Final = (".mat", *ARRAY_FORMATS)
"""Endings of logs that are not text."""

_HDF5: Final = (b"MATLAB 7.3", b"\x89HDF")
_MAGIC: Final = ((b"MATLAB ", ".mat"), (b"\x89HDF", ".mat"), (b"PK\x03\x04", ".npz"), (b"PAR1", ".parquet"))


def stored_ending(raw: SourceBytes) -> str:
    """Return which kind of stored log it is by its first bytes or its ending, nothing for a text.

    Examples
    --------
    >>> stored_ending(SourceBytes(name="run.mat", stem="run", data=b""))
    '.mat'
    """
    by_bytes = next((ending for magic, ending in _MAGIC if raw.data.startswith(magic)), "")
    return by_bytes or next((ending for ending in STORED_FORMATS if raw.name.lower().endswith(ending)), "")


def stored_sheet(raw: SourceBytes, ending: str) -> Sheet:
    """Read stored arrays: vectors of the common length are columns, single values remarks.

    Raises
    ------
    InputError
        Where the file cannot be read or holds no columns.
    """
    if raw.data.startswith(_HDF5):
        raise InputError(
            raw.name,
            "a .mat file of version 7.3, which is HDF5, cannot be read",
            expected="version 7 or older, such as save(..., '-v7') writes, or CSV",
        )
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            stored = mat_variables(raw.data) if ending == ".mat" else read_arrays(raw.data, raw.name, ending)
    except InputError:
        raise
    except Exception as error:  # whatever a decoder of foreign bytes stumbles over
        what = f"not a {ending} file"
        raise InputError(raw.name, what, got=" ".join(str(error).split())[:100] or "other bytes") from None
    return _sheet(raw, stored)


def _sheet(raw: SourceBytes, variables: Mapping[str, Any]) -> Sheet:
    vectors: dict[str, Array] = {}
    remarks: dict[str, str] = {}
    other: list[str] = []
    for name, value in variables.items():
        array = np.squeeze(np.asarray(value))
        if array.ndim == 0 and array.dtype.kind in "biufU":
            remarks[name] = f"{array.item():.12g}" if array.dtype.kind in "iuf" else str(array.item())
        elif array.ndim == 1 and array.dtype.kind in "biuf":
            vectors[name] = array.astype(np.float64)
        else:
            other.append(name)
    rows = _common_length(vectors)
    columns = {name: vector for name, vector in vectors.items() if vector.size == rows}
    other += [name for name in vectors if name not in columns]
    aside = (f"variables ignored, not columns of {rows} rows: {', '.join(other)}",) if other else ()
    return Sheet(
        name=raw.name,
        stem=raw.stem,
        digest=hashlib.sha256(raw.data).hexdigest(),
        names=tuple(columns),
        rows=rows,
        load=lambda names: {name: columns[name] for name in names},
        where=lambda row: f"{raw.name}: row {row + 1}",
        header=raw.name,
        remarks=remarks,
        warnings=aside,
    )


def _common_length(vectors: Mapping[str, Array]) -> int:
    """Return the length of `t`, or else that of most vectors, the longest of several."""
    if "t" in vectors:
        return vectors["t"].size
    counts = collections.Counter(vector.size for vector in vectors.values())
    return max(counts, key=lambda size: (counts[size], size), default=0)
