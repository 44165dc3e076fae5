"""Progress on standard error, for runs that take longer than a second."""

from __future__ import annotations

import re
import sys
import threading
import time
from types import TracebackType
from typing import Final, TextIO

PATIENCE_S = 1.0
"""Seconds of silence before the first word."""


REMINDER: Final = 30.0
"""A stage that goes on is named again after so many times the patience."""


class ProgressPrinter:
    """Names the stage a command is in: first when it has run for a second, then at most once a second.

    A stage that goes on is named again every half minute.

    Examples
    --------
    >>> with ProgressPrinter() as progress:
    ...     progress("planning")
    """

    def __init__(self, stream: TextIO | None = None, patience: float = PATIENCE_S) -> None:
        self._stream = stream or sys.stderr
        self._begin = time.monotonic()
        self._patience = patience
        self._current = ""
        self._shown = ""
        self._done = threading.Event()
        self._teller = threading.Thread(target=self._tell_now_and_then, daemon=True)

    def __enter__(self) -> ProgressPrinter:
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
        again = 0.0
        while not self._done.wait(self._patience):
            current = self._current
            seconds = time.monotonic() - self._begin
            if current and (current != self._shown or seconds >= again):
                self._shown = current
                again = seconds + REMINDER * self._patience
                self._stream.write(f"ph-post: {current} ({seconds:.0f} s) ...\n")
                self._stream.flush()


class FilterProgress:
    """Tells the screens of LinuxCNC how far a filter is: ``FILTER_PROGRESS=n``, from 0 to 100.

    A stage that is known by its name has its place on the way, and so has a count (``3 of 12``); anything
    else, and whatever comes again, moves on by a tenth of what is left.

    Examples
    --------
    >>> progress = FilterProgress(sys.stdout)
    >>> for name in ("reading", "searching the best for turning point 3 of 4", "writing", "done"):
    ...     progress(name)
    FILTER_PROGRESS=1
    FILTER_PROGRESS=55
    FILTER_PROGRESS=90
    FILTER_PROGRESS=100
    """

    def __init__(self, stream: TextIO | None) -> None:
        self._stream = stream
        self._percent = 0.0
        self._shown = 0

    def __call__(self, stage: str) -> None:
        """Enter the next stage."""
        name = stage.rpartition(": ")[2]
        place = next((at for begin, at in _ON_THE_WAY if name.startswith(begin)), 0.0)
        if count := _COUNT.search(name):
            place += _SEARCH * (int(count[1]) - 1) / int(count[2])
        onward = self._percent + _STEP * max(0.0, _LAST - self._percent)
        self._percent = place if place > self._percent else onward
        if self._stream is not None and int(self._percent) > self._shown:
            self._shown = int(self._percent)
            self._stream.write(f"FILTER_PROGRESS={self._shown}\n")
            self._stream.flush()


_ON_THE_WAY: Final = (
    ("reading", 1.0),
    ("locating", 5.0),
    ("planning offsets", 10.0),
    ("fitting", 15.0),
    ("planning", 20.0),
    ("searching", 25.0),
    ("proving", 85.0),
    ("writing", 90.0),
    ("verifying", 95.0),
    ("done", 100.0),
)
"""Where on the way [%] a stage begins, by the first words of its name."""

_COUNT: Final = re.compile(r"(\d+) of (\d+)$")
_SEARCH: Final = 60.0
_LAST: Final = 89.0
_STEP: Final = 0.1
