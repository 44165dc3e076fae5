"""Columns in each other's place and turned signs, made from a table that lags and rubs by formulas."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ph_post.errors import InputError
from ph_post.identify.logprogram import read_log

T = 1e-3 * np.arange(4000)
LAG = 6e-3


def motion(t: np.ndarray, rate: float) -> np.ndarray:
    return 12.0 * np.sin(rate * t) + 5.0 * np.sin(2.7 * rate * t)


def columns(noise: float = 2e-4) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(3)
    found = {"t": T}
    for axis, rate in (("X", 2.0), ("Y", 3.1)):
        found[f"{axis}_cmd"] = motion(T, rate)
        motor = motion(T - LAG, rate)
        way = np.sign(np.gradient(motor))
        found[f"{axis}_motor"] = motor + noise * rng.standard_normal(T.size)
        found[f"{axis}_act"] = motor - 0.015 * way + noise * rng.standard_normal(T.size)
        speed = np.gradient(motor, 1e-3)
        found[f"{axis}_force"] = 0.05 * np.gradient(speed, 1e-3) + 20.0 * way + 0.1 * speed
    return found


def read(tmp_path: Path, found: dict[str, np.ndarray], *mappings: str) -> tuple[str, ...]:
    rows = np.column_stack(list(found.values()))
    np.savetxt(tmp_path / "run.csv", rows, fmt="%.7f", delimiter=",", header=",".join(found), comments="")
    return read_log(tmp_path / "run.csv", columns=mappings).warnings


def without(*kinds: str) -> dict[str, np.ndarray]:
    return {name: values for name, values in columns().items() if name.partition("_")[2] not in kinds}


def swapped(found: dict[str, np.ndarray], one: str, other: str) -> dict[str, np.ndarray]:
    return found | {one: found[other], other: found[one]}


def test_a_log_in_order_is_read_without_a_word(tmp_path: Path) -> None:
    assert read(tmp_path, columns()) == ()
    assert read(tmp_path, without("motor", "force")) == ()


def test_metres_that_were_taken_for_mm(tmp_path: Path) -> None:
    found = {name: values if name == "t" else 1e-3 * values for name, values in without("motor", "force").items()}
    rows = np.column_stack(list(found.values()))
    np.savetxt(tmp_path / "run.csv", rows, fmt="%.10f", delimiter=",", header=",".join(found), comments="")
    said = read_log(tmp_path / "run.csv").warnings
    travel = np.ptp(motion(T, 2.0))
    assert said[0].startswith(f"X_cmd moves by {1e-3 * travel:.3g} mm in all, and X_act is read to 0.2 nm: are these ")
    assert said[0].endswith("--column X_cmd=X_cmd:m --column X_act=X_act:m")
    assert len(said) == 2
    columns = [f"{axis}_{what}={axis}_{what}:m" for axis in "XY" for what in ("cmd", "act")]
    assert read_log(tmp_path / "run.csv", columns=columns).warnings == ()


@pytest.mark.parametrize("lag", [2e-4, 8e-4])
def test_swapped_columns_of_a_drive_that_is_fed_forward(tmp_path: Path, lag: float) -> None:
    """It follows so closely that the lead alone is no sign; a command that is rougher by far than its reading is."""
    rng = np.random.default_rng(4)
    read_at = motion(T - lag, 2.0) + 3e-4 * rng.standard_normal(T.size)
    found = {"t": T, "X_cmd": motion(T, 2.0), "X_act": read_at}
    assert read(tmp_path, found) == ()
    wrong = swapped(found, "X_cmd", "X_act")
    if lag < 3e-4:  # within what command and reading may be apart in time
        assert read(tmp_path, wrong) == ()
        return
    with pytest.raises(InputError, match="the two are swapped; expected --column X_cmd=X_act"):
        read(tmp_path, wrong)


def test_a_command_and_its_reading_swapped(tmp_path: Path) -> None:
    wrong = swapped(without("motor", "force"), "X_cmd", "X_act")
    words = r"X_act runs 6.5 ms ahead of X_cmd, which is rougher: the two are swapped; expected --column X_cmd=X_act"
    with pytest.raises(InputError, match=words):
        read(tmp_path, wrong)
    assert read(tmp_path, wrong, "X_cmd=X_act", "X_act=X_cmd") == ()


def test_two_axes_swapped(tmp_path: Path) -> None:
    wrong = swapped(without("motor", "force"), "X_act", "Y_act")
    with pytest.raises(InputError, match="X_act follows Y_cmd, not X_cmd: the axes are swapped"):
        read(tmp_path, wrong)
    assert read(tmp_path, wrong, "X_act=Y_act", "Y_act=X_act") == ()


def test_motor_and_table_swapped(tmp_path: Path) -> None:
    wrong = swapped(without("force"), "X_act", "X_motor")
    (words,) = read(tmp_path, wrong)
    assert words.startswith("X_act runs 30 µm ahead of X_motor, by its direction")


def test_an_effort_of_the_other_sign(tmp_path: Path) -> None:
    found = columns()
    wrong = found | {"X_force": -found["X_force"]}
    with pytest.raises(InputError, match=r"its sign is turned; expected --column X_force=X_force\*-1:N"):
        read(tmp_path, wrong)
    assert read(tmp_path, wrong, "X_force=X_force*-1:N") == ()


def test_an_effort_that_holds_back_what_a_cut_drives(tmp_path: Path) -> None:
    """It pushes along the path; only what is left beside the speed says that the effort speeds the axis up."""
    found = without("act")
    speed = np.gradient(motion(T - LAG, 2.0), 1e-3)
    driven = found | {"X_force": 0.05 * np.gradient(speed, 1e-3) - 10.0 * speed}
    assert read(tmp_path, driven) == ()


@pytest.mark.parametrize(
    ("copied", "late", "words"),
    [
        ("X_cmd", 0, "X_act is X_cmd to the last digit: one value was recorded twice, or nothing was measured"),
        ("X_cmd", 1, "X_act is X_cmd to the last digit, late by 1 sample:"),
        ("X_motor", 0, "X_motor is X_act to the last digit"),
    ],
)
def test_a_value_that_was_recorded_twice(tmp_path: Path, copied: str, late: int, words: str) -> None:
    """It would be a drive without a lag, or an axis without backlash."""
    found = columns()
    copy = np.roll(found[copied], late)
    copy[:late] = copy[late]
    assert [one for one in read(tmp_path, found | {"X_act": copy}) if one.startswith(words)]
