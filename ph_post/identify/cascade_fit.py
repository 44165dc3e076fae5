"""Fit of a cascade to a log, where a single loop leaves more than it: by what is predicted on held-out samples.

Fitted are K_v, ω_v and T_n, the weight of the velocity feed-forward and the dead time of the command, then the backlash
as with a single loop. A current loop, further feed-forward and filters of the command are looked for where too much is
left; as far as a log shows no more they hide in the dead time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from ph_post.drive.cascade import is_stable
from ph_post.drive.plant import Plant, base_value, with_base_value
from ph_post.identify.cascade_numbers import CASCADE_NUMBERS, FITTED, NAMES, with_cascade_values
from ph_post.identify.drive_fit import (
    EARNS,
    LENGTHS,
    MAY_BE_NONE,
    BacklashVerdict,
    DriveFit,
    decide_backlash,
    fit_drive,
    free_number,
    held_out_gain,
    position_rms,
    smallest_visible_backlash,
    tangent,
    why_backlash_hidden,
    with_all_samples,
)
from ph_post.identify.errors import fit_covariance
from ph_post.identify.estimates import LEAST_UNCERTAINTY, between_samples, sensitivity_of
from ph_post.identify.free_run import AxisProblem, residuals, weighted_residuals, weights_of
from ph_post.types import Array, Axis, AxisLog, Cascade, Servo
from ph_post.types.diagnosis import Channel, Estimate, IdentifiedDrive, Origin
from ph_post.units import MICROMETRE, MM, MS

GAINS: Final = tuple(CASCADE_NUMBERS[name].field for name in FITTED)
"""Fields that are fitted in any case."""

RARE: Final = {
    "acceleration_feedforward": 0.5,
    "acceleration_lead": 1e-3,
    "current_time": 0.5e-3,
    "moving_average": 5e-3,
    "exponential": 2e-3,
}
"""Fields that are fitted where too much is left without, and what they start from."""

LIKELY: Final = 2
"""How many of them are fitted: those that help most where all is straight."""

MOST_RARE: Final = 2
"""Most of them."""

FINEST: Final = {
    "gap": 0.0,
    "velocity_feedforward": 1e-3,
    "dead_time": 0.02,
    "current_time": 0.02,
    "acceleration_lead": 0.02,
}
"""Least standard errors as numbers are fitted; of others it is :data:`LEAST_UNCERTAINTY`."""

GAPS: Final = (2e-5, 1e-4)
"""Backlash from which it is fitted together with gains [m]."""

EARLY: Final = 0.1
"""Part of a period from which on it is said that readings are early."""

UNSEEN: Final = {"current_time": 0.3}
"""What a cascade may have though a log shows too little of it to be fitted, as a standard error [ms]."""

POSITION_GAINS: Final = (15.0, 30.0, 60.0, 120.0)
"""K_v that are tried first [1/s]."""

WEIGHTS: Final = (0.0, 0.7, 0.95, 1.0)
"""Weights of the feed-forward that are tried first."""

QUICKER: Final = 5.0
"""ω_v that is tried first, in units of K_v."""

RATES: Final = (0.7, 2.5)
"""1 / T_n that are tried first, in units of K_v."""

STARTS: Final = 3
"""Starts of which the fit goes on."""

CLEAN: Final = 1.5
"""Times the noise that a complete model may leave."""

ROUGH: Final = 3.0
"""Times the noise up to which a cascade that is only begun from needs no other beside it."""

BETTER: Final = 0.35
"""Part of what a single loop leaves of held-out samples that a cascade may leave at most."""

MUCH: Final = 0.7
"""Part of it that a cascade has to stay below, however little noise there is."""

FRICTIONS: Final = (4e-6, 3e-5)
"""Friction that is tried first, F/K [m], where a cascade without any leaves too much."""

IDLE_INTEGRAL: Final = 10.0
"""T_n [s] from which on a velocity loop is one without an integrator: a thousand times what drives have."""

FED: Final = 0.02
"""Part of the speed that is not fed forward, up to which K_v and 1/T_n may be in each other's place."""

TWINS: Final = 0.1
"""Part by which these are apart that it makes a difference."""

ALIKE: Final = 1.1
"""Times what a cascade leaves that one with K_v and 1/T_n in each other's place leaves at most to move like it."""

NOTED: Final = 0.02
"""Part of a feed-forward from which on it is said that the dead time may make up for it."""

VAGUE: Final = 0.25
"""Relative standard error above which a number is not separate from others."""


class CascadeFit(NamedTuple):
    """A fitted cascade: on the fitted half, with its verdict on backlash, and what it leaves of the other half [m]."""

    fit: DriveFit
    verdict: BacklashVerdict
    held_out: float


def _exchanged(plant: Plant) -> Plant | None:
    """Return a cascade with K_v and 1/T_n in each other's place; None where it moves otherwise, or as good as the same.

    Where all of the speed is fed forward the velocity loop gets ω_v (s + K_v) (s + 1/T_n) / s of the following error:
    which of both is which no log shows. Of what is not fed forward the part is as much larger as K_v is, and so is b.
    """
    assert plant.cascade is not None
    gain, rate, short = (
        plant.cascade.position_gain,
        plant.cascade.integral_rate,
        1.0 - plant.cascade.velocity_feedforward,
    )
    if rate <= 0.0 or abs(short) > FED or abs(math.log(rate / gain)) < TWINS:
        return None
    twin = with_base_value(with_base_value(plant, "position_gain", rate), "integral_rate", gain)
    twin = with_base_value(twin, "velocity_feedforward", 1.0 - short * rate / gain)
    size = twin.b / plant.b
    return replace(twin, coulomb_plus=size * plant.coulomb_plus, coulomb_minus=size * plant.coulomb_minus)


def _likelier(problem: AxisProblem, plants: Sequence[Plant]) -> Plant:
    """Return the cascade whose K_v is nearer to the file's, or else smaller: the outer loop is the slower one."""
    if problem.plant.cascade is None:
        return min(plants, key=_gain_of)
    return min(plants, key=lambda one: abs(math.log(_gain_of(one) / _gain_of(problem.plant))))


def finest_noise(problem: AxisProblem) -> float:
    """Return the noise of the positions [m] by their fourth differences, or the noise floor where that is less.

    Nothing that a drive does shows in these at 1 kHz; what repeats badly is no noise here.
    """
    squares = []
    for one in problem.positions:
        bends = np.abs(np.diff(one.values[one.ok], 4))
        squares.append((float(np.median(bends)) / (0.6745 * math.sqrt(70.0))) ** 2)
    return min(math.sqrt(float(np.mean(squares))), problem.noise_floor)


def leaves_much(problem: AxisProblem, left: Mapping[Channel, Array]) -> bool:
    """Whether what a single loop leaves asks for a cascade.

    Not where the file says of the loop that it is PI or PID, or how the axis rubs.
    """
    plant = problem.plant
    if not plant.loop.has_controller or plant.ki or plant.kd or problem.axis.effects or plant.b == 0.0:
        return False
    return position_rms(problem, left, problem.counted) > CLEAN * finest_noise(problem)


def gains_of(plant: Plant) -> tuple[str, ...]:
    """List the numbers of a cascade that a log is fitted by; a P velocity loop has no T_n."""
    return tuple(name for name in GAINS if name != "integral_rate" or base_value(plant, name) > 0.0)


def _tried(problem: AxisProblem) -> list[Plant]:
    """Return cascades that are tried first, that of the file among them: without backlash, or with one that is held."""
    bare = replace(problem.plant, gap=_held_gap(problem), ki=0.0, kd=0.0)
    tried = [_with_gains(bare, *one) for one in product(POSITION_GAINS, WEIGHTS, RATES)]
    return tried if bare.cascade is None else [bare, *tried]


def _held_gap(problem: AxisProblem) -> float:
    """Return the backlash of the file where the log is read with it and cannot show another [m].

    In a position of unknown side it shows where that was read behind it; without it, friction would be fitted for it.
    """
    return problem.plant.gap if problem.side == "unknown" and not problem.plant.loop.encloses_backlash else 0.0


def fit_cascade(problem: AxisProblem) -> DriveFit | None:
    """Fit a cascade without backlash to the fitted half of an axis; None where nothing that settles was found.

    Its velocity loop has T_n where that predicts the other half better.
    """
    tried = _tried(problem)
    tried.sort(key=lambda one: position_rms(problem, residuals(problem, one), problem.fit))
    fits = [fit_drive(problem, one, gains_of(one), rounds=1) for one in tried[:STARTS]]
    base = min(fits, key=lambda one: position_rms(problem, one.left, problem.fit))
    base = fit_drive(problem, base.plant, base.names, rounds=1)
    if base_value(base.plant, "integral_rate") > 0.0:
        plain = with_base_value(base.plant, "integral_rate", 0.0)
        simple = fit_drive(problem, plain, gains_of(plain), rounds=2)
        if held_out_gain(problem, base, simple) < EARNS:
            base = simple
    return base if _settles(base.plant) else None


def _with_rare(problem: AxisProblem, base: DriveFit) -> DriveFit:
    """Add what few cascades have, the best first, where too much is left without and no more than noise with it.

    Where the best leaves nearly as much of the held-out samples, no two leave noise alone.
    """
    found = base
    for _ in range(MOST_RARE):
        if _is_complete(problem, found):
            return found
        starts = {
            name: with_base_value(found.plant, name, base_value(found.plant, name) or RARE[name])
            for name in RARE
            if name not in found.names
        }
        likely = sorted(starts, key=lambda name: _left_beside(found, starts[name]))[:LIKELY]
        tried = [fit_drive(problem, starts[name], (*found.names, name), rounds=1) for name in likely]
        best = max(tried, key=lambda one: held_out_gain(problem, one, found))
        much = position_rms(problem, best.left, problem.held) > MUCH * position_rms(problem, found.left, problem.held)
        if held_out_gain(problem, best, found) < EARNS or (much and not _is_complete(problem, best)):
            break
        found = best
    return found if _is_complete(problem, found) else base


def roughly_fitted(problem: AxisProblem, gap: float, off: float) -> Plant | None:
    """Return a cascade near the one of a log, be it with friction; None where nothing that settles was found.

    Its gains are good enough to begin a search from. `gap` [m] is the backlash that is known of the axis, `off` [m]
    what the file leaves: where no cascade that is tried first leaves less, none is fitted.
    """
    size = FRICTIONS[0]
    tried = [replace(one, gap=gap, coulomb_plus=size, coulomb_minus=size) for one in _tried(problem)[1:]]
    best = _best_of_two(problem, tried, ("friction",), off, ROUGH * problem.noise_floor)
    if best is None or not _settles(best.plant):
        return None
    twin = _exchanged(best.plant)
    if twin is None or _likelier(problem, (best.plant, twin)) is best.plant or not _settles(twin):
        return best.plant
    less = position_rms(problem, residuals(problem, twin), problem.fit) <= ALIKE * position_rms(
        problem, best.left, problem.fit
    )
    return twin if less else best.plant


def _left_beside(found: DriveFit, other: Plant) -> float:
    """Return the squares that a fit leaves if it goes towards another plant, and its numbers give way, along lines."""
    weights = weights_of(found.problem, found.left, found.problem.fit)
    here = weighted_residuals(found.problem, found.left, weights, found.problem.fit)
    there = weighted_residuals(found.problem, residuals(found.problem, other), weights, found.problem.fit)
    columns = np.column_stack([found.jacobian, there - here])
    left = here - columns @ np.linalg.lstsq(columns, here, rcond=None)[0]
    return float(left @ left)


def _is_complete(problem: AxisProblem, fit: DriveFit) -> bool:
    return position_rms(problem, fit.left, problem.held) <= CLEAN * finest_noise(problem)


def with_backlash(problem: AxisProblem, base: DriveFit, axis_log: AxisLog) -> CascadeFit | None:
    """Decide on backlash behind or in a fitted cascade; None where it then does not settle.

    Its gains are held. Where they have given way to the backlash both are fitted, and taken if they leave noise alone.
    """
    hidden = why_backlash_hidden(problem, axis_log)
    verdict, best = BacklashVerdict(None, None, (hidden,)), base
    if not hidden:
        verdict = decide_backlash(problem, tangent(problem, base.plant, ()))
        if verdict.fit is not None:
            best = fit_drive(problem, verdict.fit.plant, (*base.names, "gap"), rounds=2)
            verdict = verdict._replace(fit=best)
        elif verdict.bound is not None:
            verdict = verdict._replace(bound=smallest_visible_backlash(problem, base))
    rubbing = None if _is_complete(problem, best) else _with_friction(problem, best, bool(hidden))
    if rubbing is not None:
        bound = None if hidden or "gap" in rubbing.names else smallest_visible_backlash(problem, rubbing)
        words = (hidden,) if hidden else ()
        best, verdict = rubbing, BacklashVerdict(rubbing if "gap" in rubbing.names else None, bound, words)
    elif not hidden:
        for gap in () if _is_complete(problem, best) else GAPS:
            joint = fit_drive(problem, replace(base.plant, gap=gap), (*base.names, "gap"), rounds=2)
            if _is_complete(problem, joint):
                best, verdict = joint, BacklashVerdict(joint, None)
                break
    best = _without_idle_integrator(problem, _with_rare(problem, best))
    if not _settles(best.plant):
        return None
    return CascadeFit(best, verdict, position_rms(problem, best.left, problem.held))


def _without_idle_integrator(problem: AxisProblem, found: DriveFit) -> DriveFit:
    """Take the integrator from a velocity loop whose T_n has gone beyond all that a drive can be set to."""
    if not 0.0 < base_value(found.plant, "integral_rate") < 1.0 / IDLE_INTEGRAL:
        return found
    plain = with_base_value(found.plant, "integral_rate", 0.0)
    return fit_drive(problem, plain, tuple(name for name in found.names if name != "integral_rate"), rounds=1)


def _with_friction(problem: AxisProblem, plain: DriveFit, hidden: bool) -> DriveFit | None:
    """Fit friction with the gains, which else give way to it: K_v of 8 for 40 where F/K is 60 µm.

    `hidden` says that no backlash shows; else it is fitted with them. None where that leaves no less of the held-out
    samples, or the file says how the axis rubs.
    """
    if problem.axis.effects or problem.plant.coulomb_plus > 0.0:
        return None
    found = [_rubbing(problem, gaps) for gaps in ((0.0,), GAPS)[: 1 if hidden else 2]]
    best = found[0]
    if len(found) > 1 and held_out_gain(problem, found[1], best) >= EARNS and found[1].plant.gap > 0.0:
        best = found[1]
    less = position_rms(problem, best.left, problem.held) < MUCH * position_rms(problem, plain.left, problem.held)
    return best if less and best.plant.coulomb_plus > 0.0 and _settles(best.plant) else None


def _rubbing(problem: AxisProblem, gaps: Sequence[float]) -> DriveFit:
    """Fit gains and friction, and backlash where one of `gaps` is, from the best that is tried of two K_v."""
    tried = [
        replace(one, gap=gap or one.gap, coulomb_plus=size, coulomb_minus=size)
        for one, gap, size in product(_tried(problem), gaps, FRICTIONS)
    ]
    best = _best_of_two(problem, tried, ("friction", *(("gap",) if any(gaps) else ())))
    assert best is not None
    return fit_drive(problem, best.plant, best.names, rounds=1)


def _best_of_two(
    problem: AxisProblem, tried: Sequence[Plant], more: Sequence[str], most: float = math.inf, enough: float = 0.0
) -> DriveFit | None:
    """Fit gains and more from the best of what is tried of two K_v, or of one where that leaves no more than `enough`.

    None where all of what is tried leaves more than `most` [m].
    """
    left = [position_rms(problem, residuals(problem, one), problem.fit) for one in tried]
    order = sorted(range(len(tried)), key=lambda number: left[number])
    if left[order[0]] > most:
        return None
    first = tried[order[0]]
    found = fit_drive(problem, first, (*gains_of(first), *more), rounds=1)
    if position_rms(problem, found.left, problem.fit) <= enough:
        return found
    second = next((tried[k] for k in order if _gain_of(tried[k]) != _gain_of(first)), first)
    other = fit_drive(problem, second, (*gains_of(second), *more), rounds=1)
    return min(found, other, key=lambda one: position_rms(problem, one.left, problem.fit))


def _gain_of(plant: Plant) -> float:
    return base_value(plant, "position_gain")


def is_better(problem: AxisProblem, cascade: DriveFit, single: DriveFit) -> bool:
    """Whether a cascade predicts the held-out samples so much better than a single loop that it is the structure."""
    left, other = (position_rms(one.problem, one.left, problem.held) for one in (cascade, single))
    return left <= max(CLEAN * finest_noise(problem), BETTER * other) and left < MUCH * other


def _with_gains(plant: Plant, gain: float, weight: float, rate: float) -> Plant:
    fresh = Cascade(position_gain=gain, velocity_gain=QUICKER * gain, dead_time=0.5 * MS)
    cascade = replace(
        plant.cascade or fresh,
        position_gain=gain,
        velocity_gain=QUICKER * gain,
        integral_rate=rate * gain,
        velocity_feedforward=weight,
    )
    b = 1.0 / (cascade.velocity_gain * gain)
    own = min(plant.eta, 1.0) * b * plant.beta if plant.loop.encloses_backlash else 0.0
    return replace(plant, cascade=cascade, b=b, c=own)


def _servo(plant: Plant, stiffness: float | None) -> Servo:
    assert plant.cascade is not None
    return Servo(b=plant.b, c=plant.c + 1.0 / plant.cascade.position_gain, stiffness=stiffness, cascade=plant.cascade)


def _settles(plant: Plant) -> bool:
    return is_stable(_servo(plant, None))


def cascaded_axis(
    problem: AxisProblem, found: CascadeFit, from_file: bool, notes: Sequence[str]
) -> tuple[IdentifiedDrive, Axis]:
    """Fit a cascade to all samples, and return its estimates and the axis with them, rounded as they are written."""
    found, twin = _likelier_fit(problem, found)
    counted = with_all_samples(problem)
    names = found.fit.names
    best = tangent(counted, fit_drive(counted, found.fit.plant, names).plant, names)
    errors = _errors(best)
    plant = best.plant
    if base_value(plant, "dead_time") < 0.0:
        # Readings that are early are the recorder's: no drive has a dead time below 0.
        plant = with_base_value(plant, "dead_time", 0.0)
    parameters = _estimates(plant, errors)
    left = best.left
    if "friction" in names:
        left = residuals(counted, replace(best.plant, coulomb_plus=0.0, coulomb_minus=0.0))
    rms = position_rms(counted, left, counted.counted)
    said = [*notes, *_remarks(problem, found, best, errors), *twin]
    if rms > CLEAN * problem.noise_floor:
        said.append(
            f"the free run misses the readings by {rms / MICROMETRE:.3g} µm rms, their noise is "
            f"{problem.noise_floor / MICROMETRE:.2g} µm: something is missing"
        )
    axis = _axis_with(problem.axis, plant, parameters, "gap" in names or found.verdict.bound is not None)
    rest: Origin = "file" if from_file else "assumed"
    kept = ["lost_motion"]
    if plant.loop.encloses_backlash:
        kept += ["inertia_fraction", "motor_time_constant"]
    origins: dict[str, Origin] = dict.fromkeys((name for name in kept if name not in parameters), rest)
    origins |= dict.fromkeys(parameters, "record")
    drive = IdentifiedDrive(
        parameters=parameters,
        origins=origins,
        rms=rms,
        noise=problem.noise_floor,
        sensitivity=sensitivity_of(best),
        notes=tuple(said),
    )
    return drive, axis


def _likelier_fit(problem: AxisProblem, found: CascadeFit) -> tuple[CascadeFit, tuple[str, ...]]:
    """Return a fit, or where K_v and 1/T_n may be in each other's place the likelier one, and what is said of that."""
    twin = _exchanged(found.fit.plant)
    if twin is None:
        return found, ()
    other = fit_drive(problem, twin, found.fit.names, rounds=2)
    held_out = position_rms(problem, other.left, problem.held)
    apart = abs(math.log(_gain_of(other.plant) / _gain_of(found.fit.plant)))
    if held_out > ALIKE * found.held_out or apart < TWINS or not _settles(other.plant):
        return found, ()
    left = other.plant
    if _likelier(problem, (found.fit.plant, other.plant)) is other.plant:
        left, verdict = found.fit.plant, found.verdict
        found = CascadeFit(other, verdict if verdict.fit is None else verdict._replace(fit=other), held_out)
    said = f"K_v = {_gain_of(left):.3g} 1/s with T_n = {1.0 / MS / base_value(left, 'integral_rate'):.3g} ms"
    return found, (f"{said} moves alike: where all of the speed is fed forward no log tells K_v from 1/T_n",)


def _remarks(problem: AxisProblem, found: CascadeFit, best: DriveFit, errors: Mapping[str, float]) -> Iterator[str]:
    """Say what has to be known of a cascade that is fitted to all samples; `errors` are those of its numbers."""
    names, plant = found.fit.names, best.plant
    if problem.plant.cascade is None:
        yield "a cascade predicts the held-out samples better than a single loop"
    yield from found.verdict.notes
    if "friction" in names:
        size = plant.coulomb_plus / MICROMETRE
        yield (
            f"friction of {size:.2g} µm of following error was fitted beside the gains and is not written: run ph-post"
            " diagnose to name it"
        )
    early = -base_value(plant, "dead_time")
    if early > EARLY * problem.period:
        yield f"the readings are {early / MS:.2g} ms early against their commands: taken for the recorder's"
    vague = [name for name in names if name not in MAY_BE_NONE and name not in LENGTHS and errors[name] > VAGUE]
    if vague:
        words = " and ".join(NAMES[one].replace("_", " ") for one in vague)
        others = "each other" if len(vague) > 1 else "the other gains"
        yield f"{words} cannot be told from {others} by this log; what they do to the path together is known"
    if found.verdict.fit is None and found.verdict.bound is not None:
        yield f"the log shows no backlash above {found.verdict.bound / MICROMETRE:.2g} µm"
    less = _like_feedforward(plant)
    if less > NOTED:
        weight = base_value(plant, "velocity_feedforward")
        yield (
            f"feed-forward is {100.0 * weight:.3g} % if the command is late by the dead time, and"
            f" {100.0 * (weight - less):.3g} % if the position loop is, as where a drive computes in steps; the path is"
            " the same"
        )
    if "gap" in names and plant.loop.encloses_backlash:
        yield f"the lost motion is given for inertia_fraction = {plant.eta:.4g}"


def _like_feedforward(plant: Plant) -> float:
    """Return the part of a feed-forward that the dead time makes up for if it is all in the position loop.

    A loop that knows its place so much late takes K_v times that of the speed for an error: with so much less
    feed-forward it moves like one whose command is late. A drive that computes in steps is such a loop.
    """
    return _gain_of(plant) * max(base_value(plant, "dead_time"), 0.0)


def _errors(best: DriveFit) -> dict[str, float]:
    """Return standard errors of the numbers as they are fitted.

    They are made of the noise, of what the log hardly shows of a cascade and may be there, of what the command does
    between its samples, of what no log of a drive that computes in steps is better than, and of where its dead time is.
    """
    problem, names = best.problem, best.names
    unseen = {name: error for name, error in UNSEEN.items() if name not in names}
    loose = tangent(problem, best.plant, (*names, *unseen))
    left = weighted_residuals(problem, loose.left, weights_of(problem, loose.left, problem.fit), problem.fit)
    rows = np.eye(len(loose.names))[len(names) :] / np.array(list(unseen.values()))[:, None]
    spread = fit_covariance(problem, loose.left, loose.jacobian, rows, problem.fit)
    both = np.vstack([loose.jacobian, rows])
    moved = np.linalg.lstsq(both, np.concatenate([left, np.zeros(len(unseen))]), rcond=None)[0]
    between = between_samples(best, names)
    if "gap" in names:
        between["gap"] *= best.plant.gap / MICROMETRE
    late = {"velocity_feedforward": _like_feedforward(best.plant) / math.sqrt(3.0)}
    return {
        name: math.hypot(
            math.sqrt(spread[k, k]),
            moved[k],
            between[name],
            late.get(name, 0.0),
            FINEST.get(name, LEAST_UNCERTAINTY),
        )
        for k, name in enumerate(names)
    }


def _estimates(plant: Plant, errors: Mapping[str, float]) -> dict[str, Estimate]:
    """Return the numbers in the units of a machine file; `errors` are as they are fitted, by field."""
    found = {}
    for field, error in errors.items():
        if field == "gap":
            found["lost_motion"] = Estimate(value=plant.gap / MM, stderr=error * MICROMETRE / MM, unit="mm")
            continue
        if field in LENGTHS:
            continue
        name, free = NAMES[field], free_number(field, plant)
        here = _shown(name, plant)
        if here is not None:
            there = _shown(name, free.put(plant, free.read(plant) + SLIGHT))
            slope = 0.0 if there is None else (there - here) / SLIGHT
            unit = CASCADE_NUMBERS[name].unit
            found[name] = Estimate(value=round(here, 6), stderr=abs(slope) * error, unit=unit)
    return found


def _shown(name: str, plant: Plant) -> float | None:
    """Return a number of a cascade in the unit of a machine file; None where there is none."""
    assert plant.cascade is not None
    number = CASCADE_NUMBERS[name]
    value = number.of(plant.cascade)
    return None if value is None else value / number.size


SLIGHT: Final = 1e-4
"""Step of a fitted number by which its unit is found."""


def _axis_with(axis: Axis, plant: Plant, parameters: dict[str, Estimate], gap_known: bool) -> Axis:
    """Return the axis with what was identified, as the machine file will say it."""
    assert plant.cascade is not None
    values = {name: float(f"{one.value:.7g}") for name, one in parameters.items()}
    cascade = with_cascade_values(plant.cascade, {name: values[name] for name in CASCADE_NUMBERS if name in values})
    b = 1.0 / (cascade.velocity_gain * cascade.position_gain)
    gap = axis.gap
    damping = 0.0 if gap.beta is None else (gap.inertia_fraction or 1.0) * b * gap.beta
    if "lost_motion" in values or gap_known:
        gap = gap.with_lost_motion(values.get("lost_motion", 0.0) * MM)
    servo = Servo(b=b, c=damping + 1.0 / cascade.position_gain, stiffness=axis.servo.stiffness, cascade=cascade)
    limits = replace(axis.limits, motor_acceleration=None) if axis.loop.encloses_backlash else axis.limits
    return replace(axis, servo=servo, gap=gap, limits=limits)
