"""Run commands as a person does, alone or beside the function of ``ph_post`` that they call."""

import io
import json
import sys
from typing import Any

import pytest

import ph_post
from ph_post.cli.main import main
from tests.support.streams import without_progress


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    """Run a command; return its exit status, what it prints, and what it says but for its progress."""
    status = main([str(one) for one in arguments])
    streams = capsys.readouterr()
    return status, streams.out, without_progress(streams.err)


def answered(monkeypatch: pytest.MonkeyPatch, *lines: str) -> None:
    """Have lines stand on standard input, as answers of a person."""
    monkeypatch.setattr(sys, "stdin", io.StringIO("".join(f"{line}\n" for line in lines)))


def once(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """Have a function of ``ph_post`` work once for calls that are alike: what is new is how a command shows it."""
    work, known = getattr(ph_post, name), {}

    def remembered(*given: Any, progress: object = None, **asked: Any) -> Any:
        key = (given, tuple(sorted(asked.items())))
        if key not in known:
            known[key] = work(*given, progress=progress, **asked)
        return known[key]

    monkeypatch.setattr(ph_post, name, remembered)


def printed(capsys: Any, *arguments: object, status: int = 0) -> Any:
    """Return what a command prints with ``--json``."""
    assert main([*map(str, arguments), "--json"]) == status
    return json.loads(capsys.readouterr().out)
