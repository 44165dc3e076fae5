"""Cascades against a plant with equations of its own, in m/s² and 1/s, stepped finely."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from msgspec.structs import replace as changed
from scipy.signal import fftconvolve
from support.cascade_plant import DRIVES, FINE, PERIOD, motor_of, play, to_and_fro, two_bodies

from ph_post.drive.plant import Plant
from ph_post.simulate.machine import AxisCommand, run_plant
from ph_post.types import Array, Pickup


@pytest.mark.parametrize("name", DRIVES)
def test_motor_and_table_behind_it(name: str) -> None:
    drive, command, gap = DRIVES[name], to_and_fro(), 3e-5
    table, motor, _ = run_plant(AxisCommand(command, 0.0, 0.0), drive.plant(gap=gap), 1, PERIOD)
    fine = 3 * FINE if name == "limited" else FINE
    assert np.abs(motor - motor_of(drive, command, fine=fine)).max() < 1e-6
    assert np.abs(table - play(motor, gap)).max() < 5e-7
    assert name == "100 %" or np.abs(motor - command).max() > 1e-5


def test_it_is_not_the_steps_of_the_reference() -> None:
    """Ten times finer, the reference is ten times nearer."""
    drive, command = DRIVES["95 %"], to_and_fro()[:200]
    motor = run_plant(AxisCommand(command, 0.0, 0.0), drive.plant(), 1, PERIOD)[1]
    far, near = (np.abs(motor - motor_of(drive, command, fine=fine)).max() for fine in (FINE // 4, 4 * FINE))
    assert near < 0.07 * far


def test_friction_of_the_motor() -> None:
    drive, command, coulomb = DRIVES["95 %"], to_and_fro(), 0.3
    held = coulomb / (drive.kv * drive.wv)
    plant = drive.plant(coulomb_plus=held, coulomb_minus=held)
    motor = run_plant(AxisCommand(command, 0.0, 0.0), plant, 1, PERIOD)[1]
    assert np.abs(motor - motor_of(drive, command, coulomb)).max() < 1e-6
    assert np.abs(motor - motor_of(drive, command)).max() > 1e-5


@pytest.mark.parametrize("rule", ["standstill", "contact"])
@pytest.mark.parametrize("side", ["motor", "load"])
@pytest.mark.parametrize("name", ["P, P", "95 %"])
def test_table_in_the_loop(name: str, side: str, rule: Pickup) -> None:
    """With its speed from the motor, a dual loop, or from the table."""
    drive, command, gap, eta, beta = DRIVES[name], to_and_fro(), 2e-5, 0.4, 3.0
    damping = 1.5
    plant = drive.plant("load", side, gap=gap, eta=eta, beta=beta, pickup=rule, damping=damping / (drive.kv * drive.wv))
    table = run_plant(AxisCommand(command, 0.0, 0.0), plant, 1, PERIOD)[0]
    off = np.abs(table - two_bodies(drive, command, gap, eta, beta, damping, rule, side)).max()
    assert off < 1e-6
    without = run_plant(AxisCommand(command, 0.0, 0.0), drive.plant("load", side, damping=plant.c), 1, PERIOD)[0]
    assert np.abs(table - without).max() > 10.0 * off


def test_the_loop_of_the_paper_is_one() -> None:
    """P around P without feed-forward, its speed from the motor: Eq. (9), with a motor that brakes itself."""
    drive, command = DRIVES["P, P"], to_and_fro()
    b, tau = 1.0 / (drive.kv * drive.wv), 1.0 / drive.kv
    for feedback in ("motor", "load"):
        cascade = drive.plant(feedback, gap=2e-5, eta=0.4)
        single = Plant(feedback=feedback, b=b, c=tau, gap=2e-5, eta=0.4, beta=tau / (0.4 * b))
        found = [run_plant(AxisCommand(command, 0.0, 0.0), plant, 1, PERIOD)[0] for plant in (cascade, single)]
        np.testing.assert_allclose(found[0], found[1], atol=1e-12)


def test_filters_of_the_command() -> None:
    """Against sums over the command on a grid 100 times as fine."""
    command, drive = to_and_fro()[:300], DRIVES["100 %"]
    rows = command.size
    fine = np.interp(np.arange(-30 * FINE, (rows - 1) * FINE + 1) / FINE, np.arange(rows), command)
    t = np.arange(0, 30 * FINE) / FINE * PERIOD
    late, average, lag, omega, damping = 1.3e-3, 7.5e-3, 2e-3, 2.0 * math.pi * 30.0, 0.1
    lower = omega * math.sqrt(1.0 - damping**2)
    overshoot = math.exp(-damping * omega * math.pi / lower)

    def passed(weights: Array) -> Array:
        return fftconvolve(fine, weights)[30 * FINE : 30 * FINE + (rows - 1) * FINE + 1 : FINE]

    flat = np.where(t <= average, 1.0, 0.0)
    flat[[0, int(average / PERIOD * FINE)]] = 0.5
    falling = np.exp(-t / lag)
    falling[0] = 0.5
    shaped = np.zeros(t.size)
    half = math.pi / lower / PERIOD * FINE
    shaped[0], shaped[int(half)] = 1.0, overshoot * (1.0 - half % 1.0)
    shaped[int(half) + 1] = overshoot * (half % 1.0)
    cases = {
        "dead_time": np.eye(1, t.size, 130)[0],
        "moving_average": flat / flat.sum(),
        "exponential": falling / falling.sum(),
        "shaper_frequency": shaped / shaped.sum(),
    }
    values = {"dead_time": late, "moving_average": average, "exponential": lag, "shaper_frequency": omega}
    for key, weights in cases.items():
        more = {key: values[key]} | ({"shaper_damping": damping} if key.startswith("shaper") else {})
        plant = drive.plant()
        assert plant.cascade is not None
        filtered = changed(plant, cascade=changed(plant.cascade, **more))
        found, unfiltered = (run_plant(AxisCommand(command, 0.0, 0.0), one, 1, PERIOD)[1] for one in (filtered, plant))
        expected = run_plant(AxisCommand(passed(weights), 0.0, 0.0), plant, 1, PERIOD)[1]
        assert np.abs(found - expected).max() < 2e-7, key
        assert np.abs(found - unfiltered).max() > 5e-5, key


@pytest.mark.parametrize("name", ["P, PI", "95 %", "of LinuxCNC"])
def test_moving_start(name: str) -> None:
    """In steady motion it stays in steady motion, filters and all."""
    drive, speed = DRIVES[name], 0.05
    cascade = replace(drive).cascade(moving_average=8e-3, dead_time=2e-3, exponential=1e-3, shaper_frequency=200.0)
    plant = Plant(feedback="motor", b=1.0 / (drive.kv * drive.wv), c=0.0, cascade=cascade, gap=2e-5)
    command = speed * PERIOD * np.arange(300)
    table, motor, changes = run_plant(AxisCommand(command, 0.0, speed), plant, 1, PERIOD)
    assert np.abs(np.diff(motor) / PERIOD - speed).max() < 1e-9
    assert np.abs(motor - table - 1e-5).max() < 1e-12
    assert changes.t.size == 0
