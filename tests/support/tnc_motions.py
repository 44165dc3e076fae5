"""Motions of a conversational program, by a small interpreter of its own: dense places of the motors [mm].

It follows L, CC, C, CR and CP with places, angles and increments, F, FMAX, FQ with FN 0 and cycle 9, and
passes over everything else, up to M2, M30 or END PGM. Nothing is shared with ph_post.
"""

from __future__ import annotations

import math
import re

import numpy as np

from .sinumerik_motions import STEP, Played, turn

_PLACE = re.compile(r"(I?)([XYZ])([-+]?\d*\.?\d+)")


class TncRun(Played):
    """A conversational program, played."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.functions: list[str] = []
        self._pole, self._feed = np.zeros(3), 1000.0
        self._axes = [0, 1]
        self._known: dict[str, float] = {}
        self._unit = 25.4 if re.search(r"^\s*\d*\s*BEGIN PGM .* IN(?:CH)?\s*$", text, re.MULTILINE) else 1.0
        for line in text.splitlines():
            bare = re.sub(r"^\s*\d+\s+", "", line).split(";")[0].strip()
            bare = re.sub(r"(?<=\d),(?=\d)", ".", bare)
            if bare.startswith("END PGM"):
                break
            self._line(bare)
            if re.search(r"\bM0?(?:2|30)\b", bare):
                break

    def _line(self, line: str) -> None:
        word = line.split(" ", maxsplit=1)[0]
        if dwell := re.match(r"CYCL DEF 9\.1.*?([\d.]+)$", line):
            self.seconds += float(dwell[1])
        self.functions += re.findall(r"\bM\d+", line) if word in ("L", "C", "CR") or word[:1] == "M" else []
        if feed := re.search(r"\bF(\d+\.?\d*)", line):
            self._feed = float(feed[1])
        if given := re.match(r"FN 0: (Q\d+) =([-+\d.]+)", line):
            self._known[given[1]] = float(given[2])
        if feed := re.search(r"\bF(Q\d+)", line):
            self._feed = self._known[feed[1]]
        if word not in ("L", "C", "CR", "CC", "CP") or "M140" in line or "M91" in line:
            return
        end = self.at.copy()
        for step, axis, number in _PLACE.findall(line):
            column = "XYZ".index(axis)
            end[column] = self._unit * float(number) + (self.at[column] if step else 0.0)
        if word == "CC":
            places = _PLACE.findall(line)
            named = {axis for _, axis, _ in places}
            self._pole = np.array([end[n] if "XYZ"[n] in named or not places else self._pole[n] for n in range(3)])
            self._axes = {"XZ": [2, 0], "YZ": [1, 2]}.get("".join(sorted(named)), [0, 1])
            return
        self._move(word, line, end)

    def _move(self, word: str, line: str, end: np.ndarray) -> None:
        begin, axes = self.at, self._axes
        a, b = begin[axes], end[axes]
        rapid = re.search(r"\bF\s*MAX\b", line) is not None
        if word == "L":
            count = max(2, math.ceil(float(np.linalg.norm(end - begin)) / STEP))
            places = begin + np.linspace(0.0, 1.0, count + 1)[1:, None] * (end - begin)
        else:
            left, center, angle = "DR+" in line, self._pole[axes], 0.0
            if word == "CR":
                found = re.search(r"\bR([-+]?\d+\.?\d*)", line)
                assert found is not None
                radius = self._unit * float(found[1])
                half = 0.5 * np.linalg.norm(b - a)
                away = math.sqrt(max(radius * radius - half * half, 0.0)) * (1 if (radius > 0) == left else -1)
                center = 0.5 * (a + b) + away * np.array([-(b - a)[1], (b - a)[0]]) / (2.0 * half)
            if steps := re.search(r"IPA([-+]?[\d.]+)", line):
                angle = math.radians(float(steps[1]))
                turned = math.atan2(*(a - center)[::-1]) + angle
                b = center + np.hypot(*(a - center)) * np.array([math.cos(turned), math.sin(turned)])
                end[axes] = b
            elif to := re.search(r"(?<!I)PA\s*([-+]?[\d.]+)", line):
                way = math.radians(float(to[1]))
                b = center + np.hypot(*(a - center)) * np.array([math.cos(way), math.sin(way)])
                end[axes] = b
                angle = turn(a - center, b - center) - (0.0 if left else math.tau)
            else:
                angle = turn(a - center, b - center)
                angle = (angle or math.tau) if left else angle - math.tau
            size = np.hypot(*(a - center))
            count = max(2, math.ceil(size * abs(angle) / STEP))
            share = np.linspace(0.0, 1.0, count + 1)[1:]
            turned = math.atan2(a[1] - center[1], a[0] - center[0]) + angle * share
            places = begin + share[:, None] * (end - begin)
            places[:, axes[0]] = center[0] + size * np.cos(turned)
            places[:, axes[1]] = center[1] + size * np.sin(turned)
            assert np.allclose(places[-1], end, atol=2e-3), line
            places[-1] = end
        self.points.append(places)
        self.cuts.append(np.full(len(places), not rapid))
        way = np.linalg.norm(np.diff(np.vstack([begin, places]), axis=0), axis=1).sum()
        self.seconds += 60.0 * way / (6000.0 if rapid else self._feed)
        self.at = end


_SPOKEN = {"G00": ("L", " FMAX"), "G01": ("L", ""), "G02": ("C", " DR-"), "G03": ("C", " DR+"), "G04": ("", "")}


def iso_run(text: str) -> TncRun:
    """Run an ISO program: each block in conversational words, by the mode that lasts."""
    lines, mode = [], "G01"
    for line in text.splitlines():
        words = re.sub(r"\s*\*\s*$|;.*", "", re.sub(r"^N\d+\s*", "", line)).split()
        mode = next((word for word in words if word in _SPOKEN and word != "G04"), mode)
        rest = " ".join(word for word in words if not re.match(r"[GST]\d", word))
        keyword, tail = _SPOKEN[mode]
        if not words or words[0].startswith("%") or {"G30", "G31"} & {*words}:
            continue
        if words[0] == "G04":
            lines.append(f"CYCL DEF 9.1 DWELL {words[1][1:]}")
        elif rest[:1] in ("I", "J"):
            lines.append("CC " + rest.replace("I", "X").replace("J", "Y"))
        elif re.match(r"M\d", rest):
            lines.append(rest)
        elif rest:
            radius = re.search(r" R[+-]", rest)
            lines.append(f"{'CR' if radius else keyword} {rest}{tail}")
    return TncRun("\n".join(lines))
