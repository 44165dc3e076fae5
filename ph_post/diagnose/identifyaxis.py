"""From a fitted drive to what a person and a machine file get: estimates, notes, and the axis."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.diagnose.coastdown import CoastDown, pooled
from ph_post.diagnose.drivefit import DriveFit
from ph_post.diagnose.effortgain import effort_gain
from ph_post.diagnose.findings import LEAST_UNCERTAINTY
from ph_post.diagnose.gapsearch import GapVerdict
from ph_post.diagnose.identification import Drive, Origin, Sensitivity
from ph_post.diagnose.model import Problem
from ph_post.diagnose.record import Estimate
from ph_post.diagnose.separation import relative_errors
from ph_post.types import Axis, AxisLog, Gap, Uncertainty
from ph_post.units import MICROMETRE, MM

PRODUCT: Final = "lost_motion_times_inertia_fraction"
"""What a load loop shows from positions: Δθ_m/C in the units of the axis, η times the lost motion."""

MOST_UNCERTAIN: Final = 0.9


class Settled(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A fitted axis and what was decided on the way.

    `fit` has the sensitivities by all numbers that act, of which `shown` are those that the record tells;
    `between` says by how much each of them, relative, depends on what the command does between samples.
    """

    problem: Problem
    record: AxisLog
    fit: DriveFit
    shown: tuple[str, ...]
    between: Mapping[str, float]
    verdict: GapVerdict
    coasts: tuple[CoastDown, ...]
    sensitivity: Sensitivity
    from_file: bool
    rms: float
    notes: tuple[str, ...]


def told_drive(settled: Settled) -> Drive:
    """Tell estimates, where each number comes from, and what could not be separated."""
    parameters, notes = _base(settled)
    gap, gap_notes = _gap(settled)
    motor, motor_notes = _motor(settled)
    stiffness = _stiffness(settled)
    parameters |= gap | motor | stiffness
    noise = [one.noise for one in settled.problem.observed if one.channel != "force"]
    notes = [*settled.notes, *notes, *gap_notes, *motor_notes, *_left(settled, noise)]
    return Drive(
        parameters=parameters, origins=_origins(settled, parameters), sensitivity=settled.sensitivity,
        rms=settled.rms, noise=math.sqrt(float(np.mean(np.square(noise)))), notes=tuple(notes),
    )  # fmt: skip


def _errors(settled: Settled) -> dict[str, float]:
    """Return relative standard errors of what shows: by noise and by what is not known of the command."""
    if not settled.shown:
        return {}
    errors = relative_errors(settled.fit, settled.shown)
    return {name: math.hypot(errors[name], shift) for name, shift in settled.between.items()}


def _kept(settled: Settled) -> str:
    """Say what stands in place of what does not show."""
    return "that of the machine file is kept" if settled.from_file else "it is not identified"


def _base(settled: Settled) -> tuple[dict[str, Estimate], list[str]]:
    """Tell b and c."""
    plant, errors = settled.fit.plant, _errors(settled)
    parameters, notes = {}, []
    if plant.b == 0.0:
        return {}, ["no lag shows: an ideal stepper, b and c are 0"]
    if "b" in errors:
        parameters["b"] = Estimate(value=plant.b, stderr=plant.b * errors["b"], unit="s²")
    else:
        notes.append(f"b does not show: accelerations too small; {_kept(settled)}")
    if "c" in errors:
        parameters["c"] = Estimate(value=plant.c, stderr=plant.c * errors["c"], unit="s")
    else:
        notes.append(f"c does not show: speeds too small; {_kept(settled)}")
    return parameters, notes


def _gap(settled: Settled) -> tuple[dict[str, Estimate], list[str]]:
    """Tell the lost motion; on a load loop, where η does not show, its product with η."""
    plant, verdict, errors = settled.fit.plant, settled.verdict, _errors(settled)
    notes = list(verdict.notes)
    if verdict.fit is None:
        return _no_gap(settled, notes)
    width, relative = plant.gap / MM, errors["gap"]
    if plant.feedback != "load" or "eta" in settled.shown:
        return {"lost_motion": Estimate(value=width, stderr=width * relative, unit="mm")}, notes
    product = Estimate(value=plant.eta * width, stderr=plant.eta * width * relative, unit="mm")
    words = (
        "from positions on one side only Δθ_m/C shows on a load loop: η times the lost motion is "
        f"{product.value:.4g} ± {product.stderr:.2g} mm; the lost motion is that with η = {plant.eta:.4g} of "
    )
    if settled.from_file:
        whole_error = width * math.hypot(relative, settled.problem.axis.uncertainty.gain)
        notes.append(words + "the machine file, and as uncertain as the file says of C")
    else:
        whole_error = None
        notes.append(words + "no measurement")
    gap = Estimate(value=width, stderr=whole_error, unit="mm")
    return {"lost_motion": gap, PRODUCT: product}, notes


def _no_gap(settled: Settled, notes: list[str]) -> tuple[dict[str, Estimate], list[str]]:
    """Tell how large a gap could be that does not show."""
    bound, said = settled.verdict.bound, settled.problem.axis.gap.lost_motion
    if bound is None:
        words = "that of the machine file is kept" if said > 0.0 else "none is taken"
        if not notes:
            notes.append("the gap does not show: no width of it would be seen")
        return {}, [*notes, f"lost motion: {words}"]
    note = f"no gap above {bound / MICROMETRE:.2g} µm shows"
    if 0.0 < said <= bound:
        return {}, [*notes, f"{note}; that of the machine file is smaller and is kept"]
    return {"lost_motion": Estimate(value=0.0, stderr=bound / MM / 3.0, unit="mm")}, [*notes, note]


def _motor(settled: Settled) -> tuple[dict[str, Estimate], list[str]]:
    """Tell η and β, β from coast-downs too."""
    plant, errors, notes = settled.fit.plant, _errors(settled), []
    parameters: dict[str, Estimate] = {}
    if "eta" in errors:
        parameters["inertia_fraction"] = Estimate(value=plant.eta, stderr=plant.eta * errors["eta"], unit="")
    free = [one for one in settled.coasts if not one.coupled]
    relative = errors.get("beta")
    if free:
        rate, error = pooled(free)
        relative = error / rate
        notes.append(
            f"β is that of {len(free)} coast-down{'s' * (len(free) > 1)} of what the motor's encoder was "
            "fixed to: that was the motor alone if it was uncoupled"
        )
    if relative is not None:
        tau = 1.0 / plant.beta
        parameters["motor_time_constant"] = Estimate(value=tau, stderr=tau * relative, unit="s")
    coupled = [one for one in settled.coasts if one.coupled]
    if coupled:
        rate, error = pooled(coupled)
        notes.append(
            f"the axis coasts down with {rate:.4g} ± {error:.2g} 1/s: motor and table together, the part of "
            "c/b that is no controller's; β of the motor alone it does not show"
        )
    acts = plant.feedback == "load" and settled.verdict.fit is not None
    if acts and relative is None:
        notes.append(f"β does not show while the gap is crossed; {_held(settled, 'β')}")
    return parameters, notes


def _held(settled: Settled, name: str) -> str:
    if settled.from_file:
        return "that of the machine file is kept"
    return f"{name} = {settled.fit.plant.beta:.4g} 1/s is assumed"


def _stiffness(settled: Settled) -> dict[str, Estimate]:
    """Tell K by the recorded effort, in its unit a millimetre of following error."""
    plant, problem, record = settled.fit.plant, settled.problem, settled.record
    if plant.ki or plant.kd or plant.command_delay:
        return {}
    found = effort_gain(record, plant.feedback, problem.period, problem.counted)
    if found is None:
        return {}
    K, stderr = found
    return {"servo_stiffness": Estimate(value=K * MM, stderr=stderr * MM, unit=f"{record.effort_unit}/mm")}


def _left(settled: Settled, noise: list[float]) -> list[str]:
    """Say that the base model is not all there is."""
    floor = math.sqrt(float(np.mean(np.square(noise))))
    if settled.rms <= 1.5 * floor:
        return []
    return [
        f"the free run misses the readings by {settled.rms / MICROMETRE:.3g} µm rms, their noise is "
        f"{floor / MICROMETRE:.2g} µm: the base model is not all there is; ph-post diagnose tells what is"
        " missing"
    ]


def _origins(settled: Settled, parameters: dict[str, Estimate]) -> dict[str, Origin]:
    """Say of every number of the drive where it comes from."""
    rest: Origin = "file" if settled.from_file else "assumed"
    names = ["b", "c", "lost_motion"]
    if settled.problem.plant.feedback == "load":
        names += ["inertia_fraction", "motor_time_constant"]
    return {name: "record" if name in parameters else rest for name in names}


def identified_axis(settled: Settled, drive: Drive) -> Axis:
    """Return the axis with the numbers that the record shows, rounded as they are written."""
    axis, plant = settled.problem.axis, settled.fit.plant
    servo, gap = axis.servo, axis.gap
    shown = drive.parameters
    if "b" in shown:
        servo = replace(servo, b=_written(plant.b))
    if "c" in shown:
        servo = replace(servo, c=_written(plant.c))
    stiffness = shown.get("servo_stiffness")
    if stiffness is not None and stiffness.unit == "N/mm":
        servo = replace(servo, stiffness=_written(stiffness.value) / MM)
    if "lost_motion" in shown:
        gap = _wide(gap, _written(shown["lost_motion"].value) * MM)
    if "inertia_fraction" in shown:
        gap = replace(gap, inertia_fraction=_written(plant.eta))
    if "motor_time_constant" in shown:
        gap = replace(gap, beta=1.0 / _written(shown["motor_time_constant"].value))
    uncertainty = _uncertainty(axis.uncertainty, shown)
    return replace(axis, servo=servo, gap=gap, uncertainty=uncertainty)


def _written(value: float) -> float:
    return float(f"{value:.7g}")


def _wide(gap: Gap, lost_motion: float) -> Gap:
    angle = gap.motor_angle
    if gap.gear_ratio is not None and gap.travel_per_rad is not None:
        angle = lost_motion * gap.gear_ratio / gap.travel_per_rad
    return replace(gap, lost_motion=lost_motion, motor_angle=angle)


def _uncertainty(before: Uncertainty, shown: Mapping[str, Estimate]) -> Uncertainty:
    """Put standard errors in place of what the file supposes: C goes with 1/(η b)."""
    uncertainty = before
    if (gap := _relative(shown.get("lost_motion"))) is not None:
        uncertainty = replace(uncertainty, backlash=gap)
    if (beta := _relative(shown.get("motor_time_constant"))) is not None:
        uncertainty = replace(uncertainty, beta=beta)
    eta, b = _relative(shown.get("inertia_fraction")), _relative(shown.get("b"))
    if eta is not None and b is not None:
        uncertainty = replace(uncertainty, gain=float(f"{math.hypot(eta, b):.3g}"))
    return uncertainty


def _relative(estimate: Estimate | None) -> float | None:
    if estimate is None or not estimate.stderr or estimate.value <= 0.0:
        return None
    return float(f"{min(max(estimate.stderr / estimate.value, LEAST_UNCERTAINTY), MOST_UNCERTAIN):.3g}")
