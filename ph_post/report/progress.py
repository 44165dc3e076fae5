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
    """Names the stage a command is in, once the command has run for longer than a second.

    Examples
    --------
    >>> with Progress() as stage:
    ...     stage("planning")
    """

    def __init__(self, stream: TextIO | None = None, patience: float = PATIENCE_S) -> None:
        self._stream = stream or sys.stderr
        self._begin = time.monotonic()
        self._patience = patience
        self._lock = threading.Lock()
        self._current = ""
        self._told = ""
        self._done = False
        self._timer = threading.Timer(patience, self._tell)
        self._timer.daemon = True

    def __enter__(self) -> Progress:
        self._timer.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._timer.cancel()
        with self._lock:
            self._done = True

    def __call__(self, stage: str) -> None:
        """Enter the next stage."""
        with self._lock:
            self._current = stage
        if time.monotonic() - self._begin >= self._patience:
            self._tell()

    def _tell(self) -> None:
        with self._lock:
            if self._current != self._told and not self._done:
                self._told = self._current
                seconds = time.monotonic() - self._begin
                self._stream.write(f"ph-post: {self._current} ({seconds:.0f} s) ...\n")
                self._stream.flush()
