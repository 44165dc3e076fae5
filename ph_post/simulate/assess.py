"""Contour error of a command on every machine that a machine file leaves possible."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import combinations
from typing import Any, Final, TypeVar

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.bounds import in_parts, threads
from ph_post.drive.effects.active import plant_of
from ph_post.simulate.contour import (
    ContourError,
    Nearest,
    Nominal,
    TurningError,
    contour_error,
    first_counted,
    turning_errors,
)
from ph_post.simulate.machine import Runs, axis_command, first_flank, simulate
from ph_post.types import Array, Axis, BoolArray, Command, IntArray, Machine, Pickup, Run, Scenario, TurningPoint

T = TypeVar("T")

KEPT: Final = 4
"""Runs with which others are compared: backlash as stated, larger and smaller, each of which may be on two sides."""

RUNS_ON: Final = (0.8, 2.0)
"""Times the friction of the file by which tables are slowed down that run on: it may be less, and without its motor a
table is lighter."""

PICKUPS: Final[tuple[Pickup, ...]] = ("standstill", "momentum", "contact")
"""Every pick-up rule; all are tried where the file names none."""


class Assessment(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The errors of a command on a machine, and on the others that its file leaves possible.

    `errors` holds one entry a scenario; None, there as elsewhere, where the motion is over before it counts.
    `error` is the largest at the file's values: the worse initial flank, and where the file leaves the
    pick-up rule open the worst of them. `error_worst` is the largest of all, in the scenario `worst`. Of
    several runs the one with the largest maximum counts, with its own root mean square.

    `run`, `nearest` and `turning` are those of `error`; `first` is the first row that counts. `error_gap` and
    `turning_gap` are what the gap adds to the same run without one. In space, where an error has no side, all
    errors are positive.
    """

    scenarios: tuple[Scenario, ...]
    errors: tuple[ContourError | None, ...]
    error: ContourError | None
    error_worst: ContourError | None
    error_gap: ContourError | None
    worst: Scenario
    run: Run
    nearest: Nearest
    first: int
    turning: tuple[TurningError | None, ...]
    turning_gap: tuple[TurningError | None, ...]


def assess(
    command: Command,
    machine: Machine,
    nominal: Nominal,
    turning_points: Sequence[TurningPoint] = (),
    tried: Sequence[Scenario] = (),
) -> Assessment:
    """Simulate a command in every scenario, and measure how far the table is from the path.

    Parameters
    ----------
    command : Command
    machine : Machine
    nominal : Nominal
        The path.
    turning_points : sequence of TurningPoint, optional
        Around which the error is summed up.
    tried : sequence of Scenario, optional
        In place of those of :func:`scenarios`.

    Returns
    -------
    Assessment
    """
    tried = tuple(tried) or scenarios(machine, command.axes, resting_axes(command))
    first = first_counted(command, machine)
    errors = contour_errors(command, machine, nominal, tried)
    decides, worst = decisive(errors, tried)
    run, nearest = _measured(command, machine, nominal, tried[decides])
    without = _measured(command, machine, nominal, tried[decides].without_backlash)
    added = _added(nominal, (run, nearest), without)[first:]
    signed, s = nearest.error[first:], command.s[first:]
    loop = nominal.length if nominal.closed and command.feed[0] != 0.0 else None
    return Assessment(
        scenarios=tried,
        errors=errors,
        error=errors[decides],
        error_worst=errors[worst],
        worst=tried[worst],
        error_gap=contour_error(added),
        run=run,
        nearest=nearest,
        first=first,
        turning=turning_errors(signed, s, turning_points, loop),
        turning_gap=turning_errors(added, s, turning_points, loop),
    )


def contour_errors(
    command: Command, machine: Machine, nominal: Nominal, tried: Iterable[Scenario]
) -> tuple[ContourError | None, ...]:
    """Contour error in each scenario, side by side; no run is kept."""
    return for_each_scenario(command, machine, nominal, tried, contour_error)


def for_each_scenario(
    command: Command,
    machine: Machine,
    nominal: Nominal,
    tried: Iterable[Scenario],
    take: Callable[[Array], T],
) -> tuple[T, ...]:
    """Take something from the errors (n,) [m] of the rows that count in each scenario, side by side.

    Few runs and errors are kept, however many scenarios there are: those that others may be alike.
    """
    first, runs = first_counted(command, machine), Runs(command, machine)
    alike = AlikeRows(lambda table, rows: nominal.nearest(table, command.s[rows]).error)

    def measure(scenario: Scenario) -> T:
        errors = alike.errors(runs.tables(scenario))[first:]
        return take(np.abs(errors) if nominal.dimension > 2 else errors)

    return run_scenarios(measure, tried)


def run_scenarios(measure: Callable[[Scenario], T], tried: Iterable[Scenario]) -> tuple[T, ...]:
    """Measure every scenario, side by side, in the order of `tried`."""
    # The first alone, so that the engine is compiled once, and that is printed once.
    first_of_all, *others = tried
    with ThreadPoolExecutor(max_workers=threads()) as pool:
        return (measure(first_of_all), *pool.map(measure, others))


class AlikeRows:
    """Errors of several runs of one command; what is alike in some of them is measured once.

    Machines that differ in the sides on which their axes stand at first are alike from the first reversals on.

    Parameters
    ----------
    measure : callable
        Errors (m,) [m] of places of the table (m, axes) [m] in rows (m,) of the command.
    """

    def __init__(self, measure: Callable[[Array, IntArray], Array]) -> None:
        self._measure = measure
        self._known: list[tuple[Sequence[Array], Array]] = []

    def errors(self, table: Sequence[Array]) -> Array:
        """Errors (n,) [m] of the places of the table in every row, a column (n,) an axis [m]."""
        count, rows, found = table[0].size, None, np.zeros(0)
        for known, errors in self._known:
            others = np.flatnonzero(_unlike(table, known))
            if others.size < (count if rows is None else rows.size):
                rows, found = others, errors
        found = np.empty(count) if rows is None else found.copy()
        unlike = count if rows is None else rows.size
        for part in in_parts(unlike):
            own = np.arange(part.start, min(part.stop, count)) if rows is None else rows[part]
            found[own] = self._measure(np.stack([column[own] for column in table], axis=1), own)
        if 2 * unlike > found.size:
            self._known = [*self._known, (table, found)][-KEPT:]
        return found

    def forget(self) -> None:
        """Let go of the tables with which others are compared."""
        self._known = []


def _unlike(table: Sequence[Array], other: Sequence[Array]) -> BoolArray:
    """Mask of the rows (n,) in which two tables differ; a column that both have takes no time."""
    unlike = np.zeros(table[0].size, dtype=np.bool_)
    for one, two in zip(table, other, strict=True):
        if one is not two:
            unlike |= one != two
    return unlike


def gap_error(
    command: Command, machine: Machine, nominal: Nominal, tried: Sequence[Scenario], plain: Command
) -> ContourError | None:
    """Return the largest contour error in some scenarios that backlash causes.

    It is what the motion has more than the same motion on the machine without backlash, where nothing need be
    added to the path to cross it.

    Parameters
    ----------
    command, machine, nominal
        As of :func:`assess`.
    tried : sequence of Scenario
        See :func:`backlash_scenarios`.
    plain : Command
        The same rows without what `command` adds to the path to cross backlash.
    """
    first = first_counted(command, machine)
    gapless = tuple(dict.fromkeys(one.without_backlash for one in tried))
    runs = run_scenarios(lambda one: _measured(plain, machine, nominal, one), gapless)
    without = dict(zip(gapless, runs, strict=True))

    def added(scenario: Scenario) -> ContourError | None:
        run = _measured(command, machine, nominal, scenario)
        return contour_error(_added(nominal, run, without[scenario.without_backlash])[first:])

    errors = run_scenarios(added, tried)
    return errors[_largest(errors, range(len(errors)))]


def backlash_scenarios(tried: Iterable[Scenario]) -> tuple[Scenario, ...]:
    """Leave out the scenarios that differ from the machine file in more than their backlash."""
    return tuple(one for one in tried if one.beta == one.gain == one.friction == 1.0 and one.runs_on is None)


def resting_axes(command: Command) -> tuple[str, ...]:
    """Name the axes that rest at the first row, where only the file says the flank."""
    return tuple(
        name
        for number, name in enumerate(command.axes)
        if name not in command.flanks and axis_command(command, number).speed == 0.0
    )


def scenarios(machine: Machine, axes: Sequence[str], resting: Collection[str] | None = None) -> tuple[Scenario, ...]:
    """List the machines that a file leaves possible, those at the file's values first.

    Tried are every combination of initial flanks of the axes that rest at the beginning and do not say their own,
    and every pick-up rule where an axis with a scale on the table names none; with each of these the gap larger
    and smaller by its uncertainty; with each rule β, C and friction, likewise, on the first flanks alone, as they
    change the way through the gap and not where it is entered. All axes have the same rule and factors; the gap of
    each is off by its own uncertainty, of β, C and friction the largest counts. What makes no difference to any axis is
    left out: of two axes at most 48 are left, 16 where the rule is known, 12 where no axis has a scale on the table; of
    three 84, 28 and 24. Where an axis has friction it is 6 more, 2 where the rule is known; 2 more where a table that
    its motor does not hold may run on in its backlash, as the motor brakes harder than friction.

    Parameters
    ----------
    machine : Machine
    axes : sequence of str
        Those that the command moves.
    resting : collection of str, optional
        Those that rest at the beginning; all by default.

    Returns
    -------
    tuple of Scenario

    Examples
    --------
    >>> from ph_post.drive.machinefile import read_machine
    >>> [len(scenarios(read_machine(name), ("X", "Y"))) for name in ("mill", "paper", "router")]
    [48, 16, 12]
    """
    drives = [machine.axes[name] for name in axes]
    resting = axes if resting is None else resting
    unknown = [axis.name for axis in drives if axis.gap.initial_flank == "unknown" and axis.name in resting]
    open_rule = any(axis.loop.encloses_backlash and axis.gap.pickup is None for axis in drives)
    sides = _initial_sides(unknown)
    rules: tuple[Any, ...] = PICKUPS if open_rule else (None,)
    nominal = [replace(one, pickup=rule) for rule in rules for one in sides]
    found = list(nominal)
    for sign in (1.0, -1.0):
        found += [replace(one, spread=sign) for one in nominal]
    for name in ("beta", "gain", "friction"):
        spread = max(getattr(axis.uncertainty, name) for axis in drives)
        for factor in (1.0 + spread, max(1.0 - spread, 0.0)):
            found += [replace(one, **{name: factor}) for one in nominal[:: len(sides)]]
    found += [replace(nominal[0], runs_on=factor) for factor in RUNS_ON]
    return _distinct(found, drives, resting)


def _initial_sides(unknown: Sequence[str]) -> list[Scenario]:
    """Every combination of flanks of the axes whose own is not known; those that are all alike come first."""
    if not unknown:
        return [Scenario()]
    others = [found for size in range(len(unknown)) for found in combinations(unknown[1:], size)]
    return [Scenario(flank=flank, opposite=found) for found in others for flank in ("+", "-")]


def _distinct(found: Iterable[Scenario], drives: Sequence[Axis], resting: Collection[str]) -> tuple[Scenario, ...]:
    kept: list[Scenario] = []
    seen: list[object] = []
    for scenario in found:
        looks = [_looks(axis, scenario, axis.name in resting) for axis in drives]
        if looks not in seen:
            seen.append(looks)
            kept.append(scenario)
    return tuple(kept)


def _looks(axis: Axis, scenario: Scenario, rests: bool) -> object:
    """All that a scenario changes about an axis."""
    plant = plant_of(axis, scenario)
    if not axis.loop.encloses_backlash:
        plant = replace(plant, eta=0.5, beta=0.0, pickup="standstill")
    return plant, first_flank(axis, scenario) if rests and (plant.gap or plant.widening) else 0


def is_nominal(scenario: Scenario) -> bool:
    """Return whether a scenario has the values of the machine file."""
    exact = scenario.spread == 0.0 and scenario.gap == scenario.beta == scenario.gain == scenario.friction == 1.0
    return exact and scenario.runs_on is None


def decisive(errors: Sequence[ContourError | None], tried: Sequence[Scenario]) -> tuple[int, int]:
    """Return the indices of the scenarios with the largest error: of those at the file's values, and of all."""
    nominal = [k for k, one in enumerate(tried) if is_nominal(one)] or range(1)
    return _largest(errors, nominal), _largest(errors, range(len(tried)))


def _largest(errors: Sequence[ContourError | None], among: Iterable[int]) -> int:
    """Index of the error with the largest maximum, the first of equals."""

    def size(number: int) -> float:
        error = errors[number]
        return -1.0 if error is None else error.max

    return max(among, key=size)


def _measured(command: Command, machine: Machine, nominal: Nominal, scenario: Scenario) -> tuple[Run, Nearest]:
    run = simulate(command, machine, scenario)
    nearest = nominal.nearest(run.executed, command.s)
    if nominal.dimension > 2:
        nearest = replace(nearest, error=np.abs(nearest.error))
    return run, nearest


def _added(nominal: Nominal, run: tuple[Run, Nearest], without: tuple[Run, Nearest]) -> Array:
    """Contour error (n,) that a run has more than another [m]; in space the length of their difference."""
    if nominal.dimension == 2:
        return np.asarray(run[1].error - without[1].error)
    here, there = (one.executed - nominal.places(nearest.s) for one, nearest in (run, without))
    return np.asarray(np.linalg.norm(here - there, axis=1))


def scenario_words(scenario: Scenario) -> str:
    """Describe the assumptions of a scenario.

    Examples
    --------
    >>> scenario_words(Scenario(pickup="contact", gap=1.2))
    'pick-up contact, backlash × 1.2'
    >>> scenario_words(Scenario(flank="+", opposite=("Y",)))
    'starts on the + side, Y on the - side'
    """
    words = [f"pick-up {scenario.pickup}"] if scenario.pickup else []
    if scenario.flank:
        other = "-" if scenario.flank == "+" else "+"
        words.append(f"starts on the {scenario.flank} side")
        words += [f"{', '.join(scenario.opposite)} on the {other} side"] if scenario.opposite else []
    factors = (
        ("backlash", scenario.gap),
        ("beta", scenario.beta),
        ("gain", scenario.gain),
        ("friction", scenario.friction),
    )
    words += [f"{name} × {factor:g}" for name, factor in factors if factor != 1.0]
    if scenario.spread:
        words.append(f"backlash {'larger' if scenario.spread > 0.0 else 'smaller'} by its uncertainty")
    words += ["the table runs on in its backlash"] if scenario.runs_on is not None else []
    return ", ".join(words) or "the values of the machine file"
