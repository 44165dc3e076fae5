"""A part program compensated from another program: what changes, what it costs, what it is worth.

Run:  python samples/compensate_program.py
"""

from pathlib import Path

from ph_post.audit.deliver import Delivery, Request, deliver
from ph_post.audit.outcome import Outcome, weigh
from ph_post.compensate.options import PlanOptions
from ph_post.gcode.splice.options import SpliceOptions
from ph_post.io.machinefile import read_machine
from ph_post.io.programfile import read_program_file
from ph_post.units import MM

POCKET = Path(__file__).parent / "programs" / "pocket.ngc"


def compensate_program(name: str) -> tuple[Delivery, Outcome]:
    """Return the compensated pocket for a shipped machine, and both programs run on the models."""
    machine = read_machine(name)
    request = Request(
        plan=PlanOptions(strategy="auto", carrier="program"), splice=SpliceOptions(max_slowdown=0.25)
    )
    delivery = deliver(read_program_file(POCKET), machine, request)
    return delivery, weigh(delivery, machine, errors=True)


if __name__ == "__main__":
    delivery, outcome = compensate_program("router")
    print(delivery.after.data.decode())
    for what, one in (("before", outcome.before), ("after", outcome.after)):
        error = "-" if one.error is None else f"{one.error.max / MM:.4f} mm"
        print(f"{what:6s} {one.time:7.3f} s, contour error {error}")
