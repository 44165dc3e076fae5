"""The engine against scipy.integrate.solve_ivp with event functions, and an hour of motion."""

import math
import resource
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
from msgspec.structs import replace
from scipy.integrate import solve_ivp
from support.drives import AMPLITUDE, OMEGA, PAPER_GAP
from support.drives import axis as paper_axis
from support.engine_cases import make_command, make_machine

from ph_post.simulate.machine import simulate

PERIOD = 1e-3
MINUTE = 60.0
HOUR = 3600.0
AIM = 200
REPEATS = 3
"""Runs of which the fastest counts."""
SECONDS, BYTES = 10.0, 2**30
WITHIN = 1e-9
"""1e-6 mm of 250 mm."""

B, C, ETA, BETA = 5e-4, 5e-3, 0.35, 1.0
HALF = 0.5 * 0.125664 / 25.0
TINY = 1e-15


def circle(seconds):
    t = PERIOD * np.arange(round(seconds / PERIOD) + 1)
    return AMPLITUDE * np.stack([np.cos(OMEGA * t), np.sin(OMEGA * t)], axis=1)


def event(function, direction):
    function.terminal, function.direction = True, direction
    return function


def engaged(X, slope, start, flank):
    """Rates and events of position and speed of the axis: the gap opens where it reverses."""

    def rate(t, y):
        return [y[1], (X + slope * (t - start) - y[0] - C * y[1]) / B]

    return rate, [event(lambda t, y: flank * y[1] + TINY, -1)]


def opened(X, slope, start, rest):
    """Rates and events of place in the gap and speed of the motor, while the table rests."""

    def rate(t, y):
        return [y[1], (X + slope * (t - start) - rest) / (ETA * B) - BETA * y[1]]

    return rate, [event(lambda t, y, s=s: s * y[0] - HALF - TINY, 1) for s in (1, -1)]


def integrate(X, speed, rtol):
    """One axis of the paper with solve_ivp, restarted at every sample; standstill at pick-up."""
    flank = 1 if speed >= 0.0 else -1
    y, table, rest = [X[0], speed], np.empty(X.size), 0.0
    table[0] = X[0]
    for k in range(X.size - 1):
        start, end = k * PERIOD, (k + 1) * PERIOD
        t, slope = start, (X[k + 1] - X[k]) / PERIOD
        while True:
            rate, events = engaged(X[k], slope, start, flank) if flank else opened(X[k], slope, start, rest)
            run = solve_ivp(
                rate, (t, end), y, method="DOP853", rtol=rtol, atol=1e-13, first_step=end - t, events=events
            )
            t, y = run.t[-1], run.y[:, -1]
            if run.status == 0:
                break
            if flank:
                rest, y, flank = y[0], [flank * HALF, 0.0], 0
            else:
                y, flank = [rest, 0.0], 1 if y[0] > 0.0 else -1
        table[k + 1] = y[0] if flank else rest
    return table


def test_a_minute_of_two_axes_against_solve_ivp():
    position = circle(MINUTE)
    machine = make_machine([paper_axis(gap=PAPER_GAP), _named("Y")], PERIOD)
    command = make_command(position, PERIOD, moving=True)
    simulate(command, machine)
    fast = math.inf
    for _ in range(REPEATS):
        start = time.perf_counter()
        ours = simulate(command, machine)
        fast = min(fast, time.perf_counter() - start)
    start = time.perf_counter()
    # The first axis starts at its turning point, on the flank "+".
    theirs = np.stack([integrate(position[:, 0], 1e-300, 1e-9), integrate(position[:, 1], AMPLITUDE * OMEGA, 1e-9)])
    slow = time.perf_counter() - start
    apart = np.abs(ours.executed.T - theirs).max()
    sys.stdout.write(
        f"\n60 s of two axes at 1 kHz: {fast * 1e3:.1f} ms, with solve_ivp {slow:.1f} s: "
        f"{slow / fast:.0f} times; {apart * 1e3:.1e} mm apart, {len(ours.events)} events\n"
    )
    assert len(ours.events) > 30
    assert apart < WITHIN
    assert slow / fast >= AIM


def _named(name):
    return replace(paper_axis(gap=PAPER_GAP), name=name)


def hour_of_three_axes():
    """Seconds of a warm run, and the peak memory of this process [bytes]."""
    t = PERIOD * np.arange(round(HOUR / PERIOD))
    position = AMPLITUDE * np.stack([np.cos(OMEGA * t), np.sin(OMEGA * t), 0.1 * np.sin(3.0 * t)], axis=1)
    machine = make_machine([_named(name) for name in "XYZ"], PERIOD)
    command = make_command(position, PERIOD)
    simulate(make_command(position[:100], PERIOD), machine)
    start = time.perf_counter()
    run = simulate(command, machine)
    seconds = time.perf_counter() - start
    return seconds, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024, len(run.events)


def test_an_hour_of_three_axes():
    """In a process of its own, so that the peak is that of this motion (its command included)."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        seconds, peak, events = pool.submit(hour_of_three_axes).result()
    sys.stdout.write(
        f"\nan hour of three axes at 1 kHz: {seconds:.2f} s, peak {peak / 2**20:.0f} MiB, {events} events\n"
    )
    assert seconds <= SECONDS
    assert peak <= BYTES
