"""Writing outputs whole or not at all, several files as one."""

from __future__ import annotations

import contextlib
import os
import pathlib
import secrets
import shutil
import stat
import sys
from collections.abc import Iterator, Mapping

import msgspec

from ph_post.errors import InputError
from ph_post.io.source import STDIN as STDOUT

Content = bytes | str


class _Product(msgspec.Struct, frozen=True, kw_only=True):
    """One file to write: the name it was asked for by, its true place, and the names used on the way."""

    name: str
    place: pathlib.Path
    data: bytes
    fresh: pathlib.Path
    old: pathlib.Path


def write_atomically(products: Mapping[str, Content]) -> None:
    """Write every product to its place, or none of them.

    Each file is first written beside its place under a temporary name, so that a full disk or a missing
    folder is met before anything is touched; then all are moved into place. A file that was there keeps its
    permissions; of a symbolic link the target is replaced. ``-`` is standard output; it and devices cannot
    be taken back and are written after the temporary files and before the moves. The moves follow the order
    of `products`: a run killed between two of them has made the first.

    Parameters
    ----------
    products : mapping
        What to write by file name; text is written as UTF-8 with the line ends it has.

    Raises
    ------
    InputError
        Where a place cannot be written, or two products have the same place. Nothing has been touched then.
    """
    streams = {name: _encoded(content) for name, content in products.items() if _is_stream(name)}
    files = [
        _plan(name, products[name], number) for number, name in enumerate(products) if name not in streams
    ]
    _refuse_same_place(files)
    try:
        for product in files:
            with _refusing(product.name):
                _stage(product)
        for name, data in streams.items():
            _send(name, data)
        _commit(files)
    finally:
        for product in files:
            # What could not be made need not be taken away: a read-only disk refuses both.
            with contextlib.suppress(OSError):
                product.fresh.unlink(missing_ok=True)
                product.old.unlink(missing_ok=True)


def _encoded(content: Content) -> bytes:
    return content.encode() if isinstance(content, str) else content


def _is_stream(name: str) -> bool:
    """Tell standard output, devices and pipes from files and places for files."""
    try:
        mode = pathlib.Path(name).stat().st_mode
    except (OSError, ValueError):
        return name == STDOUT
    return name == STDOUT or not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def _plan(name: str, content: Content, number: int) -> _Product:
    with _refusing(name):
        place = pathlib.Path(os.path.realpath(name))
        if place.is_dir():
            raise InputError(name, "is a directory", expected="a file to write")
        if not place.parent.is_dir():
            raise InputError(
                name, "cannot be written", expected="an existing folder", got=os.fspath(place.parent)
            )
        if place.exists() and not os.access(place, os.W_OK):
            raise InputError(name, "cannot be written", got="a write-protected file")
    # By chance, not by process: what a killed run left behind must not be in the way of one of its number.
    stem = f".ph-post-{secrets.token_hex(6)}-{number}"
    fresh, old = place.with_name(f"{stem}.new"), place.with_name(f"{stem}.old")
    return _Product(name=name, place=place, data=_encoded(content), fresh=fresh, old=old)


def _refuse_same_place(files: list[_Product]) -> None:
    names: dict[pathlib.Path, str] = {}
    for product in files:
        if product.place in names:
            raise InputError(
                product.name, "would be written twice", got=f"the same file as {names[product.place]}"
            )
        names[product.place] = product.name


@contextlib.contextmanager
def _refusing(name: str) -> Iterator[None]:
    """Turn what the operating system refuses into one line."""
    try:
        yield
    except OSError as error:
        raise InputError(name, "cannot be written", got=error.strerror or str(error)) from None
    except ValueError as error:  # a NUL in the name
        raise InputError(repr(name), "is no file name", got=str(error)) from None


def _stage(product: _Product) -> None:
    """Write the temporary file, with the permissions the file will have."""
    with product.fresh.open("xb") as file:
        file.write(product.data)
        file.flush()
        os.fsync(file.fileno())
    if product.place.exists():
        product.fresh.chmod(stat.S_IMODE(product.place.stat().st_mode))


def _send(name: str, data: bytes) -> None:
    if name == STDOUT:
        if sys.stdout is None:
            raise InputError("standard output", "cannot be written", got="a closed stream")
        sys.stdout.flush()
        sys.stdout.buffer.write(data)
        sys.stdout.buffer.flush()
        return
    with _refusing(name):
        pathlib.Path(name).write_bytes(data)


def _commit(files: list[_Product]) -> None:
    """Move all files into place; where one move fails, put back what the earlier ones replaced."""
    moved: list[_Product] = []
    try:
        for product in files:
            with _refusing(product.name):
                if product.place.exists():
                    _keep(product.place, product.old)
                product.fresh.replace(product.place)
            moved.append(product)
    except InputError:
        for product in moved:
            if product.old.exists():
                product.old.replace(product.place)
            else:
                product.place.unlink()
        raise


def _keep(place: pathlib.Path, old: pathlib.Path) -> None:
    """Give the file that stands there a second name, by copying where the file system has no links."""
    try:
        old.hardlink_to(place)
    except OSError:
        shutil.copy2(place, old)


def make_folder(name: str) -> pathlib.Path:
    """Return the folder `name`, made if it is not there.

    Raises
    ------
    InputError
        If it cannot be made, or something else has its name.
    """
    folder = pathlib.Path(name)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(name, f"the folder cannot be made: {reason}") from error
    return folder
