"""What ``identify`` found, as text and as JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ph_post.diagnose.record import Estimate
from ph_post.report.diagnoses import estimate_view
from ph_post.report.findingwords import number_words
from ph_post.report.tables import NOTHING, format_table

Parameters = Mapping[str, Mapping[str, Estimate]]
"""Parameters of every axis, by name."""


def identification_view(axes: Parameters, notes: Sequence[str] = ()) -> dict[str, Any]:
    """Return the parameters as a JSON object; what is not known is None.

    Parameters
    ----------
    axes : mapping
        By axis and name.
    notes : sequence of str
        What the record could not separate, and what else a person should know.
    """
    return {
        "axes": {
            axis: {name: estimate_view(one) for name, one in parameters.items()}
            for axis, parameters in axes.items()
        },
        "notes": list(notes),
    }


def identification_lines(axes: Parameters, notes: Sequence[str] = ()) -> list[str]:
    """Say in lines what the parameters are, and how well the record shows them.

    Parameters are those of :func:`identification_view`.
    """
    rows = [
        (axis, name, *_cells(one)) for axis, parameters in axes.items() for name, one in parameters.items()
    ]
    header = ("axis", "parameter", "value", "standard error", "unit")
    table = format_table(header, rows).splitlines() if rows else ["This record shows no parameter."]
    return [*table, *(f"note: {note}" for note in notes)]


def _cells(one: Estimate) -> tuple[str, str, str]:
    value, error = number_words(one)
    return value, "not known" if error is None else f"± {error}", one.unit or NOTHING
