"""A little player of programs of Fanuc's lathes (G code system A) for tests, from the manual of its lathe system.

It gives the way of the tool in radii: lines, arcs, increments by U and W, and the cycles G70, G90 and G94. What it does
not know it gives as a word of its own. Nothing is shared with the package.
"""

import math
import re

import numpy as np

from .reference_player import Move

WORD = re.compile(r"([A-Z])(-?\d*\.?\d*)")

LATHE = re.compile(r"G7[0-3](?=[^\n]*P\d)(?=[^\n]*Q\d)(?![^\n]*[XZ][-.\d])|(?s:G50 *S\d.*G96)|(?s:G96.*G50 *S\d)")
"""Words that mills have not: cycles of a shape from P to Q, and the spindle's highest speed beside one of the cut."""


def is_lathe(text):
    """Return whether a program is one of a lathe.

    By its words, or as it moves X and Z alone, at feeds up to 2 or with tools called with their offsets.
    """
    bare = re.sub(r"\([^)]*\)?", "", text.upper())
    feeds = [float(found) for found in re.findall(r"F *(\d+\.?\d*|\.\d+)", bare)]
    alone = "X" in bare and "Z" in bare and "Y" not in bare
    own = re.search(r"T\d{4}(?!\d)", bare) and re.search(r"G28[^\n]*U|G96", bare)
    return LATHE.search(bare) is not None or bool(alone and (own or 0.0 < max(feeds, default=0.0) <= 2.0))


def lathe_moves(text, begin):
    """Moves of a lathe's program [mm] that begins at a place, to which it comes back where nobody knows its own."""
    player = LathePlayer(begin)
    unit, at, found = 1.0, np.array(begin), []
    for kind, *numbers in player.play(text):
        if kind == "unit":
            unit = numbers[0]
        if kind not in (0, 1, 2, 3):
            continue
        end = np.array(begin) if len(numbers) == 0 else np.array([unit * numbers[0], begin[1], unit * numbers[1]])
        move = Move(kind, at, end, 0, math.nan)
        if kind > 1:
            center = unit * numbers[3], unit * numbers[2]
            first, last = (math.atan2(one[0] - center[1], one[2] - center[0]) for one in (at, end))
            sweep = (last - first) % math.tau if kind == 3 else -((first - last) % math.tau)
            move = Move(kind, at, end, 0, math.nan, (2, 0, 1), center, sweep, spiral=True)
        found.append(move)
        at = end
    # Where a program ends with the tool at home its last place is that of its last move before.
    while found and not found[-1].mode and (found[-1].end == begin).all():
        found.pop()
    return found


class LathePlayer:
    def __init__(self, begin=None):
        self.moves = []
        self.begin = None if begin is None else (2.0 * begin[0], begin[2])
        self.x, self.z = self.begin or (math.nan, math.nan)  # in diameters, as the program says
        self.group, self.cycle = 0.0, None

    def play(self, text):
        self.blocks = []
        for line in text.splitlines():
            bare = re.sub(r"\(.*?\)", "", line).replace(" ", "").strip()
            if bare and bare[0] not in "%O":
                self.blocks.append(WORD.findall(bare))
        ends = (k for k, words in enumerate(self.blocks) if any(w[0] == "M" and float(w[1]) in (2, 30) for w in words))
        self.blocks = self.blocks[: next(ends, len(self.blocks)) + 1]
        labels = {int(words[0][1]): k for k, words in enumerate(self.blocks) if words and words[0][0] == "N"}
        k = 0
        while k < len(self.blocks):
            values = dict(self.blocks[k])
            codes = [float(number) for letter, number in self.blocks[k] if letter == "G"]
            rough = {71.0, 72.0, 73.0} & set(codes)
            shape = None
            if {"P", "Q"} <= set(values) and {int(float(values[one])) for one in "PQ"} <= set(labels):
                shape = [labels[int(values[letter])] for letter in "PQ"]
            if rough:
                self.moves.append(("cycle", *[word for word in self.blocks[k] if word[0] != "N"]))
                k = shape[1] if shape else k
            elif 70.0 in codes and shape:
                begin = self.x, self.z
                for line in range(shape[0], shape[1] + 1):
                    self.block([word for word in self.blocks[line] if word[0] != "N"])
                self.go(0, *begin)
                self.group = None
            else:
                self.block([word for word in self.blocks[k] if word[0] != "N"])
            k += 1
        return self.moves

    def block(self, words):
        values = {letter: float(number) for letter, number in words if letter not in "GM" and number}
        codes = [float(number) for letter, number in words if letter == "G"]
        self.moves += [("unit", 25.4 if code == 20.0 else 1.0) for code in codes if code in (20.0, 21.0)]
        self.moves += [("word", letter, float(number)) for letter, number in words if letter in "MST"]
        self.moves += [("feed", code) for code in codes if code in (98.0, 99.0)]
        for code in codes:
            if code in (0.0, 1.0, 2.0, 3.0, 90.0, 94.0):
                self.group = code
                self.cycle = {"begin": (self.x, self.z)} if code >= 90.0 else None
        if {28.0, 30.0, 53.0} & set(codes):
            if self.begin is not None:
                self.moves.append((0,))
                self.x, self.z = self.begin
            return
        if {4.0, 10.0, 50.0, 74.0, 75.0, 76.0, 92.0} & set(codes):
            return
        x, z = self.target(values)
        if not set(values) & set("XZUW"):
            return
        if self.group >= 90.0:
            self.single(values, x, z)
        elif self.group < 2.0:
            self.go(int(self.group), x, z)
        else:
            self.arc(values, x, z)

    def target(self, values):
        x = values.get("X", self.x + values.get("U", 0.0))
        return x, values.get("Z", self.z + values.get("W", 0.0))

    def go(self, motion, x, z):
        if (x, z) != (self.x, self.z):
            self.moves.append((motion, 0.5 * x, z))
        self.x, self.z = x, z

    def arc(self, values, x, z):
        one, other = complex(self.z, 0.5 * self.x), complex(z, 0.5 * x)
        if "R" in values:
            chord = other - one
            height = math.sqrt(max(values["R"] ** 2 - 0.25 * abs(chord) ** 2, 0.0))
            center = 0.5 * (one + other) + 1j * chord / abs(chord) * height * (1.0 if self.group == 3.0 else -1.0)
        else:
            center = one + complex(values.get("K", 0.0), values.get("I", 0.0))
        self.moves.append((int(self.group), other.imag, other.real, center.imag, center.real))
        self.x, self.z = x, z

    def single(self, values, x, z):
        self.cycle |= {"x": x} if {"X", "U"} & set(values) else {}
        self.cycle |= {"z": z} if {"Z", "W"} & set(values) else {}
        self.cycle |= {"r": values["R"]} if "R" in values else {}
        (x0, z0), x, z, r = self.cycle["begin"], self.cycle["x"], self.cycle["z"], self.cycle.get("r", 0.0)
        if self.group == 90.0:
            self.go(0, x + 2.0 * r, z0)
            self.go(1, x, z)
            self.go(1, x0, z)
        else:
            self.go(0, x0, z + r)
            self.go(1, x, z)
            self.go(1, x, z0)
        self.go(0, x0, z0)


def random_turning(rng):
    """Lines that the player knows."""
    out = ["%", "O1", "G21 G18 G40 G99", "G50 S2500", "G96 S200 M3", "T0101", "G0 X60. Z5."]

    def length(low, high):
        return f"{rng.randint(10 * low, 10 * high) / 10:.1f}"

    def place(letters):
        return " ".join(f"{one}{length(1, 40) if one in 'XU' else '-' + length(1, 30)}" for one in letters)

    shapes, number = [], 10
    for _ in range(rng.randint(3, 10)):
        kind = rng.random()
        if kind < 0.4:
            out.append(f"{rng.choice(['G0', 'G1'])} {place(rng.choice(['X', 'Z', 'XZ', 'UZ', 'XW', 'UW', 'W', 'U']))}")
            out += rng.choice([[], ["F0.2"], ["M8"], [f"{place('Z')} (ON)"]])
        elif kind < 0.55:
            turn = rng.choice(["G2", "G3"])
            out.append(f"G1 {place('XZ')} F0.1")
            out.append(rng.choice([f"{turn} U10. W-5. R5.", f"{turn} U-4. W-3. I-2. K-3.", f"{turn} U0.4 W-6. R30."]))
        elif kind < 0.75:
            out += [f"G0 X{length(41, 60)} Z{length(1, 5)}", "G1 W-1."]
            cycle = rng.choice(["G90", "G94"])
            taper = rng.choice(["", "", f" R-{length(1, 3)}", f" R{length(1, 3)}"])
            out.append(f"{cycle} {place(rng.choice(['XZ', 'XW']))}{taper} F0.3")
            for _ in range(rng.randint(0, 3)):
                out.append(rng.choice([place("X"), place("XZ"), "U-20. F0.25", place("W"), place("X") + " R-0.5"]))
            out.append("G0 X60.")
        elif kind < 0.9 or not shapes:
            shape = [f"N{number} G0 X{length(5, 10)}", "G1 W-5. F0.1", "U4.", "G2 U6. W-3. R3."]
            shape += ["G1 Z-40.", f"N{number + 1} X50."]
            out += ["G0 X60. Z5.", "G71 U1.5 R0.5", f"G71 P{number} Q{number + 1} U0.4 W0.1 F0.3", *shape]
            shapes.append(number)
            number += 10
            out.append("G0 X61. Z5.")
        else:
            one = rng.choice(shapes)
            out += [f"G0 X{length(51, 60)} Z{length(1, 5)}", f"G70 P{one} Q{one + 1}", "G0 X70."]
    return "\n".join([*out, "M30", "%"]) + "\n"
