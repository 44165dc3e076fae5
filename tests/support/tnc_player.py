"""What a conversational program moves, played block by block as the manuals tell; nothing is shared with ph_post.

Formulas are turned into Python's own. The player knows labels, repeats, jumps, L, C with CC, CR, CP by an angle, and
cycles 1, 200, 201, 203, 205, 240 and 9; a block with anything else is kept as it stands, for comparison. Places are
told as the datum has them: cycles 8 and 10 are matrices.
"""

from __future__ import annotations

import cmath
import math
import re

import numpy as np

_FUNCTIONS = {
    "SIN": lambda x: math.sin(math.radians(x)),
    "COS": lambda x: math.cos(math.radians(x)),
    "TAN": lambda x: math.tan(math.radians(x)),
    "ATAN": lambda x: math.degrees(math.atan(x)),
    "SQRT": math.sqrt,
    "SQ": lambda x: x**2,
    "ABS": abs,
    "NEG": lambda x: -x,
    "INT": int,
    "FRAC": lambda x: x - int(x),
    "LN": math.log,
    "EXP": math.exp,
}
_TESTS = {"EQU": lambda a, b: a == b, "NE": lambda a, b: a != b, "GT": lambda a, b: a > b, "LT": lambda a, b: a < b}


class _Function:
    """A function that is applied to what stands on its right, before any product: ``SIN 30 * 2`` is ``1``."""

    def __init__(self, apply):
        self.apply = apply

    def __pow__(self, value):
        return self.apply(value)


class TncPlayer:
    """`events` are dwells and moves: the word, the place, the feed, the side of the cutter (1 right, -1 left), and of
    arcs the sense (1 left) and the centre or radius."""

    def __init__(self, text):
        self.q, self.at, self.events = {}, dict.fromkeys("XYZ", 0.0), []
        self.feed, self.pole, self.cycle = None, {}, None
        self.turned, self.mirrored, self.frame = 0.0, "", np.eye(2)
        joined = re.sub(r"~[ \t]*(?=\n)", "", re.sub(r";[^\n~]*", "", text))
        joined = re.sub(r"\n\s*(?=Q\d{3}\s*=)", " ", joined)
        self.blocks = [re.sub(r"^\s*\d+\s+", "", line).strip() for line in joined.splitlines()]
        labels = {block[4:]: k for k, block in enumerate(self.blocks) if block.startswith("LBL ")}
        k, back, repeats = 0, [], {}
        while k < len(self.blocks):
            block, k = self.blocks[k], k + 1
            if block == "LBL 0":
                k = back.pop() if back else k
            elif found := re.fullmatch(r"CALL LBL (\S+) REP ?(\d+)(?:/\d+)?", block):
                repeats.setdefault(k, int(found[2]))
                repeats[k] -= 1
                if repeats[k] >= 0:
                    k = labels[found[1]]
                else:
                    del repeats[k]
            elif found := re.fullmatch(r"CALL LBL (\S+)", block):
                back.append(k)
                k = labels[found[1]]
            elif found := re.fullmatch(r"FN ?\d+: IF (\S+) (\w+) (\S+) GOTO LBL (\S+)", block):
                if _TESTS[found[2]](self.value(found[1]), self.value(found[3])):
                    k = labels[found[4]]
            elif found := re.fullmatch(r"(?:FN ?\d+: )?(Q\d+) ?= ?(.*)", block):
                self.q[found[1]] = self.value(found[2])
            else:
                self.block(block)
                if re.search(r"\bM0?(2|30)\b", block):
                    break

    def value(self, text):
        if found := re.fullmatch(r"(\S+) (LEN|ANG) (\S+)", text):
            a, b = self.value(found[1]), self.value(found[3])
            return math.hypot(a, b) if found[2] == "LEN" else math.degrees(math.atan2(a, b)) % 360
        code = re.sub(r"Q\d+", lambda one: f"({self.q[one[0]]!r})", text).replace("^", "**").replace("DIV", "/")
        code = re.sub(r"[A-Z]+", lambda one: "math.pi" if one[0] == "PI" else f"{one[0]} **", code)
        names = {name: _Function(apply) for name, apply in _FUNCTIONS.items()}
        return float(eval(code, {"math": math, **names}))

    def number(self, text):
        return self.q[text.lstrip("+-")] * (-1 if text[0] == "-" else 1) if "Q" in text else float(text)

    def block(self, block):
        word = block.split(" ")[0]
        if found := re.match(r"CYCL DEF (\d+)(?:\.(\d+))?", block):
            self.define(int(found[1]), found[2], block)
            return
        if word == "TOOL":
            self.feed = float(found[1]) if (found := re.search(r" F(\d+)", block)) else self.feed
        places, here = {}, self.seen(self.at)
        for step, axis, number in re.findall(r"(?<![A-Z])(I?)([XYZ])([-+]?(?:Q\d+|[\d.]+))", block):
            places[axis] = self.number(number) + (here[axis] if step else 0.0)
        if word == "CC":
            had = self.seen(self.pole) if self.pole and places else here
            self.pole = self.placed({axis: {**had, **places}[axis] for axis in "XY"})
            return
        if found := re.match(r"CP .*?\b(I?)PA([-+][\d.]+)", block):
            pole = self.seen(self.pole)
            away, angle = complex(here["X"] - pole["X"], here["Y"] - pole["Y"]), math.radians(float(found[2]))
            away = away * cmath.exp(1j * angle) if found[1] else cmath.rect(abs(away), angle)
            places |= {"X": pole["X"] + away.real, "Y": pole["Y"] + away.imag}
        if word in ("L", "C", "CR", "CP", "CYCL") or re.match(r"M\d", word):
            self.move(word, block, places)
        elif word not in ("TOOL", "BEGIN", "END", "LBL", ""):
            self.events.append(("kept", block))
        if re.search(r"M99|CYCL CALL", block):
            self.drill()

    def move(self, word, block, places):
        rapid = "FMAX" in block
        found = re.search(r"(?<![A-Z])F(Q?\d[\d.]*)", block)
        self.feed = self.number(found[1]) if found else self.feed
        here = self.seen(self.at)
        moves = word in ("C", "CR", "CP") or any(here[axis] != place for axis, place in places.items())
        if {"X", "Y"} & set(places):
            places = {**self.placed({**here, **places}), "Z": places.get("Z", self.at["Z"])}
        self.at |= places
        orders = [code for code in re.findall(r"M\d+", block) if code != "M99"]
        side = re.search(r" R([LR])\b", block)
        right = np.linalg.det(self.frame) * {None: 0, "L": -1, "R": 1}[side and side[1]]
        if moves and word in ("L", "C", "CR", "CP"):
            more = (round(right),)
            if word != "L":
                radius = re.search(r" R([-+]Q?[\d.]+)", block)
                left = np.linalg.det(self.frame) * float(re.search(r"DR([+-])", block)[1] + "1")
                more += (round(left), self.number(radius[1]) if radius else dict(self.pole))
            self.events.append((word, *self.at.values(), "MAX" if rapid else self.feed, *more))
        self.events += [("order", code) for code in orders]

    def seen(self, place):
        """Return a place of the datum as the frame has it."""
        xy = np.linalg.solve(self.frame, [place["X"], place["Y"]])
        return {**place, **dict(zip("XY", xy.tolist(), strict=True))}

    def placed(self, place):
        """Return a place of the frame as the datum has it."""
        return dict(zip("XY", (self.frame @ [place["X"], place["Y"]]).tolist(), strict=True))

    def define(self, number, part, block):
        if number in (8, 10):
            if found := re.search(r"10\.1 (I?)ROT([-+][\d.]+)", block):
                self.turned = float(found[2]) + (self.turned if found[1] else 0.0)
            elif found := re.search(r"8\.1(.*)", block):
                self.mirrored = found[1]
            c, s = math.cos(math.radians(self.turned)), math.sin(math.radians(self.turned))
            self.frame = np.diag([-1.0 if axis in self.mirrored else 1.0 for axis in "XY"]) @ [[c, -s], [s, c]]
            return
        if number == 9:
            if part == "1":
                self.events.append(("dwell", self.number(re.search(r"(\S+)$", block)[1])))
        elif part in (None, "0"):
            self.cycle = {"": number}
        if part not in (None, "0") and number == 1:
            self.cycle[int(part)] = float(re.search(r"([-\d.]+)$", block)[1])
        for key, value in re.findall(r"Q(\d{3}) ?= ?(\S+)", block):
            self.q[f"Q{key}"] = self.cycle[int(key)] = math.inf if value == "MAX" else self.number(value)

    def z(self, place, feed):
        if place != self.at["Z"]:
            self.at["Z"] = place
            self.events.append(("L", *self.at.values(), feed, 0))

    def wait(self, seconds):
        if seconds:
            self.events.append(("dwell", seconds))

    def drill(self):
        c = self.cycle
        if c[""] == 1:
            return self.peck(c)
        surface, clear = c[203], c[203] + c[200]
        deep, second = surface + c[201], max(clear, surface + c.get(204, 0))
        out = "MAX" if c.get(208, math.inf) == math.inf else c[208] or c[206]
        self.z(clear, "MAX")
        at, step = surface, c.get(202, -c[201])
        while at - step > deep + 1e-9 and c[""] in (200, 203, 205):
            at -= step
            self.z(at, c[206])
            self.z(clear, out if c[""] == 203 else "MAX")
            self.wait(c.get(210, 0))
            self.z(at + (c[258] if c[""] == 205 else c[200]), "MAX")
            step = max(step - c.get(212, 0), c.get(205, 0))
        self.z(deep, c[206])
        self.wait(c.get(211, 0))
        if out != "MAX":
            self.z(clear, out)
        self.z(second, "MAX")
        return None

    def peck(self, c):
        begin, clear, hole, step = self.at["Z"], abs(c[1]), abs(c[2]), abs(c[3])
        ahead = 0.6 if hole <= 30 else min(hole / 50, 7)
        bottoms = [k * step for k in range(1, 1000) if k * step < hole - 1e-9] + [hole]
        for bottom in bottoms:
            self.z(begin - clear - bottom, c[5])
            if bottom == hole:
                self.wait(c[4])
            self.z(begin, "MAX")
            if bottom != hole:
                self.z(begin - clear - bottom + ahead, "MAX")
