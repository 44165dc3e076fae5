"""Axes stepped finely in compiled code: those in a cascade to the end, others from event to event.

Forces are metres of following error as everywhere here: the motor of a cascade gives
(ω_v (n + ∫n / T_n) + a_f Ẍ) / (ω_v K_v) with n = K_v (X - x) + k_f Ẋ - w, as in Groß, Hamann, Wiegärtner, Elektrische
Vorschubantriebe (Publicis 2006), divided by the inertia. Its steps are of the second order and end where the axis
sticks, slips, or meets a flank of its gap. Without a cascade they are Runge and Kutta's of the fourth order, and one
in which something of that happens is halved until it ends there.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numba
import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import lfilter

from tests.support.cascade_plant import Drive
from tests.support.plants.axis import Forces, Hidden, Plant
from tests.support.plants.stepping import Floats
from tests.support.plants.tracks import Track

STEP = 1e-4
"""[s]."""

FINE = STEP / 2.0
"""What the command is computed at [s]; in between it is taken as straight."""


def arrives(forces: Forces, end: float) -> tuple[Floats, Floats, Floats]:
    """The command as it reaches the loops, its speed and its acceleration, a row each FINE."""
    rows = _given(forces.track, forces.axis, forces.late, end)
    of = forces.plant.effect("command_filter")
    if of is not None:
        rows = [_averaged(_smoothed(row, of.get("exponential_filter")), of.get("moving_average")) for row in rows]
    return rows[0], rows[1], rows[2]


@lru_cache(maxsize=4)
def _given(track: Track, axis: int, late: float, end: float) -> list[Floats]:
    """The same before any filter; plants that differ in other things alone have it in common."""
    return list(track.rows(axis, np.arange(math.ceil(end / FINE) + 3) * FINE - late))


def _averaged(row: Floats, length: float) -> Floats:
    """A moving average over so many seconds; before the first row all was as it is there."""
    if not length:
        return row
    t = np.arange(len(row)) * FINE
    whole = cumulative_trapezoid(row - row[0], dx=FINE, initial=0.0)
    return np.asarray(row[0] + (whole - np.interp(t - length, t, whole)) / length)


def _smoothed(row: Floats, time: float) -> Floats:
    """A filter of the first order of what is straight between rows, all but exactly."""
    if not time:
        return row
    kept = math.exp(-FINE / time)
    middle = np.concatenate([row[:1], 0.5 * (row[1:] + row[:-1])]) - row[0]
    return np.asarray(row[0] + lfilter([1.0 - kept], [1.0, -kept], middle))


REST, SLIP, CROSS = 0, 1, 2
"""The modes that an axis is in."""

EVENTS = ("open", "stick", "pickup", "back")
OPEN, STICK, PICKUP, BACK = range(4)


class Axis(NamedTuple):
    """The numbers of an axis, for what is compiled; rows of what the command alone makes, one each FINE."""

    kv: float
    tn: float
    current: float
    own: float
    b: float
    eta: float
    beta: float
    kept: float
    motor_speed: bool
    inside: bool
    gap: float
    slope: float
    reference: float
    bump: float
    centre: float
    width: float
    coulomb: float
    breakaway: float
    fade: float
    plus: float
    minus: float
    cubic: float
    square: float
    limit: float
    share: float
    over: float
    teeth: Floats
    wanted: Floats
    """What the loops make of the command: K_v X + k_f Ẋ [m/s]."""
    fed: Floats
    """The force that is fed forward."""
    loads: Floats
    """Forces on the table that depend on time alone."""


class _State(NamedTuple):
    """Place and speed of what moves, what the velocity loop has summed, and the force that the motor gives."""

    place: float
    speed: float
    total: float
    given: float


class Mode(NamedTuple):
    """What an axis does: its mode, the flank it is on, the way it slips, its table, and where the motor left."""

    kind: int
    side: int
    way: int
    x: float
    left: float


class CascadeBody:
    """An axis in a cascade from rest to the end of a grid; rows are its place, its speed, the motor, the force."""

    def __init__(self, plant: Plant, forces: Forces, grid: Floats) -> None:
        assert plant.drive is not None
        self.plant, self.forces, self.grid = plant, forces, grid
        self.rows = np.empty((len(grid), 4))
        self.events: list[tuple[float, str]] = []
        self.axis = numbers(plant, forces, float(grid[-1]))

    def run(self) -> None:
        """Fill the rows."""
        axis, load, held = self.axis, self.forces.rigid(0.0, 0.0, 0.0), self.forces.held
        integrates = axis.tn < math.inf
        x = 0.0 if integrates else -math.copysign(max(abs(load) - held, 0.0), load)
        side = int(math.copysign(1, load)) if axis.inside and load else self.plant.flank
        y = _State(x, 0.0, load * axis.kv * axis.tn if integrates else 0.0, load)
        mode = Mode(REST if held > 0.0 or axis.inside else SLIP, side, 0, x, 0.0)
        each = round(float(self.grid[1] - self.grid[0]) / STEP)
        events = _run(axis, y, mode, each, self.rows)
        self.events = [(t, EVENTS[kind]) for t, kind in events]


def numbers(plant: Plant, forces: Forces, end: float) -> Axis:
    """The numbers of an axis to the end of a record; without a cascade what is wanted is a place."""
    place, speed, bend = arrives(forces, end)
    varied = plant.effect("position_dependent_backlash") or Hidden("none")
    share, over = forces.heavier or (0.0, 1.0)
    drive = plant.drive or Drive(kv=1.0, current=0.0)
    return Axis(
        kv=drive.kv,
        tn=drive.tn,
        current=drive.current,
        own=plant.c - (1.0 / drive.kv if plant.drive else 0.0),
        b=plant.b,
        eta=plant.eta,
        beta=plant.beta,
        kept=plant.kept,
        motor_speed=plant.fast_side == "motor",
        inside=plant.feedback == "load" and (plant.gap > 0.0 or varied.name != "none"),
        gap=plant.gap,
        slope=varied.get("slope"),
        reference=varied.get("reference"),
        bump=varied.get("bump"),
        centre=varied.get("centre"),
        width=varied.get("width", 1.0),
        coulomb=forces.coulomb,
        breakaway=forces.breakaway,
        fade=forces.fade,
        plus=forces.drag[0],
        minus=forces.drag[1],
        cubic=forces.cubic,
        square=forces.square,
        limit=forces.limit,
        share=share,
        over=over,
        teeth=np.array(forces.teeth).reshape(-1, 3),
        wanted=drive.kv * place + drive.velocity * speed,
        fed=drive.acceleration * plant.b * bend,
        loads=forces.loads(np.arange(len(place)) * FINE),
    )


@numba.njit(cache=True)
def _run(axis, y, mode, each, rows):  # type: ignore[no-untyped-def]
    """Fill rows, so many steps apart; return the events."""
    events = [(0.0, -1)]  # whose types the list takes
    for row in range(len(rows)):
        if row:
            for k in range((row - 1) * each, row * each):
                y, mode = _advance(axis, k * STEP, STEP, y, mode, events)
        t = row * each * STEP
        crosses = mode.kind == CROSS
        x, v = (mode.x, 0.0) if crosses else (y.place, y.speed)
        rows[row, 0], rows[row, 1], rows[row, 3] = x, v, y.given
        rows[row, 2] = y.place if crosses else _touching(axis, mode, x)
        if not axis.current:
            rows[row, 3] = _asked(axis, t, x, y.speed if axis.motor_speed else v, y.total)[1]
    return events[1:]


@numba.njit
def _advance(axis, t, h, y, mode, events):  # type: ignore[no-untyped-def]
    for _ in range(8):
        if mode.kind == REST:
            y, mode = _leaves(axis, t, y, mode, events)
        after = _stepped(axis, t, h, y, mode)
        left = _ends(axis, y, after, mode)
        if left == 1.0 and mode.kind == SLIP:
            # It pushed hard enough for an instant only: it rests, and its integrator and its current go on.
            mode = Mode(REST, mode.side, 0, mode.x, mode.left)
            after, left = _stepped(axis, t, h, y, mode), -1.0
        if left < 0.0:
            y = after
            break
        done = h * (1.0 - left)
        y = _stepped(axis, t, done, y, mode)
        t, h = t + done, h - done
        y, mode = _changes(axis, t, y, mode, events)
    x = mode.x if mode.kind == CROSS else y.place
    return y, Mode(mode.kind, mode.side, mode.way, x, mode.left)


@numba.njit
def _leaves(axis, t, y, mode, events):  # type: ignore[no-untyped-def]
    """End a rest where it ends: `push` is the motor's, `net` what of it is left on the table."""
    side, x, held = mode.side, mode.x, axis.coulomb + axis.breakaway
    push = (y.given if axis.current else _asked(axis, t, x, 0.0, y.total)[1]) - _cogged(axis, _touching(axis, mode, x))
    net = push - _rigid(axis, t, x, 0.0)
    if axis.inside and side * push < 0.0:
        events.append((t, OPEN))
        left = x + 0.5 * side * _width(axis, x)
        return _State(left, 0.0, y.total, y.given), Mode(CROSS, side, mode.way, x, left)
    if (side * net if axis.inside else abs(net)) > held:
        way = side if axis.inside else (1 if net > 0.0 else -1)
        return y, Mode(SLIP, side, way, x, mode.left)
    return y, mode


@numba.njit
def _ends(axis, y, after, mode):  # type: ignore[no-untyped-def]
    """Which part of a step is left to do when the mode ends in it; -1: it does not."""
    if mode.kind == SLIP and mode.way and mode.way * after.speed < 0.0:
        return after.speed / (after.speed - y.speed)
    if mode.kind == CROSS:
        way = mode.side * (after.place - mode.left)
        over = max(-way - _width(axis, mode.x), way)
        if over > 0.0:
            return min(over / max(abs(after.place - y.place), 1e-18), 1.0)
    return -1.0


@numba.njit
def _changes(axis, t, y, mode, events):  # type: ignore[no-untyped-def]
    """Go over to the mode that follows."""
    if mode.kind == SLIP:
        events.append((t, STICK))
        return _State(y.place, 0.0, y.total, y.given), Mode(REST, mode.side, 0, y.place, mode.left)
    across = -mode.side * (y.place - mode.left) > 0.5 * _width(axis, mode.x)
    side = -mode.side if across else mode.side
    events.append((t, PICKUP if across else BACK))
    speed = axis.kept * axis.eta * y.speed
    slips = speed * side > 1e-9
    after = _State(mode.x, speed if slips else 0.0, y.total, y.given)
    return after, Mode(SLIP if slips else REST, side, side if slips else 0, mode.x, mode.left)


@numba.njit
def _stepped(axis, t, h, y, mode):  # type: ignore[no-untyped-def]
    """Make a step by the midpoint rule."""
    middle = _moved(y, _slopes(axis, t, y, mode), 0.5 * h)
    return _moved(y, _slopes(axis, t + 0.5 * h, middle, mode), h)


@numba.njit
def _moved(y, by, h):  # type: ignore[no-untyped-def]
    return _State(y.place + h * by.place, y.speed + h * by.speed, y.total + h * by.total, y.given + h * by.given)


@numba.njit
def _slopes(axis, t, y, mode):  # type: ignore[no-untyped-def]
    """Return what the state changes by in a second, in the mode that it is in."""
    speed, bend = y.speed, 0.0
    x, table = (mode.x, 0.0) if mode.kind == CROSS else (y.place, speed)
    off, asked = _asked(axis, t, x, speed if axis.motor_speed else table, y.total)
    force = y.given if axis.current else asked
    if mode.kind == SLIP:
        force -= axis.own * speed + _cogged(axis, _touching(axis, mode, x))
        force -= _rigid(axis, t, x, speed)
        if mode.way:
            force -= mode.way * _dry(axis, abs(speed))
        bend = force / (axis.b * (1.0 + axis.share * min(max(t / axis.over, 0.0), 1.0)))
    elif mode.kind == CROSS:
        bend = (force - _cogged(axis, y.place)) / (axis.eta * axis.b) - axis.beta * speed
    return _State(speed, bend, off, (asked - y.given) / axis.current if axis.current else 0.0)


@numba.njit
def _asked(axis, t, place, speed, total):  # type: ignore[no-untyped-def]
    """Return what the velocity loop is off by [m/s], and the force that it asks for."""
    off = _between(axis.wanted, t) - axis.kv * place - speed
    asked = (off + total / axis.tn) / axis.kv + _between(axis.fed, t)
    return off, min(max(asked, -axis.limit), axis.limit)


@numba.njit
def _between(rows, t):  # type: ignore[no-untyped-def]
    row = t / FINE
    i = int(row)
    return rows[i] + (row - i) * (rows[i + 1] - rows[i])


@numba.njit
def _touching(axis, mode, x):  # type: ignore[no-untyped-def]
    return x + 0.5 * mode.side * _width(axis, x) if axis.inside else x


@numba.njit
def _width(axis, x):  # type: ignore[no-untyped-def]
    off = (x - axis.centre) / axis.width
    return max(axis.gap + axis.slope * (x - axis.reference) + axis.bump * math.exp(-0.5 * off * off), 0.0)


@numba.njit
def _cogged(axis, x):  # type: ignore[no-untyped-def]
    total = 0.0
    for force, rate, phase in axis.teeth:
        total += force * math.sin(rate * x + phase)
    return total


@numba.njit
def _rigid(axis, t, x, v):  # type: ignore[no-untyped-def]
    drag = (axis.plus if v > 0.0 else axis.minus) * v
    return drag + _between(axis.loads, t) + axis.cubic * x * x * x + axis.square * v * abs(v)


@numba.njit
def _dry(axis, speed):  # type: ignore[no-untyped-def]
    ratio = speed / axis.fade
    return axis.coulomb + axis.breakaway * math.exp(-ratio * ratio)


# Without a cascade, from event to event.

SHORTEST = 1e-6
"""[s] The first step behind an event: a longer one could leave and return, and call that the same event."""

HALVINGS = 50
"""Of a step in which an event is: a step of 0.1 ms comes to less than 1e-18 s."""


@numba.njit(cache=True)
def run_leg(axis, mode, t, y, grid, rows):  # type: ignore[no-untyped-def]
    """Fill rows (n, 2) at the times of a grid (n,) to its end or an event; how many, and time, state and event (or -1).

    `y` is the place and the speed of what moves; the place of a motor in its gap is its way from the flank it left.
    """
    longest = SHORTEST if mode.way or mode.kind == CROSS else STEP
    for row in range(len(grid)):
        while t < grid[row]:
            until = min((math.floor(t / STEP + 1e-6) + 1.0) * STEP, t + longest)
            if until > grid[row] - 1e-12:
                until = grid[row]
            after = _leg_step(axis, mode, t, y, until - t)
            if _leg_event(axis, mode, after) >= 0:
                low, high = 0.0, until - t
                for _ in range(HALVINGS):
                    middle = 0.5 * (low + high)
                    if _leg_event(axis, mode, _leg_step(axis, mode, t, y, middle)) >= 0:
                        high = middle
                    else:
                        low = middle
                y = _leg_step(axis, mode, t, y, high)
                return row, t + high, y, _leg_event(axis, mode, y)
            t, y, longest = until, after, STEP
        rows[row, 0], rows[row, 1] = y
    return len(grid), t, y, -1


@numba.njit
def _leg_event(axis, mode, y):  # type: ignore[no-untyped-def]
    """Return 0 where a slip stops or a motor meets the other flank, 1 where it is back at its own; -1: neither."""
    if mode.kind == SLIP:
        return 0 if mode.way and mode.way * y[1] <= 0.0 else -1
    if -mode.side * y[0] >= _width(axis, mode.x):
        return 0
    return 1 if mode.side * y[0] >= 0.0 else -1


@numba.njit
def _leg_step(axis, mode, t, y, h):  # type: ignore[no-untyped-def]
    """Make one step of Runge and Kutta."""
    half, (x, v) = 0.5 * h, y
    first = _bend(axis, mode, t, x, v)
    second = _bend(axis, mode, t + half, x + half * v, v + half * first)
    third = _bend(axis, mode, t + half, x + half * (v + half * first), v + half * second)
    fourth = _bend(axis, mode, t + h, x + h * (v + half * second), v + h * third)
    return x + h * (v + h / 6.0 * (first + second + third)), v + h / 6.0 * (first + 2.0 * (second + third) + fourth)


@numba.njit
def _bend(axis, mode, t, place, speed):  # type: ignore[no-untyped-def]
    """Return the acceleration: b ẍ + c ẋ = X - x less the other forces, or of the motor alone η b (m̈ + β ṁ) = X - x."""
    if mode.kind == CROSS:
        push = _limited(axis, _between(axis.wanted, t) - mode.x) - _cogged(axis, mode.left + place)
        return push / (axis.eta * axis.b) - axis.beta * speed
    force = _limited(axis, _between(axis.wanted, t) - place) - axis.own * speed - _rigid(axis, t, place, speed)
    force -= _cogged(axis, _touching(axis, mode, place)) + mode.way * _dry(axis, abs(speed))
    return force / (axis.b * (1.0 + axis.share * min(max(t / axis.over, 0.0), 1.0)))


@numba.njit
def _limited(axis, push):  # type: ignore[no-untyped-def]
    return min(max(push, -axis.limit), axis.limit)
