"""What is shipped: found by name, readable, and with a source."""

from fractions import Fraction
from pathlib import Path

import mpmath as mp
import pytest

from ph_post.drive.machinefile import read_machine
from ph_post.errors import InputError
from ph_post.files import storage as module
from ph_post.files.path import read_path
from ph_post.files.storage import or_shipped, shipped, shipped_names

PATHS = ("butterfly", "circle", "figure1", "inflection", "oval", "pocket", "spatial")
MACHINES = ("mill", "old_mill", "paper", "router", "stepper")


def test_everything_is_found():
    assert shipped_names("paths") == PATHS
    assert shipped_names("machines") == MACHINES


@pytest.mark.parametrize("name", PATHS)
def test_every_path_reads_and_says_where_it_comes_from(name):
    path = read_path(shipped("paths", name))
    assert path.source
    assert path.name


@pytest.mark.parametrize("name", MACHINES)
def test_every_machine_reads_by_its_bare_name(name):
    machine = read_machine(name)
    assert {"X", "Y"} <= set(machine.axes)


def test_the_papers_machine_has_the_papers_numbers():
    x = read_machine("paper").axes["X"]
    assert (x.feedback, x.servo.b, x.servo.c) == ("load", 0.0005, 0.005)
    assert (x.gap.gear_ratio, x.gap.travel_per_rad, x.gap.inertia_fraction, x.gap.beta) == (25, 1, 0.35, 1)
    assert (x.gap.motor_angle, x.gap.pickup) == (0.125664, "standstill")


def test_the_circle_is_the_papers():
    path = read_path(shipped("paths", "circle"))
    (segment,) = path.segments
    # radius 250 mm once around in 12 s; the file's feed has ten digits
    assert path.feed * 12 == pytest.approx(2 * 3.141592653589793 * 0.25, rel=1e-10)
    assert segment.curve.exact == ((Fraction(250), 0), (Fraction(250), 0), (0, 0))


def test_the_oval_joins_with_two_continuous_derivatives():
    curves = [segment.curve for segment in read_path(shipped("paths", "oval")).segments]
    for before, after in zip(curves, curves[1:] + curves[:1], strict=True):
        old = before.exact_pieces()[0].control
        new = after.exact_pieces()[0].control
        for axis in range(2):
            a, b = [point[axis] for point in old], [point[axis] for point in new]
            assert a[5] == b[0]
            assert a[5] - a[4] == b[1] - b[0]
            assert a[5] - 2 * a[4] + a[3] == b[2] - 2 * b[1] + b[0]


def test_a_file_of_the_users_comes_before_a_shipped_one(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert or_shipped("machines", "paper") == shipped("machines", "paper")
    Path("paper").write_text("mine", encoding="utf-8")
    assert or_shipped("machines", "paper") == "paper"


def test_names_with_a_folder_an_ending_or_a_dash_are_files():
    for name in ("-", "paper.toml", "./paper", "no/such/paper"):
        assert or_shipped("machines", name) == name


def test_an_unknown_name_is_told_the_nearest():
    with pytest.raises(InputError, match=r"^papper: no such file, and none of the shipped machines; expected paper$"):
        or_shipped("machines", "papper")


def test_an_installed_package_looks_inside_itself(tmp_path, monkeypatch):
    (tmp_path / "a.json").write_text("{}", encoding="utf-8")
    monkeypatch.setitem(module._FOLDERS, "paths", (tmp_path, tmp_path / "none", ".json"))
    assert shipped("paths", "a") == tmp_path / "a.json"


def bezier(points):
    """Both coordinates of a Bézier curve as functions of xi, at mpmath's precision."""
    degree = len(points) - 1

    def coordinate(axis):
        row = [mp.mpf(point[axis].numerator) / point[axis].denominator for point in points]
        return lambda t: mp.fsum(mp.binomial(degree, k) * t**k * (1 - t) ** (degree - k) * x for k, x in enumerate(row))

    return coordinate(0), coordinate(1)


def test_figure_1_has_the_printed_extents():
    """2|s| of Eq. (6): 0.2411 where the tangent is vertical (ε = 1e-6), 0.2033 where horizontal (1e-5)."""
    (segment,) = read_path(shipped("paths", "figure1")).segments
    with mp.workdps(40):
        x, y = bezier(segment.curve.exact_pieces()[0].control)

        def speed(t):
            return mp.hypot(mp.diff(x, t), mp.diff(y, t))

        def curvature(t):
            return (mp.diff(x, t) * mp.diff(y, t, 2) - mp.diff(y, t) * mp.diff(x, t, 2)) / speed(t) ** 3

        def along(function):
            return lambda t: mp.diff(function, t) / speed(t)

        vertical = mp.mpf("0.3")
        horizontal = mp.findroot(lambda t: mp.diff(y, t), 0.82)
        assert abs(mp.diff(x, vertical)) < mp.mpf("1e-15")
        assert abs(along(curvature)(vertical)) < mp.mpf("1e-8")
        by_second = 2 * (24 * mp.mpf("1e-6") / abs(along(along(curvature))(vertical))) ** 0.25
        by_first = 2 * (6 * mp.mpf("1e-5") / abs(along(curvature)(horizontal))) ** (mp.mpf(1) / 3)
    assert float(by_second) == pytest.approx(0.2411, abs=0.5e-4)
    assert float(by_first) == pytest.approx(0.2033, abs=0.5e-4)
