"""What a diagnosis consists of: frozen records, SI units but where a unit stands beside the number."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import msgspec

from ph_post.types import Array, BoolArray, EffectSetting, Machine

Verdict = Literal["named", "nothing-missing", "ambiguous", "unknown", "not-identifiable"]
Channel = Literal["act", "motor", "force"]


class Estimate(msgspec.Struct, frozen=True, kw_only=True):
    """A parameter as the shop reads it: `value` and `stderr` in `unit`; `stderr` None where nothing tells."""

    value: float
    stderr: float | None
    unit: str


class ChannelQuality(msgspec.Struct, frozen=True, kw_only=True):
    """What one recorded channel can show [m, or the effort's unit].

    `resolution` is the smallest step between different readings, 0 where none is seen; `noise` the root mean
    square of what changes from sample to sample, resolution included, and `noise_from` how that was found;
    `missing` counts samples; `shift` [s] is by how much the channel is late beyond what its drive explains,
    None where the record does not tell.
    """

    axis: str
    channel: Channel
    resolution: float
    noise: float
    noise_from: Literal["repeats", "stationary stretches", "differences"]
    missing: int = 0
    shift: float | None = None


class Quality(msgspec.Struct, frozen=True, kw_only=True):
    """What a record can show: before anything is fitted to it.

    `first` is the first sample behind the start-up transient. `faults` say why it can show nothing at all,
    `notes` what else a person should know, each a plain sentence.
    """

    period: float
    jitter: float
    first: int
    channels: tuple[ChannelQuality, ...]
    faults: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


class Place(msgspec.Struct, frozen=True, kw_only=True):
    """Where a residual lies, of one axis: its `share` of the excess over the noise floor, and a sentence.

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


class GapStep(msgspec.Struct, frozen=True, kw_only=True):
    """The gap between model and record after an effect was added ("effect:axis", None at first) [m].

    Root mean squares of the free-run residual over all position channels, on the samples that were fitted and
    on those that were held out.
    """

    added: str | None
    fit_rms: float
    holdout_rms: float


class Trail(msgspec.Struct, frozen=True, kw_only=True, eq=False):
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
    """What would tell more: the part program to run, what to record, and why."""

    name: str
    why: str
    record: tuple[str, ...]
    program: str


class Diagnosis(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """What is missing from a machine, as a record shows it.

    `places` tell where the residual of the machine as it was lies, `remaining` where that of the better one
    does. `machine` is the better one, the same as before where nothing was added. `noise_floor` [m] is the
    root mean square that no model can get below.
    """

    verdict: Verdict
    findings: tuple[Finding, ...]
    noise_floor: float
    steps: tuple[GapStep, ...]
    quality: Quality
    places: tuple[Place, ...]
    remaining: tuple[Place, ...]
    trails: tuple[Trail, ...]
    machine: Machine
    next_experiment: Experiment | None = None
    notes: tuple[str, ...] = ()
