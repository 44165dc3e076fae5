"""The command reference in docs/cli.md is what the commands say."""

from __future__ import annotations

import click
import pytest

from support import helppages, reference
from support.helppages import pages


def test_the_document_is_what_the_commands_say():
    same = reference.DOCUMENT.read_text(encoding="utf-8") == reference.reference()
    assert same, f"the commands' help has changed: {reference.HOW} writes docs/cli.md anew"


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.words)
def test_a_command_is_described_whole(page):
    section = reference.reference().split(f"\n## {page.words}\n")[1].split("\n## ")[0]
    for parameter in page.command.params:
        if isinstance(parameter, click.Option) and parameter.opts[0] not in reference.EVERYWHERE:
            assert parameter.opts[-1] in section
        elif isinstance(parameter, click.Argument):
            assert (parameter.metavar or str(parameter.type.choices[0])) in section
    words = " ".join(section.split())
    assert all(" ".join(line.split()) in words for line in (*page.examples, *page.json))


def test_any_command_can_be_described(monkeypatch):
    @click.command()
    @click.argument("files", nargs=-1)
    @click.option("--scale", type=float, default=2.0, show_default=True, help="A factor | for *all*.")
    @click.option("--kind", type=click.Choice(["a", "b"]), required=True, help="Which.")
    def plain():
        """Do something with X_act < 3.

        \b
        Examples:
          ph-post plain a b --kind a
        """

    @click.command()
    def bare():
        pass

    known = {"plain": plain, "bare": bare}
    group = click.Group("ph-post", commands=known)
    monkeypatch.setattr(helppages, "cli", group)
    text = reference.reference()
    assert "    ph-post plain [FILES]... --kind a/b [OPTIONS]\n" in text
    assert r"| `--scale NUMBER` | A factor \| for \*all\*. [2.0] |" in text
    assert "| `--kind a/b` | Which. |" in text
    assert "Do something with X_act &lt; 3." in text
    assert "```sh\nph-post plain a b --kind a\n```" in text
    assert "## ph-post bare\n\n    ph-post bare\n" in text
