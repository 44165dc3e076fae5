"""What a program leaves the controller at: modes, offsets and the position as far as they are known."""

from __future__ import annotations

import math
from typing import Final, TypeAlias

from ph_post.expand.values import UNKNOWN

Version: TypeAlias = tuple[int, ...]
"""A version of LinuxCNC, as (2, 9, 4)."""

AXES: Final = "xyzabcuvw"
LINEAR: Final = "xyzuvw"

PLANES: Final = {170: ("x", "y", "z"), 180: ("z", "x", "y"), 190: ("y", "z", "x")}
"""First, second and third axis of G17, G18 and G19."""

GROUPS: Final = {
    "plane": (170, 180, 190, 171, 181, 191),
    "units": (200, 210),
    "distance": (900, 910),
    "centres": (901, 911),
    "feed_mode": (930, 940, 950),
    "cutter": (400, 410, 411, 420, 421),
    "length": (430, 431, 432, 490),
    "system": (540, 550, 560, 570, 580, 590, 591, 592, 593),
    "path": (610, 611, 640),
    "retract": (980, 990),
    "spindle_mode": (960, 970),
    "diameter": (70, 80),
}
"""Ten times the numbers of modal G words, by group; motions are apart."""

GROUP_OF: Final = {code: group for group, codes in GROUPS.items() for code in codes}

MOTIONS: Final = (
    *(0, 10, 20, 30, 50, 51, 52, 60, 61, 62, 330, 331, 382, 383, 384, 385, 730, 740, 760, 800),
    *(810, 820, 830, 840, 850, 860, 870, 880, 890, 700, 710, 711, 712, 720, 721, 722),
)

START: Final = {
    "plane": 170,
    "units": 0,
    "distance": 900,
    "centres": 911,
    "feed_mode": 940,
    "cutter": 400,
    "length": 490,
    "system": 540,
    "path": 0,
    "retract": 0,
    "spindle_mode": 970,
    "diameter": 80,
}
"""How LinuxCNC begins; 0 is not known, as it stays from one program to the next."""


class MachineState:
    """Modes and places.

    `place` in program coordinates and units, `offset` what the machine's coordinate has besides (work offset, G92,
    tool), NaN where it is not known. `version` is that of the controller's LinuxCNC, None where nobody said it.
    """

    def __init__(self) -> None:
        self.version: Version | None = None
        self.modes: dict[str, int] = dict(START)
        self.motion = 800
        self.place: dict[str, float] = dict.fromkeys(AXES, UNKNOWN)
        self.path_words = ""
        self.feed, self.speed = UNKNOWN, UNKNOWN
        self.spindle, self.mist, self.flood = 0, False, False
        self.selected, self.tool = UNKNOWN, UNKNOWN
        self.overrides: dict[int, bool] = {}

    def snapshot(self) -> tuple[object, ...]:
        """Return all of it, so that two equal ones are the same state."""
        places = tuple(None if math.isnan(one) else one for one in self.place.values())
        return (tuple(self.modes.values()), self.motion, places, str(self.feed), str(self.speed), self.spindle)

    @property
    def absolute(self) -> bool:
        """Whether G90 holds."""
        return self.modes["distance"] == 900

    @property
    def axes(self) -> tuple[str, str, str] | None:
        """Axes of the plane and the one across it; None in planes of U, V and W."""
        return PLANES.get(self.modes["plane"])

    def set_units(self, code: int) -> None:
        """Change between G20 and G21."""
        had = self.modes["units"]
        if had == code:
            return
        factor = UNKNOWN if had == 0 else (25.4 if code == 210 else 1.0 / 25.4)
        for axis in LINEAR:
            self.place[axis] *= factor
        self.modes["units"] = code

    def forget(self, axes: str = AXES) -> None:
        """Forget where axes are."""
        for axis in axes:
            self.place[axis] = UNKNOWN

    def factor(self, axis: str) -> float:
        """Return by what the place of an axis is multiplied in its word: X of a lathe may be a diameter."""
        return 2.0 if axis == "x" and self.modes["diameter"] == 70 else 1.0

    def target(self, words: dict[str, float]) -> dict[str, float]:
        """Return the place to which axis words lead.

        Polar words (``@`` and ``^``) are of the plane X, Y.
        """
        end = dict(self.place)
        for axis in AXES:
            if axis in words:
                value = words[axis] / self.factor(axis)
                end[axis] = value if self.absolute else end[axis] + value
        if "@" in words or "^" in words:
            end["x"], end["y"] = self._polar(words)
        return end

    def _polar(self, words: dict[str, float]) -> tuple[float, float]:
        radius, angle = math.hypot(self.place["x"], self.place["y"]), math.atan2(self.place["y"], self.place["x"])
        if self.absolute:
            radius = words.get("@", radius)
            angle = math.radians(words["^"]) if "^" in words else angle
        else:
            radius += words.get("@", 0.0)
            angle += math.radians(words.get("^", 0.0))
        return radius * math.cos(angle), radius * math.sin(angle)
