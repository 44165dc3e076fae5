"""``diff -m`` measures from the nominal path: that of A, or of the original that a program declares."""

from __future__ import annotations

from pathlib import Path

import pytest

import ph_post as ph
from tests.support.ideal_play import play_error

RING = Path(__file__).resolve().parents[1] / "golden" / "ring_jogs"


@pytest.fixture(scope="module")
def programs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A ring as it is, and with the offsets of a stepper machine, which nothing in it declares."""
    folder = tmp_path_factory.mktemp("ring")
    files = folder / "plain.ngc", folder / "offset.ngc"
    for file, strategy in zip(files, ("none", "takeup"), strict=True):
        how = {"strategy": strategy, "max_slowdown": 10.0}
        ph.compensate(RING / "path.json", RING / "machine.toml", **how).write(file)
    return files


def in_the_air(text: str) -> str:
    """Make rapids of the moves that bring axes onto their sides before the tool cuts."""
    lines = text.split("\n")
    for k, line in enumerate(lines):
        if line.startswith("(ph-post: +") and "approach" in line:
            own = slice(k + 1, k + 1 + int(line.split()[1]))
            lines[own] = [one.replace("G1 ", "G0 ") for one in lines[own]]
    return "\n".join(lines)


@pytest.mark.slow
def test_a_shifted_path_is_measured_from_that_of_a(programs: tuple[Path, Path]) -> None:
    """Measured from its own shifted path, B would be as bad as A: the table follows the path, not the command."""
    machine = ph.read_machine(RING / "machine.toml")
    found = ph.diff(*programs, machine).predicted
    assert found is not None
    backlash = {name: 1e3 * axis.gap.lost_motion for name, axis in machine.axes.items()}
    plain, offset = programs[0].read_text(), in_the_air(programs[1].read_text())
    sides = [{"X": side, "Y": side, "Z": 1.0} for side in (1.0, -1.0)]
    for error, gap, text in zip(found.errors, found.gaps, (plain, offset), strict=True):
        largest, rms = (
            max(sizes) for sizes in zip(*(play_error(text, plain, backlash, one) for one in sides), strict=True)
        )
        # LinuxCNC rounds joints by up to 1 µm, and chords may be as far off. The approach crosses the end of the ring.
        assert 1e3 * error.max > largest - 2e-3
        for one in (error, gap):
            assert 1e3 * one.rms == pytest.approx(rms, abs=1.5e-3)
    assert found.gaps[1].rms < 0.2 * found.gaps[0].rms
    assert found.gap_worst.max > found.gaps[1].max


def test_a_declared_original_is_measured_from(tmp_path: Path, programs: tuple[Path, Path]) -> None:
    edited = tmp_path / "edited.ngc"
    result = ph.compensate(programs[0], RING / "machine.toml", max_slowdown=10.0)
    result.write(edited)
    machine = ph.read_machine(RING / "machine.toml")
    there, back = ph.diff(programs[0], edited, machine).predicted, ph.diff(edited, programs[0], machine).predicted
    assert there is not None
    assert back is not None
    assert there.errors == back.errors[::-1]
    assert there.errors == (result.before.error, result.after.error)
    assert there.gaps == (result.before.error_gap, result.after.error_gap)
    assert there.gap_worst == result.after.error_gap_worst
