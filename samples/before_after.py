"""Draw a path with its windows, and the feed along it before and after: the picture in README.md.

Run:  python samples/before_after.py [FOLDER]
"""

import sys
from pathlib import Path

from ph_post.analysis.path_analysis import analyse
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.drive.machinefile import read_machine
from ph_post.files.path import read_path
from ph_post.files.storage import shipped
from ph_post.report.figures import draw_plan, write_figure
from ph_post.units import MM


def before_after(folder: Path) -> float:
    """Write before_after.png and return how much longer the program takes (a factor)."""
    path = read_path(str(shipped("paths", "oval")))
    analysis = analyse(path, read_machine("mill"), tolerance=0.005 * MM)
    plan = make_plan(analysis, PlanOptions(strategy="suppress"))
    (folder / "before_after.png").write_bytes(write_figure(draw_plan(analysis, plan), "before_after.png"))
    return plan.phases[-1].start / plan.nominal[-1].start


if __name__ == "__main__":
    print(f"cycle time x {before_after(Path(sys.argv[1] if len(sys.argv) > 1 else 'samples')):.3f}")
