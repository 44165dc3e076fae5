"""Words that firmware knows, from its own documents and from nothing in ph_post, and how printers read.

Grbl 1.1: the list "Supported G-Codes in v1.1" of its wiki and README, and `LINE_BUFFER_SIZE` 80. grblHAL: the
lists of its README, and gcode.c for G84. Marlin 2: `gcode.cpp`, words that depend on no build option but
ARC_SUPPORT (on by default) and BACKLASH_GCODE (of which the program says that it may be missing),
`MAX_CMD_SIZE` 96. Klipper: docs/G-Codes.md without optional sections, and `cmd_G21` of gcode_move.py.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np


def _listed(words: str) -> list[str]:
    return words.split()


GRBL = frozenset(
    _listed(
        "G0 G1 G2 G3 G38.2 G38.3 G38.4 G38.5 G80 G4 G10 G28 G30 G28.1 G30.1 G53 G92 G92.1 G93 G94 G20 G21 G90"
        " G91 G91.1 G17 G18 G19 G43.1 G49 G40 G54 G55 G56 G57 G58 G59 G61 M0 M2 M30 M3 M4 M5 M8 M9"
    )
)
GRBLHAL = GRBL | frozenset(
    _listed(
        "G5 G5.1 G33 G43 G43.2 G50 G51 G73 G76 G81 G82 G83 G84 G85 G86 G89 G95 G96 G97 G98 G99 G7 G8 M1 M6 M7"
        " M60 M61 M62 M63 M64 M65 M66 M67 M68"
    )
)
MARLIN = {
    "G0": "XYZEF",
    "G1": "XYZEF",
    "G2": "XYZEFIJR",
    "G3": "XYZEFIJR",
    "G4": "PS",
    "G21": "",
    "G28": "XYZ",
    "G90": "",
    "G91": "",
    "G92": "XYZE",
    "M17": "",
    "M18": "",
    "M84": "",
    "M114": "",
    "M119": "",
    "M201": "XYZE",
    "M203": "XYZE",
    "M204": "PRTS",
    "M205": "XYZEJS",
    "M220": "S",
    "M400": "",
    "M425": "FSXYZ",
}
KLIPPER = {
    "G0": "XYZEF",
    "G1": "XYZEF",
    "G4": "P",
    "G21": "",
    "G28": "XYZ",
    "G90": "",
    "G91": "",
    "G92": "XYZE",
    "M18": "",
    "M82": "",
    "M83": "",
    "M84": "",
    "M114": "",
    "M204": "SPT",
    "M220": "S",
    "M221": "S",
    "M400": "",
}
LINES = {"grbl": 79, "grblhal": 255, "marlin": 95, "klipper": 10**6}
"""Longest line that each takes, without its end."""

_WORD = re.compile(r"([A-Z])([-+]?(?:\d+\.?\d*|\.\d+))")
_PRINTERS = {"marlin": MARLIN, "klipper": KLIPPER}


class RefusedError(Exception):
    """A line that the firmware would not execute as it is meant."""


def commands(line: str, firmware: str) -> list[tuple[str, dict[str, float]]]:
    """Commands of a line, each with its parameters: none of a comment."""
    if len(line) > LINES[firmware]:
        raise RefusedError(f"{len(line)} characters: {line}")
    if not line.isascii() or not line.isprintable() or any(c in line for c in "!?~%"):
        raise RefusedError(f"a character that is obeyed or not taken: {line}")
    if firmware in _PRINTERS:
        return _printer_command(line, firmware)
    text = re.sub(r"\([^()]*\)", "", line).replace(" ", "")
    if _WORD.sub("", text):
        raise RefusedError(f"no words: {line}")
    known = GRBL if firmware == "grbl" else GRBLHAL
    found = [letter + str(float(number)).removesuffix(".0") for letter, number in _WORD.findall(text)]
    codes = [word for word in found if word[0] in "GM"]
    if unknown := [word for word in codes if word not in known]:
        raise RefusedError(f"unknown {unknown[0]}: {line}")
    letters = [word[0] for word in found if word[0] not in "GM"]
    spline = "Q" if firmware == "grblhal" else ""
    if len(set(letters)) < len(letters) or not set(letters) <= set("XYZFIJKLNPRST" + spline):
        raise RefusedError(f"a letter twice, or one that is not taken: {line}")
    return [(word, {}) for word in codes]


def _printer_command(line: str, firmware: str) -> list[tuple[str, dict[str, float]]]:
    """Return the one command of a line: its first word, the rest are parameters."""
    text = line.split(";", 1)[0].strip()
    if not text:
        return []
    words = text.split(" ")
    if any(not _WORD.fullmatch(word) for word in words):
        raise RefusedError(f"no words: {line}")
    known = _PRINTERS[firmware]
    if words[0] not in known:
        raise RefusedError(f"unknown {words[0]}: {line}")
    letters = [word[0] for word in words[1:]]
    if len(set(letters)) < len(letters) or not set(letters) <= set(known[words[0]]):
        raise RefusedError(f"parameters that {words[0]} does not have: {line}")
    return [(words[0], {word[0]: float(word[1:]) for word in words[1:]})]


@dataclass
class Trip:
    """What printer firmware does: where each move ends (n, 3), at which F, and the dwells [s]."""

    ends: np.ndarray
    feeds: list[float]
    arcs: list[tuple[float, float]]
    dwells: list[float]


def travel(text: str, firmware: str) -> Trip:
    """Run a program of printer firmware; lengths in mm, X, Y and Z from 0. Arcs have to fit their ends."""
    place, feed, absolute = np.zeros(3), 0.0, True
    trip = Trip(ends=np.zeros((0, 3)), feeds=[], arcs=[], dwells=[])
    ends = []
    for line in text.splitlines():
        for word, given in commands(line, firmware):
            if word in ("G90", "G91"):
                absolute = word == "G90"
            elif word == "G4":
                milliseconds = given.get("P", 0.0)
                if firmware == "marlin" and milliseconds != int(milliseconds):
                    raise RefusedError(f"a part of a millisecond: {line}")
                trip.dwells.append(given["S"] if "S" in given else milliseconds / 1e3)
            elif word in ("G0", "G1", "G2", "G3"):
                feed = given.get("F", feed)
                if feed <= 0.0:
                    raise RefusedError(f"no F: {line}")
                target = np.array(
                    [given.get(axis, here if absolute else 0.0) for axis, here in zip("XYZ", place, strict=True)]
                )
                target = target if absolute else place + target
                if word in ("G2", "G3"):
                    center = place[:2] + np.array([given.get("I", 0.0), given.get("J", 0.0)])
                    radii = [float(np.hypot(*(point[:2] - center))) for point in (place, target)]
                    trip.arcs.append((radii[0], radii[1]))
                place = target
                ends.append(place)
                trip.feeds.append(feed)
    trip.ends = np.array(ends)
    return trip
