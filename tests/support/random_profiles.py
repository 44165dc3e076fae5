"""Programs of LinuxCNC with a turning cycle over a random profile: lines and arcs, with and without pockets."""

from __future__ import annotations

import math
import random

CYCLES = ("G70", "G71", "G71", "G71.1", "G71.2", "G72", "G72", "G72.1", "G72.2")
RADIUS = {2: -1, 3: 1}


def turned_program(seed: int) -> str:
    """Return a program with one cycle, whose profile is a subprogram; not each is one that LinuxCNC accepts."""
    draw = random.Random(seed)
    grid = draw.choice((0.0, 0.5, 0.5, 1.0, 0.1, 0.25))
    cycle = draw.choice(CYCLES)
    faces = draw.random() < 0.5 if cycle == "G70" else cycle.startswith("G72") != (draw.random() < 0.15)
    across, along = draw.random() < 0.5, draw.random() < 0.5
    begin, pieces = _profile(draw, grid)

    def placed(place: complex) -> complex:
        """Return a place of the profile in one of the eight positions that it may have on a lathe."""
        place = complex(place.imag, place.real) if faces else place
        return complex(-place.real if along else place.real, -place.imag if across else place.imag)

    changed = ((across != along) != faces, draw.random() < 0.3, draw.random() < 0.2)
    return _written(draw, cycle, placed(begin), [(kind, placed(a), placed(b)) for kind, a, b in pieces], changed)


def _profile(draw: random.Random, grid: float) -> tuple[complex, list[tuple[int, complex, complex]]]:
    """Return where a cycle begins, and motions with ends and centres, z + i·x, to lower z and mostly to higher x."""

    def even(value: float) -> float:
        return round(value / grid) * grid if grid else value

    pockets = draw.random() < 0.5
    at = complex(even(draw.uniform(0, 5)), even(draw.uniform(0, 8)))
    top = even(at.imag + draw.uniform(2, 12))
    begin = complex(at.real + even(draw.uniform(0, 2)), top)
    pieces = [(draw.choice((0, 1)), at, 0j)]
    for _ in range(draw.randint(1, 7)):
        if draw.random() < 0.55:
            step = complex(-even(draw.uniform(0, 6)), even(draw.uniform(-3 if pockets else 0, 4)))
            level = draw.random()
            at += step.real if level < 0.25 else complex(0, step.imag) if level < 0.45 else step
            pieces.append((1, at, 0j))
            continue
        radius, kind = even(draw.uniform(0.5, 4)) or 1.0, draw.choice((2, 3))
        first = draw.choice((0.0, 0.0, 90.0, draw.uniform(0, 120)))
        last = min(180.0, first + draw.choice((90.0, draw.uniform(10, 60))))
        whole = pockets and draw.random() < 0.2
        ends = [_around(angle * RADIUS[kind], radius) for angle in ((0.0, 180.0) if whole else (first, last))]
        center = at - ends[0]
        at = center + ends[1]
        pieces.append((kind, at, center))
    if draw.random() < 0.75:
        pieces.append((1, complex(at.real, max(top, at.imag + 1.0)), 0j))
    return begin, pieces


def _around(degrees: float, radius: float) -> complex:
    angle = math.radians(degrees)
    return radius * complex(round(math.cos(angle), 12), round(math.sin(angle), 12))


def _written(
    draw: random.Random,
    cycle: str,
    begin: complex,
    pieces: list[tuple[int, complex, complex]],
    changed: tuple[bool, bool, bool],
) -> str:
    mirrored, diameters, absolute = changed
    factor = 2.0 if diameters else 1.0

    def xz(place: complex) -> str:
        return f"X{place.imag * factor:.9f} Z{place.real:.9f}"

    corners = draw.random() < 0.3
    lines, at = [], begin
    for number, (kind, end, center) in enumerate(pieces):
        if kind < 2:
            lines.append(f"G{kind} {xz(end)}")
        else:
            sense = 5 - kind if mirrored else kind
            to = center if absolute else center - at
            by_radius = draw.random() < 0.2 and abs(end - at) < 1.9 * abs(at - center)
            how = f"R{abs(at - center):.9f}" if by_radius else f"I{to.imag:.9f} K{to.real:.9f}"
            lines.append(f"G{sense} {xz(end)} {how}")
        if corners and number < len(pieces) - 1 and draw.random() < 0.4:
            lines[-1] += f" {draw.choice('AC')}{draw.choice((0.1, 0.3, 0.5))}"
        at = end
    words = [cycle, "Q100"]
    if draw.random() < 0.5:
        words.append(f"D{draw.choice((0.2, 0.5, draw.uniform(0, 1))):.6f}")
    step = f"I{draw.choice((0.5, 1, 0.7, draw.uniform(0.2, 2))):.6f} R{draw.choice((0, 0.3, 0.5, 1))}"
    words.append(f"E{draw.choice((0, 0.1))} P{draw.choice((1, 2, 3))}" if cycle == "G70" else step)
    goes = draw.random() < 0.7
    words += [xz(begin), "F200"] if goes else []
    head = ["G21 G90 G18", "G7" if diameters else "G8", "G90.1" if absolute else "G91.1", f"F100 G0 {xz(begin)}"]
    return "\n".join([*head, "o100 sub", *lines, "o100 endsub", " ".join(words), "G0 X50 Z50", "M2", ""])
