"""Run the lines of a program one after the other, and stop where they run on without an end."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from ph_post.expand.faults import ExpandError

_MOST_LINES: Final = 1_000_000
"""Lines that a program may run, and lines that may come of it."""

MOST_SILENT: Final = 100_000
"""Lines that a program may run one after the other without one that does anything."""


def check_turn(heads: dict[int, object], at: int, state: object) -> None:
    """Refuse a loop that comes back to a line with nothing changed; `heads` keeps the state of each from before.

    Raises
    ------
    ExpandError
        Where the state is the one from before.
    """
    if heads.get(at) == state:
        raise ExpandError("the loop never ends: nothing changes from one turn to the next")
    heads[at] = state


class Progress:
    """Counts the lines that run, and names the line of what goes wrong."""

    def __init__(self) -> None:
        self._count = self._last = self._written = 0

    def step(self, run: Callable[[], bool], file: str, number: int, written: int) -> bool:
        """Run a line (from 1) of a file; `written` lines have come of the program so far.

        Raises
        ------
        ExpandError
            With file and line.
        """
        self._count += 1
        if written != self._written:
            self._written, self._last = written, self._count
        try:
            if max(self._count, written) > _MOST_LINES or self._count - self._last > MOST_SILENT:
                raise ExpandError("the program runs on without an end: more lines than could be meant")
            return run()
        except ExpandError as error:
            raise error.at(file, number) from None
        except OverflowError:
            raise ExpandError("the number is beyond all bounds").at(file, number) from None
        except RecursionError:
            raise ExpandError("brackets within brackets are too deep").at(file, number) from None
