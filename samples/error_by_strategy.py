"""How far the part will be off with one strategy and another, by simulation of the machine.

Run:  python samples/error_by_strategy.py
"""

from collections.abc import Sequence

from ph_post.analysis.path_analysis import analyse
from ph_post.compensate.comparison import compare_strategies
from ph_post.compensate.options import PlanOptions
from ph_post.drive.machinefile import read_machine
from ph_post.files.path import read_path
from ph_post.files.storage import shipped
from ph_post.units import MM


def error_by_strategy(names: Sequence[str]) -> dict[str, float]:
    """Return the largest contour error [m] of strategies on the paper's circle, by name."""
    analysis = analyse(read_path(str(shipped("paths", "circle"))), read_machine("paper"), tolerance=0.005 * MM)

    def options_for(name: str) -> PlanOptions:
        return PlanOptions(strategy=name, start="moving", inverse_dynamics=name == "takeup")

    found = {}
    for one in compare_strategies(analysis, options_for, names=names):
        if one.ok and one.assessment is not None and one.assessment.error is not None:
            found[one.name] = one.assessment.error.max
    return found


if __name__ == "__main__":
    for name, error in error_by_strategy(("none", "suppress", "takeup")).items():
        print(f"{name:10s} {error / MM:8.5f} mm")
