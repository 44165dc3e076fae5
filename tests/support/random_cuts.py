"""Random part programs as shops write them, each with a random machine: what compensation must never make worse.

A program is a list of moves in thousandths of a millimetre, or ten-thousandths of an inch times ten, which a manner of
writing turns into words: inches or millimetres, absolute or incremental, modal or not, centres or radii.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ph_post.types import Axis, Gap, Limits, Machine, PlannerSettings, Servo, Uncertainty

Random = np.random.Generator

PLANES = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}
DIALECTS = ("grbl", "grblhal", "marlin", "klipper", "linuxcnc")
SAFE = 5.0
"""Height of rapids [mm]."""


class Cut(NamedTuple):
    """A move to `end` [mm]: `code` 0 to 3, feed [mm/min], centre (3,) and plane of an arc."""

    code: int
    end: tuple[float, float, float]
    feed: float = 0.0
    center: tuple[float, float, float] | None = None
    plane: int = 17


class RandomCut(NamedTuple):
    """A program, its machine, and what kind of work it is; `smooth` where no axis turns in a corner."""

    number: int
    kind: str
    smooth: bool
    text: str
    machine: Machine


class _Work:
    """Moves of one program; positions are on the grid of what is written."""

    def __init__(self, rng: Random, grid: float) -> None:
        self.rng, self.grid = rng, grid
        self.at = (0.0, 0.0, SAFE)
        self.flat = False
        self.cuts: list[Cut] = []
        self.feed = float(rng.choice([300, 600, 900, 1200, 1800, 3000]))
        self.plunge = float(rng.choice([120, 300, 600]))

    def plane(self, of: Sequence[int]) -> int:
        """A plane for arcs; XY where the controller knows no other."""
        found = int(self.rng.choice(of))
        return 17 if self.flat else found

    def snap(self, value: float) -> float:
        return round(value / self.grid) * self.grid

    def to(self, code: int, feed: float = 0.0, **axes: float) -> None:
        end = tuple(self.snap(axes.get(name, old)) for name, old in zip("xyz", self.at, strict=True))
        if end != self.at:
            self.cuts.append(Cut(code, end, feed))
            self.at = end

    def line(self, **axes: float) -> None:
        self.to(1, self.feed, **axes)

    def arc(self, turn: int, end: Sequence[float], center: Sequence[float], plane: int = 17) -> None:
        """An arc to a place about a centre; both are rounded."""
        place = tuple(map(self.snap, end))
        middle = tuple(map(self.snap, center))
        self.cuts.append(Cut(3 if turn > 0 else 2, place, self.feed, middle, plane))
        self.at = place

    def begin(self, x: float, y: float, z: float) -> None:
        """Rapids in the air to above a place, and down into the work."""
        if self.at[2] < SAFE:
            self.to(0, z=SAFE)
        self.to(0, x=x, y=y)
        if self.rng.random() < 0.3:
            self.to(0, z=1.0)
        self.to(1, self.plunge, z=z)

    def depth(self) -> float:
        return -float(self.rng.uniform(0.1, 2.0))


def _around(center: Sequence[float], radius: float, angle: float, plane: int, third: float) -> list[float]:
    a, b, c = PLANES[plane]
    place = [0.0, 0.0, 0.0]
    place[a] = center[a] + radius * math.cos(angle)
    place[b] = center[b] + radius * math.sin(angle)
    place[c] = third
    return place


def _circles(work: _Work) -> None:
    rng = work.rng
    for _ in range(int(rng.integers(1, 4))):
        center, radius = rng.uniform(-30.0, 30.0, 2).round(2), float(rng.choice([2.0, 5.0, 10.0, 20.0]))
        angle = rng.choice([0.0, 0.5 * math.pi, math.pi, rng.uniform(0.0, 6.0)])
        x, y = center[0] + radius * math.cos(angle), center[1] + radius * math.sin(angle)
        work.begin(x, y, work.depth())
        turn = int(rng.choice([1, -1]))
        for _ in range(int(rng.integers(1, 3))):
            work.arc(turn, work.at, (center[0], center[1], 0.0))
        work.to(0, z=SAFE)


def _pocket(work: _Work) -> None:
    rng = work.rng
    width, height, round_off = rng.uniform(8.0, 30.0), rng.uniform(8.0, 30.0), float(rng.choice([0.0, 1.0, 3.0]))
    x0, y0 = rng.uniform(-20.0, 20.0, 2)
    climb, z = bool(rng.random() < 0.5), 0.0
    begun = False
    for _ in range(int(rng.integers(1, 3))):
        z -= 0.5
        inset = 0.0
        while inset < 3.5 and min(width, height) - 2.0 * inset > 2.0 * round_off + 2.0:
            r, w, h = round_off, width - 2.0 * inset, height - 2.0 * inset
            x, y = x0 + inset, y0 + inset
            if begun:
                work.line(x=x + r, y=y)
                work.to(1, work.plunge, z=z)
            else:
                work.begin(x + r, y, z)
                begun = True
            corners = [(x + w, y), (x + w, y + h), (x, y + h), (x, y)]
            ways = [(1, 0), (0, 1), (-1, 0), (0, -1)]
            if climb:
                for (cx, cy), (dx, dy) in zip(corners, ways, strict=True):
                    work.line(x=cx - r * dx, y=cy - r * dy)
                    if r:
                        nx, ny = -dy, dx
                        work.arc(1, (cx + r * nx, cy + r * ny, z), (cx + r * (nx - dx), cy + r * (ny - dy), z))
            else:
                for cx, cy in corners:
                    work.line(x=cx, y=cy)
            work.line(x=x + r, y=y)
            inset += float(rng.uniform(1.0, 2.0))
    work.to(0, z=SAFE)


def _arcs(work: _Work) -> None:
    """A serpentine of tangent half circles and lines, in any plane."""
    rng = work.rng
    plane = work.plane([17, 18, 19])
    a, b, c = PLANES[plane]
    radius, angle = float(rng.choice([2.0, 3.0, 6.0])), float(rng.choice([0.0, 0.5 * math.pi, rng.uniform(0.0, 6.0)]))
    place = [float(v) for v in (*rng.uniform(-10.0, 10.0, 2), -1.0)]
    work.begin(*place)
    turn = int(rng.choice([1, -1]))
    for _ in range(int(rng.integers(3, 8))):
        sweep = turn * float(rng.uniform(0.5, 1.5)) * math.pi
        center = list(work.at)
        center[a] -= turn * radius * math.sin(angle)
        center[b] += turn * radius * math.cos(angle)
        begin = math.atan2(work.at[b] - center[b], work.at[a] - center[a])
        angle += sweep
        end = _around(center, radius, begin + sweep, plane, work.at[c])
        work.arc(turn, end, center, plane)
        if rng.random() < 0.5:
            way = float(rng.uniform(1.0, 8.0))
            there = list(work.at)
            there[a] += way * math.cos(angle)
            there[b] += way * math.sin(angle)
            work.line(**dict(zip("xyz", there, strict=True)))
        turn = -turn if rng.random() < 0.7 else turn
    work.to(0, z=max(SAFE, work.at[2] + 1.0))


def _helix(work: _Work) -> None:
    rng = work.rng
    plane = work.plane([17, 17, 18, 19])
    c = PLANES[plane][2]
    radius, angle = float(rng.uniform(2.0, 8.0)), float(rng.uniform(0.0, 6.0))
    center = [float(v) for v in rng.uniform(-5.0, 5.0, 3)]
    center[2] -= 10.0
    begin = _around(center, radius, angle, plane, center[c])
    work.begin(*begin)
    turn, rise = int(rng.choice([1, -1])), float(rng.choice([-1.0, 1.0, 0.5]))
    for _ in range(int(rng.integers(2, 4))):
        end = list(work.at)
        end[c] += rise
        work.arc(turn, end, [*(center if c != 2 else (*center[:2], 0.0))], plane)
    work.to(0, z=SAFE)


def _spline(work: _Work) -> None:
    rng = work.rng
    waves = rng.uniform(-1.0, 1.0, (3, 4)) / np.arange(1, 4)[:, None] ** 1.5
    size, step = rng.uniform(5.0, 15.0), float(rng.choice([0.1, 0.3, 1.0]))
    u = np.linspace(0.0, 1.0, 4001)
    angle = 2.0 * math.pi * np.arange(1, 4)[:, None] * u
    x = size * (waves[:, 0] @ np.cos(angle) + waves[:, 1] @ np.sin(angle))
    y = size * (waves[:, 2] @ np.cos(angle) + waves[:, 3] @ np.sin(angle))
    z = -1.0 + (0.3 * np.sin(4.0 * math.pi * u) if rng.random() < 0.3 else 0.0 * u)
    way = np.append(0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))
    count = int(min(way[-1] / step, 400)) + 1
    at = np.linspace(0.0, way[-1], count + 1)
    points = np.stack([np.interp(at, way, column) for column in (x, y, z)], axis=1)
    work.begin(*points[0].tolist())
    for place in points[1:].tolist():
        work.line(**dict(zip("xyz", place, strict=True)))
    work.to(0, z=SAFE)


def _engraving(work: _Work) -> None:
    rng = work.rng
    x, y = rng.uniform(-10.0, 10.0, 2)
    z = -float(rng.uniform(0.1, 0.3))
    for _ in range(int(rng.integers(2, 6))):
        work.begin(x, y, z)
        for _ in range(int(rng.integers(1, 5))):
            if rng.random() < 0.5:
                dx, dy = rng.uniform(-3.0, 3.0, 2)
                work.line(x=work.at[0] + dx, y=work.at[1] + dy)
            else:
                radius, angle = rng.uniform(0.5, 2.5), rng.uniform(0.0, 2.0 * math.pi)
                turn, sweep = int(rng.choice([1, -1])), rng.uniform(0.5, 5.0)
                center = (work.at[0] + radius * math.cos(angle), work.at[1] + radius * math.sin(angle), z)
                end = _around(center, radius, angle + math.pi + turn * sweep, 17, work.at[2])
                work.arc(turn, end, center)
        work.to(0, z=1.0)
        x += float(rng.uniform(2.0, 5.0))
        if rng.random() < 0.5:
            y = work.at[1]
    work.to(0, z=SAFE)


def _drilling(work: _Work) -> None:
    rng = work.rng
    z = work.depth() - 1.0
    work.to(0, z=SAFE)
    for _ in range(int(rng.integers(3, 10))):
        x, y = rng.uniform(-20.0, 20.0, 2)
        axes = {"x": x, "y": y} if rng.random() < 0.7 else {"x": x} if rng.random() < 0.5 else {"y": y}
        work.to(0, **axes)
        if rng.random() < 0.5:
            work.to(0, z=1.0)
        work.to(1, work.plunge, z=z)
        work.to(0, z=SAFE if rng.random() < 0.5 else 1.0)
    work.to(0, z=SAFE)


def _positioning(work: _Work) -> None:
    """Grooves between rapids that name one axis or two."""
    rng = work.rng
    for _ in range(int(rng.integers(3, 9))):
        work.to(0, z=SAFE)
        names = [["x"], ["y"], ["x", "y"]][int(rng.integers(3))]
        work.to(0, **{name: float(rng.uniform(-15.0, 15.0)) for name in names})
        work.to(1, work.plunge, z=-0.5)
        name = str(rng.choice(["x", "y"]))
        way = float(rng.choice([-1.0, 1.0]) * rng.uniform(1.0, 10.0))
        work.line(**{name: work.at["xyz".index(name)] + way})
    work.to(0, z=SAFE)


def _corners(work: _Work) -> None:
    rng = work.rng
    work.begin(*rng.uniform(-15.0, 15.0, 2), work.depth())
    for _ in range(int(rng.integers(3, 9))):
        axes = {"x": rng.uniform(-15.0, 15.0), "y": rng.uniform(-15.0, 15.0)}
        if rng.random() < 0.3:
            axes["z"] = work.depth()
        if rng.random() < 0.3:
            axes.pop(str(rng.choice(["x", "y"])))
        work.line(**axes)
    work.to(0, z=SAFE)


KINDS = {
    "circles": _circles,
    "pocket": _pocket,
    "arcs": _arcs,
    "helix": _helix,
    "spline": _spline,
    "engraving": _engraving,
    "drilling": _drilling,
    "positioning": _positioning,
    "corners": _corners,
}
SMOOTH = frozenset(("circles", "arcs", "helix", "spline"))
NAMES = (*KINDS, "mixed")


def random_cut(number: int) -> RandomCut:
    """Program and machine of a number."""
    rng = np.random.default_rng([1515, number])
    kind = NAMES[number % len(NAMES)]
    dialect = DIALECTS[int(rng.integers(len(DIALECTS)))]
    inch = bool(rng.random() < 0.2)
    cuts = random_work(rng, kind, 25.4e-5 if inch else 1e-3, flat=dialect in ("marlin", "klipper"))
    text = _written(rng, dialect, inch, cuts)
    return RandomCut(number, kind, kind in SMOOTH, text, _machine(rng, dialect))


def random_work(rng: Random, kind: str, grid: float, *, flat: bool) -> list[Cut]:
    """Moves of a kind of work, on a grid [mm]; `flat` ones have arcs in the plane of X and Y alone."""
    work = _Work(rng, grid)
    begin = rng.uniform(-20.0, 20.0, 2)
    work.flat = flat
    work.cuts.append(Cut(0, (work.snap(begin[0]), work.snap(begin[1]), work.snap(SAFE))))
    work.at = work.cuts[-1].end
    for one in [kind] if kind != "mixed" else rng.choice(list(KINDS), 2).tolist():
        KINDS[one](work)
    return work.cuts


def _written(rng: Random, dialect: str, inch: bool, cuts: Sequence[Cut]) -> str:
    unit, decimals = (25.4, 5) if inch else (1.0, 3)
    alone = dialect in ("marlin", "klipper")
    relative, modal = bool(rng.random() < 0.25), bool(rng.random() < 0.5) and not alone
    radii = bool(rng.random() < 0.2) and dialect != "klipper"
    centers = dialect == "linuxcnc" and not relative and bool(rng.random() < 0.3)
    head = [f"G{20 if inch else 21}", "G90", *([] if alone else ["G17", "G94"])]
    lines = head if alone else [" ".join(head)]
    if dialect == "linuxcnc":
        lines.append(str(rng.choice(["G61", "G64 P0.005", "G64 P0.01", "G64 P0.02"])))
        if inch and lines[-1] != "G61":
            lines[-1] = "G64 P0.0004"
        lines += ["G90.1"] if centers else []

    def number(value: float) -> str:
        text = f"{value / unit:.{decimals}f}".rstrip("0").rstrip(".")
        return "0" if text in ("", "-0") else text

    mode, plane, feed, at = "", 17, 0.0, (0.0, 0.0, 0.0)
    for row, cut in enumerate(cuts):
        words = []
        if cut.center is not None and cut.plane != plane:
            (lines if alone else words).append(f"G{cut.plane}")
            plane = cut.plane
        if f"G{cut.code}" != mode or not modal:
            mode = f"G{cut.code}"
            words.append(mode)
        for axis, name in enumerate("XYZ"):
            moves = row == 0 or cut.end[axis] != at[axis]
            if moves or (cut.center is not None and axis in PLANES[plane][:2]):
                words.append(name + number(cut.end[axis] - (at[axis] if relative and row else 0.0)))
        if cut.center is not None:
            words += _center_words(cut, at, plane, number, radii=radii, centers=centers)
        if cut.code and cut.feed != feed:
            feed = cut.feed
            words.append(f"F{number(feed)}")
        lines.append(" ".join(words))
        at = cut.end
        if relative and row == 0:
            lines.append("G91")
    return "\n".join([*lines, *([] if alone else ["M2"]), ""])


def _center_words(cut: Cut, at: Sequence[float], plane: int, number, *, radii: bool, centers: bool) -> list[str]:  # type: ignore[no-untyped-def]
    a, b, _ = PLANES[plane]
    assert cut.center is not None
    first, last = (math.atan2(p[b] - cut.center[b], p[a] - cut.center[a]) for p in (at, cut.end))
    sweep = (last - first) * (1.0 if cut.code == 3 else -1.0) % (2.0 * math.pi)
    if radii and 0.2 < sweep < 2.8:
        return ["R" + number(math.hypot(at[a] - cut.center[a], at[b] - cut.center[b]))]
    return ["IJK"[axis] + number(cut.center[axis] - (0.0 if centers else at[axis])) for axis in sorted((a, b))]


def _machine(rng: Random, dialect: str) -> Machine:
    feedback = str(rng.choice(["none", "motor"]))
    lag = float(rng.choice([0.5e-3, 2e-3, 5e-3, 10e-3, 25e-3])) if feedback == "motor" else 0.0
    axes = {}
    for name in "XYZ":
        push = float(10.0 ** rng.uniform(math.log10(0.3), math.log10(3.0)))
        flank = str(rng.choice(["+", "-", "unknown", "unknown", "unknown"]))
        reference = str(rng.choice(["both", "both", "both", "+", "-"]))
        axes[name] = Axis(
            name=name,
            feedback=feedback,
            servo=Servo(b=(0.5 * lag / rng.uniform(0.6, 1.6)) ** 2, c=lag),
            gap=Gap(lost_motion=float(10.0 ** rng.uniform(-5.0, -4.0)), initial_flank=flank),
            limits=Limits(velocity=float(rng.choice([0.06, 0.1, 0.15])), acceleration=push, jerk=100.0 * push),
            uncertainty=Uncertainty(backlash=0.2),
            reference_direction="-" if name == "Z" and rng.random() < 0.5 else reference,
            gravity_side="-" if name == "Z" and rng.random() < 0.15 else None,
        )
    settings = PlannerSettings()
    if dialect == "marlin" and rng.random() < 0.5:
        settings = PlannerSettings(jerk=float(rng.choice([0.005, 0.01])))
    return Machine(name="bench", dialect=dialect, servo_period=1e-3, axes=axes, planner=settings, digest=16 * "5")
