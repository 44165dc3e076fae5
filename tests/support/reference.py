"""The command reference, docs/cli.md, made of the commands' own help.

``python -m tests.support.reference`` writes it anew; a test compares.
"""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path

import click

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from support.helppages import Page, pages

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "cli.md"
HOW = ".venv/bin/python -m tests.support.reference"

WIDTH = 120
SHARED = 3
"""As many commands have to share an option for it to be described once."""

Shared = dict[tuple[str, str], tuple[click.Option, bool]]
"""Options by what they are and say, and whether all commands have the same default of them."""

EVERYWHERE = ("--json", "--debug")

HEAD = """\
<!-- made by `python -m tests.support.reference`, not by hand -->

# Commands

The help page of every command. All of them take `-h`, `--help` and `--debug` (a traceback
where something goes wrong), and all but `filter`, `slicer` and `freecad` take `--json` (one JSON object on
standard output and nothing else there; what does not exist is `null`). Lengths are in mm, feeds in mm/min,
times in s; `-` is standard input or output.
Exit status, where a command says nothing else: 0 done, or no difference; 1 a difference found, a check failed
or a target missed; 2 bad usage or bad input, reported in one line on standard error; 130 interrupted.
"""


def reference() -> str:
    """Return the whole document."""
    every = pages()
    shared = _shared(every)
    index = " · ".join(f"[{page.words[8:]}](#{page.words.replace(' ', '-')})" for page in every)
    parts = [HEAD, *_filled(index), "", "## Options that several commands share", ""]
    parts += _table([_row(one, _default(one) if same else "") for one, same in shared.values()])
    for page in every:
        parts += ["", *_section(page, shared)]
    return "\n".join([*parts, ""])


def _options(command: click.Command) -> list[click.Option]:
    return [one for one in command.params if isinstance(one, click.Option) and one.opts[0] not in EVERYWHERE]


def _key(option: click.Option) -> tuple[str, str]:
    return _spelled(option), option.help or ""


def _shared(every: list[Page]) -> Shared:
    """Return the options that several commands have in the same words, and whether their default is one."""
    found: dict[tuple[str, str], list[click.Option]] = {}
    for page in every:
        for one in _options(page.command):
            found.setdefault(_key(one), []).append(one)
    return {
        key: (those[0], len({_default(one) for one in those}) == 1)
        for key, those in found.items()
        if len(those) >= SHARED
    }


def _section(page: Page, shared: Shared) -> Iterator[str]:
    yield f"## {page.words}"
    yield ""
    yield f"    {_synopsis(page)}"
    for paragraph in page.paragraphs:
        yield ""
        yield from _filled(_escaped(paragraph)) if isinstance(paragraph, str) else _as_it_is(paragraph)
    options = _options(page.command)
    if own := [_row(one, _default(one)) for one in options if _key(one) not in shared]:
        yield ""
        yield from _table(own)
    if others := [_mention(one, shared[_key(one)][1]) for one in options if _key(one) in shared]:
        yield ""
        yield from _filled(f"{'Also' if own else 'Options'}, as above: {', '.join(others)}.")
    if page.examples:
        yield from ("", "```sh", *page.examples, "```")
    if page.json:
        yield from ("", "JSON:", "", "```text", *page.json, "```")


def _as_it_is(lines: Sequence[str]) -> Iterator[str]:
    yield from ("```text", *lines, "```")


def _mention(option: click.Option, same: bool) -> str:
    """Name an option that is described above, with its default where that is this command's own."""
    return f"`{option.opts[-1]}`" + ("" if same else f" {_escaped(_default(option))}".rstrip())


def _synopsis(page: Page) -> str:
    """Return the command line: arguments, options that are required, and that there are others."""
    words = [page.words]
    for one in page.command.params:
        if isinstance(one, click.Argument):
            words.append(_argument(one))
        elif isinstance(one, click.Option) and one.required:
            words.append(" ".join([one.opts[0], *_spelled(one).split(" ")[len(one.opts) :]]))
    if isinstance(page.command, click.Group):
        words.append("|".join(page.command.commands))
    if any(not one.required for one in _options(page.command)):
        words.append("[OPTIONS]")
    return " ".join(words)


def _argument(argument: click.Argument) -> str:
    choices = argument.type.choices if isinstance(argument.type, click.Choice) else ()
    word = argument.metavar or "|".join(map(str, choices)) or str(argument.name).upper()
    word = word if argument.required or word.startswith("[") else f"[{word}]"
    return word if argument.nargs == 1 or word.endswith("...") else f"{word}..."


def _table(rows: list[str]) -> list[str]:
    return ["| option | |", "|---|---|", *rows]


def _row(option: click.Option, default: str) -> str:
    told = " ".join(f"{option.help or ''} {default}".split())
    return f"| `{_spelled(option)}` | {_escaped(told)} |"


def _spelled(option: click.Option) -> str:
    """Return an option's names and the word behind them."""
    names = ", ".join([*option.opts, *option.secondary_opts])
    if option.is_flag:
        return names
    if isinstance(option.type, click.Choice) and option.metavar is None:
        return f"{names} {'/'.join(map(str, option.type.choices))}"
    word = option.metavar or {"integer": "N", "float": "NUMBER"}.get(option.type.name.split()[0], "TEXT")
    return f"{names} {word}"


def _default(option: click.Option) -> str:
    """Return the default as the help page has it."""
    if not option.show_default:
        return ""
    value = option.default if option.show_default is True else option.show_default
    return f"[{value}]" if isinstance(value, int | float | str) and value is not True and value != "" else ""


def _escaped(text: str) -> str:
    """Return text that Markdown shows as it is; what stands between back-ticks is left alone."""
    parts = text.split("`")
    for place in range(0, len(parts), 2):
        parts[place] = parts[place].replace("*", r"\*").replace("<", "&lt;")
    return "`".join(parts).replace("|", r"\|")


def _filled(text: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, break_long_words=False, break_on_hyphens=False)


if __name__ == "__main__":
    DOCUMENT.write_text(reference(), encoding="utf-8")
