"""What a Siemens program moves in frames, played line by line as the manual tells; nothing is shared with ph_post.

The player knows TRANS, ROT, MIRROR, the same with A, G0 to G3 with X, Y, Z, I, J, CR, AC and IC, G40 to G42, G90 and
G91, and F. Places are told in the frame of the settable zero offset; the program's frame is a matrix.
"""

from __future__ import annotations

import math
import re

import numpy as np

_NUMBER = r"([-+]?[\d.]+)"


def _frame(word, values):
    found = np.eye(4)
    if word == "TRANS":
        found[:3, 3] = [values.get(axis, 0.0) for axis in "XYZ"]
    elif word == "ROT":
        c, s = math.cos(math.radians(values["RPL"])), math.sin(math.radians(values["RPL"]))
        found[:2, :2] = [[c, -s], [s, c]]
    else:
        found[:3, :3] = np.diag([-1.0 if axis in values else 1.0 for axis in "XYZ"])
    return found


class SinumerikPlayer:
    """`events` are moves: the G word as the settable zero offset sees it, the place, F, the side and the centre."""

    def __init__(self, text):
        self.frame, self.at, self.events = np.eye(4), np.array([0.0, 0.0, 0.0, 1.0]), []
        self.mode, self.absolute, self.side, self.feed = None, True, 0, None
        for line in text.splitlines():
            bare = line.partition(";")[0].strip()
            if found := re.match(r"(A?)(TRANS|ROT|MIRROR)\b(.*)", bare):
                values = {name: float(number) for name, number in re.findall(rf"(RPL|[XYZ])=?{_NUMBER}", found[3])}
                frame = _frame(found[2], values) if values else np.eye(4)
                self.frame = self.frame @ frame if found[1] else frame
            elif bare:
                self.block(bare)

    def block(self, bare):
        for code in map(int, re.findall(r"\bG(\d+)", bare)):
            self.mode = code if code < 4 else self.mode
            self.absolute = {90: True, 91: False}.get(code, self.absolute)
            self.side = {40: 0, 41: -1, 42: 1}.get(code, self.side)
        if found := re.search(rf"\bF{_NUMBER}", bare):
            self.feed = float(found[1])
        here = np.linalg.solve(self.frame, self.at)
        start, center, moves = here.copy(), here.copy(), False
        for name, way, number in re.findall(r"\b([XYZIJ])(?:=?(AC|IC)\()?([-+]?[\d.]+)", bare):
            column, value, moves = "XYZIJ".index(name), float(number), True
            if column > 2:
                center[column - 3] = value + (0.0 if way == "AC" else start[column - 3])
            else:
                steps = way == "IC" or (not way and not self.absolute)
                here[column] = value + (start[column] if steps else 0.0)
        if not moves:
            return
        self.at, turned = self.frame @ here, float(np.linalg.det(self.frame[:2, :2]))
        event = [self.mode, *self.at[:3].tolist(), self.feed, round(turned * self.side)]
        if self.mode in (2, 3):
            event[0] = self.mode if turned > 0 else 5 - self.mode
            radius = re.search(rf"CR={_NUMBER}", bare)
            event += [float(radius[1])] if radius else (self.frame @ center)[:2].tolist()
        self.events.append(tuple(event))
