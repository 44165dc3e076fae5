"""The numbers of a cascade that are fitted, by the names, keys and units in which people have them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final, NamedTuple

from msgspec.structs import replace

from ph_post.types import Cascade
from ph_post.units import MS, PERCENT


class CascadeNumber(NamedTuple):
    """A number of a cascade: its `key` in a machine file, whose `unit` has this `size` [SI], and its `field`.

    `inverse`: the field is one over the number, and the number does not exist where that is 0.
    """

    key: str
    unit: str
    size: float
    field: str
    inverse: bool = False

    def of(self, cascade: Cascade) -> float | None:
        """Return the number [SI], None where there is none."""
        value = float(getattr(cascade, self.field))
        if not self.inverse:
            return value
        return 1.0 / value if value else None

    def put(self, cascade: Cascade, value: float) -> Cascade:
        """Return a cascade with another number [SI]."""
        return replace(cascade, **{self.field: 1.0 / value if self.inverse else value})


CASCADE_NUMBERS: Final[Mapping[str, CascadeNumber]] = {
    "position_gain": CascadeNumber("control.position_gain_per_s", "1/s", 1.0, "position_gain"),
    "velocity_gain": CascadeNumber("control.velocity_gain_per_s", "1/s", 1.0, "velocity_gain"),
    "velocity_integral_time": CascadeNumber("control.velocity_integral_time_ms", "ms", MS, "integral_rate", True),
    "velocity_feedforward": CascadeNumber("control.velocity_feedforward_percent", "%", PERCENT, "velocity_feedforward"),
    "dead_time": CascadeNumber("control.dead_time_ms", "ms", MS, "dead_time"),
    "acceleration_feedforward": CascadeNumber(
        "control.acceleration_feedforward_percent", "%", PERCENT, "acceleration_feedforward"
    ),
    "acceleration_lead": CascadeNumber("control.acceleration_lead_ms", "ms", MS, "acceleration_lead"),
    "current_bandwidth": CascadeNumber("control.current_bandwidth_hz", "Hz", math.tau, "current_time", True),
    "moving_average": CascadeNumber("control.moving_average_ms", "ms", MS, "moving_average"),
    "exponential_filter": CascadeNumber("control.exponential_filter_ms", "ms", MS, "exponential"),
}
"""By the names of parameters. What any log is fitted by comes first, then what few drives have."""

NAMES: Final = {number.field: name for name, number in CASCADE_NUMBERS.items()}
"""Names of a cascade's numbers by its fields."""

FITTED: Final = tuple(CASCADE_NUMBERS)[:5]
"""Those that any log is fitted by."""


def cascade_values(cascade: Cascade) -> dict[str, float]:
    """Return the numbers of a cascade as a machine file has them, without what few have and it has not.

    Examples
    --------
    >>> cascade_values(Cascade(position_gain=40.0, velocity_gain=200.0, integral_rate=50.0))["velocity_integral_time"]
    20.0
    """
    values = {name: number.of(cascade) for name, number in CASCADE_NUMBERS.items()}
    return {
        name: float(f"{value / CASCADE_NUMBERS[name].size:.7g}")
        for name, value in values.items()
        if value is not None and (value or name in FITTED)
    }


def with_cascade_values(cascade: Cascade, values: Mapping[str, float]) -> Cascade:
    """Return a cascade with numbers by the names of parameters, in the units of a machine file."""
    for name, value in values.items():
        cascade = CASCADE_NUMBERS[name].put(cascade, value * CASCADE_NUMBERS[name].size)
    return cascade
