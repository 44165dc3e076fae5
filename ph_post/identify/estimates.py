"""Estimates of a fitted drive: separable parameters, their standard errors, and the identified axis.

Separability comes from the singular values of the whitened sensitivities. Parameters are taken by their
logarithms, so that columns compare and a direction is a product of powers: in (ln η, ln gap) the direction
(1, -1) leaves η times the gap unchanged. Rows are residuals over their size, as many as are independent;
the reciprocal of a singular value is then a relative standard error.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.drive.cascade import with_cascade
from ph_post.drive.plant import Plant
from ph_post.files.check import counted
from ph_post.identify.cascade_numbers import CASCADE_NUMBERS, with_cascade_values
from ph_post.identify.direct_readings import CoastDown, effort_gain, pooled_rate
from ph_post.identify.drive_fit import BacklashVerdict, DriveFit, position_rms
from ph_post.identify.errors import fit_covariance
from ph_post.identify.free_run import AxisProblem, residuals, weighted_residuals, weights_of
from ph_post.quantities import measured_words
from ph_post.types import Array, Axis, AxisLog, Uncertainty
from ph_post.types.diagnosis import PRODUCT, Estimate, IdentifiedDrive, Origin, Sensitivity
from ph_post.units import MICROMETRE, MM

MOST_RELATIVE_ERROR: Final = 0.25
"""Relative standard error up to which a number is known at all."""

LEAST_DIRECTION_SHARE: Final = 0.3
"""Part of a direction from which on a number belongs to it."""


class AssessedFit(NamedTuple):
    """A fit and how sure it is.

    `shown` are the numbers that the log shows and that were fitted; the others are held in `fit`. In
    `loose` these too are let go, as far as `known` lets them: their relative standard errors beforehand.
    """

    shown: tuple[str, ...]
    fit: DriveFit
    loose: DriveFit
    known: Mapping[str, float]

    def errors(self) -> dict[str, float]:
        """Relative standard errors of what is shown.

        They are made of the noise and of what is held, and of what a command may do between its samples.
        """
        spread = np.sqrt(np.diag(log_covariance_with_priors(self.loose, self.known)))
        moved = self._moved()
        between = between_samples(self.fit, self.shown)
        names = self.fit.names
        return {name: math.hypot(float(spread[names.index(name)]), moved[name], between[name]) for name in self.shown}

    def product_error(self) -> float:
        """Relative standard error of η times the gap, η being held."""
        names, spread, moved = (
            self.fit.names,
            log_covariance_with_priors(self.loose, self.known),
            self._moved(),
        )
        both = [names.index("gap"), names.index("eta")]
        own = math.sqrt(float(np.sum(spread[np.ix_(both, both)])))
        between = between_samples(self.fit, self.shown)["gap"]
        return math.hypot(own, moved["gap"] + moved["eta"], between)

    def _moved(self) -> dict[str, float]:
        """Change of the logarithms as the others were let go."""
        return {
            name: math.log(max(getattr(self.loose.plant, name), 1e-12) / getattr(self.fit.plant, name))
            for name in self.fit.names
        }


def whitened_sensitivities(fit: DriveFit) -> Array:
    """Return the whitened sensitivities by the logarithms of the numbers, (rows, names)."""
    return np.asarray(_sensitivities(fit) / math.sqrt(fit.worth))


def _sensitivities(fit: DriveFit) -> Array:
    """Return the sensitivities of the weighted residuals by the logarithms of the numbers, (rows, names)."""
    sizes = [fit.plant.gap / MICROMETRE if name == "gap" else 1.0 for name in fit.names]
    return np.asarray(fit.jacobian * np.array(sizes))


def relative_errors(fit: DriveFit, names: Sequence[str]) -> dict[str, float]:
    """Return relative standard errors of some numbers while the others hold; infinite where nothing shows them."""
    columns = whitened_sensitivities(fit)[:, [fit.names.index(name) for name in names]]
    spread = log_covariance(columns)
    return {name: math.sqrt(spread[k, k]) for k, name in enumerate(names)}


def log_covariance(columns: Array) -> Array:
    """Covariance of the logarithms; what shows in no row has an infinite variance."""
    _, values, directions = np.linalg.svd(columns, full_matrices=False)
    inverse = np.divide(1.0, values, out=np.full_like(values, 1e9), where=values > 1e-9)
    return np.asarray((directions.T * inverse**2) @ directions)


def log_covariance_with_priors(fit: DriveFit, priors: Mapping[str, float]) -> Array:
    """Covariance of the logarithms of all numbers, some of them known beforehand.

    Parameters
    ----------
    fit : DriveFit
    priors : mapping
        Relative standard errors of what is held, by name.
    """
    problem = fit.problem
    each = np.eye(len(fit.names))
    rows = [each[fit.names.index(name)] / error for name, error in priors.items()]
    prior = np.stack(rows) if rows else np.zeros((0, len(fit.names)))
    return fit_covariance(problem, fit.left, _sensitivities(fit), prior, problem.fit)


def sensitivity_of(fit: DriveFit) -> Sensitivity:
    """Return rank, singular values and the directions that do not show."""
    _, values, directions = np.linalg.svd(whitened_sensitivities(fit), full_matrices=False)
    shown = values * MOST_RELATIVE_ERROR > 1.0
    weak = tuple(
        {
            name: float(part)
            for name, part in zip(fit.names, direction, strict=True)
            if abs(part) >= LEAST_DIRECTION_SHARE
        }
        for direction in directions[~shown]
    )
    return Sensitivity(
        names=fit.names,
        singular_values=tuple(float(one) for one in values),
        rank=int(np.count_nonzero(shown)),
        weak=weak,
    )


def shown_names(fit: DriveFit, give_up: Sequence[str]) -> tuple[str, ...]:
    """Return the numbers that a log shows, if the others are what they are in the plant.

    Parameters
    ----------
    fit : DriveFit
        With the sensitivities by all of them.
    give_up : sequence of str
        What is held first where it is not known; what is not in it is never held.
    """
    names = list(fit.names)
    for name in give_up:
        if name in names and relative_errors(fit, names)[name] > MOST_RELATIVE_ERROR:
            names.remove(name)
    return tuple(names)


def smoothed(problem: AxisProblem) -> AxisProblem:
    """Return a problem whose command, linear between its samples, is on average that of a smooth curve.

    The chord of a curve lies by ẍ h²/12 on the inside of it, in the mean over a period h. The log does not
    show which of the two the drive was given.
    """
    command = problem.command
    bend = np.zeros_like(command)
    bend[1:-1] = np.diff(command, 2)
    moved = command - bend / 12.0
    return replace(problem, command=moved, fine=moved)


def between_samples(fit: DriveFit, names: Sequence[str]) -> dict[str, float]:
    """Return the relative change of numbers if the command were smooth between samples."""
    problem = fit.problem
    if problem.parts > 1:  # smooth already
        return dict.fromkeys(names, 0.0)
    if not names:
        return {}
    weights = weights_of(problem, fit.left, problem.fit)
    change = weighted_residuals(problem, residuals(smoothed(problem), fit.plant), weights, problem.fit)
    change -= weighted_residuals(problem, fit.left, weights, problem.fit)
    sizes = [fit.plant.gap / MICROMETRE if name == "gap" else 1.0 for name in fit.names]
    columns = (fit.jacobian * np.array(sizes))[:, [fit.names.index(name) for name in names]]
    moved = -np.linalg.lstsq(columns, change, rcond=None)[0]
    return dict(zip(names, map(float, moved), strict=True))


MOST_UNCERTAIN: Final = 0.9


class AxisFit(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A fitted axis and what was decided on the way; `repeats` says that runs of the same motion agree."""

    problem: AxisProblem
    axis_log: AxisLog
    settling: AssessedFit
    verdict: BacklashVerdict
    coasts: tuple[CoastDown, ...]
    from_file: bool
    notes: tuple[str, ...]
    repeats: bool = True

    @property
    def plant(self) -> Plant:
        """The fitted plant."""
        return self.settling.fit.plant

    @property
    def rms(self) -> float:
        """Root mean square that the free run leaves of the positions [m]."""
        return position_rms(self.problem, self.settling.fit.left, self.problem.counted)


def estimate_drive(settled: AxisFit) -> IdentifiedDrive:
    """Return estimates, the origin of each number, and what could not be separated."""
    parameters, notes = _base(settled)
    gap, gap_notes = _gap(settled)
    motor, motor_notes = _motor(settled)
    stiffness, effort_notes = _stiffness(settled)
    parameters |= gap | motor | stiffness
    notes = [*settled.notes, *notes, *gap_notes, *motor_notes, *effort_notes, *_left(settled)]
    return IdentifiedDrive(
        parameters=parameters,
        origins=_origins(settled, parameters),
        rms=settled.rms,
        noise=settled.problem.noise_floor,
        sensitivity=sensitivity_of(settled.settling.loose),
        notes=tuple(notes),
    )


def _base(settled: AxisFit) -> tuple[dict[str, Estimate], list[str]]:
    """Return b and c."""
    plant, errors = settled.plant, settled.settling.errors()
    parameters, notes = {}, []
    kept = "the machine file's value is kept" if settled.from_file else "its value is assumed"
    if plant.b == 0.0:
        return {}, ["the log shows no lag: an ideal stepper, b and c are 0"]
    if "b" in errors:
        parameters["b"] = Estimate(value=plant.b, stderr=plant.b * errors["b"], unit="s²")
    else:
        notes.append(f"b cannot be identified: the accelerations in the log are too small; {kept}")
    if "c" in errors:
        parameters["c"] = Estimate(value=plant.c, stderr=plant.c * errors["c"], unit="s")
    else:
        notes.append(f"c cannot be identified: the speeds in the log are too small; {kept}")
    return parameters, notes


def _gap(settled: AxisFit) -> tuple[dict[str, Estimate], list[str]]:
    """Return the lost motion; on a load loop that does not show η, its product with η."""
    plant, verdict, errors = settled.plant, settled.verdict, settled.settling.errors()
    notes = list(verdict.notes)
    if verdict.fit is None:
        return _no_gap(settled, notes)
    width, relative = plant.gap / MM, errors["gap"]
    if not plant.loop.encloses_backlash or "eta" in settled.settling.shown:
        return {"lost_motion": Estimate(value=width, stderr=width * relative, unit="mm")}, notes
    product = plant.eta * width
    estimate = Estimate(value=product, stderr=product * settled.settling.product_error(), unit="mm")
    words = (
        "positions on one side of a load loop show only Δθ_m/C: η times the lost motion is "
        f"{measured_words(product, estimate.stderr, 'mm')}; the lost motion is given for η = {plant.eta:.4g}, "
    )
    if settled.from_file:
        notes.append(words + "the machine file's, with the file's uncertainty of C")
    else:
        notes.append(words + "which is assumed")
    gap = Estimate(value=width, stderr=width * relative if settled.from_file else None, unit="mm")
    return {"lost_motion": gap, PRODUCT: estimate}, notes


def _no_gap(settled: AxisFit, notes: list[str]) -> tuple[dict[str, Estimate], list[str]]:
    """Return how large a backlash the log could hide."""
    bound, said = settled.verdict.bound, settled.problem.axis.gap.lost_motion
    if bound is None:
        words = "the machine file's value is kept" if said > 0.0 else "none is taken"
        if not notes:
            notes.append("the log cannot show backlash of any size")
        return {}, [*notes, f"lost motion: {words}"]
    note = f"the log shows no backlash above {bound / MICROMETRE:.2g} µm"
    if 0.0 < said <= bound:
        return {}, [*notes, f"{note}; the machine file's smaller value is kept"]
    return {"lost_motion": Estimate(value=0.0, stderr=bound / MM / 3.0, unit="mm")}, [*notes, note]


def _motor(settled: AxisFit) -> tuple[dict[str, Estimate], list[str]]:
    """Return η and β, β from coast-downs too."""
    plant, errors, notes = settled.plant, settled.settling.errors(), []
    parameters: dict[str, Estimate] = {}
    if "eta" in errors:
        parameters["inertia_fraction"] = Estimate(value=plant.eta, stderr=plant.eta * errors["eta"], unit="")
    free = [one for one in settled.coasts if not one.coupled]
    relative = errors.get("beta")
    if free:
        rate, error = pooled_rate(free)
        relative = error / rate
        notes.append(
            f"β is from {counted(len(free), 'coast-down')} of what the motor's encoder was fixed to: the motor"
            " alone if it was uncoupled"
        )
    if relative is not None:
        tau = 1.0 / plant.beta
        parameters["motor_time_constant"] = Estimate(value=tau, stderr=tau * relative, unit="s")
    coupled = [one for one in settled.coasts if one.coupled]
    if coupled:
        rate, error = pooled_rate(coupled)
        notes.append(
            f"the axis coasts down at {measured_words(rate, error, '1/s')}, motor and table together: the mechanical"
            " part of c/b, not β of the motor alone"
        )
    acts = plant.loop.encloses_backlash and settled.verdict.fit is not None
    if acts and relative is None:
        kept = "the machine file's value is kept" if settled.from_file else f"β = {plant.beta:.4g} 1/s is assumed"
        notes.append(f"the log does not show β while the backlash is crossed; {kept}")
    return parameters, notes


def _stiffness(settled: AxisFit) -> tuple[dict[str, Estimate], list[str]]:
    """Return K by the recorded effort, in its unit a millimetre of following error."""
    plant, problem, axis_log = settled.plant, settled.problem, settled.axis_log
    if plant.ki or plant.kd or plant.command_delay:
        return {}, []
    found = effort_gain(axis_log, plant.loop, problem.period, problem.counted)
    if found is None:
        return {}, []
    if not settled.repeats:
        return {}, [
            "servo_stiffness is not taken from the log: something else than the command moves the axis, and what its"
            " effort answers cannot be told; with servo_stiffness_n_per_mm of the drive in the file, diagnose can"
        ]
    K, stderr = found
    return {"servo_stiffness": Estimate(value=K * MM, stderr=stderr * MM, unit=f"{axis_log.effort_unit}/mm")}, []


def _left(settled: AxisFit) -> list[str]:
    """Say that the base model is incomplete."""
    floor = settled.problem.noise_floor
    if settled.rms <= 1.5 * floor:
        return []
    return [
        f"the free run misses the readings by {settled.rms / MICROMETRE:.3g} µm rms, their noise is "
        f"{floor / MICROMETRE:.2g} µm: the base model is incomplete; run ph-post diagnose to find the"
        " missing effect"
    ]


def _origins(settled: AxisFit, parameters: dict[str, Estimate]) -> dict[str, Origin]:
    """Return the origin of every number of the drive."""
    rest: Origin = "file" if settled.from_file else "assumed"
    names = ["b", "c", "lost_motion"]
    if settled.problem.plant.loop.encloses_backlash:
        names += ["inertia_fraction", "motor_time_constant"]
    return {name: "record" if name in parameters else rest for name in names}


KEYS: Final = {
    "b": "b",
    "c": "c",
    "lost_motion": "lost_motion_mm",
    "inertia_fraction": "inertia_fraction",
    "motor_time_constant": "motor_time_constant_s",
    **{name: one.key for name, one in CASCADE_NUMBERS.items()},
}
"""Keys of the machine file by the names of parameters."""


def identified_axis(settled: AxisFit, drive: IdentifiedDrive) -> Axis:
    """Return the axis with the numbers that the log shows, rounded as they are written."""
    shown = drive.parameters
    numbers = {key: float(f"{shown[name].value:.7g}") for name, key in KEYS.items() if name in shown}
    axis = with_keys(settled.problem.axis, numbers)
    stiffness = shown.get("servo_stiffness")
    if stiffness is not None and stiffness.unit == "N/mm":
        axis = replace(axis, servo=replace(axis.servo, stiffness=float(f"{stiffness.value:.7g}") / MM))
    return replace(axis, uncertainty=_uncertainty(axis.uncertainty, shown))


def with_keys(axis: Axis, keys: Mapping[str, float]) -> Axis:
    """Return an axis with numbers in the units of the machine file, by :data:`KEYS`.

    An axis that shows backlash is not held by gravity.
    """
    servo, gap, held = axis.servo, axis.gap, axis.gravity_side
    servo = replace(servo, b=keys.get("b", servo.b), c=keys.get("c", servo.c))
    if servo.cascade is not None:
        values = {name: keys[one.key] for name, one in CASCADE_NUMBERS.items() if one.key in keys}
        servo = with_cascade(servo, with_cascade_values(servo.cascade, values))
    if "lost_motion_mm" in keys:
        gap = gap.with_lost_motion(keys["lost_motion_mm"] * MM)
        held = None if gap.lost_motion > 0.0 else held
    if "inertia_fraction" in keys:
        gap = replace(gap, inertia_fraction=keys["inertia_fraction"])
    if "motor_time_constant_s" in keys:
        gap = replace(gap, beta=1.0 / keys["motor_time_constant_s"])
    return replace(axis, servo=servo, gap=gap, gravity_side=held)


def _uncertainty(before: Uncertainty, shown: Mapping[str, Estimate]) -> Uncertainty:
    """Put standard errors in place of what the file supposes: C goes with 1/(η b)."""
    uncertainty = before
    if (gap := relative_uncertainty(shown.get("lost_motion"))) is not None:
        uncertainty = replace(uncertainty, backlash=gap)
    if (beta := relative_uncertainty(shown.get("motor_time_constant"))) is not None:
        uncertainty = replace(uncertainty, beta=beta)
    eta, b = relative_uncertainty(shown.get("inertia_fraction")), relative_uncertainty(shown.get("b"))
    if eta is not None and b is not None:
        uncertainty = replace(uncertainty, gain=float(f"{math.hypot(eta, b):.3g}"))
    return uncertainty


def relative_uncertainty(estimate: Estimate | None) -> float | None:
    """Return a standard error as the relative uncertainty of a machine file; None where it has none."""
    if estimate is None or not estimate.stderr or estimate.value <= 0.0:
        return None
    return float(f"{min(max(estimate.stderr / estimate.value, LEAST_UNCERTAINTY), MOST_UNCERTAIN):.3g}")


LEAST_UNCERTAINTY: Final = 0.005
"""No number of a machine is known better than that from one log."""
