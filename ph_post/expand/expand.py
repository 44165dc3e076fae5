"""Write a program out: what it computes becomes plain motions, and all else stays in order."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import msgspec

from ph_post.expand.faults import ExpandError
from ph_post.expand.lines import Source
from ph_post.expand.run import Runner
from ph_post.expand.writing import DECIMALS, Written, head_line, is_written_out, with_original

_NEEDED: Final = re.compile(
    rb"#|\[|^[ \t]*/?[ \t]*(?:N[ \t\d.]*)?O[ \t]*[<\d]|"
    rb"G[ \t]*(?:7[34]|8[1-9])(?![\d.])|M[ \t]*(?:98|99|7[0-3])(?!\d)|[@^]",
    re.IGNORECASE | re.MULTILINE,
)
"""What a program that computes has somewhere."""

_COMMENT: Final = re.compile(rb"\([^)\r\n]*\)?|;[^\r\n]*")


class Expansion(msgspec.Struct, frozen=True, kw_only=True):
    """A program that was written out: its text, and what has to be known of it, a sentence each."""

    data: bytes
    notes: tuple[str, ...] = ()


def computes(data: bytes) -> bool:
    """Return whether a program may hold something that has to be written out."""
    return _NEEDED.search(_COMMENT.sub(b"", data)) is not None


class Folders:
    """Finds the files of subprograms, and keeps what was read.

    Parameters
    ----------
    folders : sequence of Path
        Where to look, in order.
    known : mapping of str to bytes
        Texts of files that are known already; then no folder is looked into.
    """

    def __init__(self, folders: tuple[Path, ...] = (), known: Mapping[str, bytes] | None = None) -> None:
        self._folders, self._known = folders, known
        self.read: dict[str, bytes] = {}
        self._sources: dict[str, Source | None] = {}

    def find(self, label: str) -> Source | None:
        """Return the file of a subprogram, None where there is none."""
        if label not in self._sources:
            self._sources[label] = self._look(f"{label}.ngc")
        return self._sources[label]

    def _look(self, name: str) -> Source | None:
        data: bytes | None = None
        if self._known is not None:
            data = self._known.get(name)
        elif Path(name).name == name:
            for folder in self._folders:
                try:
                    data = (folder / name).read_bytes()
                    break
                except OSError:
                    continue
        if data is None:
            return None
        self.read[name] = data
        return Source(name, data.decode("latin-1"))


def expand(
    data: bytes,
    name: str,
    folders: Folders | None = None,
    *,
    parameters: Mapping[int, float] | None = None,
) -> Expansion:
    r"""Write a program of LinuxCNC's language out.

    Parameters
    ----------
    data : bytes
    name : str
        For messages.
    folders : Folders, optional
        Where subprograms are that are files of their own.
    parameters : mapping of int to float, optional
        The controller's own file of parameters.

    Returns
    -------
    Expansion
        With the program's own bytes where there is nothing to write out.

    Raises
    ------
    ExpandError
        Where that is not possible, with file and line.

    Examples
    --------
    >>> found = expand(b"o1 sub\nG1 X#1 F60\no1 endsub\nG21 G90\no1 call [2*3]\nM2\n", "a.ngc")
    >>> found.data.split(b"\n")[1:4]
    [b'G21 G90', b'G1 X6 F60', b'M2']
    """
    if is_written_out(data) or not computes(data):
        return Expansion(data=data)
    folders = folders or Folders()
    end = b"\r\n" if b"\r\n" in data else b"\n"
    source = Source(name, data.decode("latin-1"))
    runner = Runner(source, folders.find, DECIMALS, parameters)
    lines = runner.run()
    if not runner.blocks.changed:
        return Expansion(data=data)
    digest = hashlib.sha256(data).hexdigest()
    at = 1 if lines and lines[0].lstrip().startswith("%") else 0
    lines = [*lines[:at], head_line(digest), *lines[at:]]
    text = b"".join(line.encode("latin-1") + end for line in lines)
    written = Written(
        original=data,
        digest=hashlib.sha256(text).hexdigest(),
        files=folders.read,
        parameters=None if parameters is None else dict(parameters),
    )
    assumed = sorted(runner.store.assumed)
    notes = list(runner.notes)
    if assumed and parameters is None:
        named = ", ".join(f"#{key}" for key in assumed[:8]) + (", …" if len(assumed) > 8 else "")
        notes.insert(0, f"taken to be 0, as nothing was put there before they were read: {named}")
    return Expansion(data=with_original(text, written, end), notes=tuple(notes))


__all__ = ["ExpandError", "Expansion", "Folders", "computes", "expand"]
