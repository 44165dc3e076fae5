"""Run the lines of a program one after the other, and stop where they run on without an end."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

from ph_post.expand.faults import ExpandError
from ph_post.expand.lines import Source

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


class WrittenLines(NamedTuple):
    """Lines that a program comes to, and the line of it, from 0, that each comes of."""

    texts: list[str]
    origins: list[int]


def origins_within(first: int, count: int, written: int) -> list[int]:
    """Return the lines, from 0, that `written` ones come of where those from `first` on were `count`."""
    return [first + min(k, count - 1) for k in range(written)]


class Progress:
    """Counts the lines that run, names the line of what goes wrong, and knows what each written line comes of.

    Parameters
    ----------
    main : Source
        The program whose lines are counted; what a subprogram in another file writes comes of the line that calls it.
    """

    def __init__(self, main: Source) -> None:
        self._main = main
        self._count = self._last = self._written = 0
        self._runs: list[tuple[int, int, int]] = []
        """Lines that were written before some of the main program ran, the first of these, and how many they are."""

    def written(self, texts: Sequence[str], behind: int) -> WrittenLines:
        """Return what was written, and behind it the lines of the main program from `behind` on."""
        runs, found = [*self._runs, (len(texts), 0, 0)], list[int]()
        for (begin, first, count), (end, _, _) in pairwise(runs):
            found += origins_within(first, count, end - begin)
        lines = self._main.texts
        return WrittenLines([*texts, *lines[behind:]], [*found, *range(behind, len(lines))])

    def step(self, run: Callable[[], bool], file: str, number: int, written: int, count: int = 1) -> bool:
        """Run some lines, the first of them `number` (from 1), of a file; `written` ones have come of all before.

        Raises
        ------
        ExpandError
            With file and line.
        """
        self._count += 1
        if file == self._main.name:
            if self._runs and self._runs[-1][0] == written:
                self._runs.pop()  # that wrote nothing
            self._runs.append((written, number - 1, count))
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
