"""The commands that other programs call, run as they run them: processes of their own, but for `call`."""

from __future__ import annotations

import contextlib
import io
import os
import queue
import shlex
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from unittest import mock

from ph_post.cli.main import main

ROOT = Path(__file__).resolve().parents[2]

PATIENCE = 120.0
"""Longest time to wait for a line [s]: the machine may be busy, and compiles once."""

END = 300.0
"""Longest time to wait for the end of a command [s]."""

TOLD = (
    "ph_post",
    "PYTHONPATH",
    "SLIC3R_PP_HOST",
    "SLIC3R_PP_OUTPUT_NAME",
    "PH_POST_MACHINE",
    "INI_FILE_NAME",
)


def environment(**more: str) -> dict[str, str]:
    """Return what a command is started with, and nothing that these tests were."""
    found = {key: value for key, value in os.environ.items() if key not in TOLD}
    return {**found, "PYTHONPATH": str(ROOT), **more}


def command(*words: str | Path) -> list[str]:
    """Return a command line of ``ph-post`` for this source tree."""
    return [sys.executable, "-m", "ph_post", *map(str, words)]


def run(*words: str | Path, cwd: Path | None = None, **more: str) -> subprocess.CompletedProcess[bytes]:
    """Run ``ph-post`` to its end, with nothing on standard input."""
    return subprocess.run(
        command(*words),
        env=environment(**more),
        cwd=cwd,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        check=False,
        timeout=END,
    )


def call(*words: str | Path, cwd: Path | None = None, **more: str) -> subprocess.CompletedProcess[bytes]:
    """Run ``ph-post`` to its end in this process, where a process of its own is not what counts."""
    out, err = (io.TextIOWrapper(io.BytesIO(), "utf-8", newline="") for _ in range(2))
    with (
        mock.patch.dict(os.environ, environment(**more), clear=True),
        mock.patch.object(sys, "stdin", io.TextIOWrapper(io.BytesIO())),
        contextlib.chdir(cwd or Path.cwd()),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        status = main([str(word) for word in words])
    told = []
    for stream in (out, err):
        stream.flush()
        told.append(stream.buffer.getvalue())
    return subprocess.CompletedProcess(list(words), status, *told)


def executable(place: Path, *words: str) -> Path:
    """Write an executable that calls ``ph-post`` with these words first, as an installed one would."""
    place.write_text(f'#!/bin/sh\nPYTHONPATH={shlex.quote(str(ROOT))} exec {shlex.join(command(*words))} "$@"\n')
    place.chmod(0o755)
    return place


class Watching:
    """A running ``ph-post convert --watch``, and what it says."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process
        self.said: list[str] = []
        self._lines: queue.Queue[str | None] = queue.Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stderr is not None
        with self.process.stderr as stream:
            for line in stream:
                self._lines.put(line.rstrip("\n"))
        self._lines.put(None)

    def close(self) -> None:
        """Be sure that it is over."""
        self.process.kill()
        self.process.wait()
        self._reader.join()

    def wait_for(self, words: str) -> str:
        """Wait for a line that holds these words."""
        end = time.monotonic() + PATIENCE
        while (line := self._lines.get(timeout=max(0.0, end - time.monotonic()))) is not None:
            self.said.append(line)
            if words in line:
                return line
        raise AssertionError("\n".join(self.said))

    def stop(self, how: signal.Signals = signal.SIGTERM) -> int:
        """Stop it, and take in all that it said; its exit status."""
        self.process.send_signal(how)
        return self.end()

    def end(self) -> int:
        """Wait for its end; its exit status."""
        status = self.process.wait(PATIENCE)
        while (line := self._lines.get(timeout=PATIENCE)) is not None:
            self.said.append(line)
        return status


@contextlib.contextmanager
def heeding_interrupts() -> Iterator[None]:
    """Let processes that begin here heed Ctrl-C, also where a shell runs the tests in its background."""
    before = signal.getsignal(signal.SIGINT)
    if before is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextlib.contextmanager
def watching(folder: Path, *words: str | Path) -> Iterator[Watching]:
    """Watch a folder while the block runs."""
    options: Sequence[str | Path] = ("-m", "stepper", "--settle", "0.6", "--max-slowdown", "1", *words)
    with heeding_interrupts():
        process = subprocess.Popen(
            command("convert", "--watch", folder, *options),
            env=environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
    found = Watching(process)
    try:
        found.wait_for("watching")
        yield found
    finally:
        found.close()
