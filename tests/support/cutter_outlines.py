"""Random outlines of pockets and parts with cutter compensation, whose corners are sharp, rounded or chamfered."""

from __future__ import annotations

import numpy as np


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
