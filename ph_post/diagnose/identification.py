"""What an identification consists of: frozen records, SI units but where a unit stands beside the number."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import msgspec

from ph_post.diagnose.record import Estimate
from ph_post.types import Machine

Origin = Literal["record", "file", "assumed"]
"""Where a number comes from: the record shows it, the machine file says it, or it stands for want of one."""


class Sensitivity(msgspec.Struct, frozen=True, kw_only=True):
    """Which numbers of a drive a record can tell apart, from its whitened sensitivities.

    Parameters
    ----------
    names : tuple of str
        The numbers that were asked for, each by its logarithm.
    singular_values : tuple of float
        Largest first. One over it is the relative standard error along its direction.
    rank : int
        How many directions are known better than the record's noise allows; see
        :data:`ph_post.diagnose.separation.TELLS`.
    weak : tuple of mapping
        The other directions: the share of each number in them, by name.
    """

    names: tuple[str, ...]
    singular_values: tuple[float, ...]
    rank: int
    weak: tuple[Mapping[str, float], ...] = ()

    @property
    def condition(self) -> float:
        """Largest over smallest singular value, infinite where that is none."""
        if not self.singular_values or self.singular_values[-1] <= 0.0:
            return float("inf")
        return self.singular_values[0] / self.singular_values[-1]


class Drive(msgspec.Struct, frozen=True, kw_only=True):
    """One axis as its record shows it.

    `parameters` are what the record shows, by name and in the units of a machine file; `origins` say of each
    number of the drive where it comes from. `rms` and `noise` [m] are what the free run leaves of the
    positions, and what no model could get below.
    """

    parameters: Mapping[str, Estimate]
    origins: Mapping[str, Origin]
    sensitivity: Sensitivity
    rms: float
    noise: float
    notes: tuple[str, ...] = ()


class Identification(msgspec.Struct, frozen=True, kw_only=True):
    """Drives from a record, and the machine that they make.

    `machine` has every axis of the machine file, those of `drives` with their new numbers; where there was no
    machine file, its limits are what the record reached. `notes` are what concerns no axis alone.
    """

    drives: Mapping[str, Drive]
    machine: Machine
    notes: tuple[str, ...] = ()

    @property
    def axes(self) -> dict[str, Mapping[str, Estimate]]:
        """Parameters by axis."""
        return {name: drive.parameters for name, drive in self.drives.items()}

    @property
    def sentences(self) -> tuple[str, ...]:
        """All notes, those of an axis with its name before them."""
        own = [f"{name}: {note}" for name, drive in self.drives.items() for note in drive.notes]
        return (*self.notes, *own)
