"""Records of a diagnosis and of an identification, frozen.

SI units except where a unit stands beside the number.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Literal

import msgspec

from ph_post.types import Array, AxisLog, BoolArray, EffectSetting, Machine

Verdict = Literal["named", "nothing-missing", "ambiguous", "unknown", "not-identifiable"]
Channel = Literal["act", "motor", "force"]


class Estimate(msgspec.Struct, frozen=True, kw_only=True):
    """A parameter as the shop reads it: `value` and `stderr` in `unit`; `stderr` None where nothing tells."""

    value: float
    stderr: float | None
    unit: str


def recorded_channels(axis: AxisLog) -> dict[Channel, Array]:
    """Return the readings (n,) of an axis that were recorded, by channel."""
    channels: dict[Channel, Array | None] = {"act": axis.table, "motor": axis.motor, "force": axis.effort}
    return {channel: values for channel, values in channels.items() if values is not None}


class ChannelQuality(msgspec.Struct, frozen=True, kw_only=True):
    """Resolution, noise and delay of one logged channel [m, or the effort's unit].

    `resolution` is the smallest step between different readings, 0 where none is seen; `noise` the root mean
    square of what changes from sample to sample, resolution included, and `noise_from` how that was found;
    `missing` counts samples; `shift` [s] is by how much the channel is late beyond what its drive explains,
    None where the record does not tell; `unrepeated` what repeats differ by where that is far more than noise.
    """

    axis: str
    channel: Channel
    resolution: float
    noise: float
    noise_from: Literal["repeats", "stationary stretches", "differences"]
    missing: int = 0
    shift: float | None = None
    unrepeated: float | None = None

    @property
    def count(self) -> float:
        """The resolution where its rounding, 0.29 of it, is nearly all of the noise, else 0."""
        return self.resolution if self.noise < _ROUNDED * self.resolution else 0.0


_ROUNDED: Final = 0.4
"""Noise of a reading, in its counts, that is hardly more than their rounding."""


class LogQuality(msgspec.Struct, frozen=True, kw_only=True):
    """Quality of a log, assessed before anything is fitted to it.

    `first` is the first sample behind the start-up transient. `faults` are reasons why
    it cannot be used, `notes` are further remarks, each a sentence.
    """

    period: float
    jitter: float
    first: int
    channels: tuple[ChannelQuality, ...]
    faults: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def repeats(self, axis: str) -> bool:
        """Return whether no reading of an axis differs between runs of the same motion by far more than noise."""
        return all(one.unrepeated is None for one in self.channels if one.axis == axis)


class ResidualPlace(msgspec.Struct, frozen=True, kw_only=True):
    """Place of an axis' residual: its `share` of the excess over the noise floor, and a sentence.

    `by` names the split ("reversal", "travel", "offset", "direction", "speed", "acceleration", "position",
    "position of Y" and the like, "period", "time", "rotation", "frequency"); `value` is what the split
    measured (a time, a length, a ratio), in SI units.
    """

    axis: str
    by: str
    share: float
    value: float
    sentence: str


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """A missing effect: its name, its axis and its parameters, the leading one first.

    `where` is a plain phrase; `evidence` are sentences, each what physics predicts against what the record
    shows; `confidence` 0 to 1; `ambiguous_with` the names ("effect:axis" where the axis is another) that
    explain the record as well. `setting` is what the machine file gets, None where `keys`, numbers of the
    axis by their keys in that file, say it all.
    """

    name: str
    axis: str
    parameters: Mapping[str, Estimate]
    where: str
    evidence: tuple[str, ...]
    confidence: float
    ambiguous_with: tuple[str, ...] = ()
    setting: EffectSetting | None = None
    keys: Mapping[str, float] = {}


class DroppedName(msgspec.Struct, frozen=True, kw_only=True):
    """A name that explains much of a log and was dropped all the same: `why` is a phrase."""

    name: str
    axis: str
    why: str


class ResidualStep(msgspec.Struct, frozen=True, kw_only=True):
    """The gap between model and record after an effect was added ("effect:axis", None at first) [m].

    Root mean squares of the free-run residual over all position channels, on the samples that were fitted and
    on those that were held out.
    """

    added: str | None
    fit_rms: float
    holdout_rms: float


class ResidualTrace(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Residuals of one channel before anything was added and at the end, (n,) [m, or the effort's unit].

    `counted` marks the samples that count, `held_out` those of them that were not fitted.
    """

    axis: str
    channel: Channel
    t: Array
    command: Array
    before: Array
    after: Array
    counted: BoolArray
    held_out: BoolArray


class Experiment(msgspec.Struct, frozen=True, kw_only=True):
    """Proposed experiment: the part program to run, the channels to record, and the reason."""

    name: str
    why: str
    record: tuple[str, ...]
    program: str


class Diagnosis(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Effects missing from a machine, by a log of its motion.

    `places` are those of the original machine's residual, `remaining` those of the improved one's. `machine`
    is the improved machine, the original where nothing was added. `noise_floor` [m] is the
    root mean square that no model can get below. `dropped` are names that the log speaks for, and against.
    """

    verdict: Verdict
    findings: tuple[Finding, ...]
    noise_floor: float
    steps: tuple[ResidualStep, ...]
    quality: LogQuality
    places: tuple[ResidualPlace, ...]
    remaining: tuple[ResidualPlace, ...]
    trails: tuple[ResidualTrace, ...]
    machine: Machine
    next_experiment: Experiment | None = None
    notes: tuple[str, ...] = ()
    dropped: tuple[DroppedName, ...] = ()


Origin = Literal["record", "file", "assumed"]
"""Source of a number: the log, the machine file, or a default."""


class Sensitivity(msgspec.Struct, frozen=True, kw_only=True):
    """Numbers of a drive that a log can tell apart, by its whitened sensitivities.

    Parameters
    ----------
    names : tuple of str
        The numbers that were asked for, each by its logarithm.
    singular_values : tuple of float
        Largest first. One over it is the relative standard error along its direction.
    rank : int
        Number of directions known better than the log's noise allows; see
        :data:`ph_post.identify.estimates.MOST_RELATIVE_ERROR`.
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


class IdentifiedDrive(msgspec.Struct, frozen=True, kw_only=True):
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

    drives: Mapping[str, IdentifiedDrive]
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


PRODUCT: Final = "lost_motion_times_inertia_fraction"
"""Number that positions alone show in a load loop: Δθ_m/C in the units of the axis, η times the lost motion."""
