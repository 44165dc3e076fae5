"""Quantities as a person reads them: the digits that mean something, in the units of the shop.

Errors of the part are in µm, places and offsets in mm, times in s. JSON takes numbers as they are.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from ph_post.units import MICROMETRE, MM

NOTHING: Final = "-"
"""Stands for a number that does not exist."""

DIGITS: Final = 3
"""Significant digits of an error in µm."""

FINEST: Final = 2
"""Decimals of an error in µm at most: what is finer than 0.01 µm is rounding."""


def micrometres(length: float | None, sign: str = "") -> str:
    """Write an error in µm, without its unit: three significant digits, and no finer than 0.01 µm.

    Parameters
    ----------
    length : float or None
        The error [m].
    sign : {"", "+"}
        ``"+"`` writes the sign of positive errors too.

    Examples
    --------
    >>> [micrometres(one) for one in (1.2345e-3, 1.2345e-5, 1.2345e-6, 3.1e-7, 1e-12, 0.0, None)]
    ['1234', '12.3', '1.23', '0.31', '<0.01', '0', '-']
    >>> micrometres(4.4512e-6, "+"), micrometres(-4.4512e-6, "+"), micrometres(-1e-12)
    ('+4.45', '-4.45', '<0.01')
    """
    if length is None or not math.isfinite(length):
        return NOTHING
    size = abs(length) / MICROMETRE
    if size == 0.0:
        return "0"
    if size < 0.5 * 10.0**-FINEST:
        return f"<{10.0**-FINEST:g}"
    whole = math.floor(math.log10(float(f"{size:.{DIGITS - 1}e}"))) + 1
    return f"{length / MICROMETRE:{sign}.{min(max(DIGITS - whole, 0), FINEST)}f}"


def rounded_micrometres(length: float | None) -> str:
    """Write an error in µm for a sentence, without its unit: two significant digits, no finer than 0.1 µm.

    Examples
    --------
    >>> [rounded_micrometres(one) for one in (1.2345e-4, 4.71e-5, 2.04e-6, 2.38e-6, 3e-7, 4e-8, 0.0, None)]
    ['123', '47', '2', '2.4', '0.3', '<0.1', '0', '-']
    """
    if length is None or not math.isfinite(length):
        return NOTHING
    size = abs(length) / MICROMETRE
    if 0.0 < size < 0.05:
        return "<0.1"
    return f"{size:.0f}" if size >= 9.95 else f"{size:.1f}".removesuffix(".0")


def rounded_seconds(*times: float) -> tuple[str, ...]:
    """Write times in s beside each other, without their unit: the longest to three significant digits.

    Examples
    --------
    >>> rounded_seconds(48.512, 49.24), rounded_seconds(8.112, 8.1416), rounded_seconds(1234.5, 1235.0)
    (('48.5', '49.2'), ('8.11', '8.14'), ('1234', '1235'))
    """
    longest = max(times)
    decimals = 2 - math.floor(math.log10(longest)) if longest > 0.0 else 2
    return tuple(f"{time:.{min(max(decimals, 0), 3)}f}" for time in times)


def millimetres(length: float | None) -> str:
    """Write a place, an offset or a backlash in mm, without its unit: to 1 µm.

    Examples
    --------
    >>> millimetres(0.000180009), millimetres(-1e-9), millimetres(None)
    ('0.180', '0.000', '-')
    """
    if length is None or not math.isfinite(length):
        return NOTHING
    return f"{round(length / MM, 3) + 0.0:.3f}"


def seconds(time: float | None) -> str:
    """Write a time in s, without its unit: to 1 ms.

    Examples
    --------
    >>> seconds(13.86449), seconds(None)
    ('13.864', '-')
    """
    return NOTHING if time is None else f"{time:.3f}"


def before_and_after(before: float | None, after: float | None, write: Callable[[float | None], str], unit: str) -> str:
    """Write a quantity before and after.

    Examples
    --------
    >>> before_and_after(11.4e-6, 4.451e-6, micrometres, "µm")
    '11.4 µm before, 4.45 µm after'
    """
    return f"{write(before)} {unit} before, {write(after)} {unit} after"


MOST_DIGITS: Final = 4
"""Digits of a value that an error stands beside, at most."""


def with_error(value: float, error: float | None) -> tuple[str, str | None]:
    """Write a value and its standard error, both to the last digit of the error; None where it is not known.

    The error has one digit, or two where one would be off by more than 5 %. No value has more than four digits: a model
    is no better than that, whatever the scatter; the error is then rounded up to the last of them.

    Examples
    --------
    >>> with_error(20.4123, 0.1), with_error(0.031234, 0.00134), with_error(12.3456, None)
    (('20.4', '0.1'), ('0.0312', '0.0013'), ('12.35', None))
    >>> with_error(-0.001, 0.04)
    ('0.00', '0.04')
    >>> with_error(0.180009, 0.000017), with_error(15042.0, 3.0)
    (('0.1800', '0.0001'), ('15040', '10'))
    >>> with_error(1.5623e-4, 2e-6), with_error(2.3456e-5, 1.2e-6)
    (('0.000156', '2e-06'), ('2.35e-05', '1.2e-06'))
    """
    if error is None or not math.isfinite(error) or error <= 0.0:
        return f"{value:.4g}", None
    short = float(f"{error:.0e}")
    digits = 1 if abs(short - error) <= 0.05 * error else 2
    last = math.floor(math.log10(float(f"{error:.{digits - 1}e}"))) - digits + 1
    most = last if value == 0.0 else math.floor(math.log10(abs(value))) - MOST_DIGITS + 1
    if most > last:
        last = most
        error = math.ceil(error / 10.0**last) * 10.0**last
    if abs(value) < 1e-3 and last < -5:
        shown = math.floor(math.log10(abs(value) or error)) - last + 1
        digits = math.floor(math.log10(error) + 1e-9) - last + 1
        return f"{value:{'#' if shown > 1 else ''}.{max(shown, 1)}g}", f"{error:.{max(digits, 1)}g}"
    shown = max(-last, 0)
    return f"{round(value, -last) + 0.0:.{shown}f}", f"{round(error, -last):.{shown}f}"


def measured_words(value: float, error: float | None, unit: str = "", sign: str = "±") -> str:
    """Write a value, its standard error where one is known, and their unit.

    Examples
    --------
    >>> measured_words(0.031234, 0.00134, "mm"), measured_words(12.3456, None, "N", "+-")
    ('0.0312 ± 0.0013 mm', '12.35 N')
    """
    shown, error_shown = with_error(value, error)
    both = shown if error_shown is None else f"{shown} {sign} {error_shown}"
    return f"{both} {unit}" if unit else both
