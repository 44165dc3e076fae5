"""A word on stderr where a run takes longer than a second, and none where it does not."""

from __future__ import annotations

import sys
import threading
import time
from types import TracebackType
from typing import TextIO

PATIENCE_S = 1.0
"""Seconds of silence before the first word."""


class Progress:
    """Names the stage a command is in: first when it has run for a second, then at most once a second.

    Examples
    --------
    >>> with Progress() as stage:
    ...     stage("planning")
    """

    def __init__(self, stream: TextIO | None = None, patience: float = PATIENCE_S) -> None:
        self._stream = stream or sys.stderr
        self._begin = time.monotonic()
        self._patience = patience
        self._current = ""
        self._told = ""
        self._done = threading.Event()
        self._teller = threading.Thread(target=self._tell_now_and_then, daemon=True)

    def __enter__(self) -> Progress:
        self._teller.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._done.set()
        self._teller.join()

    def __call__(self, stage: str) -> None:
        """Enter the next stage."""
        self._current = stage

    def _tell_now_and_then(self) -> None:
        while not self._done.wait(self._patience):
            current = self._current
            if current != self._told:
                self._told = current
                seconds = time.monotonic() - self._begin
                self._stream.write(f"ph-post: {current} ({seconds:.0f} s) ...\n")
                self._stream.flush()
