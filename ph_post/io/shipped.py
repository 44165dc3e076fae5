"""Where shipped paths, machines and post-processors are: in an installed package, or in the source tree."""

from __future__ import annotations

import os
import pathlib
from typing import Final, Literal

from ph_post.errors import InputError
from ph_post.io.check import one_of

Kind = Literal["paths", "machines", "freecad"]

_PACKAGE: Final = pathlib.Path(__file__).resolve().parent.parent
_FOLDERS: Final[dict[Kind, tuple[pathlib.Path, pathlib.Path, str]]] = {
    "paths": (_PACKAGE / "_shipped" / "paths", _PACKAGE.parent / "paths", ".json"),
    "machines": (_PACKAGE / "_shipped" / "machines", _PACKAGE.parent / "samples" / "machines", ".toml"),
    "freecad": (_PACKAGE / "_shipped" / "freecad", _PACKAGE.parent / "freecad", ".py"),
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
    """Return the file of a shipped path or machine.

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
    bare = pathlib.PurePath(name).name == name and not pathlib.PurePath(name).suffix and name != "-"
    return shipped(kind, name) if bare and not os.path.lexists(name) else source


def _folder(kind: Kind) -> tuple[pathlib.Path, str]:
    installed, source_tree, ending = _FOLDERS[kind]
    return (installed if installed.is_dir() else source_tree), ending
