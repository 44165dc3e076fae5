"""Programs with crossings on the fly, compensated by a generator that shares no code with the package.

A program is a list of moves. Crossings are given by their place along the path: there the moves are cut, and straight
blocks lead from the path with the old offset to the path with the new one. What the table does is found by brute force,
by thousands of points. Lengths are millimetres or inches, as the program has them.
"""

from __future__ import annotations

import hashlib
import math
import re
from dataclasses import dataclass, field
from dataclasses import replace as changed

import numpy as np
from scipy.spatial import cKDTree

AXES = "XYZ"
CENTRES = "IJK"
PLANES = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}


@dataclass(frozen=True)
class Move:
    """A move to `end`: rapid, line, or arc (with `center`, `turn` +1 from the plane's first axis to the second)."""

    end: tuple[float, ...]
    kind: str = "line"
    feed: float = 0.0
    center: tuple[float, ...] = ()
    turn: int = 0
    plane: int = 17
    radius: bool = False
    before: str = ""
    behind: str = ""
    lines: tuple[str, ...] = ()
    extruded: float | None = None


@dataclass(frozen=True)
class Crossing:
    """A crossing of one axis to a new direction, from `low` to `high` along the path.

    It is bulged out by `bulge` over `lead` before and behind, and cut in `steps` blocks.
    """

    axis: str
    sign: int
    low: float
    high: float
    bulge: float = 0.0
    lead: float = 0.0
    feed: float | None = None
    steps: int = 1


@dataclass(frozen=True)
class Style:
    """How a program is written."""

    head: tuple[str, ...] = ("G21 G90 G17 G94",)
    tail: tuple[str, ...] = ("M2",)
    unit: float = 1.0
    unit_name: str = "mm"
    decimals: int = 4
    relative: bool = False
    centers: bool = False
    inverse: bool = False
    dialect: str = ""


@dataclass
class Job:
    """Moves, the sides (minus, plus) of axes with an offset, shifts at the rapids by number, and crossings."""

    moves: list[Move]
    sides: dict[str, tuple[float, float]]
    shifts: dict[int, dict[str, float]] = field(default_factory=dict)
    crossings: list[Crossing] = field(default_factory=list)
    style: Style = Style()
    facts: tuple[str, ...] = ()
    approaches: dict[int, dict[str, float]] = field(default_factory=dict)


class Geometry:
    """The moves as curves by their length."""

    def __init__(self, moves: list[Move]) -> None:
        self.moves, self.starts = moves, []
        at = np.zeros(3)
        lengths = []
        for move in moves:
            self.starts.append(at)
            lengths.append(self._length(move, at))
            at = np.array(move.end, dtype=float)
        self.ends = np.cumsum(lengths)
        self.begins = self.ends - lengths

    @staticmethod
    def _turn(move: Move, start):
        a, b, c = PLANES[move.plane]
        center = np.array(move.center, dtype=float)
        one = math.atan2(start[b] - center[b], start[a] - center[a])
        other = math.atan2(move.end[b] - center[b], move.end[a] - center[a])
        angle = (other - one) * move.turn % (2 * math.pi)
        return (a, b, c), center, one, (angle if angle > 1e-9 else 2 * math.pi) * move.turn

    def _length(self, move: Move, start) -> float:
        if move.kind != "arc":
            return float(np.linalg.norm(np.array(move.end) - start))
        (a, b, c), center, _, angle = self._turn(move, start)
        return math.hypot(math.hypot(start[a] - center[a], start[b] - center[b]) * angle, move.end[c] - start[c])

    def point(self, k: int, place):
        """Points of a move at places along the program, (..., 3)."""
        move, start = self.moves[k], self.starts[k]
        share = np.asarray((place - self.begins[k]) / (self.ends[k] - self.begins[k]))
        if move.kind != "arc":
            return start + share[..., None] * (np.array(move.end) - start)
        (a, b, c), center, one, angle = self._turn(move, start)
        radius, out = math.hypot(start[a] - center[a], start[b] - center[b]), np.zeros((*share.shape, 3))
        out[..., a] = center[a] + radius * np.cos(one + share * angle)
        out[..., b] = center[b] + radius * np.sin(one + share * angle)
        out[..., c] = start[c] + share * (move.end[c] - start[c])
        return out

    def at(self, place):
        """Points at places, (..., 3)."""
        place = np.asarray(place)
        on = np.minimum(np.searchsorted(self.ends, place - 1e-12), len(self.moves) - 1)
        out = np.empty((*place.shape, 3))
        for k in np.unique(on).tolist():
            out[on == k] = self.point(k, place[on == k])
        return out


class Maker:
    """Writes a job's original, and the compensated program."""

    def __init__(self, job: Job) -> None:
        self.job, self.way = job, Geometry(job.moves)
        self.step = 10.0**-job.style.decimals
        self.crossings = sorted(job.crossings, key=lambda one: one.low)

    def text(self, value: float) -> str:
        """Digits of a length."""
        found = f"{round(value / self.step) * self.step:.{self.job.style.decimals}f}".rstrip("0").rstrip(".")
        return "0" if found in ("-0", "") else found

    def round(self, point):
        """Round to the last digit."""
        return np.round(point / self.step) * self.step

    def words(self, move: Move, start, end, shift) -> str:
        """Words of a move from one motor's place to another."""
        style = self.job.style
        named = [
            a for a in range(3) if (move.kind == "arc" and a in PLANES[move.plane][:2]) or abs(end[a] - start[a]) > 1e-9
        ]
        if move.kind == "rapid":
            named = [0, 1, 2]
        out = [AXES[a] + self.text(end[a] - start[a] if style.relative else end[a]) for a in named]
        if move.kind != "arc":
            return " ".join(out)
        a, b, _ = PLANES[move.plane]
        if move.radius:
            size = math.hypot(start[a] - move.center[a] - shift[a], start[b] - move.center[b] - shift[b])
            out.append("R" + self.text(size))
            return " ".join(out)
        for axis in (a, b):
            center = move.center[axis] + shift[axis]
            out.append(CENTRES[axis] + self.text(center if style.centers else center - start[axis]))
        return " ".join(out)

    @staticmethod
    def code(move: Move) -> str:
        """G word of a move."""
        return {"rapid": "G0", "line": "G1"}.get(move.kind) or ("G3" if move.turn > 0 else "G2")

    def feed_word(self, length: float, feed: float) -> str:
        """F word; under inverse time, of a length."""
        return f"F{feed / length:.6f}" if self.job.style.inverse else f"F{feed:.6g}"

    def line(self, k: int, start, end, shift, feed: str | None, whole: bool = True, amount: float | None = None) -> str:
        """Write a move, or a part of it."""
        move = self.job.moves[k]
        if not whole:
            move = changed(move, radius=False)
        parts = [move.before if whole else "", self.code(move), self.words(move, start, end, shift)]
        parts += [feed or ""] + ([f"E{amount:.5f}"] if amount is not None else []) + [move.behind if whole else ""]
        return " ".join(part for part in parts if part)

    def original(self) -> str:
        """Text of the original."""
        lines, feed = list(self.job.style.head), None
        for k, move in enumerate(self.job.moves):
            lines += move.lines
            word = None
            if move.kind != "rapid" and (self.job.style.inverse or move.feed != feed):
                word, feed = self.feed_word(self.way.ends[k] - self.way.begins[k], move.feed), move.feed
            zero = np.zeros(3)
            lines.append(self.line(k, self.way.starts[k], np.array(move.end, float), zero, word, amount=move.extruded))
        return "\n".join([*lines, *self.job.style.tail, ""])

    def compensated(self) -> str:
        """Text of the compensated program."""
        style, _sides = self.job.style, self.job.sides
        lines, feed = ["{header}" + style.head[0], *style.head[1:]], None
        shift, motor = np.zeros(3), np.zeros(3)
        self.within, self.longest = 0.0, 0.0
        k = 0
        while k < len(self.job.moves):
            move = self.job.moves[k]
            lines += move.lines
            begin, finish = self.way.begins[k], self.way.ends[k]
            inside = [one for one in self.crossings if begin - 1e-9 <= one.low < finish - 1e-9]
            if k in self.job.approaches:
                shift, motor, feed = self.approach(k, lines, shift, motor, feed)
                k += 1
                continue
            if not inside:
                if move.kind == "rapid":
                    for axis, value in self.job.shifts.get(k, {}).items():
                        shift[AXES.index(axis)] = value
                end = np.array(move.end, float) + shift
                word = None
                if move.kind != "rapid" and (style.inverse or move.feed != feed):
                    word, feed = self.feed_word(self.way.ends[k] - self.way.begins[k], move.feed), move.feed
                lines.append(self.line(k, motor, end, shift, word, amount=move.extruded))
                motor = end
                k += 1
                continue
            k, feed, motor = self.change(k, lines, shift, motor, feed)
        return "\n".join([*lines, *style.tail, ""])

    def approach(self, k, lines, shift, motor, feed):
        """Write a rapid that ends beyond, and the moves of single axes that bring each to its place."""
        move = self.job.moves[k]
        beyond = shift.copy()
        for axis, value in self.job.shifts[k].items():
            shift[AXES.index(axis)] = value
        for axis, value in self.job.approaches[k].items():
            beyond[AXES.index(axis)] = value
        end = np.array(move.end, float)
        change = [self.line(k, motor, end + beyond, beyond, None)]
        at = end + beyond
        for axis in self.job.approaches[k]:
            target = at.copy()
            target[AXES.index(axis)] = end[AXES.index(axis)] + shift[AXES.index(axis)]
            value = target - at if self.job.style.relative else target
            change.append(f"G1 {axis}{self.text(value[AXES.index(axis)])} F500")
            at = target
        if feed is not None:
            change.append(f"F{feed:.6g}")
        lines.append(f"(ph-post: +{len(change)} -1 {', '.join(self.job.approaches[k])} approach)")
        lines.extend(change)
        return shift, at, feed if feed is not None else 500.0

    def change(self, k, lines, shift, motor, feed):
        """Write the change of all crossings that begin on a move, and on those that they reach."""
        one = _Change(self, k, shift, motor, feed)
        k = one.write()
        own = self.job.moves[k - 1].feed
        if not self.job.style.inverse and one.feed != own and not self.job.style.dialect:
            one.texts.append(f"F{own:.6g}")
            one.feed = own
        lines.append(f"(ph-post: +{len(one.texts)} -{k - one.first} {', '.join(dict.fromkeys(one.labels))})")
        lines += one.texts
        return k, one.feed, one.motor

    def speed(self, here: Crossing, index: int, jump) -> float:
        """Feed of the motor at which the table keeps its own."""
        length = max(here.high - here.low, 1e-12)
        if length < 1e-9:
            return 300.0
        factor = math.hypot(1.0, float(np.linalg.norm(jump)) / length)
        return math.floor(self.job.moves[index].feed * factor * 10.0) / 10.0

    def amounts(self):
        """Extruded length by place."""
        known = [
            (self.way.ends[k], move.extruded) for k, move in enumerate(self.job.moves) if move.extruded is not None
        ]
        first = next((k for k, move in enumerate(self.job.moves) if move.extruded is not None), 0)
        places, values = zip(*known, strict=True) if known else ((0.0,), (0.0,))
        return [self.way.begins[first], *places], [0.0, *values]

    def length(self, move: Move, start, end, shift) -> float:
        """Length of a block."""
        if move.kind != "arc":
            return float(np.linalg.norm(end - start))
        centre = tuple(np.array(move.center) + shift)
        return Geometry._length(self.way, changed(move, end=tuple(end), center=centre), start)

    def through(self, here: Crossing, old, new, out):
        """Places and ends of the blocks of a crossing."""
        found = [(here.low, self.way.at(here.low) + old + out)] if here.lead else []
        for step in range(1, here.steps + 1):
            share = step / here.steps
            place = here.low + share * (here.high - here.low)
            found.append((place, self.way.at(place) + old + share * (new - old) + out))
        high = here.high + here.lead
        return [*found, (high, self.way.at(high) + new)] if here.lead else found

    def error(self, here: Crossing, low, high, old, new, out) -> float:
        """Largest distance of the table from the path, by brute force."""
        margin = 3.0 * (high - low) + 20.0 * float(np.linalg.norm(new - old))
        first = max(low - margin, 0.0)
        before = self.way.at(np.linspace(first, low, 800)) + old
        through = np.array([point for _, point in self.through(here, old, new, out)])
        last = min(high + margin, self.way.ends[-1])
        behind = self.way.at(np.linspace(high, last, 800)) + new
        points = np.concatenate([before, through, behind])
        pieces = np.repeat([2, 400, 2], [len(before) - 1, len(through), len(behind)])
        step = np.repeat(np.arange(pieces.size), pieces)
        share = (np.arange(step.size) - (np.cumsum(pieces) - pieces)[step] + 1) / pieces[step]
        between = points[step] + (points[step + 1] - points[step]) * share[:, None]
        motor = np.concatenate([points[:1], between])
        table = motor.copy()
        for axis, (minus, plus) in self.job.sides.items():
            a = AXES.index(axis)
            ahead = old[a] if here.axis == axis else None
            if ahead is None:
                table[:, a] = motor[:, a] - old[a]
                continue
            at = motor[0, a] - ahead
            held = []
            for place in motor[:, a].tolist():
                at = min(max(at, place - plus), place - minus)
                held.append(at)
            table[:, a] = held
        path = cKDTree(self.way.at(np.linspace(first, last, 16001)))
        return float(path.query(table)[0].max())


class _Change:
    """The lines of one change; `shift` is carried on."""

    def __init__(self, maker, first, shift, motor, feed):
        self.maker, self.first, self.shift, self.motor, self.feed = maker, first, shift, motor, feed
        self.texts, self.labels, self.amounts = [], [], maker.amounts()

    def write(self) -> int:
        """Write all moves up to the first that no crossing touches; returns its number."""
        maker, way, k = self.maker, self.maker.way, self.first
        at = way.begins[k]
        pending = [one for one in maker.crossings if one.low >= at - 1e-9]
        while True:
            here = next((one for one in pending if one.low < way.ends[k] - 1e-9), None)
            if here is None:
                if at < way.ends[k] - 1e-9:
                    self.emit(k, np.array(maker.job.moves[k].end, float) + self.shift, True, None, at, way.ends[k])
                return k + 1
            pending.remove(here)
            k, at = self.cross(here, k, at)
            if abs(at - way.ends[k]) < 1e-9:
                k += 1
                if not any(at - 1e-9 <= one.low < way.ends[k] - 1e-9 for one in pending):
                    return k

    def cross(self, here: Crossing, k: int, at: float) -> tuple[int, float]:
        """Write the path up to a crossing, and the crossing; returns move and place behind it."""
        maker, way = self.maker, self.maker.way
        low, high, old = here.low - here.lead, here.high + here.lead, self.shift.copy()
        if low > at + 1e-9:
            self.emit(k, way.at(low) + old, True, None, at, low)
        self.labels.append(f"crossing {here.axis}{'+' if here.sign > 0 else '-'}")
        axis, out, new = AXES.index(here.axis), np.zeros(3), self.shift.copy()
        out[axis] = -here.sign * here.bulge
        new[axis] = maker.job.sides[here.axis][1 if here.sign > 0 else 0]
        index = k
        while way.ends[index] < high - 1e-9:
            index += 1
        through = maker.through(here, old, new, out)
        for n, (place, target) in enumerate(through):
            slow = here.lead and n in (0, len(through) - 1)
            feed = here.feed if slow else here.feed or maker.speed(here, index, new - old)
            self.emit(k if slow and n == 0 else index, target, False, feed, place, place)
        self.shift[:] = new
        maker.longest = max(maker.longest, high - low)
        maker.within = max(maker.within, maker.error(here, low, high, old, new, out))
        return index, high

    def emit(self, index, target, part, speed, low, high):
        """Write a part of a move, or a block of a crossing."""
        maker, move = self.maker, self.maker.job.moves[index]
        way, style = maker.way, maker.job.style
        begins = part and low <= way.begins[index] + 1e-9
        whole = begins and high >= way.ends[index] - 1e-9
        piece = move if part else changed(move, kind="line")
        piece = changed(piece, radius=move.radius and whole)
        target = target if whole else maker.round(target)
        speed, word = speed or move.feed, ""
        if style.inverse:
            word = maker.feed_word(maker.length(piece, self.motor, target, self.shift), speed)
        elif speed != self.feed:
            word, self.feed = f"F{speed:.6g}", speed
        texts = [
            move.before if begins else "",
            maker.code(piece),
            maker.words(piece, self.motor, target, self.shift),
            word,
        ]
        if move.extruded is not None:
            texts.append(f"E{float(np.interp(high, *self.amounts)):.5f}")
        texts.append(move.behind if begins else "")
        self.texts.append(" ".join(text for text in texts if text))
        self.motor = target


def header(maker: Maker, original: str) -> str:
    """The lines of the header."""
    job, style = maker.job, maker.job.style
    unit = style.unit
    texts = [
        "(ph-post 0.3.0 compensated this program)",
        f"(ph-post: original sha256 {hashlib.sha256(original.encode('latin-1')).hexdigest()})",
        "(ph-post: machine bench, sha256 0123456789abcdef)",
        "(ph-post: options sha256 fedcba9876543210)",
        *([f"(ph-post: dialect {style.dialect})"] if style.dialect else []),
        *(
            f"(ph-post: offset {axis} {_sign(*both)}{max(both[1], -both[0]):.6f} {style.unit_name})"
            for axis, both in job.sides.items()
        ),
        *job.facts,
        f"(ph-post: {len(job.approaches)} stops, 0 dips)",
    ]
    if job.crossings:
        count = len(job.crossings)
        longest = math.ceil(maker.longest * unit * 1e4 - 1e-6) / 1e4
        within = math.ceil(maker.within * unit * 1e4) / 1e4
        texts.append(f"(ph-post: {count} crossings, up to {longest:.4f} mm long, within {within:.4f} mm)")
    decimals = style.decimals
    texts.append(
        f"(ph-post: dwell 0 s, decimals {decimals}, chord tolerance 0.001 mm, block time 5 ms, path mode as it is)"
    )
    return "\n".join(texts) + "\n"


def _sign(minus: float, plus: float) -> str:
    return "" if minus < 0.0 < plus else "+" if plus > 0.0 else "-"


def crossed(job: Job) -> tuple[bytes, bytes]:
    """Original and compensated program."""
    maker = Maker(job)
    original = maker.original()
    text = maker.compensated()
    text = text.replace("{header}", header(maker, original))
    if job.style.dialect:
        text = re.sub(r"^\((ph-post.*)\)$", r"; \1", text, flags=re.MULTILINE)
    return original.encode("latin-1"), text.encode("latin-1")
