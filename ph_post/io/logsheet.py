"""What a log is read from: columns by name, their rows, and where each of them stands in the file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import msgspec

from ph_post.types import Array


class Sheet(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Columns of a file, which are read when asked for.

    `names` are its columns; `named` is False where the file does not name them and they are numbered from 1.
    `load` reads some of them, as they stand in the file, and `where` tells where a row is. `header` is where
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
