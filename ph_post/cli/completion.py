"""``ph-post completion``: the shell scripts, and the completion of options and arguments.

Names and files are completed by the word that stands for them on the help page: where a command says MACHINE,
shipped machines and machine files are offered, and the command needs no code for it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final

import click
from click.shell_completion import CompletionItem

from ph_post.cli import options

Names = Callable[[], Iterable[str]]


class Completed(click.types.StringParamType):
    """A text whose names and files are completed.

    Parameters
    ----------
    names : callable, optional
        ``names() -> iterable of str``: called when a shell asks.
    files : tuple of str or None
        Endings of files to offer beside them, none for any file; None where it is no file at all.
    """

    def __init__(self, names: Names | None = None, files: tuple[str, ...] | None = ()) -> None:
        self._names, self._files = names, files

    def shell_complete(self, _ctx: click.Context, _param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Return the names that begin so, with files of the right endings; else whatever files there are."""
        known = self._names() if self._names is not None else ()
        found = [CompletionItem(name) for name in known if name.startswith(incomplete)]
        if self._files is None:
            return found
        if not found:
            return [CompletionItem(incomplete, type="file")]
        # A shell that is told to look for files forgets the names, so those that fit are named too.
        return found + [CompletionItem(file) for file in _files(incomplete, self._files)]


class CompletedFolder(click.types.StringParamType):
    """A text that is the name of a folder."""

    def shell_complete(self, _ctx: click.Context, _param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Leave it to the shell."""
        return [CompletionItem(incomplete, type="dir")]


def complete_by_metavar(command: click.Command) -> None:
    """Give the texts of a command, and of those below it, what completes them."""
    for parameter in command.params:
        kind = KINDS.get(parameter.opts[0]) or KINDS.get((parameter.metavar or "").strip("[]"))
        if kind is not None and type(parameter.type) is click.types.StringParamType:
            parameter.type = kind
    if isinstance(command, click.Group):
        for below in command.commands.values():
            complete_by_metavar(below)


def _files(incomplete: str, endings: tuple[str, ...]) -> list[str]:
    """List files of these endings that begin so."""
    folder, start = Path(incomplete).parent, Path(incomplete).name if incomplete else ""
    try:
        there = sorted(file.name for file in folder.iterdir() if file.is_file())
    except OSError:
        return []
    return [name for name in there if name.startswith(start) and name.endswith(endings) and name[0] != "."]


def _paths() -> Iterable[str]:
    from ph_post.files.storage import shipped_names

    return shipped_names("paths")


def _machines() -> Iterable[str]:
    from ph_post.files.storage import shipped_names

    return shipped_names("machines")


def _dialects() -> Iterable[str]:
    from ph_post.dialects.registry import dialect_names

    return dialect_names()


def _axes() -> Iterable[str]:
    from ph_post.types import MACHINE_AXES

    return MACHINE_AXES


def _loops() -> Iterable[str]:
    from ph_post.types import LOOPS

    return LOOPS


def _strategies() -> Iterable[str]:
    from ph_post.compensate.strategies.registry import strategy_names

    return strategy_names()


_ANY_FILE: Final = Completed()
_FOLDER: Final = CompletedFolder()

KINDS: Final[dict[str, click.types.StringParamType]] = {
    # by option
    "--strategy": Completed(_strategies, files=None),
    "--dialect": Completed(_dialects, files=None),
    "--loop": Completed(_loops, files=None),
    "--axis": Completed(_axes, files=None),
    "--copy": Completed(_machines),
    # by the word on the help page
    "IN": Completed(
        _paths,
        (".json", ".ngc", ".nc", ".tap", ".gcode", ".cnc", ".h", ".i", ".mpf", ".spf", ".csv"),
    ),
    "MACHINE": Completed(_machines, (".toml",)),
    "FOLDER": _FOLDER,
    **dict.fromkeys(
        (
            "FILE",
            "OUT",
            "OUT.csv",
            "T",
            "LOG",
            "PATHFILE",
            "PROGRAM",
            "ORIGINAL",
            "COMPENSATED",
            "A",
            "B",
            "MACHINE.toml",
            "BETTER.toml",
            "MEASURED.toml",
            "READINGS",
            "DRAWING",
            "INPUT",
            "TABLE",
            "PATH",
        ),
        _ANY_FILE,
    ),
}
"""What completes a text, by the option's name or by its word on the help page."""


SHELLS = ("bash", "zsh", "fish")

LINES = {
    "bash": "echo 'eval \"$(ph-post completion bash)\"' >> ~/.bashrc",
    "zsh": "echo 'eval \"$(ph-post completion zsh)\"' >> ~/.zshrc",
    "fish": "ph-post completion fish > ~/.config/fish/completions/ph-post.fish",
}
"""What switches completion on for good, by shell."""


@click.command()
@click.argument("shell", type=click.Choice(SHELLS))
@options.common
def command(shell: str, as_json: bool) -> int:
    """Print the script that completes ph-post's commands, options, names and files in a shell.

    Once for every new shell: in bash, eval "$(ph-post completion bash)" as the last line of ~/.bashrc; in
    zsh the same with zsh in ~/.zshrc, behind compinit; in fish, the script as
    ~/.config/fish/completions/ph-post.fish. Completed are commands, options, shipped paths and machines,
    strategies, dialects, and files.

    \b
    Examples:
      ph-post completion bash > ph-post.bash
      ph-post completion zsh
      ph-post completion fish

    \b
    JSON:
      shell   its name
      script  what it has to run
      line    what switches completion on for good
    """
    from click.shell_completion import get_completion_class

    from ph_post.cli.main import COMPLETE_VARIABLE, cli

    complete = get_completion_class(shell)
    assert complete is not None
    script = complete(cli, {}, "ph-post", COMPLETE_VARIABLE).source()
    if as_json:
        from ph_post.report.tables import print_json

        print_json({"shell": shell, "script": script, "line": LINES[shell]})
    else:
        click.echo(script)
        if sys.stdout.isatty():  # not where every new shell reads it
            click.echo(f"for good: {LINES[shell]}", err=True)
    return 0
