"""Machine files with what a diagnosis found: the person's text, the new numbers, and where they come from."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, Final

from ph_post.diagnose.record import Diagnosis, Finding
from ph_post.errors import SolveError
from ph_post.io.machinechange import axis_change, error_words, same
from ph_post.io.machineedit import AxisChange, EffectChange, edit_axes
from ph_post.io.machinefile import machine_of
from ph_post.io.source import Source, source_of
from ph_post.types import Axis, Log, Machine

UM: Final = 1e-6
"""One micrometre in metres."""


def better_machine(original: Source, diagnosis: Diagnosis, log: Log) -> str:
    """Return a machine file with what a diagnosis added to the machine.

    What a person gave in other keys is changed there: the gap as an angle of the motor, b and c as inertia
    and damping. Above each change stands which log it comes from, and by how much the gap on held-out data
    fell; behind each number its standard error.

    Parameters
    ----------
    original : Source
        The text of the machine file that the diagnosis began with.
    diagnosis : Diagnosis
    log : Log

    Returns
    -------
    str
        A machine file that reads back as `diagnosis.machine`.

    Raises
    ------
    InputError
        Where the machine of the diagnosis cannot stand in a file.
    SolveError
        Where it differs from the file in what no diagnosis changes.
    """
    axes = machine_of(original).axes.values()
    changes = (_change(axis, diagnosis, log, original) for axis in axes)
    return changed_machine(original, changes, diagnosis.machine)


def changed_machine(original: Source, changes: Iterable[AxisChange | None], wanted: Machine) -> str:
    """Return a machine file with changes of its axes, None where one has none; it reads back as `wanted`.

    Raises
    ------
    InputError
        Where it contradicts itself.
    SolveError
        Where it is another machine's.
    """
    found = [change for change in changes if change is not None]
    text = edit_axes(original.text, found) if found else original.text
    require_same(machine_of(source_of(text, original.name, original.stem)), wanted)
    return text


def require_same(read: Machine, wanted: Machine) -> None:
    """Check that two machines have the same drives.

    Raises
    ------
    SolveError
        With the axis.
    """
    for name, axis in wanted.axes.items():
        if name not in read.axes or not same(_acting(read.axes[name]), _acting(axis)):
            raise SolveError(f"axis {name}: the machine file would not be that of the diagnosis")


def _change(axis: Axis, diagnosis: Diagnosis, log: Log, original: Source) -> AxisChange | None:
    """Return what a diagnosis changes of one axis, None where it is nothing."""
    findings = [finding for finding in diagnosis.findings if finding.axis == axis.name]
    numbers = [finding for finding in findings if finding.setting is None]
    above = [line for finding in numbers for line in _provenance(finding, diagnosis, log)]
    return axis_change(
        axis, diagnosis.machine.axes[axis.name], original,
        parameters={name: one for finding in numbers for name, one in finding.parameters.items()},
        above=above or [f"fitted to {log_words(log)}"],
        effects={
            one.setting.name: _described(one, diagnosis, log) for one in findings if one.setting is not None
        },
    )  # fmt: skip


def _described(finding: Finding, diagnosis: Diagnosis, log: Log) -> EffectChange:
    assert finding.setting is not None
    comments = {
        key: words
        for key, value in finding.setting.parameters.items()
        if isinstance(value, int | float) and (words := error_words(key, value, finding.parameters))
    }
    above = tuple(_provenance(finding, diagnosis, log))
    return EffectChange(place=None, setting=finding.setting, comments=comments, above=above)


def _provenance(finding: Finding, diagnosis: Diagnosis, log: Log) -> Iterator[str]:
    """Tell where a change comes from, and what it did to the gap."""
    yield f"{finding.name}, diagnosed from {log_words(log)}"
    for last, step in zip(diagnosis.steps, diagnosis.steps[1:], strict=False):
        if step.added == f"{finding.name}:{finding.axis}":
            gaps = f"{last.holdout_rms / UM:.3g} -> {step.holdout_rms / UM:.3g} um"
            yield f"gap between model and record on held-out data {gaps}"


def log_words(log: Log) -> str:
    """Name a log and the hash of its bytes."""
    name = " ".join(log.name.split())
    return f"{name} (sha256 {log.digest})" if log.digest else name


def _acting(axis: Axis) -> list[Any]:
    """Return what of an axis acts."""
    servo, gap, spread = axis.servo, axis.gap, axis.uncertainty
    return [
        axis.feedback, servo.b, servo.c, servo.ki_over_kp, servo.kd_over_kp, servo.stiffness,
        gap.lost_motion, gap.inertia_fraction, gap.beta, gap.pickup, gap.initial_flank,
        spread.backlash, spread.beta, spread.gain,
        [(effect.name, dict(effect.parameters)) for effect in axis.effects],
    ]  # fmt: skip
