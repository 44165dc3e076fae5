"""A part program compensated from another program: what changes, what it costs, what it is worth.

Run:  python samples/compensate_program.py
"""

from pathlib import Path

from ph_post.api.programs import CompensatedProgram, ProgramOutcome, ProgramRequest, assess_program, compensate_program
from ph_post.compensate.options import PlanOptions
from ph_post.drive.machinefile import read_machine
from ph_post.edit.edits import EditOptions
from ph_post.edit.inputs import read_program_file
from ph_post.units import MM

POCKET = Path(__file__).parent / "programs" / "pocket.ngc"


def compensated_pocket(name: str) -> tuple[CompensatedProgram, ProgramOutcome]:
    """Return the compensated pocket for a shipped machine, and both programs run on the models."""
    machine = read_machine(name)
    request = ProgramRequest(plan=PlanOptions(strategy="auto", carrier="program"), edit=EditOptions(max_slowdown=0.25))
    delivery = compensate_program(read_program_file(POCKET), machine, request)
    return delivery, assess_program(delivery, machine, errors=True)


if __name__ == "__main__":
    delivery, outcome = compensated_pocket("router")
    print(delivery.after.data.decode())
    for what, one in (("before", outcome.before), ("after", outcome.after)):
        error = "-" if one.error is None else f"{one.error.max / MM:.4f} mm"
        print(f"{what:6s} {one.time:7.3f} s, contour error {error}")
