"""A plan that leads a path of 1,000 PH quintics on the shipped mill, against the time that may be waited for."""

import sys
import time

import numpy as np
from support.motions import look, make_path

from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.drive.machinefile import read_machine
from ph_post.geometry.ph import ph_hermite

SEGMENTS = 1_000
LONGEST = 10.0


def wavy(count: int, size: float = 0.05, waves: int = 12) -> list:
    """An ellipse whose radius rises and falls, interpolated by PH quintics."""
    t = np.linspace(0.0, 2.0 * np.pi, count + 1)
    radius, slope = 1.0 + 0.15 * np.cos(waves * t), -0.15 * waves * np.sin(waves * t)
    points = np.stack([size * radius * np.cos(t), 0.6 * size * radius * np.sin(t)], axis=1)
    along = np.stack([slope * np.cos(t) - radius * np.sin(t), 0.6 * (slope * np.sin(t) + radius * np.cos(t))], axis=1)
    along *= size * (t[1] - t[0])
    return [ph_hermite(points[k : k + 2], along[k : k + 2]) for k in range(count)]


def test_a_plan_of_a_thousand_segments_that_leads() -> None:
    machine = read_machine("mill")
    analysis = look(make_path(wavy(SEGMENTS), 0.03, closed=True), machine)
    make_plan(look(make_path(wavy(20), 0.03, closed=True), machine), PlanOptions(strategy="none"))
    start = time.perf_counter()
    plain = make_plan(analysis, PlanOptions(strategy="none"))
    middle = time.perf_counter()
    led = make_plan(analysis, PlanOptions(strategy="none", inverse_dynamics=True))
    end = time.perf_counter()
    seconds = led.phases[-1].start / plain.phases[-1].start
    sys.stdout.write(
        f"\n1,000 segments: plain {middle - start:.2f} s, led {end - middle:.2f} s, {seconds:.3f} as long\n"
    )
    assert led.inverse_dynamics
    assert end - middle <= LONGEST
