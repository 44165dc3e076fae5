"""Lost motion, squareness and scale from readings by hand, on machines that know nothing of ph_post."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support import hand_trials
from support.hand_machine import HandMachine, ball_bar
from support.hand_trials import MM, Shop

import ph_post as ph
from ph_post.cli.main import main
from ph_post.errors import InputError

Errors = dict[str, list[tuple[float, float]]]
"""By quantity: how far a value is off the truth, and the error that was stated."""


def measure_many(folder: Path, count: int, shop: Shop, *, dial: bool = True, cut: bool = False) -> Errors:
    """Measure machines, and collect how far each result is off.

    Of one axis in a thousand each test refuses by chance readings that agree: then all are taken again.
    """
    errors: Errors = defaultdict(list)
    again = 0
    for seed in range(count):
        random = np.random.default_rng(seed)
        machine = hand_trials.draw(random, worn=dial)
        file = folder / "readings.toml"
        file.write_text(hand_trials.readings(machine, random, shop, dial, cut))
        try:
            found = ph.measure(file, "stepper")
        except InputError:
            again += 1
            file.write_text(hand_trials.readings(machine, random, shop, dial, cut))
            found = ph.measure(file, "stepper")
        for axis in "XY":
            lost = found.axes[axis].lost_motion
            errors["lost motion"].append((lost.value / MM - hand_trials.true_play(machine, axis), lost.error / MM))
            if cut:
                scale = found.scale[axis]
                errors["scale"].append((scale.value - machine.scale[axis], scale.error))
        if cut:
            angle = found.squareness["X", "Y"]
            errors["squareness"].append((angle.value - machine.squareness, angle.error))
    assert again <= 0.01 * count, shop
    return errors


def share_within(pairs: list[tuple[float, float]], limit: float) -> float:
    return float(np.mean([abs(off) < limit for off, _ in pairs]))


def coverage(pairs: list[tuple[float, float]]) -> float:
    return float(np.mean([abs(off) < error for off, error in pairs]))


def dial_is_honest(folder: Path, count: int) -> None:
    for shop in (Shop(), Shop(dial_grain=0.01), Shop(dial=0.02, dial_grain=0.01, repeats=4)):
        pairs = measure_many(folder, count, shop)["lost motion"]
        assert share_within(pairs, 0.010) >= 0.9, shop
        assert 0.6 <= coverage(pairs) <= 0.75, shop


def cut_is_honest(folder: Path, count: int) -> None:
    """The test cut alone, where the play is the same all over the plate."""
    errors = measure_many(folder, count, Shop(), dial=False, cut=True)
    assert share_within(errors["lost motion"], 0.010) >= 0.9
    for name, pairs in errors.items():
        assert 0.6 <= coverage(pairs) <= 0.75, name


def both_are_honest(folder: Path, count: int) -> None:
    pairs = measure_many(folder, count, Shop(), cut=True)["lost motion"]
    assert share_within(pairs, 0.010) >= 0.99
    assert 0.6 <= coverage(pairs) <= 0.75


def bars_are_honest(folder: Path, count: int) -> None:
    for error in (0.005, 0.020):
        errors = measure_bars(folder, count, error)
        assert share_within(errors["lost motion"], 0.010) >= 0.9
        assert 0.6 <= coverage(errors["lost motion"]) <= 0.75, error
        assert 0.6 <= coverage([pair for pairs in errors.values() for pair in pairs]) <= 0.75, error


def test_a_dial_finds_the_lost_motion_and_says_how_sure_it_is(tmp_path):
    dial_is_honest(tmp_path, 60)


def test_few_readings_of_a_coarse_dial_are_as_sure_as_they_say(tmp_path):
    pairs = measure_many(tmp_path, 60, Shop(dial=0.02, dial_grain=0.01))["lost motion"]
    assert 0.6 <= coverage(pairs) <= 0.75
    assert 0.006 < np.mean([error for _, error in pairs]) < 0.010


def measured_as_asked(folder: Path, count: int, shop: Shop) -> list[float]:
    """Measure machines by a dial, those anew that want more readings, as often as they ask for; how far off each is."""
    off = []
    file = folder / "readings.toml"
    for seed in range(count):
        random = np.random.default_rng(seed)
        machine = hand_trials.draw(random)
        file.write_text(hand_trials.readings(machine, random, shop))
        found = ph.measure(file, "stepper")
        wanted = max(one.repeats or 0 for one in found.dial.values())
        if wanted:
            file.write_text(hand_trials.readings(machine, random, replace(shop, repeats=wanted)))
            found = ph.measure(file, "stepper")
        off += [found.axes[axis].lost_motion.value / MM - hand_trials.true_play(machine, axis) for axis in "XY"]
    return off


@pytest.mark.parametrize("dial", [0.005, 0.02])
@pytest.mark.thinned(2)
def test_a_dial_asks_for_as_many_readings_as_it_takes(tmp_path, dial):
    off = measured_as_asked(tmp_path, 60, Shop(dial=dial, dial_grain=0.01))
    assert np.mean(np.abs(off) < 0.010) >= 0.9


def test_a_reading_that_is_a_tenth_off_is_refused_by_its_row(tmp_path):
    """Of readings good to 5 µm; that none which agree are refused is shown by all tests of honest readings."""
    file = tmp_path / "readings.toml"
    for seed in range(12):
        random = np.random.default_rng(seed)
        text = hand_trials.readings(hand_trials.draw(random), random, Shop())
        rows = text.split("readings = [")
        wrong = int(random.integers(1, len(rows)))
        numbers, rest = rows[wrong].split("]", 1)
        values = [float(one) for one in numbers.split(",")]
        values[int(random.integers(len(values)))] += float(random.choice([-0.1, 0.1]))
        rows[wrong] = f"{', '.join(f'{one:.3f}' for one in values)}]{rest}"
        file.write_text("readings = [".join(rows))
        with pytest.raises(ph.InputError, match=rf"dial\[{wrong - 1}\].*(contradict|another way)"):
            ph.measure(file, "stepper")


def test_two_readings_that_no_dial_scatters_by_are_refused_without_others_beside_them(capsys):
    assert main(["machine", "measure", "-m", "stepper", "--dial", "X 0 0.501 0.031 0.001 0.161"]) == 2
    assert "from plus, 0.031 mm contradicts 0.161 mm, read there again" in capsys.readouterr().err


def test_rows_without_a_place_that_are_of_one_machine_are_taken(tmp_path):
    file = tmp_path / "readings.toml"
    for seed in range(40):
        random = np.random.default_rng(seed)
        text = hand_trials.readings(hand_trials.draw(random, worn=False), random, Shop())
        file.write_text("\n".join(line for line in text.splitlines() if "place_mm" not in line))
        assert set(ph.measure(file, "stepper").axes) == {"X", "Y"}


def test_rows_without_a_place_and_without_repeats_are_as_unsure_as_they_are_apart(tmp_path):
    """Nobody says whether the machine is worn or a reading is wrong: the error holds both lost motions."""
    file = tmp_path / "readings.toml"
    file.write_text('dial = [{axis = "X", readings = [0, 0.5, 0.03]}, {axis = "X", readings = [0, 0.5, 0.121]}]')
    lost = ph.measure(file, "stepper").axes["X"].lost_motion
    assert abs(lost.value / MM - 0.0755) < 1e-4
    assert lost.error / MM > 0.045


@pytest.mark.parametrize(("off", "warned"), [(1e-3, 0), (5.6e-3, 2)])
def test_scales_that_no_screw_has_come_with_a_warning(tmp_path, off, warned):
    machine = HandMachine(play={"X": 0.05, "Y": 0.05}, scale={"X": off})
    file = tmp_path / "readings.toml"
    shop = Shop(calipers=0.01)
    file.write_text(hand_trials.readings(machine, np.random.default_rng(1), shop, dial=False, cut=True))
    warnings = ph.measure(file, "stepper").warnings
    assert len(warnings) == warned
    if warned:
        assert warnings[0].startswith("the scale of X is +5.")
        assert warnings[1].startswith("the scales of X and Y differ by +5.")


def test_a_cut_shows_squareness_and_scale_beside_the_lost_motion(tmp_path):
    errors = measure_many(tmp_path, 8, Shop(), cut=True)
    assert share_within(errors["lost motion"], 0.010) == 1.0
    assert coverage(errors["squareness"] + errors["scale"]) > 0.4
    assert np.std([off for off, _ in errors["scale"]]) < 6e-4


def test_readings_without_error_give_the_machine_itself(tmp_path):
    machine = HandMachine(
        play={"X": 0.06, "Y": 0.11}, squareness=8e-4, scale={"X": 6e-4, "Y": -4e-4}, cutter=5.96, climb=0.03
    )
    exact = Shop(dial=1e-9, dial_grain=1e-4, calipers=1e-9, calipers_grain=1e-4, widths=2)
    file = tmp_path / "readings.toml"
    file.write_text(hand_trials.readings(machine, np.random.default_rng(1), exact, cut=True))
    found = ph.measure(file, "stepper")
    for axis in "XY":
        for source in found.axes[axis].sources.values():
            assert source.value / MM == pytest.approx(machine.play[axis], abs=1e-3)
        assert found.scale[axis].value == pytest.approx(machine.scale[axis], abs=3e-5)
    assert found.squareness["X", "Y"].value == pytest.approx(machine.squareness, abs=3e-5)
    assert found.cut is not None
    assert found.cut.tool is not None
    assert found.cut.tool.value / MM == pytest.approx(machine.cutter, abs=1e-3)


def test_a_wrong_model_of_the_cut_would_be_seen(tmp_path):
    """The circles swapped have the plays of the axes swapped, and the squares say otherwise."""
    machine = HandMachine(play={"X": 0.06, "Y": 0.11})
    exact = Shop(dial=1e-9, dial_grain=1e-4, calipers=1e-9, calipers_grain=1e-4, widths=2)
    text = hand_trials.readings(machine, np.random.default_rng(1), exact, dial=False, cut=True)
    swapped = (
        text.replace("circle_ccw", "circle_no").replace("circle_cw", "circle_ccw").replace("circle_no", "circle_cw")
    )
    file = tmp_path / "readings.toml"
    file.write_text(swapped)
    with pytest.raises(ph.InputError, match="contradicts the other widths"):
        ph.measure(file, "stepper")


def test_what_varies_along_the_axis_is_in_the_uncertainty_of_the_file(tmp_path):
    random = np.random.default_rng(4)
    worn = HandMachine(play={"X": 0.1, "Y": 0.1}, slope={"X": 4e-4})
    file = tmp_path / "readings.toml"
    file.write_text(hand_trials.readings(worn, random, Shop()))
    found = ph.measure(file, "stepper")
    assert found.machine.axes["X"].uncertainty.backlash == pytest.approx(0.2, abs=0.04)
    assert found.machine.axes["Y"].uncertainty.backlash < 0.06
    copy = tmp_path / "measured.toml"
    found.write(copy)
    again = ph.read_machine(copy)
    for axis in "XY":
        assert again.axes[axis].gap.lost_motion == found.machine.axes[axis].gap.lost_motion
        assert again.axes[axis].uncertainty == found.machine.axes[axis].uncertainty
    assert again.axes["Z"] == ph.read_machine("stepper").axes["Z"]


def write_arcs(file: Path, parts: list[tuple[np.ndarray, np.ndarray]], error: float, seed: int) -> None:
    random = np.random.default_rng(seed)
    lines = ["# nominal_mm: 100", "# feed_mm_min: 1000", "angle,radius"]
    for angle, radius in parts:
        noisy = radius + random.normal(0.0, error, radius.size)
        lines += [f"{a:.3f},{r:.4f}" for a, r in zip(angle, noisy, strict=True)]
    file.write_text("\n".join(lines) + "\n")


def bar_machine(seed: int) -> tuple[HandMachine, tuple[float, float]]:
    random = np.random.default_rng(seed)
    machine = HandMachine(
        play={axis: random.uniform(0.0, 0.1) for axis in "XY"},
        squareness=random.normal(0.0, 3e-4),
        scale={axis: random.normal(0.0, 2e-4) for axis in "XY"},
    )
    return machine, (random.uniform(0.0, 0.05), random.uniform(0.0, 0.05))


def measure_bars(folder: Path, count: int, error: float) -> Errors:
    errors: Errors = defaultdict(list)
    for seed in range(count):
        machine, lag = bar_machine(seed)
        file = folder / "bar.csv"
        write_arcs(file, [ball_bar(machine, 100.0, turn, 360, lag, (0.02, -0.03)) for turn in (1, -1)], error, seed)
        found = ph.measure(None, "stepper", ball_bar=[file])
        bar = found.ball_bar[0]
        for axis, one in zip("XY", bar.lost_motion, strict=True):
            assert one is not None
            errors["lost motion"].append((one.value / MM - machine.play[axis], one.error / MM))
        assert bar.squareness is not None
        assert bar.mismatch is not None
        assert bar.servo is not None
        errors["squareness"].append((bar.squareness.value - machine.squareness, bar.squareness.error))
        truth = machine.scale["X"] - machine.scale["Y"]
        errors["mismatch"].append((bar.mismatch.value - truth, bar.mismatch.error))
        errors["servo"].append((bar.servo.value / MM - (lag[0] - lag[1]), bar.servo.error / MM))
    return errors


def test_a_ball_bar_gives_back_the_machine_and_says_how_sure_it_is(tmp_path):
    errors = measure_bars(tmp_path, 25, 0.005)
    assert max(abs(off) for off, _ in errors["lost motion"]) < 0.004
    assert max(abs(off) for off, _ in errors["squareness"]) < 3e-5
    assert max(abs(off) for off, _ in errors["servo"]) < 0.003
    assert 0.55 <= coverage([pair for pairs in errors.values() for pair in pairs]) <= 0.8


def test_one_arc_alone_does_not_separate_squareness_from_the_servo(tmp_path):
    machine, lag = bar_machine(2)
    file = tmp_path / "bar.csv"
    write_arcs(file, [ball_bar(machine, 100.0, 1, 360, lag, (0.0, 0.0))], 0.001, 0)
    bar = ph.measure(None, "stepper", ball_bar=[file]).ball_bar[0]
    assert bar.squareness is None
    assert bar.servo is None
    assert bar.lost_motion[0] is not None
    assert bar.lost_motion[0].value / MM == pytest.approx(machine.play["X"], abs=0.002)


def test_arcs_of_two_machines_are_refused_by_their_lost_motions(tmp_path):
    """Together they would show a squareness of 0.7 mm/m, which neither machine has."""
    files = []
    for turn, play in ((1, 0.03), (-1, 0.2)):
        files.append(tmp_path / f"{turn}.csv")
        machine = HandMachine(play={"X": play, "Y": 0.03})
        write_arcs(files[-1], [ball_bar(machine, 100.0, turn, 360, (0.0, 0.0), (0.0, 0.0))], 0.002, 1)
    with pytest.raises(ph.InputError, match=r"the lost motion of X contradicts that by .*1\.csv"):
        ph.measure(None, "stepper", ball_bar=files)


def test_an_arc_that_is_given_twice_is_refused(tmp_path):
    """Twice as many readings would make the machine surer by √2 than one arc does."""
    machine, lag = bar_machine(2)
    one, copy = tmp_path / "one.csv", tmp_path / "copy.csv"
    write_arcs(one, [ball_bar(machine, 100.0, 1, 360, lag, (0.0, 0.0))], 0.001, 0)
    copy.write_text(one.read_text())
    with pytest.raises(ph.InputError, match=r"one\.csv: the arc is given twice"):
        ph.measure(None, "stepper", ball_bar=[one, one])
    with pytest.raises(ph.InputError, match=r"copy\.csv: holds the same readings as .*one\.csv"):
        ph.measure(None, "stepper", ball_bar=[one, copy])
    write_arcs(copy, [ball_bar(machine, 100.0, 1, 360, lag, (0.0, 0.0))], 0.001, 1)
    assert ph.measure(None, "stepper", ball_bar=[one, copy]).ball_bar[0].lost_motion[0] is not None


def test_a_cut_and_a_ball_bar_that_disagree_are_refused(tmp_path):
    exact = Shop(dial=1e-9, dial_grain=1e-4, calipers=0.005, calipers_grain=1e-4)
    play = {"X": 0.05, "Y": 0.05}
    file, bar = tmp_path / "readings.toml", tmp_path / "bar.csv"
    random = np.random.default_rng(1)
    file.write_text(hand_trials.readings(HandMachine(play=play), random, exact, dial=False, cut=True))
    for squareness, agrees in ((1e-4, True), (3e-3, False)):
        machine = HandMachine(play=play, squareness=squareness)
        write_arcs(bar, [ball_bar(machine, 100.0, turn, 360, (0.0, 0.0), (0.0, 0.0)) for turn in (1, -1)], 0.002, 1)
        if agrees:
            assert set(ph.measure(file, "stepper", ball_bar=[bar]).axes["X"].sources) == {"test cut", "ball bar in XY"}
            continue
        with pytest.raises(ph.InputError, match="the squareness of X and Y by test cut and by ball bar contradict"):
            ph.measure(file, "stepper", ball_bar=[bar])
