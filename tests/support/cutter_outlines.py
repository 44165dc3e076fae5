"""Random outlines of pockets and parts with cutter compensation, whose corners are sharp, rounded or chamfered."""

from __future__ import annotations

import numpy as np

FANUC = """%
O1011
G21 G17 G90 G40 G54
G00 X-20. Y-20. Z5.
G01 Z-2. F150.
G41 D01 X0. Y-10. F300.
Y30.
X40.
Y0.
X-10.
G40 X-20. Y-20.
G00 Z5.
M30
%
"""
"""A contour of straight lines whose radius is in the control's table."""


def outline(rng):
    """Program for LinuxCNC with a cutter of a random radius on a rectangle or an L, and that radius [mm]."""
    w, h = rng.uniform(15.0, 60.0), rng.uniform(15.0, 60.0)
    corners = [(0, 0), (w, 0), (w, h), (0, h)]
    if rng.random() < 0.5:
        corners = [(0, 0), (w, 0), (w, 0.5 * h), (0.55 * w, 0.5 * h), (0.55 * w, h), (0, h)]
    left_turning = rng.random() < 0.5
    if not left_turning:
        corners = [corners[0], *corners[:0:-1]]
    corners, side, radius = np.array(corners, dtype=float), rng.choice((1, -1)), rng.uniform(0.5, 6.0)
    begin, end = corners[:2]
    along = (end - begin) / np.linalg.norm(end - begin)
    middle = begin + (end - begin) * rng.uniform(0.3, 0.6)
    beside = side * np.array([-along[1], along[0]])
    onto = middle + beside * rng.uniform(8.0, 14.0) - along * rng.choice([0.0, rng.uniform(1.0, 6.0)])
    lines = [f"G4{1 if side > 0 else 2}.1 D{2.0 * radius:.3f} G1 {_words(middle)} F400"]
    for n in range(1, len(corners) + 1):
        before, here, behind = (corners[(n + k) % len(corners)] for k in (-1, 0, 1))
        lines += _corner(rng, before, here, behind, radius if (side > 0) == left_turning else None)
    last = middle + along * rng.choice([0.0, 2.0])
    off = last + beside * rng.uniform(8.0, 14.0) + along * rng.choice([0.0, rng.uniform(1.0, 6.0)])
    head = ["G21 G90 G17 G64 P0.01", f"G0 {_words(onto)} Z5", "G1 Z-1 F200"]
    return "\n".join([*head, *lines, f"G1 {_words(last)}", f"G40 G1 {_words(off)}", "G0 Z5", "M2", ""]), radius


def _corner(rng, before, here, behind, inside):
    """Lines of a corner; one that is rounded `inside` leaves room for the radius."""
    into, out = ((b - a) / np.linalg.norm(b - a) for a, b in ((before, here), (here, behind)))
    kind = rng.choice(("sharp", "rounded", "chamfered"))
    size = min(rng.uniform(1.0, 5.0) if inside is None else rng.uniform(inside + 0.3, inside + 2.0), 5.5)
    if kind == "sharp" or (inside is not None and size < inside + 0.2):
        return [f"G1 {_words(here)}"]
    first, second = here - size * into, here + size * out
    if kind == "chamfered":
        return [f"G1 {_words(first)}", f"G1 {_words(second)}"]
    turn = into[0] * out[1] - into[1] * out[0]
    i, j = size * np.sign(turn) * np.array([-into[1], into[0]])
    return [f"G1 {_words(first)}", f"G{3 if turn > 0.0 else 2} {_words(second)} I{i:.4f} J{j:.4f}"]


def _words(place):
    return f"X{place[0]:.4f} Y{place[1]:.4f}"


def round_outline(rng):
    """Program for LinuxCNC with `G41 D1` or G42 on a rounded polygon, about which axes turn in arcs, and its least arc.

    The tool comes onto a side on an arc that touches it, and leaves on another, as CAM systems have it. The least arc
    is of those about whose inside the tool is [mm].
    """
    count, left_turning, side = rng.choice((2, 3, 4, 5)), rng.random() < 0.5, rng.choice((1, -1))
    size, quarter = rng.uniform(18.0, 45.0), rng.choice((0.0, 0.5, 1.0, 1.5)) * np.pi
    angles = 2.0 * np.pi * np.arange(count) / count + np.array([rng.uniform(-0.3, 0.3) for _ in range(count)])
    # The side onto which the tool comes is along an axis.
    angles += quarter - (0.5 * (angles[0] + angles[1]) if left_turning else 0.5 * (angles[-1] + angles[-2]))
    centers = size * np.column_stack([np.cos(angles), np.sin(angles)])
    radii = [rng.uniform(3.0, 14.0)] * count
    turn = 1 if left_turning else -1
    centers = centers if left_turning else centers[::-1]
    inside = (side > 0) == left_turning
    # Sides touch all arcs from outside: parallel to the lines between centres.
    ways = np.roll(centers, -1, axis=0) - centers
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    beside = turn * np.column_stack([ways[:, 1], -ways[:, 0]])
    first = [c + r * n for c, r, n in zip(centers, radii, beside, strict=True)]
    last = [c + r * n for c, r, n in zip(np.roll(centers, -1, axis=0), radii, beside, strict=True)]
    near = rng.uniform(1.5, 4.0)
    middle, tool = 0.5 * (first[0] + last[0]), side * np.array([-ways[0][1], ways[0][0]])
    onto, off = middle + near * (tool - ways[0]), middle + near * (tool + ways[0])
    lines = [f"G4{1 if side > 0 else 2} D1 G1 {_words(onto)} F400", _arc(onto, middle, middle + near * tool, side)]
    for n in range(count):
        lines.append(f"G1 {_words(last[n])}")
        following = (n + 1) % count
        lines.append(_arc(last[n], first[following], centers[following], turn))
    lines += [f"G1 {_words(middle)}", _arc(middle, off, middle + near * tool, side)]
    begin, end = (place + near * (tool + k * 0.3 * ways[0]) for place, k in ((onto, -1), (off, 1)))
    head = ["G21 G90 G17 G64 P0.01", f"G0 {_words(begin)} Z5", "G1 Z-1 F200"]
    text = "\n".join([*head, *lines, f"G40 G1 {_words(end)}", "G0 Z5", "M2", ""])
    return text, min(near, radii[0]) if inside else near


def _arc(start, end, center, turn):
    i, j = center - start
    return f"G{3 if turn > 0 else 2} {_words(end)} I{i:.4f} J{j:.4f}"
