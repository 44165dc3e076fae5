"""Run commands as a person does, alone or beside the function of ``ph_post`` that they call."""

import io
import json
import sys
from typing import Any

import pytest

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


def printed(capsys: Any, *arguments: object, status: int = 0) -> Any:
    """Return what a command prints with ``--json``."""
    assert main([*map(str, arguments), "--json"]) == status
    return json.loads(capsys.readouterr().out)
