"""What ``identify`` found, as text and as JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ph_post.diagnose.identification import Identification, Sensitivity
from ph_post.diagnose.record import Estimate
from ph_post.report.diagnoses import estimate_view
from ph_post.report.findingwords import number_words
from ph_post.report.tables import NOTHING, format_table
from ph_post.units import MM

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


def fit_view(found: Identification) -> dict[str, Any]:
    """Return by axis what the free run misses, and which numbers the record tells apart, as JSON."""
    return {
        "fit": {
            name: {"unit": "mm", "rms": drive.rms / MM, "noise_floor": drive.noise / MM}
            for name, drive in found.drives.items()
        },
        "identifiability": {
            name: _sensitivity_view(drive.sensitivity) for name, drive in found.drives.items()
        },
    }


def _sensitivity_view(sensitivity: Sensitivity) -> dict[str, Any]:
    condition = sensitivity.condition
    return {
        "parameters": list(sensitivity.names),
        "singular_values": list(sensitivity.singular_values),
        "rank": sensitivity.rank,
        "condition": condition if math.isfinite(condition) else None,
        "not_separated": [dict(direction) for direction in sensitivity.weak],
    }
