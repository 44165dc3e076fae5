"""The functions that measure a machine give what the commands print and write."""

import pathlib

import pytest
from support.front_door import printed

import ph_post as ph
from ph_post.drive.intervalfile import interval_view, read_intervals
from ph_post.drive.intervals import IntervalTable
from ph_post.report.diagnoses import diagnosis_view, effort_units, fit_view, identification_view

ROOT = pathlib.Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A log of the shipped router."""
    name = tmp_path_factory.mktemp("run") / "run.csv"
    ph.simulate("circle", "router").write_log(name)
    return name


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    """A log of the shipped router in which nothing moves."""
    name = tmp_path_factory.mktemp("still") / "still.csv"
    rows = "".join(f"{k / 1000},0.0,0.0,0.0,0.0\n" for k in range(400))
    name.write_text("t,X_cmd,X_motor,Y_cmd,Y_motor\n" + rows)
    return name


@pytest.mark.slow
def test_identify_is_the_command(capsys, run, tmp_path):
    found = ph.identify(ph.read_log(run), "router")
    view = printed(capsys, "identify", run, "-m", "router", "-o", tmp_path / "machine.toml")
    assert {**identification_view(found.axes, found.sentences), **fit_view(found), "warnings": []} == view
    assert found.machine_file() == (tmp_path / "machine.toml").read_text()
    found.write(tmp_path / "again.toml")
    assert (tmp_path / "again.toml").read_text() == found.machine_file()
    assert {trace.axis for trace, _ in found.residuals()} == {"X", "Y"}


def test_numbers_of_the_screw_go_together(run):
    with pytest.raises(ph.InputError, match=r"^--gear-ratio and --screw-lead go together; got one of them$"):
        ph.identify(run, gear_ratio=2.0)
    with pytest.raises(ph.InputError, match="with -m the machine file gives gear ratio and lead"):
        ph.identify(run, "router", gear_ratio=2.0)


def test_diagnose_is_the_command(capsys, still, tmp_path):
    found = ph.diagnose(ph.read_log(still), "router")
    view = printed(capsys, "diagnose", still, "-m", "router", "-o", tmp_path / "better.toml")
    assert {**diagnosis_view(found, effort_units(found.log)), "warnings": []} == view
    assert found.machine_file() == (tmp_path / "better.toml").read_text()


def test_a_log_of_another_machine_is_refused(run, tmp_path):
    from msgspec.structs import replace

    router = ph.read_machine("router")
    lathe = replace(router, axes={"X": router.axes["X"]})
    for measure in (ph.identify, ph.diagnose):
        with pytest.raises(ph.InputError, match="the machine has no axis Y"):
            measure(ph.read_log(run), lathe)


def test_a_machine_made_by_hand_has_no_file(still):
    from msgspec.structs import replace

    found = ph.diagnose(still, replace(ph.read_machine("router"), digest=""))
    with pytest.raises(ph.InputError, match="was not read from a file"):
        found.machine_file()


def test_sweep_is_the_command(capsys, tmp_path):
    found = ph.sweep("mill", [1.0, 2.0], [2e7, 3e7], radius=[0.01, 0.02], feed=[0.01])
    words = ("--beta", "1,2", "--gain", "2e7,3e7", "--radius", "10,20", "--feed", "600")
    assert interval_view(found) == printed(capsys, "sweep", "-m", "mill", *words)
    found.write(tmp_path / "table.json")
    assert read_intervals(tmp_path / "table.json").gain.tolist() == [2e7, 3e7]
    assert isinstance(found, IntervalTable)


def test_circles_of_a_sweep_are_of_a_path_or_given():
    with pytest.raises(ph.InputError, match=r"^--radius needs --feed, and no path beside it$"):
        ph.sweep("mill", [1.0], [2e7], radius=[0.01])
    with pytest.raises(ph.InputError, match=r"^--feed needs --radius, or a path and then one feed$"):
        ph.sweep("mill", [1.0], [2e7], feed=[0.01])


def test_calibrate_is_the_command(capsys, tmp_path):
    kit = ph.calibrate("mill", centre=(0.15, 0.08), travel=(0.12,))
    words = ("--centre", "150,80", "--travel", "120", "-o", tmp_path)
    view = printed(capsys, "calibrate", "-m", "mill", *words)
    assert [one["name"] for one in view["programs"]] == [one.name for one in kit]
    for one, listed in zip(kit, view["programs"], strict=True):
        assert one.program == (tmp_path / listed["file"]).read_text()
