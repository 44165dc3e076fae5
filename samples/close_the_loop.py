"""A machine that its file does not know well: compensated, recorded, diagnosed, compensated again.

The worn router is the shipped one with half as much play again in X, and dry friction there. It stands for
yours: what it executes is looked at, and its record, but not what it is.

Run:  python samples/close_the_loop.py [LOG.csv to be recorded anew]
"""

import sys
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from ph_post.analysis.path_analysis import analyse
from ph_post.compensate.offsets import command_of
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.diagnose.diagnose import diagnose
from ph_post.dialects.reading import read_program_file
from ph_post.drive.machinefile import read_machine
from ph_post.files.path import read_path
from ph_post.files.storage import shipped
from ph_post.identify.logprogram import read_log
from ph_post.simulate.assess import contour_errors
from ph_post.simulate.contour import Nominal
from ph_post.simulate.controllers.run import run_program
from ph_post.simulate.machine import simulate
from ph_post.types import EffectSetting, Machine, Scenario
from ph_post.types.diagnosis import Diagnosis
from ph_post.units import MM

HERE = Path(__file__).parent
LOG = HERE / "logs" / "worn_router.csv"
AS_IT_STANDS = Scenario(flank="+")

REMARKS = """\
# made: by simulation of a worn router that runs samples/programs/to_and_fro.ngc (samples/close_the_loop.py)
# noise: 0.5 um on either reading, and steps of 0.1 um
"""


def worn_router() -> Machine:
    """Return the machine behind the record."""
    machine = read_machine("router")
    x = machine.axes["X"]
    friction = EffectSetting(name="coulomb_friction", parameters={"following_error_mm": 0.006})
    worn = replace(x, gap=replace(x.gap, lost_motion=1.5 * x.gap.lost_motion), effects=(friction,))
    return replace(machine, axes={**machine.axes, "X": worn})


def record_log() -> str:
    """Run the program on the worn router, and return what a scale on X and its encoder read."""
    machine = worn_router()
    program = read_program_file(HERE / "programs" / "to_and_fro.ngc")
    run = simulate(run_program(program, machine), machine, AS_IT_STANDS)
    rng = np.random.default_rng(1)
    x = [run.commanded[:, 0], run.executed[:, 0], run.motor[:, 0]]
    x[1:] = [side + 5e-7 * rng.standard_normal(side.size) for side in x[1:]]
    rows = zip(run.t, *(np.round(side / MM, 4) + 0.0 for side in x), strict=True)
    lines = (f"{t:.3f},{command:.4f},{table:.4f},{motor:.4f}\n" for t, command, table, motor in rows)
    return REMARKS + "t,X_cmd,X_act,X_motor\n" + "".join(lines)


def executed_error(path: str, machine: Machine, strategy: str) -> float:
    """Compensate a path for a machine as filed, and return how far the worn router then leaves it [m]."""
    analysis = analyse(read_path(str(shipped("paths", path))), machine, tolerance=0.005 * MM)
    compensated = strategy != "none"
    plan = make_plan(analysis, PlanOptions(strategy=strategy, inverse_dynamics=compensated, effort=0.2))
    command = command_of(plan, analysis.track, machine.servo_period)
    error = contour_errors(command, worn_router(), Nominal(analysis.track), (AS_IT_STANDS,))[0]
    assert error is not None
    return error.max


def close_the_loop(path: str = "oval") -> tuple[dict[str, float], Diagnosis]:
    """Return the executed errors [m]: plain, with the file as it is, with the diagnosed one."""
    machine = read_machine("router")
    found = diagnose(read_log(str(LOG)), machine)
    errors = {
        "plain": executed_error(path, machine, "none"),
        "compensated with the file": executed_error(path, machine, "auto"),
        "compensated with the diagnosed file": executed_error(path, found.machine, "auto"),
    }
    return errors, found


if __name__ == "__main__":
    if len(sys.argv) > 1:
        Path(sys.argv[1]).write_text(record_log(), encoding="utf-8")
    errors, found = close_the_loop()
    for effect in found.findings:
        for name, one in effect.parameters.items():
            print(f"{effect.axis}: {effect.name}, {name} = {one.value:.5g} {one.unit}")
    for words, error in errors.items():
        print(f"{words:36s} {error / MM:.4f} mm")
