"""Every script in samples/ is imported and asserted on one number."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

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
    delivery, outcome = load("compensate_program").compensate_program("router")
    # router.toml: half of the lost motions of 0.12, 0.08 and 0.01 mm.
    assert delivery.edits.amplitude == pytest.approx({"X": 60e-6, "Y": 40e-6, "Z": 5e-6})
    assert outcome.after.error.max < outcome.before.error.max / 3.0
