"""Output places of a converted program: a file of its own, beside the original, or in its place."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
import msgspec

from ph_post.errors import InputError
from ph_post.files.storage import STDIO, check_place


class Target(msgspec.Struct, frozen=True, kw_only=True):
    """Where the program goes, and where the bytes go that it replaces (None: nowhere)."""

    program: str
    backup: str | None = None


def choose_target(source: str, how: Mapping[str, Any]) -> Target | None:
    """Choose by -o, --suffix and --in-place; None where none of them is given.

    Raises
    ------
    click.UsageError
        Where two of them are given, or one that needs a file and the input is none.
    """
    wanted = [
        name
        for name, given in (
            ("-o", how["output"] is not None),
            ("--suffix", how["suffix"] is not None),
            ("--in-place", how["in_place"]),
        )
        if given
    ]
    if len(wanted) > 1:
        raise click.UsageError(f"one place for the program; got {' and '.join(wanted)}")
    if how["backup"] and not how["in_place"]:
        raise click.UsageError("--backup is for --in-place, which replaces the original")
    if how["output"] == "":
        raise click.UsageError("-o needs the name of a file; got an empty one")
    if not wanted or wanted == ["-o"]:
        return Target(program=how["output"]) if wanted else None
    if source == STDIO:
        raise click.UsageError(f"{wanted[0]} needs a file; got standard input")
    file = Path(source)
    if wanted == ["--suffix"]:
        refuse_bad_suffix(how["suffix"])
        return Target(program=str(file.with_name(file.stem + how["suffix"] + file.suffix)))
    return Target(program=source, backup=f"{source}{how['backup']}" if how["backup"] else None)


def check_places(
    inputs: Mapping[str, str | None], products: Mapping[str, str | None], *, json: bool, renews: str = ""
) -> None:
    """Refuse two inputs or two products in one place, a product in place of an input, and a place that is none.

    Before the work is done: nobody waits for a result that cannot be written.

    Parameters
    ----------
    inputs, products : mapping
        What was named, by its option; None where nothing was.
    json : bool
        Whether standard output is taken by the object.
    renews : str
        The input that -o may write over, as it is a newer one of the same kind.

    Raises
    ------
    click.UsageError
    InputError
        Where a folder is missing, or a file or its folder is write-protected.
    """
    streams = [option for option, name in inputs.items() if name == STDIO]
    if len(streams) > 1:
        raise click.UsageError(f"standard input can give one of them; got - for {' and '.join(streams)}")
    taken = {STDIO: "--json"} if json else {}
    for option, name in products.items():
        if name is None:
            continue
        place = STDIO if name == STDIO else os.path.realpath(name)
        if place in taken:
            shown = "standard output" if name == STDIO else name
            raise click.UsageError(f"{shown} can take one product; got {taken[place]} and {option}")
        taken[place] = option
        if name == STDIO:
            continue
        for other, read in inputs.items():
            renewed = option == "-o" and other == renews
            if read not in (None, STDIO) and not renewed and place == os.path.realpath(str(read)):
                raise click.UsageError(f"{option} would write over {other} ({name})")
        check_place(name)


def refuse_bad_suffix(suffix: str) -> None:
    """Refuse what is no end of a file's name.

    Raises
    ------
    click.UsageError
        Where it is empty, or leads to another folder.
    """
    if not suffix or "/" in suffix or os.sep in suffix:
        raise click.UsageError(f"--suffix needs an end for the file's name; got {suffix!r}")


def products_of(target: Target, program: bytes, replaced: bytes) -> dict[str, str | bytes]:
    """Return what to write by file name, in this order: the backup stands before the original is replaced.

    Where nothing changes there is nothing to keep, and an older backup, of the original, stays.

    Parameters
    ----------
    target : Target
    program, replaced : bytes
        The new program, and the one that it replaces.

    Raises
    ------
    InputError
        Where the backup would overwrite something else: it may be the only copy of the original.
    """
    if target.backup is None or program == replaced:
        return {target.program: program}
    there = Path(target.backup)
    if there.exists() and there.read_bytes() != replaced:
        raise InputError(
            target.backup,
            "the backup is there already and holds something else",
            expected="another ending after --backup, or that file moved away",
        )
    return {target.backup: replaced, target.program: program}


def refuse_existing(name: str, force: bool) -> None:
    """Refuse to replace a person's file without being told to, and a place where nothing can be written.

    Raises
    ------
    InputError
        Where something of that name is there, and `force` is not given; where it leads to no file.
    """
    if name == STDIO:
        return
    if not force and os.path.lexists(name):
        raise InputError(name, "is there already", expected="--force, or another name")
    check_place(name)
