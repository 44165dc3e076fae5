"""Random part programs that are plain RS274/NGC, for comparisons with other interpreters."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction

from hypothesis import strategies as st

PLANES = {"G17": ("X", "Y", "Z"), "G18": ("Z", "X", "Y"), "G19": ("Y", "Z", "X")}
CENTERS = {"X": "I", "Y": "J", "Z": "K"}
thousandths = st.integers(-50_000, 50_000).map(lambda n: Fraction(n, 1000))
steps = st.integers(-20, 20).filter(bool).map(Fraction)
feeds = st.integers(1, 3000)


def decimal(value: Fraction) -> str:
    """A number of at most three decimals."""
    digits = f"{abs(value) * 1000}".rjust(4, "0")
    text = f"{digits[:-3]}.{digits[-3:]}".rstrip("0").rstrip(".") or "0"
    return f"-{text}" if value < 0 else text


@dataclass
class Writer:
    """Writes a program word by word and knows where the tool stands, in the program's units."""

    draw: st.DrawFn
    lines: list[str] = field(default_factory=list)
    place: dict[str, Fraction] = field(default_factory=dict)
    absolute: bool = True
    arc_absolute: bool = False
    plane: str = "G17"
    inverse: bool = False

    def write(self, *words: str) -> None:
        """One line, with blanks, case and comments as they come."""
        blank = self.draw(st.sampled_from(["", " ", "  ", "\t"]))
        line = blank.join(words)
        style = self.draw(st.integers(0, 5))
        if style == 0:
            line = line.lower()
        elif style == 1:
            line += " (a comment; of no use)"
        elif style == 2:
            line += " ; a comment (of no use"
        self.lines.append(line)

    def begin(self, units: str) -> None:
        """A known place in these units, without a rapid or a cut before it."""
        self.write(units, "G90", f"F{self.draw(feeds)}")
        self.absolute = True
        self.place = {axis: self.draw(thousandths) for axis in "XYZ"}
        self.write("G0", *(axis + decimal(value) for axis, value in self.place.items()))

    def target_words(self, target: dict[str, Fraction]) -> list[str]:
        """Words that lead to a place under the distance mode."""
        before = dict(self.place)
        self.place.update(target)
        return [a + decimal(v if self.absolute else v - before[a]) for a, v in target.items()]

    def feed_words(self) -> list[str]:
        """F where the feed mode wants one, or perhaps."""
        return [f"F{self.draw(feeds)}"] if self.inverse or self.draw(st.booleans()) else []

    def straight(self) -> None:
        """A rapid or a line of one to three axes."""
        axes = self.draw(st.lists(st.sampled_from("XYZ"), min_size=1, max_size=3, unique=True))
        word = self.draw(st.sampled_from(["G0", "G1", "G01"]))
        words = self.target_words({axis: self.draw(thousandths) for axis in axes})
        self.write(word, *words, *([] if word == "G0" else self.feed_words()))

    def arc(self) -> None:
        """An arc by its centre: quarters of a circle, exact in decimals, perhaps a helix, perhaps full."""
        first, second, third = PLANES[self.plane]
        center = {first: self.place[first] + self.draw(steps), second: self.place[second] + self.draw(steps)}
        x, y = self.place[first] - center[first], self.place[second] - center[second]
        for _ in range(self.draw(st.integers(0, 3))):
            x, y = -y, x
        offsets = {a: center[a] if self.arc_absolute else center[a] - self.place[a] for a in center}
        target = {first: center[first] + x, second: center[second] + y}
        if self.draw(st.booleans()):
            target[third] = self.draw(thousandths)
        turns = [f"P{self.draw(st.integers(1, 3))}"] if self.draw(st.booleans()) else []
        words = [*self.target_words(target), *(CENTERS[a] + decimal(v) for a, v in offsets.items())]
        words = self.draw(st.permutations([*words, *turns, *self.feed_words()]))
        self.write(self.draw(st.sampled_from(["G2", "G3"])), *words)

    def radius_arc(self) -> None:
        """An arc by its radius, the short way or the long one."""
        first, second, _ = PLANES[self.plane]
        x, y = self.draw(steps), self.draw(steps)
        radius = abs(x) + abs(y) + self.draw(st.integers(0, 9))
        words = self.target_words({first: self.place[first] + x, second: self.place[second] + y})
        sign = self.draw(st.sampled_from(["", "-"]))
        word = self.draw(st.sampled_from(["G2", "G3"]))
        self.write(word, *words, f"R{sign}{decimal(radius)}", *self.feed_words())

    def mode(self) -> None:
        """A word that changes what the ones behind it mean."""
        word = self.draw(st.sampled_from(["G17", "G18", "G19", "G90", "G91", "G90.1", "G91.1", "G93", "G94"]))
        self.plane = word if word in PLANES else self.plane
        self.absolute = {"G90": True, "G91": False}.get(word, self.absolute)
        self.arc_absolute = {"G90.1": True, "G91.1": False}.get(word, self.arc_absolute)
        self.inverse = {"G93": True, "G94": False}.get(word, self.inverse)
        self.write(word, *([f"F{self.draw(feeds)}"] if word == "G94" else []))

    def frame(self) -> None:
        """Other units, another work system or another name of the place, and a known place after it."""
        word = self.draw(st.sampled_from(["G20", "G21", "G54", "G55", "G59.3", "G92 X1.5 Z-2", "G92.1", "G49"]))
        units = word if word in ("G20", "G21") else None
        if units is None:
            self.write(*word.split())
        self.inverse = False
        self.write("G94")
        self.begin(units or self.draw(st.sampled_from(["G20", "G21"])))

    def other(self) -> None:
        """A line without a motion."""
        words = [
            "S1000 M3",
            "M5",
            "M8",
            "M9",
            "G4 P0.1",
            "G61",
            "G64 P0.01",
            "(only a comment)",
            "",
            "G40",
        ]
        self.write(*self.draw(st.sampled_from(words)).split(" "))


@st.composite
def programs(draw: st.DrawFn) -> str:
    """A whole program."""
    writer = Writer(draw)
    writer.write("G17", "G94", "G91.1")
    writer.begin(draw(st.sampled_from(["G20", "G21"])))
    steps_of = [writer.straight, writer.arc, writer.radius_arc, writer.mode, writer.frame, writer.other]
    for _ in range(draw(st.integers(1, 25))):
        draw(st.sampled_from([*steps_of, writer.straight, writer.arc]))()
    return "\n".join([*writer.lines, "M2", ""])
