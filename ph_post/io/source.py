"""Reading an input: a file or standard input, its name for messages, its bytes and their hash."""

from __future__ import annotations

import contextlib
import hashlib
import os
import pathlib
import sys
from collections.abc import Iterator

import msgspec

from ph_post.errors import InputError

STDIN = "-"
"""The file name that means standard input or standard output."""


class Source(msgspec.Struct, frozen=True, kw_only=True):
    """An input as read: its name for messages, a name for its content where that has none, text and hash."""

    name: str
    stem: str
    text: str
    digest: str


def source_of(text: str, name: str, stem: str) -> Source:
    """Return a text that was made here as if it had been read, with its hash."""
    return Source(name=name, stem=stem, text=text, digest=hashlib.sha256(text.encode()).hexdigest())


def read_source(source: str | os.PathLike[str]) -> Source:
    """Read a UTF-8 text file, or standard input for ``-``.

    A byte order mark is dropped; `digest` is the SHA-256 of the bytes as they were.

    Raises
    ------
    InputError
        Where the file is missing, a directory, unreadable, empty or not UTF-8.
    """
    return decoded(read_raw(source))


class Raw(msgspec.Struct, frozen=True, kw_only=True):
    """An input as it was read: its name for messages, a name for its content, and its bytes."""

    name: str
    stem: str
    data: bytes


def read_raw(source: str | os.PathLike[str]) -> Raw:
    """Read a file, or standard input for ``-``.

    Raises
    ------
    InputError
        Where the file is missing, a directory or unreadable.
    """
    if os.fspath(source) == STDIN:
        if sys.stdin is None:
            raise InputError("stdin", "cannot be read", got="a closed stream")
        return Raw(name="stdin", stem="stdin", data=sys.stdin.buffer.read())
    file = pathlib.Path(source)
    with told_errors(file):
        return Raw(name=os.fspath(source), stem=file.stem, data=file.read_bytes())


def decoded(raw: Raw) -> Source:
    """Return an input as text.

    Raises
    ------
    InputError
        Where it is empty or not UTF-8.
    """
    name, stem, data = raw.name, raw.stem, raw.data
    text = _decode(data, name)
    if not text.strip():
        raise InputError(name, "the file is empty")
    return Source(name=name, stem=stem, text=text, digest=hashlib.sha256(data).hexdigest())


@contextlib.contextmanager
def told_errors(file: pathlib.Path) -> Iterator[None]:
    """Turn what goes wrong while a file is read into the error that tells it in one line."""
    try:
        yield
    except FileNotFoundError:
        raise InputError(os.fspath(file), "no such file") from None
    except IsADirectoryError:
        raise InputError(os.fspath(file), "is a directory", expected="a file") from None
    except OSError as error:
        raise InputError(os.fspath(file), "cannot be read", got=error.strerror or str(error)) from None
    except ValueError as error:  # a NUL in the name
        raise InputError(repr(os.fspath(file)), "is no file name", got=str(error)) from None


def _decode(data: bytes, name: str) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = data[: error.start]
        line = before.count(b"\n") + 1
        column = error.start - before.rfind(b"\n")
        byte = f"byte 0x{data[error.start]:02x}"
        raise InputError(f"{name}:{line}:{column}", "not a text file", expected="UTF-8", got=byte) from None
