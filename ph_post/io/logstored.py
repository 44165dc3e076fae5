"""Logs as stored arrays: ``.mat`` files, ``.npz`` and ``.parquet``, a variable a column."""

from __future__ import annotations

import collections
import hashlib
import io
import warnings
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np

from ph_post.errors import InputError
from ph_post.io.logmat import mat_variables
from ph_post.io.logsheet import Sheet
from ph_post.io.source import Raw
from ph_post.types import Array

_HDF5: Final = (b"MATLAB 7.3", b"\x89HDF")
_MAGIC: Final = ((b"MATLAB ", ".mat"), (b"\x89HDF", ".mat"), (b"PK\x03\x04", ".npz"), (b"PAR1", ".parquet"))


def stored_ending(raw: Raw) -> str:
    """Return which kind of stored log it is by its first bytes or its ending, nothing for a text.

    Examples
    --------
    >>> stored_ending(Raw(name="run.mat", stem="run", data=b""))
    '.mat'
    """
    by_bytes = next((ending for magic, ending in _MAGIC if raw.data.startswith(magic)), "")
    return by_bytes or next((ending for ending in _READERS if raw.name.lower().endswith(ending)), "")


def stored_sheet(raw: Raw, ending: str) -> Sheet:
    """Read stored arrays: vectors of the common length are columns, single values remarks.

    Raises
    ------
    InputError
        Where the file cannot be read or holds no columns.
    """
    if raw.data.startswith(_HDF5):
        raise InputError(
            raw.name, "a .mat file of version 7.3, which is HDF5, cannot be read",
            expected="version 7 or older, such as save(..., '-v7') writes, or CSV",
        )  # fmt: skip
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            variables = _READERS[ending](raw.data)
    except ImportError:
        how = "pyarrow: pip install 'ph-post[parquet]'; or a .csv, .npz or .mat file"
        raise InputError(
            raw.name, "Parquet logs need a library that is not installed", expected=how
        ) from None
    except Exception as error:  # whatever a decoder of foreign bytes stumbles over
        what = f"not a {ending} file"
        raise InputError(raw.name, what, got=" ".join(str(error).split())[:100] or "other bytes") from None
    return _sheet(raw, variables)


def _sheet(raw: Raw, variables: Mapping[str, Any]) -> Sheet:
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
    aside = (f"variables left aside, no columns of {rows} rows: {', '.join(other)}",) if other else ()
    return Sheet(
        name=raw.name, stem=raw.stem, digest=hashlib.sha256(raw.data).hexdigest(), names=tuple(columns),
        rows=rows, load=lambda names: {name: columns[name] for name in names},
        where=lambda row: f"{raw.name}: row {row + 1}", header=raw.name, remarks=remarks, warnings=aside,
    )  # fmt: skip


def _common_length(vectors: Mapping[str, Array]) -> int:
    """Return the length of `t`, or else that of most vectors, the longest of several."""
    if "t" in vectors:
        return vectors["t"].size
    counts = collections.Counter(vector.size for vector in vectors.values())
    return max(counts, key=lambda size: (counts[size], size), default=0)


def _npz(data: bytes) -> dict[str, Any]:
    with np.load(io.BytesIO(data), allow_pickle=False) as stored:
        return dict(stored)


def _parquet(data: bytes) -> dict[str, Any]:
    from pyarrow import parquet

    table = parquet.read_table(io.BytesIO(data))
    return {name: table[name].to_numpy() for name in table.column_names}


_READERS: Final[dict[str, Callable[[bytes], dict[str, Any]]]] = {
    ".mat": mat_variables,
    ".npz": _npz,
    ".parquet": _parquet,
}
