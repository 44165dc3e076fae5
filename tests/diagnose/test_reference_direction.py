"""What a log shows is relative: wherever its zero was taken, the same is found in it."""

import numpy as np
import pytest
from msgspec.structs import replace

import ph_post as ph
from ph_post.drive.machinefile import read_machine
from ph_post.types import AxisLog, Log, Servo, frozen

GAP = 50e-6
ROWS = 12_000


def log_of(zero):
    """A log of an ideal stepper's Z behind a play, its table read from a zero [m], with noise of 0.2 µm."""
    t = np.arange(ROWS) * 1e-3
    motor = 0.01 * np.sin(2.0 * np.pi * t / 2.3) + 0.004 * np.sin(2.0 * np.pi * t / 0.71)
    place, places = -0.5 * GAP, []
    for here in motor.tolist():
        place = min(max(place, here - 0.5 * GAP), here + 0.5 * GAP)
        places.append(place)
    table = np.array(places) - zero + np.random.default_rng(3).normal(0.0, 2e-7, ROWS)
    return Log(name="z.csv", t=frozen(t), period=1e-3, axes={"Z": AxisLog(command=frozen(motor), table=frozen(table))})


def machine_with(gap, said):
    machine = read_machine("stepper")
    z = machine.axes["Z"]
    z = replace(z, servo=Servo(b=0.0, c=0.0), gap=z.gap.with_lost_motion(gap), reference_direction=said)
    return replace(machine, axes={"Z": z})


@pytest.mark.parametrize(("zero", "said"), [(0.5 * GAP, "-"), (0.0, "-"), (0.5 * GAP, "both"), (-0.5 * GAP, "-")])
def test_nothing_is_missing_wherever_the_zero_was_taken(zero, said):
    assert ph.diagnose(log_of(zero), machine_with(GAP, said)).verdict == "nothing-missing"


@pytest.mark.parametrize("said", ["-", "both"])
def test_backlash_that_the_file_lacks_is_found(said):
    found = ph.diagnose(log_of(0.5 * GAP), machine_with(0.0, said))
    assert found.verdict == "named"
    (effect,) = found.findings
    assert (effect.name, effect.axis) == ("backlash", "Z")
    assert effect.parameters["lost_motion"].value == pytest.approx(GAP * 1e3, rel=0.02)
