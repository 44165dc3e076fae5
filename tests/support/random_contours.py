"""Random contours with cutter compensation: lines, arcs, corners of every kind, moves of Z and orders between them."""

import math


def contour(rng, name):
    """Lines of a contour from G41.1 or G42.1 to G40, from and to the program's zero."""
    lines = [f"(contour {name})", "G0 X0 Y0 Z5", f"{rng.choice(['G41.1', 'G42.1'])} D{rng.choice([1, 2, 4, 6])}"]
    x, y, heading = 0.0, 0.0, rng.uniform(0.0, math.tau)
    for number in range(rng.randint(3, 11)):
        heading += rng.choice([0.0, 0.0, rng.uniform(-3.0, 3.0), rng.uniform(-1.0, 1.0), math.pi / 2, -math.pi / 2])
        kind = rng.random()
        if kind < 0.6 or (number == 0 and kind < 0.9):
            length = rng.uniform(1.0, 30.0) if number else rng.uniform(4.0, 20.0)
            x, y = x + length * math.cos(heading), y + length * math.sin(heading)
            word = "G0" if rng.random() < 0.1 else "G1"
            lines.append(f"{word} X{x:.6f} Y{y:.6f}{_further(rng)}")
        elif kind < 0.93:
            radius, sense = rng.uniform(0.6, 20.0), rng.choice([1, -1])
            sweep = math.tau if rng.random() < 0.1 else rng.uniform(0.1, 6.0)
            i, j = -radius * sense * math.sin(heading), radius * sense * math.cos(heading)
            from_center = math.atan2(-j, -i) + sense * sweep
            center = f"I{i:.6f} J{j:.6f}"
            if rng.random() < 0.3 and sweep < 6.0 and abs(sweep - math.pi) > 0.1:
                center = f"R{math.copysign(radius, math.pi - sweep):.6f}"
            if sweep < math.tau:
                x, y = x + i + radius * math.cos(from_center), y + j + radius * math.sin(from_center)
            lines.append(f"G{3 if sense > 0 else 2} X{x:.6f} Y{y:.6f} {center}{_further(rng)}")
            heading += sense * sweep
        else:
            lines.append(rng.choice(["M8", "M9", "F500", "M3 S1000", "G1 Z-1", "G0 Z1", "G4 P0.5", "M5"]))
    return [*lines, *rng.choice([["G40"], ["G40 G1 X-50"], ["G40 G0 Z20"], ["G40", "F300"]]), "G1 X100", "G0 Z9"]


def _further(rng):
    """Words of other axes and feeds, on one block in four."""
    words = ["", f" Z{rng.uniform(-3.0, 3.0):.3f}", f" F{rng.randint(100, 900)}", f" A{rng.randint(0, 90)}"]
    return rng.choices(words, (12, 2, 1, 1))[0]
