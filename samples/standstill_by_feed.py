"""How far the tool travels while one axis stands in its backlash, by feed (Figure 7 of the paper).

Run:  python samples/standstill_by_feed.py
"""

import math

from ph_post.drive.intervals import backlash_interval
from ph_post.drive.machinefile import read_machine
from ph_post.units import MM, MM_PER_MIN


def standstill_travel(feed: float, radius: float = 0.25) -> float:
    """Distance [m] travelled while X of the paper's machine stands; `feed` [m/s], `radius` [m]."""
    interval, note = backlash_interval(read_machine("paper").axes["X"], radius, feed / radius)
    if interval is None:
        raise ValueError(note)
    return feed * interval.duration


if __name__ == "__main__":
    for seconds in (2, 4, 6, 12, 24):  # T, between two reversals
        feed = math.pi * 0.25 / seconds
        travel = standstill_travel(feed)
        print(f"T {seconds:3d} s   feed {feed / MM_PER_MIN:8.1f} mm/min   stands for {travel / MM:7.3f} mm")
