"""Exceptions of this package, and the wording of error messages."""

from __future__ import annotations

import math
from collections.abc import Sequence


class PhPostError(Exception):
    """Base class of the package's errors; a command prints one line and exits with `status`."""

    status = 2


class InputError(PhPostError):
    """Bad input: where it stands, what is wrong, what was expected and what was found.

    Parameters
    ----------
    where : str
        File, and place inside it: ``oval.json: segments[3].points`` or ``oval.json:12:5``.
    what : str
        What is wrong, in words.
    expected, got : str, optional
        What would have been right, and what stands there.
    excerpt : str, optional
        Lines that show the place, such as the source line and a caret; printed under the one line.

    Examples
    --------
    >>> print(InputError("a.json: feed", "feed is not positive", expected="> 0", got="0"))
    a.json: feed: feed is not positive; expected > 0; got 0
    """

    def __init__(self, where: str, what: str, *, expected: str = "", got: str = "", excerpt: str = "") -> None:
        parts = [f"{where}: {what}" if where else what]
        if expected:
            parts.append(f"expected {expected}")
        if got:
            parts.append(f"got {got}")
        super().__init__("; ".join(parts))
        self.where = where
        self.excerpt = excerpt


def is_interrupt(error: BaseException | None) -> bool:
    """Return whether Ctrl-C is behind an error: where it comes in compiled code, numba raises one of its own."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def printable(text: str) -> str:
    r"""Return a text as a terminal shows it, a column a character: what is in a file may steer a terminal.

    Examples
    --------
    >>> printable("G1\tX5\x00\x1b[2J")
    'G1 X5??[2J'
    """
    return "".join(c if c.isprintable() else " " if c == "\t" else "?" for c in text)


def out_of_range(
    where: str, got: object, low: float = -math.inf, *, open_low: bool = False, high: float = math.inf
) -> InputError:
    """Return the error of what is no finite number, or none between `low` and `high`.

    Examples
    --------
    >>> print(out_of_range("--feed", "nan", 0.0, open_low=True))
    --feed: out of range; expected a finite number > 0; got nan
    """
    least = f" {'>' if open_low else '>='} {low:g}" if math.isfinite(low) else ""
    most = f" and at most {high:g}" if math.isfinite(high) else ""
    return InputError(where, "out of range", expected=f"a finite number{least}{most}", got=str(got) or "nothing")


def unknown_word(where: str, got: object, known: Sequence[str]) -> InputError:
    """Return the error of a word that is none of those known.

    Examples
    --------
    >>> print(unknown_word("--start", "late", ("rest", "moving")))
    --start: unknown; expected rest or moving; got late
    """
    return InputError(where, "unknown", expected=" or ".join(known), got=str(got) or "nothing")


class TooLargeError(InputError):
    """A job that would take more samples or blocks than :mod:`ph_post.bounds` allows."""


class OptionsError(InputError):
    """Options that do not go together, in the words of the command line."""

    def __init__(self, what: str) -> None:
        super().__init__("", what)


class SolveError(PhPostError):
    """An equation could not be solved; the message carries the residual."""


class LimitError(PhPostError):
    """The request exceeds the machine's limits."""


class NotCompensatedError(PhPostError):
    """A reversal at which the tool cuts is not compensated, and all were required to be."""

    status = 1
