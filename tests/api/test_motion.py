"""The functions that look at a motion give what the commands print."""

import pathlib

import pytest
from support.front_door import printed

import ph_post as ph
from ph_post.api import results
from ph_post.report.simulations import comparison_view, simulation_view
from ph_post.report.views import inspection_view

ROOT = pathlib.Path(__file__).resolve().parents[2]
CIRCLE = ROOT / "paths" / "circle.json"


def test_inspect_is_the_command(capsys):
    found = ph.inspect("circle", "router", certify=True)
    assert [point.axis for point in found.turning_points] == ["X", "Y", "X", "Y"]
    assert found.certificate is not None
    assert found.certificate.ok
    assert inspection_view(found) == printed(capsys, "inspect", "circle", "-m", "router", "--certify")


@pytest.mark.parametrize(
    "job", ["circle", str(CIRCLE), CIRCLE, ph.read_path("circle")], ids=["shipped", "name", "path", "object"]
)
@pytest.mark.parametrize("machine", ["router", ph.read_machine("router")], ids=["shipped", "object"])
def test_inputs_may_be_named_or_read(job, machine):
    assert len(ph.inspect(job, machine).turning_points) == 4


def test_simulate_is_the_command(capsys, tmp_path):
    found = ph.simulate("circle", "router", strategy="step", pickup="contact", initial_flank="+")
    log = tmp_path / "run.csv"
    words = (
        "circle",
        "-m",
        "router",
        "--strategy",
        "step",
        "--pickup",
        "contact",
        "--flank",
        "+",
    )
    assert simulation_view(found) == printed(capsys, "simulate", *words, "--log", log)
    assert found.log() == log.read_bytes()
    found.write_log(tmp_path / "again.csv")
    assert (tmp_path / "again.csv").read_bytes() == found.log()


@pytest.mark.slow
def test_units_are_si(capsys):
    found = ph.simulate("circle", "router", feed=0.01)
    view = printed(capsys, "simulate", "circle", "-m", "router", "--feed", "600")
    assert view["error"]["max"] == found.error.max / 1e-3
    assert view["cycle_time"] == found.time


def test_a_table_may_be_rows_or_a_file(tmp_path):
    from ph_post.files.table import write_table

    run = ph.simulate("circle", "router")
    table = tmp_path / "table.csv"
    write_table(run.command, table)
    again = ph.simulate(table, "router", path="circle")
    assert again.error.max == pytest.approx(run.error.max, abs=1e-8)
    rows = ph.simulate(run.command, "router")
    assert rows.error is None
    assert rows.warnings == ("without --path the path is not known, and so no contour error",)


def test_a_path_is_its_own(capsys):
    with pytest.raises(ph.InputError, match=r"^--path goes with an interpolator table; a path file is its own path$"):
        ph.simulate("circle", "router", path="circle")


@pytest.mark.slow
def test_compare_is_the_command(capsys):
    found = ph.compare("circle", "router", output="program", effort=0.01)
    assert found.strategies[0].name == "none"
    words = ("circle", "-m", "router", "--carrier", "program", "--effort", "0.01")
    assert comparison_view(found) == printed(capsys, "compare", *words)


def test_a_plan_with_stops_is_not_taken_for_the_program():
    said = "the plan stops where an axis reverses; the programs that `convert` writes for this machine do not"
    run = ph.simulate("circle", "router", output="program", strategy="takeup", effort=0.01)
    assert any(caveat.startswith(said) for caveat in run.caveats)
    plain = ph.simulate("circle", "router", output="program")
    assert not any("convert" in caveat for caveat in plain.caveats)


def test_what_a_path_lacks_of_its_program_is_a_warning(tmp_path):
    part = tmp_path / "part.ngc"
    part.write_text("G21 G90 G94\nG0 X0 Y0\nG1 X10 F600\nG81 X5 Y5 Z-1 R1\nG1 X0 Y10\nX10\nM2\n")
    warnings = ph.inspect(part, "router").warnings
    assert warnings
    run = ph.simulate(part, "router")
    assert run.warnings[: len(warnings)] == warnings
    assert not set(warnings) & set(run.caveats)


@pytest.mark.parametrize("kept", [True, False])
def test_rows_of_a_motion_that_is_too_long_to_be_simulated_are_let_go(kept, monkeypatch):
    monkeypatch.setattr(results, "LONGEST_SIMULATED", 60.0 if kept else 6.0)
    program = ph.read_program(ROOT / "samples" / "programs" / "pocket.ngc")
    motion = results.ProgramMotion(program, program, ph.read_machine("mill"), "original")
    assert 7.0 < motion.time < 60.0
    assert ("command" in vars(motion)) == kept
    assert motion.command.t[-1] == motion.time  # whoever asks for them all the same gets them
