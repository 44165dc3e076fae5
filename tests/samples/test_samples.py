"""Every script in samples/ is imported and asserted on one number."""

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from ph_post.identify.logprogram import read_log

SAMPLES = Path(__file__).resolve().parents[2] / "samples"


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"sample_{name}", SAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_script_is_tested_here():
    here = Path(__file__).read_text()
    assert all(f'load("{script.stem}")' in here for script in SAMPLES.glob("*.py"))


def test_before_after(tmp_path):
    factor = load("before_after").before_after(tmp_path)
    assert 1.0 < factor <= 1.1  # the default of --max-slowdown
    assert (tmp_path / "before_after.png").read_bytes().startswith(b"\x89PNG")


def test_error_by_strategy():
    # The paper's rule at every reversal of both axes: 2.19e-3 of the radius of 250 mm, within 3 %.
    errors = load("error_by_strategy").error_by_strategy(("none", "suppress"))
    assert errors["none"] == pytest.approx(2.19e-3 * 0.25, rel=0.03)
    assert errors["suppress"] < errors["none"]


def test_standstill_by_feed():
    # Figure 7 at T = 6 s: V Δt with the Δt of PAPER_NOTES §1.
    travel = load("standstill_by_feed").standstill_travel(0.1308996939)
    assert travel == pytest.approx(0.1308996939 * 0.11874297, rel=1e-7)


def test_compensate_program():
    result = load("compensate_program").compensated_pocket("router")
    # router.toml: half of the lost motions of 0.12 and 0.08 mm; Z cuts on the side of its zero alone.
    assert result.edited.edits.amplitude == pytest.approx({"X": 60e-6, "Y": 40e-6})
    assert result.after.error.max < result.before.error.max / 3.0


@pytest.mark.slow
def test_close_the_loop():
    errors, found = load("close_the_loop").close_the_loop()
    # The worn router's play of 1.5 x 0.12 mm, and its friction.
    assert found.verdict == "named"
    assert [(one.name, one.axis) for one in found.findings] == [("backlash", "X"), ("coulomb_friction", "X")]
    assert found.machine.axes["X"].gap.lost_motion == pytest.approx(180e-6, rel=1e-3)
    assert found.findings[1].parameters["force"].value == pytest.approx(0.006, rel=0.01)
    # Before, half the 0.06 mm that the file lacks is left, and the friction. After, what a table asks for that friction
    # of 60 mm/s² may not hold: to cross as fast as this one lets it would make a part worse where the table runs on.
    assert errors["compensated with the file"] < 0.5 * errors["plain"]
    assert errors["compensated with the diagnosed file"] < 0.3 * errors["compensated with the file"]


def test_the_recorded_log_is_what_its_remarks_say(tmp_path):
    anew = tmp_path / "anew.csv"
    anew.write_text(load("close_the_loop").record_log(), encoding="utf-8")
    logs = [read_log(str(file)) for file in (anew, SAMPLES / "logs" / "worn_router.csv")]
    columns = [np.array([log.axes["X"].table, log.axes["X"].motor, log.axes["X"].command]) for log in logs]
    # Steps of 0.1 um: another machine's last bit may fall on the other side of one.
    assert np.allclose(*columns, rtol=0.0, atol=1.1e-7)
    assert logs[0].remarks == logs[1].remarks


def test_the_log_that_is_diagnosed_is_the_only_one():
    """`tests/docs` has the command diagnose it, and compensates a program by the better file."""
    (log,) = (SAMPLES / "logs").glob("*.csv")
    assert log == load("close_the_loop").LOG
    assert log.stat().st_size < 300_000
