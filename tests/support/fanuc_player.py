"""A little player of Fanuc programs for tests, from its manuals: lines, arcs, cycles, G68, G51 and G51.1.

It knows the words that :func:`random_program` writes, and gives the way of the tool as moves without any of them.
"""

import cmath
import math
import re

WORD = re.compile(r"([A-Z])(-?\d*\.?\d*)")


class Player:
    def __init__(self):
        self.moves = []
        self.at = [0.0, 0.0, 0.0]  # in the coordinates that are in force
        self.tool, self.stale = [0.0, 0.0, 0.0], set()  # where it is; axes that the frame's begin or end left behind
        self.frame = None
        self.motion, self.absolute, self.cycle = 0, True, 0
        self.data, self.initial, self.high = {}, 0.0, True

    def play(self, text):
        for line in text.splitlines():
            bare = re.sub(r"\(.*?\)", "", line).strip()
            if bare and bare[0] not in "%O":
                self.block([(letter, float(number)) for letter, number in WORD.findall(bare.replace(" ", ""))])
        return self.moves

    def block(self, words):
        codes = [round(10 * value) for letter, value in words if letter == "G"]
        values = {letter: value for letter, value in words if letter not in "GNM"}
        self.moves += [(100, value) for letter, value in words if letter == "M" and value not in (3, 5)]
        self.modes(codes)
        if set(codes) & {680, 510, 511}:
            self.frame, self.stale = (codes[0], dict(values)), {0, 1}
        elif set(codes) & {690, 500, 501}:
            self.at, self.frame, self.stale = list(self.real(self.at)), None, {0, 1}
        elif 40 in codes:
            self.moves += [(101, values["P"])] if values["P"] else []
        elif self.cycle and set(values) & set("XYZR"):
            self.holes(values)
        elif set(values) & set("XYZIJ"):
            self.move(self.target(values), values)

    def modes(self, codes):
        for code in codes:
            if code in (900, 910):
                self.absolute = code == 900
            elif code in (980, 990):
                self.high = code == 980
            elif code in (0, 10, 20, 30):
                self.motion, self.cycle = code, 0
            elif code == 800:
                self.cycle = 0
            elif code in (810, 820, 830, 850):
                if not self.cycle:
                    self.initial, self.data = self.at[2], {}
                self.cycle = code

    def target(self, values):
        found = list(self.at)
        for axis, letter in enumerate("XYZ"):
            if letter in values:
                found[axis] = values[letter] + (0.0 if self.absolute else self.at[axis])
        return found

    def turn(self, vector):
        """A difference, without the frame."""
        code, values = self.frame
        along = complex(vector[0], vector[1])
        if code == 680:
            along *= cmath.exp(1j * math.radians(values["R"]))
            return [along.real, along.imag, vector[2]]
        if code == 511:
            return [-v if letter in values else v for v, letter in zip(vector, "XYZ", strict=True)]
        return [v * values[letter] for v, letter in zip(vector, "IJK", strict=True)]

    def real(self, place):
        if self.frame is None:
            return place
        center = [self.frame[1].get(letter, 0.0) for letter in "XYZ"]
        moved = self.turn([p - c for p, c in zip(place, center, strict=True)])
        return [c + m for c, m in zip(center, moved, strict=True)]

    def move(self, to, values, motion=None):
        motion = self.motion if motion is None else motion
        begin, end = self.tool, self.real(to)
        self.stale -= {0, 1} if self.cycle else {axis for axis, letter in enumerate("XY") if letter in values}
        end = [b if axis in self.stale else e for axis, (b, e) in enumerate(zip(begin, end, strict=True))]
        if motion in (20, 30):
            center = [values.get("I", 0.0), values.get("J", 0.0), 0.0]
            if "R" in values:
                chord = complex(to[0] - self.at[0], to[1] - self.at[1])
                height = math.sqrt(max(values["R"] ** 2 / abs(chord) ** 2 - 0.25, 0.0))
                height *= -1.0 if (motion == 20) == (values["R"] > 0.0) else 1.0
                middle = chord * complex(0.5, height)
                center = [middle.real, middle.imag, 0.0]
            center = self.real([p + c for p, c in zip(self.at, center, strict=True)])
            corner = self.turn([1.0, 0.0, 0.0]) + self.turn([0.0, 1.0, 0.0]) if self.frame else [1, 0, 0, 0, 1, 0]
            flips = corner[0] * corner[4] - corner[1] * corner[3] < 0.0
            self.moves.append((102, (motion == 20) != flips, *end, *center[:2]))
        elif math.dist(begin, end) > 2e-7:
            self.moves.append((motion, *end))
        self.at, self.tool = to, end

    def holes(self, values):
        for letter in "RZP":
            if letter in values:
                self.data[letter] = values[letter]
        level = self.data["R"] + (0.0 if self.absolute else self.initial)
        floor = self.data["Z"] + (0.0 if self.absolute else level)
        clear = self.initial if self.high else level
        for _ in range(int(values.get("K", 1))):
            x, y, _ = self.target({letter: values[letter] for letter in "XY" if letter in values})
            self.move([x, y, self.at[2]], {}, 0)
            self.move([x, y, level], {}, 0)
            self.move([x, y, floor], {}, 10)
            if self.cycle == 820 and self.data.get("P"):
                self.moves.append((101, self.data["P"]))
            if self.cycle == 850:
                self.move([x, y, level], {}, 10)
            self.move([x, y, clear], {}, 0)


def random_program(rng):
    """Lines that the player knows, mostly as a person would write them."""
    out = ["%", "O1", "G21 G17 G90 G40 G98 F500.", "G0 X0. Y0. Z5."]

    def place(*letters):
        return " ".join(f"{letter}{rng.randint(-200, 200) / 10:.1f}" for letter in letters)

    framed = None
    for _ in range(rng.randint(4, 14)):
        kind = rng.random()
        if kind < 0.35:
            mode = rng.choice(["", "", "G90 ", "G91 "])
            out.append(f"{mode}{rng.choice(['G0 ', 'G1 ', ''])}{place(*rng.choice(['X', 'Y', 'XY', 'XYZ', 'Z']))}")
        elif kind < 0.5:
            turn = rng.choice(["G2", "G3"])
            out += [
                f"G91 {turn} {place('X', 'Y')} R{rng.randint(300, 400) / 10:.1f}",
                rng.choice(["G90", "G1", "F300."]),
            ]
        elif kind < 0.6:
            out.append(f"{rng.choice(['G2', 'G3'])} {place('I', 'J')}")
        elif kind < 0.8:
            cycle = rng.choice(["G81", "G82", "G85", "G81", "G83"])
            out += [
                "G90 G0 Z5.",
                f"{rng.choice(['G98', 'G99'])} {cycle} {place('X', 'Y')} Z-3. R2. P{rng.choice([0, 250])}",
            ]
            if cycle == "G83":
                out[-1] += " Q1."
            for _ in range(rng.randint(0, 3)):
                out.append(rng.choice([place("X"), place("X", "Y"), place("Y"), "M8", "F200.", place("X") + " Z-4."]))
            out.append(rng.choice(["G80", "G80", "G0 Z9.", "G1 Z5.", "G80 G0 X1."]))
        elif framed:
            out += [framed] + (["G90 G0 " + place("X", "Y", "Z")] if rng.random() < 0.9 else [])
            framed = None
        else:
            begin, framed = rng.choice(
                [
                    (f"G68 {place('X', 'Y')} R{rng.randint(-180, 180)}.", "G69"),
                    (f"G51.1 {place('X')}", "G50.1 X0."),
                    (f"G51.1 {place('X', 'Y')}", "G50.1 X0. Y0."),
                    (f"G51 {place('X', 'Y', 'Z')} I2. J2. K1.", "G50"),
                    (f"G51 {place('X', 'Y', 'Z')} I1. J-1. K1.", "G50"),
                ]
            )
            out += ["G90", begin] + (["G90 G0 " + place("X", "Y", "Z")] if rng.random() < 0.9 else [])
    return "\n".join([*out, "M30", "%"]) + "\n"
