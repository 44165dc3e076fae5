"""The help pages as data: every command, its paragraphs, and the blocks of examples and JSON keys."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from typing import NamedTuple

import click

from ph_post.cli.main import cli

HEADS = ("Examples:", "JSON:")


class Page(NamedTuple):
    """One command: its words on the command line, and what its help says.

    A paragraph that the help does not wrap is a tuple of its lines.
    """

    words: str
    command: click.Command
    paragraphs: tuple[str | tuple[str, ...], ...]
    examples: tuple[str, ...]
    json: tuple[str, ...]

    @property
    def keys(self) -> set[str]:
        """JSON keys that the help names."""
        heads = (re.split(r"\s{2,}", line)[0] for line in self.json if not line.startswith(" "))
        return {key.strip(" ,") for head in heads for key in head.split(",") if key.strip(" ,")}


def pages() -> list[Page]:
    """Return the pages of all commands, those of groups before those below them."""
    context = click.Context(cli, info_name="ph-post")
    return [
        page
        for name in cli.list_commands(context)
        if (command := cli.get_command(context, name)) is not None
        for page in _pages(f"ph-post {name}", command)
    ]


def _pages(words: str, command: click.Command) -> Iterator[Page]:
    blocks = re.split(r"\n\s*\n", inspect.cleandoc(command.help or ""))
    yield Page(
        words=words,
        command=command,
        paragraphs=tuple(map(_paragraph, filter(_is_text, blocks))),
        examples=_block(blocks, "Examples:"),
        json=_block(blocks, "JSON:"),
    )
    if isinstance(command, click.Group):
        for name, below in command.commands.items():
            yield from _pages(f"{words} {name}", below)


def _is_text(block: str) -> bool:
    """Tell paragraphs from the blocks that pages show under heads of their own."""
    return block.strip("\b\n").split("\n")[0].strip() not in HEADS


def _paragraph(block: str) -> str | tuple[str, ...]:
    if not block.startswith("\b"):
        return " ".join(block.split())
    return tuple(inspect.cleandoc(block.removeprefix("\b")).splitlines())


def _block(blocks: list[str], head: str) -> tuple[str, ...]:
    """Return the lines of a block that the help does not wrap, without their common indentation."""
    for block in blocks:
        lines = block.strip("\b\n").splitlines()
        if lines and lines[0].strip() == head:
            return tuple(inspect.cleandoc("\n".join(["", *lines[1:]])).splitlines())
    return ()
