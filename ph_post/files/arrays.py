"""Read and write named arrays: NumPy's ``.npz``, and ``.parquet`` where pyarrow is installed."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ph_post.errors import InputError

ARRAY_FORMATS: Final = (".npz", ".parquet")
"""Endings of files of named arrays."""

_BEGINS: Final = {".npz": (b"PK\x03\x04", b"PK\x05\x06"), ".parquet": (b"PAR1",)}
"""First bytes of such files. What the libraries say of other bytes is of no help, or bad advice: to allow pickles."""


def array_content(arrays: Mapping[str, NDArray[Any]], target: str, ending: str) -> bytes:
    """Return the bytes of a file of named arrays.

    Raises
    ------
    InputError
        If pyarrow is missing for ``.parquet``; `target` is the file that it names.
    """
    file = io.BytesIO()
    if ending == ".npz":
        named: dict[str, Any] = dict(arrays)
        np.savez_compressed(file, **named)
    else:
        arrow, parquet = _pyarrow(target)
        parquet.write_table(arrow.table(dict(arrays)), file)
    return file.getvalue()


def read_arrays(data: bytes, source: str, ending: str) -> dict[str, NDArray[Any]]:
    """Read a file of named arrays.

    Raises
    ------
    InputError
        If pyarrow is missing for ``.parquet``; `source` is the file that it names.
    Exception
        Whatever the decoder raises where the bytes are no such file.
    """
    if not data.startswith(_BEGINS[ending]):
        raise ValueError("other bytes" if data else "an empty file")
    if ending == ".npz":
        with np.load(io.BytesIO(data), allow_pickle=False) as stored:
            return dict(stored)
    table = _pyarrow(source)[1].read_table(io.BytesIO(data))
    return {name: table[name].to_numpy() for name in table.column_names}


def _pyarrow(file: str) -> tuple[Any, Any]:
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError:
        how = "pyarrow: pip install 'ph-post[parquet]'; or a .csv or .npz file"
        raise InputError(file, "Parquet files need a library that is not installed", expected=how) from None
    return pa, parquet
