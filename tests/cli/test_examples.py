"""Every help page has examples, every one can be typed, and the quick ones run beside files of such names."""

from __future__ import annotations

import io
import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from support.helppages import pages

from ph_post.cli.main import cli, main

ROOT = Path(__file__).resolve().parents[2]
PAGES = pages()
RUN = {
    "convert",
    "inspect",
    "simulate",
    "verify",
    "diff",
    "sweep",
    "calibrate",
    "machines",
    "machine",
    "completion",
}
"""Commands whose examples run here; others need a controller, a screen, a record, or too long, or run elsewhere."""

EXAMPLES = [(page.words.split()[1], line) for page in PAGES for line in page.examples if "ph-post " in line]


def typed(line: str) -> list[list[str]]:
    """Words of every call of ph-post in a line."""
    words = shlex.split(line, comments=True)
    calls: list[list[str]] = []
    inside = False
    for word in words:
        if word == "ph-post":
            calls.append([])
            inside = True
        elif word in ("|", ">", "&&", ";"):
            inside = False
        elif inside:
            calls[-1].append(word)
    return calls


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.words)
def test_a_help_page_is_whole(page):
    assert page.examples, "no examples"
    assert page.paragraphs[0].endswith(".")
    assert any("ph-post" in line for line in page.examples)
    for parameter in page.command.params:
        if parameter.param_type_name == "option":
            assert re.search(r"^[A-Zβ].*[.?\]]$", parameter.help or "", re.DOTALL), parameter.opts


@pytest.mark.parametrize(("name", "line"), EXAMPLES, ids=[line for _, line in EXAMPLES])
def test_an_example_can_be_typed(name, line):
    calls = typed(line)
    assert any(call[0] == name for call in calls)
    for call in calls:
        if {"--help", "-h"} & set(call):
            continue
        command, words, told = cli, call, ["ph-post"]
        while True:
            context = command.make_context(told[-1], list(words), resilient_parsing=False)
            if not hasattr(command, "commands") and command is not cli:
                break
            _, command, words = command.resolve_command(context, [*context._protected_args, *context.args])
            told.append(command.name)


@pytest.fixture(scope="module")
def shop(tmp_path_factory):
    """A folder with the files that the examples name."""
    folder = tmp_path_factory.mktemp("shop")
    copies = {
        "part.json": "paths/oval.json",
        "mill.toml": "samples/machines/mill.toml",
        "router.toml": "samples/machines/router.toml",
        "part.ngc": "samples/programs/pocket.ngc",
        "old.ngc": "samples/programs/pocket.ngc",
        "readings.toml": "samples/readings/worn_stepper.toml",
    }
    for name, source in copies.items():
        (folder / name).write_bytes((ROOT / source).read_bytes())
    (folder / "answers.toml").write_text('loop = "load"\nlost_motion = 0.05\n')
    (folder / "grbl_settings.txt").write_text("$110=2400.000\n$111=2400.000\n$112=600.000\n")
    arcs = (ROOT / "samples" / "readings" / "ball_bar.csv").read_text().splitlines(keepends=True)
    first = next(k for k, line in enumerate(arcs) if line.startswith("360,")) + 1
    (folder / "ccw.csv").write_text("".join(arcs[:first]))
    (folder / "cw.csv").write_text("".join([*arcs[:5], *arcs[first:]]))
    quick = ("--effort", "0.01")
    compensated = str(folder / "part_compensated.ngc")
    assert main(["convert", str(folder / "part.ngc"), "-m", "router", *quick, "-o", compensated]) == 0
    (folder / "new.ngc").write_bytes(Path(compensated).read_bytes())
    table = ("--strategy", "suppress", "--table", str(folder / "part.csv"))
    assert main(["convert", str(folder / "part.json"), "-m", str(folder / "mill.toml"), *table]) == 0
    program = folder / "bin" / "ph-post"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m ph_post "$@"\n')
    program.chmod(0o755)
    (program.parent / "sender").write_text("#!/bin/sh\ncat > /dev/null\n")
    (program.parent / "sender").chmod(0o755)
    return folder


# Who watches a folder goes on until he is stopped.
RUNNABLE = [(name, line) for name, line in EXAMPLES if name in RUN and "--watch" not in line]
QUICK = dict(reversed(RUNNABLE)) | {name: line for name, line in RUNNABLE if "--undo" in line}
"""An example of each command that is tried always; that a path and a program are converted is tried elsewhere, too."""


@pytest.mark.parametrize(
    "line",
    [pytest.param(line, marks=() if QUICK[name] == line else pytest.mark.slow) for name, line in RUNNABLE],
    ids=lambda line: line.removeprefix("ph-post "),
)
def test_an_example_runs(shop, tmp_path, monkeypatch, capsys, line):
    for file in shop.iterdir():
        if file.is_file():
            (tmp_path / file.name).write_bytes(file.read_bytes())
    if "--undo" not in line:
        line = re.sub(r"(ph-post (?:convert|simulate) [^|>]*[^|> ])", r"\1 --effort 0.01", line)
    monkeypatch.chdir(tmp_path)
    status, out, err = (in_a_shell if re.search("[|>]", line) else here)(line, shop, monkeypatch, capsys)
    assert status == (1 if "ph-post diff" in line else 0), err
    if "--json" in line:
        asked = [page for page in PAGES if line.rpartition("| ")[2].startswith(page.words + " ")]
        assert json.loads(out).keys() <= asked[-1].keys


def here(line, shop, monkeypatch, capsys):
    capsys.readouterr()
    monkeypatch.setattr(sys, "stdin", io.StringIO("\n" * 20))
    status = main(shlex.split(line)[1:])
    return status, *capsys.readouterr()


def in_a_shell(line, shop, monkeypatch, capsys):
    environment = {**os.environ, "PATH": f"{shop / 'bin'}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        ["bash", "-o", "pipefail", "-c", line],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        stdin=subprocess.DEVNULL,
    )
    return done.returncode, done.stdout, done.stderr
