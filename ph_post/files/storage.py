"""Read inputs and name their kind, write outputs whole or not at all, and find the files shipped with the package.

``-`` is standard input or standard output. Several outputs are written as one: all of them or none.
"""

from __future__ import annotations

import codecs
import contextlib
import hashlib
import os
import pathlib
import re
import secrets
import shutil
import stat
import sys
from collections.abc import Iterator, Mapping
from typing import Final, Literal

import msgspec

from ph_post.errors import InputError
from ph_post.files.check import one_of

STDIO = "-"
"""The file name that means standard input or standard output."""


class SourceText(msgspec.Struct, frozen=True, kw_only=True):
    """An input as read: its name for messages, a name for its content where that has none, text and hash."""

    name: str
    stem: str
    text: str
    digest: str


def source_of(text: str, name: str, stem: str) -> SourceText:
    """Return a text that was made here as if it had been read, with its hash."""
    return SourceText(name=name, stem=stem, text=text, digest=hashlib.sha256(text.encode()).hexdigest())


def read_source(source: str | os.PathLike[str]) -> SourceText:
    """Read a UTF-8 text file, or standard input for ``-``.

    A byte order mark is dropped; `digest` is the SHA-256 of the bytes as they were.

    Raises
    ------
    InputError
        Where the file is missing, a directory, unreadable, empty or not UTF-8.
    """
    return decoded(read_raw(source))


class SourceBytes(msgspec.Struct, frozen=True, kw_only=True):
    """An input as it was read: its name for messages, a name for its content, and its bytes."""

    name: str
    stem: str
    data: bytes


def read_raw(source: str | os.PathLike[str]) -> SourceBytes:
    """Read a file, or standard input for ``-``.

    Raises
    ------
    InputError
        Where the file is missing, a directory or unreadable.
    """
    if not os.fspath(source):
        raise InputError("''", "is no file to read", expected="the name of a file")
    if os.fspath(source) == STDIO:
        if sys.stdin is None:
            raise InputError("stdin", "cannot be read", got="a closed stream")
        return SourceBytes(name="stdin", stem="stdin", data=sys.stdin.buffer.read())
    file = pathlib.Path(source)
    with reading_errors(file):
        return SourceBytes(name=os.fspath(source), stem=file.stem, data=file.read_bytes())


def decoded(raw: SourceBytes, foreign: bool = False) -> SourceText:
    """Return an input as text; a `foreign` one may also be UTF-16 or what Windows in the west of Europe writes.

    Raises
    ------
    InputError
        Where it is empty or not UTF-8.
    """
    name, stem, data = raw.name, raw.stem, raw.data
    text = _decode(data, name, foreign)
    if not text.strip():
        raise InputError(name, "the file is empty")
    return SourceText(name=name, stem=stem, text=text, digest=hashlib.sha256(data).hexdigest())


@contextlib.contextmanager
def reading_errors(file: pathlib.Path) -> Iterator[None]:
    """Turn what goes wrong while a file is read into an error of one line."""
    try:
        yield
    except FileNotFoundError:
        raise InputError(os.fspath(file), "no such file") from None
    except IsADirectoryError:
        raise InputError(os.fspath(file), "is a directory", expected="a file") from None
    except OSError as error:
        raise InputError(os.fspath(file), "cannot be read", got=error.strerror or str(error)) from None
    except ValueError as error:  # a NUL in the name
        raise InputError(repr(os.fspath(file)), "is not a file name", got=str(error)) from None


def _decode(data: bytes, name: str, foreign: bool) -> str:
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        other = "utf-16" if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else "cp1252"
        with contextlib.suppress(UnicodeDecodeError):
            if foreign and (other == "utf-16" or b"\0" not in data):
                return data.decode(other)
        got = "UTF-16" if other == "utf-16" else f"byte 0x{data[error.start]:02x}"
        raise _no_text(data, name, error.start, got) from None
    if "\0" in text:
        raise _no_text(data, name, data.index(b"\0"), "a zero byte")
    return text


def _no_text(data: bytes, name: str, place: int, got: str) -> InputError:
    """Return the error of a file that is no text from a place on."""
    before = data[:place]
    line, column = before.count(b"\n") + 1, place - before.rfind(b"\n")
    return InputError(f"{name}:{line}:{column}", "not a text file", expected="UTF-8", got=got)


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
    files = [_plan(name, products[name], number) for number, name in enumerate(products) if name not in streams]
    _refuse_same_place(files)
    try:
        for product in files:
            with _writing_errors(product.name):
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
    """Return whether a place is standard output, a device or a pipe."""
    try:
        mode = pathlib.Path(name).stat().st_mode
    except (OSError, ValueError):
        return name == STDIO
    return name == STDIO or not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def check_place(name: str) -> pathlib.Path:
    """Return the file that a name leads to, and refuse one that cannot be written.

    Raises
    ------
    InputError
        Where it is a folder, its folder is missing, or it or its folder is write-protected. A device or a pipe may be
        written wherever it is.
    """
    with _writing_errors(name):
        if not name:
            raise InputError("''", "is no file to write", expected="the name of a file")
        place = pathlib.Path(os.path.realpath(name))
        if place.is_dir():
            raise InputError(name, "is a directory", expected="a file to write")
        if not place.parent.is_dir():
            raise InputError(name, "cannot be written", expected="an existing folder", got=os.fspath(place.parent))
        if place.exists() and not os.access(place, os.W_OK):
            raise InputError(name, "cannot be written", got="a write-protected file")
        if not (_is_stream(name) or os.access(place.parent, os.W_OK | os.X_OK)):  # a new file is made beside it
            raise InputError(name, "cannot be written", got="a write-protected folder")
    return place


def _plan(name: str, content: Content, number: int) -> _Product:
    place = check_place(name)
    # By chance, not by process: what a killed run left behind must not be in the way of one of its number.
    stem = f".ph-post-{secrets.token_hex(6)}-{number}"
    fresh, old = place.with_name(f"{stem}.new"), place.with_name(f"{stem}.old")
    return _Product(name=name, place=place, data=_encoded(content), fresh=fresh, old=old)


def _refuse_same_place(files: list[_Product]) -> None:
    names: dict[pathlib.Path, str] = {}
    for product in files:
        if product.place in names:
            raise InputError(product.name, "two outputs have the same file", got=names[product.place])
        names[product.place] = product.name


@contextlib.contextmanager
def _writing_errors(name: str) -> Iterator[None]:
    """Turn what the operating system refuses into one line."""
    try:
        yield
    except OSError as error:
        raise InputError(name, "cannot be written", got=error.strerror or str(error)) from None
    except ValueError as error:  # a NUL in the name
        raise InputError(repr(name), "is not a file name", got=str(error)) from None


def _stage(product: _Product) -> None:
    """Write the temporary file, with the permissions the file will have."""
    with product.fresh.open("xb") as file:
        file.write(product.data)
        file.flush()
        os.fsync(file.fileno())
    if product.place.exists():
        product.fresh.chmod(stat.S_IMODE(product.place.stat().st_mode))


def _send(name: str, data: bytes) -> None:
    if name == STDIO:
        if sys.stdout is None:
            raise InputError("standard output", "cannot be written", got="a closed stream")
        sys.stdout.flush()
        sys.stdout.buffer.write(data)
        sys.stdout.buffer.flush()
        return
    with _writing_errors(name):
        pathlib.Path(name).write_bytes(data)


def _commit(files: list[_Product]) -> None:
    """Move all files into place; where one move fails, put back what the earlier ones replaced."""
    moved: list[_Product] = []
    try:
        for product in files:
            with _writing_errors(product.name):
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


def require_folder(name: str | os.PathLike[str], of: str, file: str = "") -> pathlib.Path:
    """Return the folder `name`, which holds `of`: logs, programs. `file` is what is expected in place of a file.

    An empty name is none, and not the folder that the command runs in: a script may have left it out.

    Raises
    ------
    InputError
        Where it is not there, no folder, or cannot be read.
    """
    folder = pathlib.Path(name)
    if not os.fspath(name) or not folder.is_dir():
        missing = not os.fspath(name) or not os.path.lexists(folder)
        what, expected = ("no such folder", "") if missing else ("is no folder", file)
        raise InputError(os.fspath(name) or "''", what, expected=expected or f"a folder of {of}")
    with reading_errors(folder), os.scandir(folder):
        return folder


def require_out(name: str | os.PathLike[str]) -> pathlib.Path:
    """Return the folder of ``-o``, which need not be there yet.

    Raises
    ------
    InputError
        Where it is no name of a folder.
    """
    if os.fspath(name) in ("", STDIO):
        raise InputError("-o", "no folder", expected="the name of a folder", got=repr(os.fspath(name)))
    return pathlib.Path(name)


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


Kind = Literal["paths", "programs", "machines", "freecad"]

_PACKAGE: Final = pathlib.Path(__file__).resolve().parent.parent
_FOLDERS: Final[dict[Kind, tuple[pathlib.Path, pathlib.Path, str]]] = {
    "paths": (_PACKAGE / "data" / "paths", _PACKAGE.parent / "paths", ".json"),
    "programs": (_PACKAGE / "data" / "programs", _PACKAGE.parent / "samples" / "programs", ".ngc"),
    "machines": (_PACKAGE / "data" / "machines", _PACKAGE.parent / "samples" / "machines", ".toml"),
    "freecad": (_PACKAGE / "data" / "freecad", _PACKAGE / "data" / "freecad", ".py"),
}


def shipped_names(kind: Kind) -> tuple[str, ...]:
    """Names of what is shipped, without their endings, in alphabetical order.

    Examples
    --------
    >>> "paper" in shipped_names("machines")
    True
    """
    folder, ending = _folder(kind)
    return tuple(sorted(file.stem for file in folder.glob(f"*{ending}")))


def shipped(kind: Kind, name: str) -> pathlib.Path:
    """Return the file of a shipped path, part program or machine.

    Raises
    ------
    InputError
        Where nothing of that name is shipped.
    """
    folder, ending = _folder(kind)
    if name not in shipped_names(kind):
        what = f"no such file, and none of the shipped {kind}"
        raise InputError(name, what, expected=one_of(shipped_names(kind), name))
    return folder / f"{name}{ending}"


def or_shipped(kind: Kind, source: str | os.PathLike[str]) -> str | os.PathLike[str]:
    """Return `source`, or the shipped file of that bare name where there is no file of the user's.

    Raises
    ------
    InputError
        Where `source` is a bare name that is neither a file nor shipped.
    """
    name = os.fspath(source)
    bare = name and pathlib.PurePath(name).name == name and not pathlib.PurePath(name).suffix and name != "-"
    return shipped(kind, name) if bare and not os.path.lexists(name) else source


def _folder(kind: Kind) -> tuple[pathlib.Path, str]:
    installed, source_tree, ending = _FOLDERS[kind]
    return (installed if installed.is_dir() else source_tree), ending


PROGRAM_ENDINGS: Final = frozenset(
    (".ngc", ".nc", ".tap", ".cnc", ".gcode", ".gco", ".gc", ".g", ".txt", ".eia", ".min", ".prg")
) | {".h", ".i", ".mpf", ".spf"}
"""Endings of part programs."""

JOB_ENDINGS: Final = (*sorted(PROGRAM_ENDINGS), ".json")
"""Endings of what is compensated in a folder: part programs and path files."""

HIDDEN: Final = (".", "~", "#")
"""How names begin that programs use while they write."""

BINARY_LOG_ENDINGS: Final = frozenset((".mat", ".npz", ".parquet"))
"""Endings of logs that are no text."""

DRAWING_ENDINGS: Final = frozenset((".dxf", ".svg"))
"""Endings of drawings, which are imported first."""

InputKind = Literal["path", "program", "log"]

_BLOCK: Final = re.compile(rb"(?:\s|\xef\xbb\xbf)*(?:[%(;]|/?\s*[A-Za-z]\s*[-+.#\[<\d]|(?:\d+\s+)?BEGIN\s+PGM)")
"""First characters of part programs: a percent sign, a comment, a word, or ``BEGIN PGM`` of Heidenhain."""


def is_program(raw: SourceBytes) -> bool:
    """Return true for a part program, false for a path file, by the ending or else by the first characters.

    Examples
    --------
    >>> is_program(SourceBytes(name="a.nc", stem="a", data=b""))
    True
    >>> is_program(SourceBytes(name="a", stem="a", data=b"{}"))
    False

    Raises
    ------
    InputError
        Where it is neither, but a drawing.
    """
    ending = _ending(raw)
    begins = _BLOCK.match(raw.data) is not None or raw.data.lstrip()[:1] in (b"#", b"$")
    return ending in PROGRAM_ENDINGS or (ending != ".json" and begins)


def input_kind(raw: SourceBytes) -> InputKind:
    """Return the kind of an input file, by its ending or else by its first characters.

    Examples
    --------
    >>> named = (("a.json", b"{"), ("a.nc", b"G1"), ("run.csv", b"t,X_cmd"), ("run.txt", b"0.5 0.25"))
    >>> [input_kind(SourceBytes(name=name, stem="", data=data)) for name, data in named]
    ['path', 'program', 'log', 'log']

    Raises
    ------
    InputError
        Where it is none of them, but a drawing.
    """
    ending = _ending(raw)
    if ending == ".json" or (ending not in BINARY_LOG_ENDINGS and raw.data.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] == b"{"):
        return "path"
    # A text file may be either.
    if ending in PROGRAM_ENDINGS and ending != ".txt":
        return "program"
    return "program" if ending not in (".csv", *BINARY_LOG_ENDINGS) and _BLOCK.match(raw.data) is not None else "log"


def _ending(raw: SourceBytes) -> str:
    """Return the ending of a name in small letters; refuse a drawing."""
    ending = pathlib.PurePath(raw.name).suffix.lower()
    if ending in DRAWING_ENDINGS:
        wanted = "a path file, such as ph-post import makes of it"
        raise InputError(raw.name, "this is a drawing", expected=wanted)
    return ending
