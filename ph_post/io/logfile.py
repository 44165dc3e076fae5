"""Logs of motion: a row a sample with what was commanded and what the axes did, as CSV in s and mm."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ph_post.io.table import DECIMALS, csv_rows
from ph_post.types import Array, Run
from ph_post.units import MM


def log_content(run: Run, remarks: Mapping[str, str]) -> bytes:
    """Return a simulated motion as a log.

    Columns are `t`, and for every axis what it was commanded, where its table is (`_act`) and where its motor
    is, in units of the table (`_motor`).

    Parameters
    ----------
    run : Run
    remarks : mapping of str to str
        Written first, as ``# key: value``; line breaks become spaces.
    """
    columns: dict[str, Array] = {"t": np.round(run.t, DECIMALS) + 0.0}
    for number, axis in enumerate(run.axes):
        sides = (("cmd", run.commanded), ("act", run.executed), ("motor", run.motor))
        for side, position in sides:
            columns[f"{axis}_{side}"] = np.round(position[:, number] / MM, DECIMALS) + 0.0
    head = "".join(f"# {key}: {' '.join(value.split())}\n" for key, value in remarks.items())
    return head.encode() + csv_rows(columns)
