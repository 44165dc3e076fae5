"""Motions made by hand, in mm, for those who judge tool paths."""

import numpy as np

from ph_post.gcode.program import ARC, CUBIC, LINE, RAPID, Motions, feed_runs

MM = 1e-3


class Tool:
    """Gathers the motions of a tool that begins at the origin."""

    def __init__(self, at=(0.0, 0.0, 0.0), feed=10.0):
        self.at = np.array(at, dtype=float)
        self.feed = feed
        self.rows = []
        self.control = {}

    def _add(self, kind, end, center=(0.0, 0.0), angle=0.0):
        feed = 0.0 if kind == RAPID else self.feed
        end = np.array(end, dtype=float)
        self.rows.append((kind, self.at, end, center, angle, feed))
        self.at = end
        return self

    def rapid(self, x, y, z=0.0):
        return self._add(RAPID, (x, y, z))

    def line(self, x, y, z=0.0):
        return self._add(LINE, (x, y, z))

    def arc(self, x, y, i, j, angle, z=0.0):
        """I and J from the start, the angle swept in degrees."""
        return self._add(ARC, (x, y, z), (self.at[0] + i, self.at[1] + j), np.radians(angle))

    def cubic(self, *points):
        control = np.array([self.at, *((*point, 0.0) for point in points)])
        self.control[len(self.rows)] = MM * control
        return self._add(CUBIC, control[-1])

    def motions(self):
        kind, start, end, center, angle, feed = (np.array([row[k] for row in self.rows], dtype=float) for k in range(6))
        count = len(self.rows)
        return Motions(
            block=np.arange(count),
            kind=kind.astype(np.int64),
            chain=np.zeros(count, dtype=np.int64),
            start=MM * start.reshape(-1, 3),
            end=MM * end.reshape(-1, 3),
            plane=np.full(count, 17),
            center=MM * center.reshape(-1, 2),
            angle=angle,
            feeds=feed_runs(MM * feed),
            duration=np.zeros(count),
            exact=np.zeros(count, dtype=np.int64),
            control=self.control,
            nurbs={},
        )
