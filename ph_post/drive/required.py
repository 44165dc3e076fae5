"""Which axes a machine must have a drive for."""

from __future__ import annotations

from collections.abc import Sequence

from ph_post.errors import InputError
from ph_post.types import Machine


def require_drives(axes: Sequence[str], what: str, drives: Machine, machine: str) -> None:
    """Refuse a machine that lacks an axis which `what` moves.

    Parameters
    ----------
    axes : sequence of str
        Axes that are moved.
    what : str
        What moves them, in a word.
    drives : Machine
    machine : str
        Name of the machine, or of its file.

    Raises
    ------
    InputError
    """
    for axis in axes:
        if axis not in drives.axes:
            raise InputError(
                machine, f"the {what} moves axis {axis}, which has no drive", expected=f"[axes.{axis}]",
                got=", ".join(f"[axes.{name}]" for name in drives.axes),
            )  # fmt: skip
