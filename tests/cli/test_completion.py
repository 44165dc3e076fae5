"""What a shell completes: asked of a real bash, and of the program as zsh and fish ask it."""

from __future__ import annotations

import json
import os
import pty
import select
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from support.pipelines import PATIENCE

from ph_post.cli.main import COMMANDS, main
from ph_post.compensate.strategies.registry import strategy_names
from ph_post.dialects.registry import dialect_names
from ph_post.files.storage import shipped_names

ROOT = Path(__file__).resolve().parents[2]

TRY = """
eval "$(ph-post completion bash)"
compopt() { echo "option $1 $2"; }
COMP_WORDS=("$@"); COMP_CWORD=$(($#-1)); COMPREPLY=()
_ph_post_completion ph-post
printf '%s\\n' "${COMPREPLY[@]}"
"""


@pytest.fixture
def shell(tmp_path):
    """An environment with `ph-post` on its path, and a folder with files to complete."""
    program = tmp_path / "bin" / "ph-post"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m ph_post "$@"\n')
    program.chmod(0o755)
    folder = tmp_path / "shop"
    folder.mkdir()
    for name in ("mine.toml", "my part.ngc", "oval.ngc", "notes.txt"):
        (folder / name).touch()
    path = f"{program.parent}:{os.environ['PATH']}"
    return folder, {**os.environ, "PATH": path, "PYTHONPATH": str(ROOT), "TERM": "dumb"}


def bash(shell, *words):
    if shutil.which("bash") is None:
        pytest.skip("no bash here")
    folder, environment = shell
    done = subprocess.run(
        ["bash", "--norc", "-c", TRY, "try", *words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stderr == ""
    return [line for line in done.stdout.splitlines() if line]


def test_bash_completes_commands(shell):
    assert bash(shell, "ph-post", "") == list(COMMANDS)
    assert bash(shell, "ph-post", "insp") == ["inspect"]
    assert bash(shell, "ph-post", "machine", "") == ["measure", "new"]


def test_bash_completes_options(shell):
    assert bash(shell, "ph-post", "convert", "oval", "--str") == ["--strict", "--strategy"]
    assert bash(shell, "ph-post", "machine", "new", "--lo") == ["--loop", "--lost-motion"]


@pytest.mark.parametrize(
    ("words", "names"),
    [
        (("convert", ""), (*shipped_names("paths"), "oval.ngc", "my part.ngc")),
        (("convert", "ov"), ("oval", "oval.ngc")),
        (("convert", "oval", "-m", ""), (*shipped_names("machines"), "mine.toml")),
        (("inspect", "oval", "-m", "m"), ("mill", "mine.toml")),
        (("convert", "oval", "--strategy", ""), strategy_names()),
        (("convert", "oval", "--dialect", ""), dialect_names()),
        (("machine", "new", "--dialect", ""), dialect_names()),
        (("machine", "new", "--loop", ""), ("load", "motor", "none")),
        (("machines", "--copy", ""), shipped_names("machines")),
        (("convert", "oval", "--start", ""), ("rest", "moving")),
        (("completion", ""), ("bash", "zsh", "fish")),
    ],
)
@pytest.mark.thinned(8)
def test_bash_completes_names(shell, words, names):
    assert set(bash(shell, "ph-post", *words)) == set(names)


@pytest.mark.parametrize(
    ("words", "option"),
    [
        (("diagnose", ""), "default"),
        (("convert", "not-shipped"), "default"),
        (("convert", "oval", "-m", "samples/"), "default"),
        (("convert", "oval", "-o", ""), "default"),
        (("simulate", "oval", "-m", "mill", "--plot", ""), "default"),
        (("machine", "new", ""), "default"),
        (("calibrate", "-m", "mill", "-o", ""), "dirnames"),
    ],
)
def test_bash_looks_for_files_itself_where_no_name_fits(shell, words, option):
    assert bash(shell, "ph-post", *words) == [f"option -o {option}"]


def test_a_bash_that_somebody_types_into_completes(shell):
    if shutil.which("bash") is None:
        pytest.skip("no bash here")
    folder, environment = shell
    master, slave = pty.openpty()
    process = subprocess.Popen(
        ["bash", "--norc", "-i"],
        stdin=slave,
        stdout=slave,
        stderr=slave,
        cwd=folder,
        env={**environment, "PS1": "> "},
        start_new_session=True,
    )
    os.close(slave)
    try:
        os.write(master, b'eval "$(ph-post completion bash)"; echo rea""dy\n')
        _read_until(master, "ready\r")
        os.write(master, b"ph-post convert oval -m rou\t --strategy takeu\t")
        _read_until(master, "-m router  --strategy takeup ")
    finally:
        process.kill()
        process.wait()
        os.close(master)


def _read_until(master: int, text: str) -> str:
    screen = ""
    while text not in screen:
        ready, _, _ = select.select([master], [], [], PATIENCE)
        assert ready, screen
        read = os.read(master, 4096)
        assert read, screen
        screen += read.decode()
    return screen


@pytest.mark.parametrize(
    ("shell_name", "begins", "answer"),
    [
        ("zsh", "#compdef ph-post", "plain\ntakeup\n_"),
        ("fish", "function _ph_post_completion", "plain,takeup"),
    ],
)
def test_zsh_and_fish_ask_for_the_same(capsys, shell, shell_name, begins, answer):
    assert main(["completion", shell_name]) == 0
    script, talk = capsys.readouterr()
    assert script.startswith(begins)
    assert f"_PH_POST_COMPLETE={shell_name}_complete" in script
    assert talk == "", "a shell that evaluates the script at its start says nothing"
    words = "ph-post convert oval --strategy take"
    asks = {"_PH_POST_COMPLETE": f"{shell_name}_complete", "COMP_WORDS": words}
    asks["COMP_CWORD"] = "4" if shell_name == "zsh" else "take"
    done = subprocess.run(
        ["ph-post"], env={**shell[1], **asks}, capture_output=True, text=True, check=True, cwd=shell[0]
    )
    assert done.stdout.split() == answer.split()


def test_json_has_the_script(capsys):
    assert main(["completion", "bash", "--json"]) == 0
    view = json.loads(capsys.readouterr().out)
    assert view["shell"] == "bash"
    assert "complete -o nosort -F _ph_post_completion ph-post" in view["script"]
    assert "ph-post completion bash" in view["line"]


def test_completion_loads_nothing_slow(shell):
    # A shell waits for it at every key; numpy and what stands on it would take most of 0.3 s.
    code = (
        "import atexit, sys; "
        "slow = ('numpy', 'scipy', 'sympy', 'matplotlib', 'tomlkit', 'numba'); "
        "atexit.register(lambda: print([name for name in slow if name in sys.modules])); "
        "from ph_post.cli.main import main; main([])"
    )
    for words in (
        "co",
        "convert --st",
        "convert o",
        "convert oval -m m",
        "convert oval --strategy t",
        "convert oval --dialect g",
        "machine new --lo",
        "machine new --dialect g",
    ):
        asks = {"COMP_WORDS": f"ph-post {words}", "COMP_CWORD": str(len(words.split()))}
        done = subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            cwd=shell[0],
            env={**shell[1], **asks, "_PH_POST_COMPLETE": "bash_complete"},
            check=False,
        )
        assert done.stdout.startswith("plain,"), (words, done)
        assert done.stdout.splitlines()[-1] == "[]", words
