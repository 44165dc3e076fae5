"""A load that changes with the speed, in a plant with equations of its own and a hum that no name explains."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from support.engine_cases import make_axis, make_machine

from ph_post.diagnose.diagnose import diagnose
from ph_post.types import AxisLog, Log
from ph_post.types.diagnosis import Diagnosis
from tests.support.plants.axis import Hidden, Plant
from tests.support.plants.courses import draw_course
from tests.support.plants.loops import PERIOD
from tests.support.plants.readings import Observer, Sensor

pytestmark = pytest.mark.drawn(4)

Floats = NDArray[np.float64]
B, C = 6.5e-5, 6.5e-3
DRY, HUM = 1.4e-5, 7e-7
"""Friction, and the hum that stays [m]."""


def diagnosed(load: float, difference: float) -> tuple[Diagnosis, Floats]:
    """Diagnose a log of a motor and its force; the speeds of the command [m/s] while it moves, too."""
    rng = np.random.default_rng(3)
    observer = Observer(draw_course(rng, False))
    effects = (
        Hidden("coulomb_friction", {"force": DRY}),
        Hidden("load_offset", {"force": load}),
        Hidden("friction_asymmetry", {"plus": 0.5 * difference, "minus": -0.5 * difference}),
        Hidden("hum", {"force": HUM, "frequency": 7.3}),
    )
    plants = (Plant("motor", B, C, effects=effects),)
    readings, command = observer(plants), observer.command(plants)[0]
    motor, force = (Sensor(2e-7, 5e-8).read(readings[f"X_{one}"], rng) for one in ("motor", "force"))
    t = PERIOD * np.arange(len(command))
    log = Log(name="test", t=t, period=PERIOD, axes={"X": AxisLog(command=command, motor=motor, effort=force)})
    speed = np.abs(np.gradient(command, PERIOD))
    return diagnose(log, make_machine([make_axis("motor", B, C, 0.0)], PERIOD)), speed[speed > 1e-6]


@pytest.mark.parametrize(("load", "difference"), [(-1e-6, -6e-5), (1.5e-6, 6e-5)])
@pytest.mark.thinned(2)
def test_friction_by_direction_is_told_beside_the_load_at_the_mean_speed(load: float, difference: float) -> None:
    """Of both at rest each would take the other's place, and the second explains less than half of what is left.

    `load` [m] is that at rest, `difference` [s] what c has more to plus than to minus: the mean of both ways is
    load + difference v / 2 at a speed v.
    """
    found, speed = diagnosed(load, difference)
    sizes = {one.name: {name: size.value for name, size in one.parameters.items()} for one in found.findings}
    assert sizes.keys() == {"coulomb_friction", "load_offset", "friction_asymmetry"}
    assert sizes["coulomb_friction"]["force"] == pytest.approx(DRY, rel=0.02)
    assert sizes["friction_asymmetry"]["difference"] == pytest.approx(difference, rel=0.1)
    even_at = 1e-3 * sizes["friction_asymmetry"]["even_at"]
    assert even_at == pytest.approx(float(np.mean(speed)), rel=0.05)
    assert sizes["load_offset"]["force"] == pytest.approx(load + 0.5 * difference * even_at, rel=0.12)
    # What stays is the hum, which the loop hardly damps, and the noise of the reading.
    assert found.steps[-1].holdout_rms == pytest.approx(np.hypot(HUM / np.sqrt(2.0), 2e-7), rel=0.15)
