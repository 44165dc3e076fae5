"""The check of samples against the limits: what it sees, and what it allows for."""

import msgspec
import numpy as np
import pytest
from support.motions import make_machine

from ph_post.compensate.violations import check_command, rounding
from ph_post.types import Command

PERIOD = 1e-3


def command(position: np.ndarray, feed: np.ndarray | None = None) -> Command:
    rows = len(position)
    return Command(
        axes=("X", "Y")[: position.shape[1]],
        period=PERIOD,
        t=np.arange(rows) * PERIOD,
        segment=np.zeros(rows, dtype=np.int64),
        xi=np.zeros(rows),
        s=np.linspace(0.0, 1.0, rows),
        position=position,
        feed=np.ones(rows) if feed is None else feed,
        window=np.full(rows, -1),
    )


def column(x: np.ndarray) -> np.ndarray:
    return np.column_stack([x, np.zeros(x.size)])


def test_steady_motion_breaks_nothing() -> None:
    x = 0.25 * np.arange(100) * PERIOD
    assert check_command(command(column(x)), make_machine(velocity=0.25)) == ()


@pytest.mark.parametrize(
    ("power", "quantity", "limit"), [(1, "velocity", 0.5), (2, "acceleration", 5.0), (3, "jerk", 100.0)]
)
@pytest.mark.parametrize("axis", [0, 1])
def test_each_limit_of_each_axis_is_seen(power: int, quantity: str, limit: float, axis: int) -> None:
    # x = c t^n / n! has the n-th difference c exactly.
    t = np.arange(20) * PERIOD
    factorial = (1.0, 1.0, 2.0, 6.0)[power]
    for over in (0.999, 1.001):
        position = np.zeros((t.size, 2))
        position[:, axis] = over * limit * t**power / factorial
        found = check_command(command(position), make_machine())
        assert [(v.axis, v.quantity) for v in found] == ([("XY"[axis], quantity)] if over > 1.0 else [])
        for violation in found:
            assert violation.value == pytest.approx(over * limit, rel=1e-9)
            assert violation.limit == limit


def test_a_run_of_rows_is_told_once_by_its_worst() -> None:
    x = np.zeros(40)
    x[10:] += 0.6 * PERIOD
    x[20:] += 0.7 * PERIOD
    x[21:] += 0.9 * PERIOD
    machine = make_machine(acceleration=1e9, jerk=1e12)
    found = check_command(command(column(x)), machine)
    assert [(v.quantity, round(v.value, 9)) for v in found] == [("velocity", 0.6), ("velocity", 0.9)]
    assert found[0].t == pytest.approx(9 * PERIOD)
    assert found[1].s == pytest.approx(20 / 39)


def test_a_machine_that_begins_and_ends_at_rest_has_to_speed_up_and_stop() -> None:
    x = 0.25 * np.arange(50) * PERIOD
    feed = np.full(50, 0.25)
    machine = make_machine()
    assert check_command(command(column(x), feed), machine) == ()
    for row, t in ((0, 0.0), (-1, 49 * PERIOD)):
        still = feed.copy()
        still[row] = 0.0
        found = check_command(command(column(x), still), machine)
        assert {violation.quantity for violation in found} == {"acceleration", "jerk"}
        assert all(abs(violation.t - t) <= 3 * PERIOD for violation in found)


def test_rounding_is_allowed_for_and_nothing_else() -> None:
    # Positions near 0.1 m, off by half a unit in their last place one way and the other.
    machine = make_machine(jerk=100.0, acceleration=50.0)
    t = np.arange(200) * PERIOD
    x = 0.1 + 100.0 * (t - 0.1) ** 3 / 6.0
    noisy = x + np.where(np.arange(200) % 2, 1.0, -1.0) * np.spacing(0.1) / 2.0
    worst = np.abs(np.diff(noisy, 3)).max() / PERIOD**3
    assert worst > 100.0
    assert check_command(command(column(noisy)), machine) == ()
    assert check_command(command(column(x + np.where(np.arange(200) % 2, 1e-13, -1e-13))), machine) != ()
    assert rounding(0.1, 1.0, 0.2, 1.0) < 1e-14


def test_short_commands_have_no_differences_to_check() -> None:
    for rows in (1, 2, 3):
        assert check_command(command(np.zeros((rows, 2))), make_machine()) == ()


def test_violations_are_ordered_by_axis_and_quantity() -> None:
    rng = np.random.default_rng(1)
    found = check_command(command(rng.uniform(-1.0, 1.0, (30, 2))), make_machine())
    names = [(violation.axis, violation.quantity) for violation in found]
    order = [(axis, quantity) for axis in "XY" for quantity in ("velocity", "acceleration", "jerk")]
    assert list(dict.fromkeys(names)) == order
    assert all(violation.value > violation.limit for violation in found)
    assert msgspec.structs.asdict(found[0]).keys() == {"axis", "quantity", "t", "s", "value", "limit"}


@pytest.mark.parametrize("over", [0.999, 1.001])
def test_the_motor_bounds_what_is_added_to_an_axis_with_a_scale(over: float) -> None:
    # C = N/(η r b) with N = 1, η = 1/2, r = 0.8 mm, b = 0.0002 s² is 1.25e7: 2000 rad/s² are 0.16 mm.
    machine = make_machine()
    limits = msgspec.structs.replace(machine.axes["X"].limits, motor_acceleration=2000.0)
    axes = {
        name: msgspec.structs.replace(axis, limits=limits, feedback="load" if name == "X" else "motor")
        for name, axis in machine.axes.items()
    }
    machine = msgspec.structs.replace(machine, axes=axes)
    offset = np.zeros((50, 2))
    offset[20:30] = over * 0.16e-3
    still = msgspec.structs.replace(command(offset, feed=np.zeros(50)), offset=offset)
    found = [v for v in check_command(still, machine) if v.quantity == "motor acceleration"]
    assert [(v.axis, v.t) for v in found] == ([("X", still.t[20])] if over > 1.0 else [])
    for violation in found:
        assert violation.value == pytest.approx(over * 2000.0, rel=1e-12)
