"""Write an identified machine: the person's file with new numbers, or a new file."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Final

import tomlkit

from ph_post.drive.machinefile import machine_of
from ph_post.errors import InputError
from ph_post.files.machine import put, written
from ph_post.files.storage import SourceText, source_of
from ph_post.identify.estimates import PRODUCT
from ph_post.identify.machinechange import axis_change, changed_machine, log_words, require_same
from ph_post.types import Axis, Log, Machine
from ph_post.types.diagnosis import Identification, IdentifiedDrive
from ph_post.units import MM, MS

Row = tuple[str, float | str, str]
"""Key, value and the comment behind it."""

_ASSUMED: Final = "assumed: the record does not show it"

_KEYS: Final = {
    "b": "b",
    "c": "c",
    "lost_motion": "lost_motion_mm",
    "inertia_fraction": "inertia_fraction",
    "motor_time_constant": "motor_time_constant_s",
}
"""Numbers of a drive by their keys."""


def identified_machine(original: SourceText | None, found: Identification, log: Log) -> str:
    """Return a machine file with what was identified.

    Parameters
    ----------
    original : SourceText, optional
        The machine file that the identification began with; its text is kept but for the numbers. Without
        one the file is new.
    found : Identification
    log : Log

    Returns
    -------
    str
        A machine file that reads back as `found.machine`.

    Raises
    ------
    InputError
        Where a file would need what neither record nor options tell.
    """
    if original is None:
        return _new_file(found, log)
    before = machine_of(original)
    changes = (
        axis_change(
            before.axes[name],
            found.machine.axes[name],
            original,
            parameters=drive.parameters,
            above=[f"identified from {log_words(log)}"],
            effects={},
        )
        for name, drive in found.drives.items()
    )
    return changed_machine(original, changes, found.machine)


def require_writable(machine: Machine, name: str) -> None:
    """Check that a new file can say all that its axes need.

    Raises
    ------
    InputError
        Where a `load` loop lacks its transmission.
    """
    for axis in machine.axes.values():
        if axis.loop.encloses_backlash and (axis.gap.gear_ratio is None or axis.gap.travel_per_rad is None):
            raise InputError(
                f"{name}: {axis.name}",
                'a machine file with feedback "load" needs gear ratio and travel',
                expected="--gear-ratio and --screw-lead, or a machine file with -m",
            )


def _new_file(found: Identification, log: Log) -> str:
    """Write a file of its own; limits are what the record reached."""
    machine = found.machine
    require_writable(machine, log.name)
    for name, drive in found.drives.items():
        for key in ("b", "c"):
            if drive.origins[key] == "assumed" and getattr(machine.axes[name].servo, key) > 0.0:
                raise InputError(
                    f"{log.name}: {name}",
                    f"{key} does not show, and a machine file needs it",
                    expected="a record with more of speed and acceleration, or a machine file with -m",
                )
    document = tomlkit.document()
    for line in (f"Identified from {log_words(log)}.", "+- is the standard error."):
        document.add(tomlkit.comment(line))
    document.add("name", tomlkit.item(machine.name))
    controller = tomlkit.table()
    put(controller, "dialect", machine.dialect, "put yours here")
    put(controller, "servo_period_ms", written(machine.servo_period / MS), "that of the record")
    document.add("controller", controller)
    axes = tomlkit.table(is_super_table=True)
    for name, drive in found.drives.items():
        axes.add(name, _axis_table(machine.axes[name], drive))
    document.add("axes", axes)
    text = tomlkit.dumps(document)
    require_same(machine_of(source_of(text, "-", machine.name)), machine)
    return text


def _axis_table(axis: Axis, drive: IdentifiedDrive) -> Any:
    table = tomlkit.table()
    for note in drive.notes:
        table.add(tomlkit.comment(note))
    for key, value, comment in (*_drive_rows(axis, drive), *_uncertainty_rows(axis)):
        put(table, key, value, comment)
    table.add(tomlkit.comment("limits: what the record reached; put those of the machine here"))
    limits = axis.limits
    put(table, "max_velocity_mm_s", written(limits.velocity / MM))
    put(table, "max_acceleration_mm_s2", written(limits.acceleration / MM))
    put(table, "max_jerk_mm_s3", written(limits.jerk / MM))
    return table


def _drive_rows(axis: Axis, drive: IdentifiedDrive) -> Iterator[Row]:
    """Yield the numbers of a drive."""
    servo, gap = axis.servo, axis.gap
    yield "feedback", axis.feedback, ""
    values = {"b": servo.b, "c": servo.c, "lost_motion": gap.lost_motion / MM}
    if gap.inertia_fraction is not None:
        values["inertia_fraction"] = gap.inertia_fraction
    if gap.beta is not None:
        values["motor_time_constant"] = 1.0 / gap.beta
    for name, value in values.items():
        yield _KEYS[name], written(value), _words(name, drive)
    if servo.stiffness is not None:
        yield "servo_stiffness_n_per_mm", written(servo.stiffness * MM), _words("servo_stiffness", drive)
    if gap.gear_ratio is not None and gap.travel_per_rad is not None:
        yield "gear_ratio", written(gap.gear_ratio), ""
        yield "screw_lead_mm", written(gap.travel_per_rad * math.tau / MM), ""


def _words(name: str, drive: IdentifiedDrive) -> str:
    """Return the comment behind a number: its standard error, or that nobody measured it."""
    estimate = drive.parameters.get(name)
    if estimate is None:
        return _ASSUMED
    if estimate.stderr is not None:
        return f"+- {estimate.stderr:.2g} {estimate.unit}".rstrip()
    product = drive.parameters.get(PRODUCT)
    if product is None or product.stderr is None:
        return ""
    return f"times inertia_fraction {product.value:.4g} +- {product.stderr:.2g} mm: only that shows"


def _uncertainty_rows(axis: Axis) -> Iterator[Row]:
    """Yield the relative uncertainties that are not what a file supposes anyway."""
    uncertainty = axis.uncertainty
    for key, value in (
        ("backlash_uncertainty", uncertainty.backlash),
        ("beta_uncertainty", uncertainty.beta),
        ("gain_uncertainty", uncertainty.gain),
    ):
        if value != type(uncertainty)().backlash:
            yield key, value, ""
