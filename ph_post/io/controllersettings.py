"""What a controller's own settings say of a machine: a listing of Grbl's ``$$``, or LinuxCNC's .ini file.

Taken are only what an interview would ask for: speed and acceleration by axis, the servo period, the backlash
that LinuxCNC takes back itself. Sources: Grbl 1.1's table of settings ($110 to $112 [mm/min], $120 to $122
[mm/s²]); LinuxCNC's INI configuration ([AXIS_L] and [JOINT_N] MAX_VELOCITY, MAX_ACCELERATION and BACKLASH in
[TRAJ] LINEAR_UNITS and seconds, [EMCMOT] SERVO_PERIOD [ns]).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from typing import Final

import msgspec

from ph_post.errors import InputError
from ph_post.io.source import Source
from ph_post.units import INCH, MINUTE, MM

_GRBL: Final = re.compile(r"^\s*\$(1[12][012])\s*=\s*([0-9.]+)", re.MULTILINE)
_SECTION: Final = re.compile(r"\s*\[\s*(\w+)\s*\]")
_ENTRY: Final = re.compile(r"\s*(\w+)\s*=\s*([^#;]*)")
_AXES: Final = ("X", "Y", "Z")
_INCHES: Final = ("inch", "in", "imperial")
_NS_IN_MS: Final = 1e6

Ini = Mapping[tuple[str, str], str]


class ControllerSettings(msgspec.Struct, frozen=True, kw_only=True):
    """What was found: by axis in mm/s, mm/s² and mm; the servo period in ms, None where it is not said."""

    dialect: str
    speed: Mapping[str, float]
    acceleration: Mapping[str, float]
    lost_motion: Mapping[str, float]
    servo_period: float | None = None


def controller_settings(text: Source) -> ControllerSettings:
    """Read the settings of a controller.

    Raises
    ------
    InputError
        Where it is neither of the two, or a number in it is none.
    """
    found = _GRBL.findall(text.text)
    if found:
        return _grbl(found, text.name)
    ini = dict(_entries(text.text))
    if any(section in ("TRAJ", "EMCMOT") for section, _ in ini):
        return _linuxcnc(ini, text.name)
    included = "#INCLUDE" in text.text
    raise InputError(
        text.name, "no settings of a controller", expected="a listing of Grbl's $$, or LinuxCNC's .ini file",
        got="a file that includes others, which are not read" if included else "",
    )  # fmt: skip


def _grbl(found: list[tuple[str, str]], name: str) -> ControllerSettings:
    numbers = {key: _number(value, f"{name}: ${key}") for key, value in found}
    return ControllerSettings(
        dialect="grbl",
        speed={axis: numbers[f"11{k}"] / MINUTE for k, axis in enumerate(_AXES) if f"11{k}" in numbers},
        acceleration={axis: numbers[f"12{k}"] for k, axis in enumerate(_AXES) if f"12{k}" in numbers},
        lost_motion={},
    )


def _linuxcnc(ini: Ini, name: str) -> ControllerSettings:
    unit = INCH / MM if ini.get(("TRAJ", "LINEAR_UNITS"), "mm").lower() in _INCHES else 1.0
    letters = ini.get(("TRAJ", "COORDINATES"), "XYZ").upper().replace(" ", "")
    places = {axis: (f"AXIS_{axis}", f"JOINT_{letters.index(axis)}") for axis in _AXES if axis in letters}

    def taken(key: str) -> dict[str, float]:
        """Return the smaller of what axis and joint allow, by axis."""
        found = {}
        for axis, sections in places.items():
            numbers = [
                _number(ini[one, key], f"{name}: [{one}] {key}") for one in sections if (one, key) in ini
            ]
            if numbers:
                found[axis] = min(numbers) * unit
        return found

    period = ini.get(("EMCMOT", "SERVO_PERIOD"))
    return ControllerSettings(
        dialect="linuxcnc",
        speed=taken("MAX_VELOCITY"),
        acceleration=taken("MAX_ACCELERATION"),
        lost_motion=taken("BACKLASH"),
        servo_period=None
        if period is None
        else _number(period, f"{name}: [EMCMOT] SERVO_PERIOD") / _NS_IN_MS,
    )


def _entries(text: str) -> Iterator[tuple[tuple[str, str], str]]:
    """Yield section, key and value of every line that has them, in its order: the last one counts."""
    section = ""
    for line in text.splitlines():
        if head := _SECTION.match(line):
            section = head[1].upper()
        elif entry := _ENTRY.match(line):
            yield (section, entry[1].upper()), entry[2].strip()


def _number(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(where, "no number", expected="a number", got=repr(text))
    return value
