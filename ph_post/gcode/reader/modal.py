"""Modal states as records, from the columns that the compiled code keeps."""

from __future__ import annotations

from ph_post.gcode.reader import codes
from ph_post.gcode.reader.record import Modal
from ph_post.types import Array


def number_text(value: float) -> str:
    """Write a word's number as short as it is exact.

    Examples
    --------
    >>> number_text(640.0 / 10), number_text(0.01)
    ('64', '0.01')
    """
    text = f"{value:.12f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def make_modal(row: Array) -> Modal:
    """Record of one row of the distinct states; what may be anything is as if the program had not said it."""
    plane, units, absolute, arc_absolute, feed_mode = (
        float(row[c]) for c in range(codes.PLANE, codes.FEED_MODE + 1)
    )
    return Modal(
        motion=_word(row[codes.MOTION]),
        plane=int(plane) if plane > 0 else 17,
        units=units if units > 0 else 1e-3,
        absolute=absolute != 0.0,
        arc_absolute=arc_absolute == 1.0,
        feed_mode=int(feed_mode) if feed_mode > 0 else 94,
        compensation=_word(row[codes.COMPENSATION]),
        length=_word(row[codes.LENGTH]),
        system=_word(row[codes.SYSTEM]),
        path=_path(row),
        retract=_word(row[codes.RETRACT]),
        spindle=f"M{row[codes.SPINDLE]:.0f}" if row[codes.SPINDLE] >= 0 else None,
        mist=_switch(row[codes.MIST]),
        flood=_switch(row[codes.FLOOD]),
        tool=_number(row[codes.TOOL]),
        prepared=_number(row[codes.PREPARED]),
        speed=_number(row[codes.SPEED]),
    )


def _word(code: float) -> str | None:
    return f"G{number_text(code / 10.0)}" if code >= 0 else None


def _number(value: float) -> float | None:
    return float(value) if value >= 0 else None


def _switch(value: float) -> bool | None:
    return bool(value) if value >= 0 else None


def _path(row: Array) -> str | None:
    word = _word(row[codes.PATH])
    if word is None:
        return None
    columns = (("P", codes.PATH_P), ("Q", codes.PATH_Q))
    extra = [f"{letter}{number_text(row[c])}" for letter, c in columns if row[c] >= 0]
    return " ".join((word, *extra))
