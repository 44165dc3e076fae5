"""A part program compensated from another program: what changes, what it costs, what it is worth.

Run:  python samples/compensate_program.py
"""

from pathlib import Path

import ph_post as ph
from ph_post.units import MM

POCKET = Path(__file__).parent / "programs" / "pocket.ngc"


def compensated_pocket(machine: str) -> ph.Compensation:
    """Return the compensation of the pocket for a shipped machine."""
    return ph.compensate(ph.read_program(POCKET), machine, max_slowdown=0.25)


if __name__ == "__main__":
    result = compensated_pocket("router")
    print(result.program().decode())
    for what, one in (("before", result.before), ("after", result.after)):
        error = "-" if one.error is None else f"{one.error.max / MM:.4f} mm"
        print(f"{what:6s} {one.time:7.3f} s, contour error {error}")
