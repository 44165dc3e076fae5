"""The loop closed on random cascades: what a person's file leaves of error, and what the diagnosed file leaves.

`tests/long/closed_loops.json` has more of them.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import pytest

import ph_post as ph
from tests.support.closed_loops import MM, diagnosed, draw_machine, of_program, of_table

pytestmark = pytest.mark.drawn(4)


@pytest.mark.slow
def test_motors_behind_whose_encoders_tables_have_backlash_and_friction(tmp_path: Path) -> None:
    machine = draw_machine(2, "motor")
    wrong, better = diagnosed(machine, tmp_path)
    for shape, play in (("circle", of_table), ("oval", of_table), ("oval", of_program)):
        before, after = (play(tmp_path, shape, file, machine.true) for file in (wrong, better))
        least = 5.0 if play is of_table else 4.0
        assert after.largest < before.largest / least
        assert after.rms < before.rms / 10.0
    # Where its motors come to stops harder than friction does, it is run more gently, and that is said.
    before, after = (of_table(tmp_path, "pocket", file, machine.true) for file in (wrong, better))
    assert any("axis X is run with at most" in one for one in after.warnings)
    assert after.largest < before.largest / 5.0
    assert after.rms < before.rms / 20.0


@pytest.mark.slow
def test_scales_on_tables_with_backlash_and_friction(tmp_path: Path) -> None:
    machine = draw_machine(0, "load")
    wrong, better = diagnosed(machine, tmp_path)
    # Of its Y axis neither backlash nor friction explains, without the other, more than a late reading would, which is
    # not between motor and table.
    found = ph.read_machine(better)
    for name, plant in zip("XY", machine.true, strict=True):
        axis = found.axes[name]
        assert axis.gap.lost_motion == pytest.approx(plant.gap, rel=0.01)
        # A dead time of 7 µs, far within its error, would leave inverse dynamics no room.
        assert axis.servo.cascade is not None
        assert axis.servo.cascade.dead_time == 0.0
        (effect,) = axis.effects
        assert effect.name == "coulomb_friction"
        assert effect.parameters["following_error_mm"] == pytest.approx(MM * plant.effects[0]["force"], rel=0.01)
    for shape in ("circle", "pocket", "oval"):
        before, after = (of_table(tmp_path, shape, file, machine.true) for file in (wrong, better))
        assert after.largest < before.largest / 5.0
        assert after.rms < before.rms / 5.0
    # A program crosses no backlash inside the loop and leads no friction, and says what does.
    said = of_program(tmp_path, "circle", better, machine.true).warnings
    assert any("friction of X and Y stays" in one and "--lead-program or --table leads it" in one for one in said)


@pytest.mark.slow
def test_a_current_loop_behind_which_friction_is_led(tmp_path: Path) -> None:
    """What it takes broke the jerk that is allowed by a tenth, and all was left: 57.6 and 59.6 µm."""
    machine = draw_machine(20, "load")
    wrong, better = diagnosed(machine, tmp_path)
    for shape, times in (("circle", 3.0), ("pocket", 20.0)):
        before, after = (of_table(tmp_path, shape, file, machine.true) for file in (wrong, better))
        assert after.largest < before.largest / times
        assert after.rms < before.rms / 3.0


@pytest.mark.slow
@pytest.mark.parametrize("side", [1, -1])
def test_tables_come_onto_their_sides_where_friction_is_not_led(side: int, tmp_path: Path) -> None:
    """There is no time for that on the pocket: on one side 1.5 of 16 µm were left of its first side, 0.87 µm in rms."""
    machine = draw_machine(2, "motor")
    true = tuple(replace(one, flank=side) for one in machine.true)
    after = of_table(tmp_path, "pocket", diagnosed(machine, tmp_path)[1], (true[0], true[1]))
    assert after.rms < 0.5e-6


@pytest.mark.slow
def test_tables_come_onto_their_sides_against_the_friction_that_keeps_motors_behind(tmp_path: Path) -> None:
    """Motors stayed 15 of 42 µm short of their sides, so that no friction was led: 14.1 of 36.0 µm were left."""
    machine = draw_machine(31, "motor")
    wrong, better = diagnosed(machine, tmp_path)
    before = of_table(tmp_path, "pocket", wrong, machine.true)
    for sides in product((1, -1), repeat=2):
        true = tuple(replace(one, flank=side) for one, side in zip(machine.true, sides, strict=True))
        after = of_table(tmp_path, "pocket", better, (true[0], true[1]))
        assert after.largest < before.largest / 50.0


@pytest.mark.slow
@pytest.mark.parametrize("loop", ["load", "motor"])
def test_a_lag_for_which_all_of_the_time_is_needed(tmp_path: Path, loop: str) -> None:
    """Turning back in corners costs no time, which all was kept for: 55.0 of 93.1 and 93.3 of 108.8 µm were left."""
    machine = draw_machine(24, loop)
    wrong, better = diagnosed(machine, tmp_path)
    before, after = (of_table(tmp_path, "pocket", file, machine.true) for file in (wrong, better))
    assert after.largest < before.largest / 5.0
    assert after.largest < 1.5e-5
    assert after.time < 1.101 * 3.77
