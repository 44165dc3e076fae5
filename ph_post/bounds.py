"""Bounds of work: the most samples, blocks, places and threads that one job may take, and the memory it gives back.

Whatever loops over samples or blocks first estimates their number from lengths, feeds and times, and asks here
before it begins. A job that is too large is refused in one line that says what would help.
"""

from __future__ import annotations

import ctypes
import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from typing import Any, Final

from ph_post.errors import TooLargeError

MOST_SAMPLES: Final = 10_000_000
"""Servo periods of one motion that is planned, sampled or simulated: 2.8 hours at 1 ms, which take 4 GB."""

MOST_BLOCKS: Final = 1_000_000
"""Blocks of a program that is written: some 30 MB of text, written in a minute or two."""

MOST_PLACES: Final = 10_000_000
"""Places at which a path is looked at together, and points that are drawn."""

MOST_EFFORT: Final = 1000.0
"""Largest effort of a search: some three hours."""

MOST_INTERVALS: Final = 2_000_000
"""Backlash intervals worked out in one run: a file of some 100 MB."""

LEAST_TOLERANCE: Final = 1e-11
"""Smallest distance [m] within which paths are the same: arcs are looked at in chords that are as close as that."""

LEAST_CORNER_TOLERANCE: Final = 1e-7
"""Smallest distance [m] within which corners of a path are rounded: no machine can show less."""

HOUR: Final = 3600.0
"""[s]"""

LONGEST_SIMULATED: Final = 1.0 * HOUR
"""No error is simulated of a program that runs longer, as time and memory grow with it [s]."""


_PART: Final = 1 << 16
"""Rows that are worked on at a time."""


def in_parts(size: int, most: int = _PART) -> Iterator[slice]:
    """Cut rows into parts, of so many at most: what is worked out of a million words or motions needs no room for all.

    Examples
    --------
    >>> [(part.start, part.stop) for part in in_parts(100_000)]
    [(0, 65536), (65536, 131072)]
    """
    return (slice(low, low + most) for low in range(0, size, most))


_among_others = ContextVar("_among_others", default=False)


def processors() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def threads() -> int:
    """Return on how many threads a job may work: one for each processor, and one where it is a job among others."""
    return 1 if _among_others.get() else processors()


@contextmanager
def among_others() -> Iterator[None]:
    """Let what is done within work on one thread: as many processes as there are processors are at work beside it.

    Examples
    --------
    >>> with among_others():
    ...     print(threads())
    1
    """
    before = _among_others.set(True)
    try:
        yield
    finally:
        _among_others.reset(before)


_MMAP_THRESHOLD, _TRIM_THRESHOLD = -3, -1
"""Numbers of glibc's settings."""

_APART: Final = 1 << 20
"""Bytes from which an array of a long program has pages of its own, which go back as soon as it does."""

_SPARE: Final = 1 << 24
"""Bytes of free memory that are kept for smaller arrays."""


@cache
def _trim() -> Any:
    """Return the C library's function that gives free memory back; None where it has none.

    From then on large arrays leave no gaps: glibc would keep memory for arrays as large as any that was ever freed.
    """
    try:
        library = ctypes.CDLL(None)
        trim = getattr(library, "malloc_trim", None)
        if trim is not None:
            library.mallopt(_MMAP_THRESHOLD, _APART)
            library.mallopt(_TRIM_THRESHOLD, _SPARE)
        return trim
    except (OSError, TypeError):
        return None


MANY_LINES: Final = 20_000
"""Lines of a program from which on memory counts for more than the time that it takes to save it."""


def give_memory_back(lines: int) -> None:
    """Give memory that is no longer used back to the system, between two stages of the work on a program.

    Much of it lies in gaps between what is kept, where glibc would keep it for arrays that may never come. To look for
    it takes some milliseconds, for which a program of few `lines` leaves too little.
    """
    if lines >= MANY_LINES and (trim := _trim()) is not None:
        trim(0)


def check_samples(where: str, duration: float, period: float, remedy: str, longest: str = "") -> None:
    """Refuse a motion that takes too many servo periods.

    Parameters
    ----------
    where : str
        Name of the path or the program.
    duration : float
        Estimated duration of the motion, or a lower bound [s].
    period : float
        Servo period [s].
    remedy : str
        What would help.
    longest : str, optional
        Where most of the time goes, such as ``line 3``.

    Raises
    ------
    TooLargeError

    Examples
    --------
    >>> check_samples("a.ngc", 60.0, 1e-3, "a higher feed")
    >>> check_samples("a.ngc", 36e6, 1e-3, "a higher feed", "line 2")
    Traceback (most recent call last):
    ...
    ph_post.errors.TooLargeError: a.ngc: the motion is too long to be sampled; expected at most 10,000,000 \
servo periods (a higher feed would help); got 3.6e+10 of 1 ms, 1e+04 h, most of it in line 2
    """
    count = duration / period
    if count <= MOST_SAMPLES:
        return
    size = f"{count:.3g} of {period * 1e3:.3g} ms, {duration / HOUR:.3g} h" if math.isfinite(count) else "more"
    raise TooLargeError(
        where,
        "the motion is too long to be sampled",
        expected=f"at most {MOST_SAMPLES:,} servo periods ({remedy} would help)",
        got=size + (f", most of it in {longest}" if longest else ""),
    )


def check_blocks(where: str, count: float, remedy: str) -> None:
    """Refuse a program of too many blocks, where `count` is estimated; raises as :func:`check_samples`.

    Examples
    --------
    >>> check_blocks("a.json", 1e9, "a larger --chord-tolerance")
    Traceback (most recent call last):
    ...
    ph_post.errors.TooLargeError: a.json: the program is too long to be written; expected at most 1,000,000 \
blocks (a larger --chord-tolerance would help); got about 1e+09
    """
    if count <= MOST_BLOCKS:
        return
    raise TooLargeError(
        where,
        "the program is too long to be written",
        expected=f"at most {MOST_BLOCKS:,} blocks ({remedy} would help)",
        got=f"about {count:.3g}" if math.isfinite(count) else "more",
    )


def check_places(where: str, what: str, count: float, remedy: str) -> None:
    """Refuse to look at too many places, where `count` is estimated; raises as :func:`check_samples`.

    Examples
    --------
    >>> check_places("a.ngc", "the path has too many points to be drawn", 1e9, "fewer turns")
    Traceback (most recent call last):
    ...
    ph_post.errors.TooLargeError: a.ngc: the path has too many points to be drawn; expected at most 10,000,000 \
(fewer turns would help); got about 1e+09
    """
    if count <= MOST_PLACES:
        return
    size = f"about {count:.3g}" if math.isfinite(count) else "more"
    raise TooLargeError(where, what, expected=f"at most {MOST_PLACES:,} ({remedy} would help)", got=size)
