"""Parts written out in the manners of CAM systems, by the rules of their published post-processors, and of slicers.

What is taken from those is how lines look: heads and ends, decimals, blanks, what is repeated. The parts are our own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple


class Step(NamedTuple):
    """A step of a part: `kind` 0 for the way to its beginning through the air, 1 a line, 2 and 3 arcs; `to` [mm]."""

    kind: int
    to: tuple[float, float]
    center: tuple[float, float] | None = None


Part = Sequence[Step]


def _island(x: float, y: float, wide: float, radius: float) -> list[Step]:
    high = 2.0 * radius
    return [
        Step(0, (x, y)),
        Step(1, (x + wide, y)),
        Step(3, (x + wide, y + high), (x + wide, y + radius)),
        Step(1, (x, y + high)),
        Step(3, (x, y), (x, y + radius)),
    ]


def _ring(x: float, y: float, radius: float) -> list[Step]:
    return [
        Step(0, (x + radius, y)),
        Step(3, (x - radius, y), (x, y)),
        Step(3, (x + radius, y), (x, y)),
    ]


def _chords(x: float, y: float, radius: float, count: int) -> list[Step]:
    angles = [math.tau * k / count for k in range(count + 1)]
    points = [(round(x + radius * math.cos(a), 3), round(y + 0.7 * radius * math.sin(a), 3)) for a in angles]
    return [Step(0, points[0]), *(Step(1, point) for point in points[1:])]


def _zigzag(wide: float, pitch: float, rows: int) -> list[Step]:
    found = [Step(0, (0.0, 0.0))]
    for row in range(rows):
        found.append(Step(1, (wide if row % 2 == 0 else 0.0, pitch * row)))
        found.append(Step(1, (found[-1].to[0], pitch * (row + 1))))
    return found


PARTS: dict[str, Part] = {
    "island": _island(5.0, 5.0, 40.0, 12.0) + _island(12.0, 11.0, 26.0, 6.0),
    "rings": _ring(30.0, 30.0, 22.0) + _ring(30.0, 30.0, 15.5) + _ring(70.0, 25.0, 8.25),
    "ellipses": _chords(25.0, 20.0, 18.0, 72) + _chords(25.0, 20.0, 11.0, 60),
    "zigzag": _zigzag(60.0, 4.0, 8),
}
"""Parts by name."""


def _arc_words(at: tuple[float, float], step: Step, text: Callable[[float], str]) -> str:
    assert step.center is not None
    return f"I{text(step.center[0] - at[0])} J{text(step.center[1] - at[1])}"


def _cut(part: Part, text: Callable[[float], str], rapid: str, down: Sequence[str], up: Sequence[str], feed: str):
    """Lines of a part: `down` behind each way through the air, `up` before the next one, `feed` with the first cut."""
    lines, at, first = [], (0.0, 0.0), True
    for number, step in enumerate(part):
        words = f"X{text(step.to[0])} Y{text(step.to[1])}"
        if step.kind == 0:
            lines += [*(up if number else ()), f"{rapid} {words}", *down]
            first = True
        else:
            more = "" if step.kind == 1 else " " + _arc_words(at, step, text)
            lines.append(f"G{step.kind} {words}{more}" + (f" F{feed}" if first else ""))
            first = False
        at = step.to
    return [*lines, *up]


def _fixed(decimals: int) -> Callable[[float], str]:
    return lambda value: f"{value + 0.0:.{decimals}f}"


def _short(value: float) -> str:
    """Write a number with its point and no zeros behind it, as Fusion's and Mastercam's posts do."""
    text = f"{value:.3f}".rstrip("0")
    return "0." if text in ("-0.", "0.") else text


def fusion(part: Part) -> str:
    """Fusion 360 for Grbl."""
    body = _cut(part, _short, "G0", ["G0 Z5.", "G1 Z-1. F300."], ["G0 Z15."], "800.")
    head = [
        "(1001)",
        "(T1 D=3. CR=0. - ZMIN=-1. - FLAT END MILL)",
        "G90 G94",
        "G17",
        "G21",
        "",
        "(2D CONTOUR1)",
        "S5000 M3",
    ]
    return "\n".join([*head, "G54", "G0 Z15.", *body, "M5", "G28 G91 Z0.", "G90", "M30", ""])


def mastercam(part: Part) -> str:
    """Mastercam for Fanuc, with its line numbers."""
    body = _cut(part, _short, "G0", ["Z2.", "G1 Z-1. F200."], ["G0 Z25."], "600.")
    head = ["G21", "G0 G17 G40 G49 G80 G90", "T1 M6", "G0 G90 G54 X0. Y0. S3500 M3", "G43 H1 Z25."]
    lines = [*head, *body, "M5", "G91 G28 Z0.", "G28 X0. Y0.", "M30"]
    return "\n".join(["%", "O0100(PART)", *(f"N{100 + 2 * k} {line}" for k, line in enumerate(lines)), "%", ""])


def vcarve(part: Part) -> str:
    """VCarve for Mach, without blanks."""
    body = _cut(part, _fixed(4), "G0", ["G1Z-1.0000F300.0"], ["G0Z5.0000"], "1000.0")
    head = [
        "( Part )",
        "( File created: by hand )",
        "( Tool number 1 )",
        "G00G21G17G90G40G49G80",
        "T1M06",
        "G00G43Z20.0000H1",
    ]
    tail = ["G00Z20.0000", "G00X0.0000Y0.0000", "M09", "M30", "%", ""]
    lines = [*head, "S12000M03", "G94", "X0.0000Y0.0000F1000.0", *(line.replace(" ", "") for line in body), *tail]
    return "\n".join(lines)


def estlcam(part: Part) -> str:
    """Estlcam, which writes every word on every line."""
    body = _cut(part, _fixed(4), "G00", ["G01 Z-1.0000 F300 S24000"], ["G00 Z5.0000"], "900 S24000")
    return "\n".join(
        ["(Project part)", "(Created by Estlcam)", "", "M03 S24000", "G00 Z5.0000", *body, "M05", "M30", ""]
    )


def easel(part: Part) -> str:
    """Easel, with a feed on every cut."""
    body = _cut(part, _fixed(3), "G0", ["G1 Z-0.800 F228.6"], ["G1 Z3.810 F228.6"], "609.6")
    body = [f"{line} F609.6" if line[:2] in ("G1", "G2", "G3") and "F" not in line else line for line in body]
    return "\n".join(
        ["G21", "M3 S12000", "G90", "G1 Z3.810 F228.6", *body, "G4 P0.1", "M5", "G0 X0.000 Y0.000", "G4 P0.1", ""]
    )


def gcodetools(part: Part) -> str:
    """Gcodetools of Inkscape, six decimals and comments on the lines."""
    down = ["G01 Z-1.000000 F100.0(Penetrate)"]
    body = _cut(part, _fixed(6), "G00", down, ["G00 Z5.000000"], "400.000000")
    head = ["%", "(Header)", "(Generated by gcodetools from Inkscape.)", "M3", "(Header end.)", "G21 (All units in mm)"]
    return "\n".join(
        [*head, "G00 Z5.000000", "(Start cutting path id: path10)", *body, "(Footer)", "M5", "M2", "%", ""]
    )


def pcb2gcode(part: Part) -> str:
    """Pcb2gcode, with its tolerance in G64."""
    down = ["G01 Z-0.10000 F100.00000", "G04 P0 ( dwell for no time -- G64 should not smooth over this point )"]
    body = _cut(part, _fixed(5), "G00", down, ["G00 Z2.00000 ( retract )"], "300.00000")
    head = ["( pcb2gcode )", "( Software-independent Gcode )", "", "G94 ( Millimeters per minute feed rate. )"]
    head += ["G21 ( Units == Millimeters. )", "G90 ( Absolute coordinates. )", "G64 P0.01000 ( set maximum deviation )"]
    return "\n".join([*head, "S10000 ( RPM spindle speed. )", "M3", *body, "M5", "M9", "M2", ""])


def lightburn(part: Part) -> str:
    """LightBurn for Grbl: a beam whose power follows the speed, and no Z."""
    body = _cut(part, _fixed(3), "G0", [], [], "1200S400")
    head = [
        "; LightBurn",
        "; GRBL device profile, absolute coords",
        "G00 G17 G40 G21 G54",
        "G90",
        "M4",
        "; Cut @ 1200 mm/min",
    ]
    return "\n".join(
        [*head, "M8", *(line.replace(" ", "") for line in body), "M9", "G1S0", "M5", "G90", "G0X0Y0", "M2", ""]
    )


def _layers(part: Part, down: str, relative: bool) -> list[str]:
    """Two layers of lines with filament; arcs are left out, as slicers write chords."""
    lines, filament = [], 0.0
    for layer in range(2):
        lines += [f";LAYER:{layer}", f"G1 Z{0.2 * (layer + 1):.3f} F7800"]
        at, first = (0.0, 0.0), True
        for step in part:
            if step.kind == 0:
                lines.append(f"G1 X{step.to[0]:.3f} Y{step.to[1]:.3f} F7800")
                first = True
            else:
                own = 0.033 * math.dist(at, step.to)
                filament += own
                feed = " F1800" if first else ""
                lines.append(f"G1 X{step.to[0]:.3f} Y{step.to[1]:.3f}{feed} E{own if relative else filament:.5f}")
                first = False
            at = step.to
    return [*lines, down]


def prusa(part: Part) -> str:
    """PrusaSlicer's manner: relative filament."""
    head = ["; generated by a slicer", "M73 P0 R1", "G21", "G90", "M83", "M104 S215", "M190 S60", "G28 W", "G92 E0.0"]
    return "\n".join([*head, *_layers(part, "G1 Z10 F720", True), "M104 S0", "M84", ""])


def cura(part: Part) -> str:
    """Cura's manner: absolute filament."""
    head = [";FLAVOR:Marlin", ";Generated with Cura_SteamEngine", "M140 S60", "M105", "M82", "G28", "G92 E0"]
    return "\n".join([*head, "G1 F2700 E-5", "M107", *_layers(part, "G91", False), "G1 Z10", "G90", "M84 X Y E", ""])


CAM = {
    "fusion": (fusion, "grbl"),
    "mastercam": (mastercam, "fanuc"),
    "vcarve": (vcarve, "grbl"),
    "estlcam": (estlcam, "grbl"),
    "easel": (easel, "grbl"),
    "gcodetools": (gcodetools, "linuxcnc"),
    "pcb2gcode": (pcb2gcode, "linuxcnc"),
    "lightburn": (lightburn, "grbl"),
}
"""Writers of parts by CAM system, and the controller that each is for."""

SLICED = ("ellipses", "zigzag")
"""Parts without arcs."""
