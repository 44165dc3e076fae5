"""Read what a new machine file can take from a controller's own settings.

Taken is only what an interview would ask for: speed and acceleration by axis, the servo period, the backlash that
LinuxCNC takes back itself, and the gains of its `pid`. Sources: Grbl 1.1's table of settings ($110 to $112 [mm/min],
$120 to $122 [mm/s²]); LinuxCNC's INI configuration ([AXIS_L] and [JOINT_N] MAX_VELOCITY, MAX_ACCELERATION and BACKLASH
in [TRAJ] LINEAR_UNITS and seconds, [EMCMOT] SERVO_PERIOD [ns], and the gains of its pid, P, I, D, FF0, FF1, FF2,
DEADBAND and MAX_OUTPUT, pid(9)); its HAL files, in which a net joins joint.N.motor-pos-cmd to the command of a pid.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import msgspec

from ph_post.errors import InputError
from ph_post.files.storage import SourceText
from ph_post.types import MACHINE_AXES
from ph_post.units import INCH, MINUTE, MM, MS, PERCENT

_GRBL: Final = re.compile(r"^\s*\$(1[12][012]?)\s*=\s*([0-9.]+)", re.MULTILINE)
_GRBL_PLANNER: Final = {"11": "junction_deviation_mm", "12": "arc_tolerance_mm"}
_STARTUP: Final = re.compile(r"G64\s*P\s*([0-9.]+)", re.IGNORECASE)
_SECTION: Final = re.compile(r"\s*\[\s*(\w+)\s*\]")
_ENTRY: Final = re.compile(r"\s*(\w+)\s*=\s*([^#;]*)")
_HAL: Final = re.compile(r"^\s*setp\s+(\S+)\.([PID]gain|FF[012]|deadband|maxoutput)\s+(\S+)", re.MULTILINE | re.I)
_NET: Final = re.compile(r"^\s*net\s+(\S+)\s+(.+)$", re.MULTILINE)
_COMMANDED: Final = re.compile(r"(?:joint|axis)\.([0-2])\.(?:motor-)?pos-cmd")
_PID: Final = ("P", "I", "D", "FF0", "FF1", "FF2", "DEADBAND", "MAX_OUTPUT")
_PID_PINS: Final = {"pgain": "P", "igain": "I", "dgain": "D", "maxoutput": "MAX_OUTPUT"} | {
    key.lower(): key for key in _PID[3:7]
}
_INCHES: Final = ("inch", "in", "imperial")
_NS_IN_MS: Final = 1e6
_INCLUDES: Final = "a file that includes others, which are not read"

Ini = Mapping[tuple[str, str], str]


class ControllerSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Settings by axis in mm/s, mm/s² and mm; the servo period in ms, None where it is not given.

    `planner` are keys of ``[controller]`` in a machine file, with their values; `gains` those of cascades, by name and
    axis, in the units of the questions of an interview. `notes` say what of them is left out.
    """

    dialect: str
    speed: Mapping[str, float]
    acceleration: Mapping[str, float]
    lost_motion: Mapping[str, float]
    servo_period: float | None = None
    planner: Mapping[str, float] = {}
    gains: Mapping[str, Mapping[str, float]] = {}
    notes: tuple[str, ...] = ()


def controller_settings(text: SourceText) -> ControllerSettings:
    """Read the settings of a controller.

    Raises
    ------
    InputError
        Where it is neither of the two, or a number in it is none.
    """
    found = _GRBL.findall(text.text)
    if found:
        return _grbl(found, text.name)
    if _HAL.search(text.text):
        return _hal(text)
    ini = dict(_entries(text.text))
    if any(section in ("TRAJ", "EMCMOT") for section, _ in ini):
        return _linuxcnc(ini, text)
    raise InputError(
        text.name,
        "no settings of a controller",
        expected="a listing of Grbl's $$, or LinuxCNC's .ini or .hal file",
        got=_INCLUDES if "#INCLUDE" in text.text else "",
    )


def _grbl(found: list[tuple[str, str]], name: str) -> ControllerSettings:
    numbers = {key: _number(value, f"{name}: ${key}") for key, value in found}
    return ControllerSettings(
        dialect="grbl",
        speed={axis: numbers[f"11{k}"] / MINUTE for k, axis in enumerate(MACHINE_AXES) if f"11{k}" in numbers},
        acceleration={axis: numbers[f"12{k}"] for k, axis in enumerate(MACHINE_AXES) if f"12{k}" in numbers},
        lost_motion={},
        planner={key: numbers[number] for number, key in _GRBL_PLANNER.items() if number in numbers},
    )


def _linuxcnc(ini: Ini, text: SourceText) -> ControllerSettings:
    unit = INCH / MM if ini.get(("TRAJ", "LINEAR_UNITS"), "mm").lower() in _INCHES else 1.0
    letters = ini.get(("TRAJ", "COORDINATES"), "XYZ").upper().replace(" ", "")
    places = {axis: (f"AXIS_{axis}", f"JOINT_{letters.index(axis)}") for axis in MACHINE_AXES if axis in letters}

    def taken(key: str) -> dict[str, float]:
        """Return the smaller of what axis and joint allow, by axis."""
        found = {}
        for axis, sections in places.items():
            numbers = [_number(ini[one, key], f"{text.name}: [{one}] {key}") for one in sections if (one, key) in ini]
            if numbers:
                found[axis] = min(numbers) * unit
        return found

    there = {section for section, _ in ini}
    for axis, (own, joint) in places.items():
        if not there & {own, joint}:
            raise InputError(
                text.name,
                f"no [{joint}] and no [{own}], which {axis} needs",
                expected=f"one of them, with MAX_VELOCITY and MAX_ACCELERATION, or [TRAJ] COORDINATES without {axis}",
                got=_INCLUDES if "#INCLUDE" in text.text else "",
            )
    gains, notes = _pid_gains(_pids_of(ini, places, text.name), unit)
    period = ini.get(("EMCMOT", "SERVO_PERIOD"))
    mode = _STARTUP.search(ini.get(("RS274NGC", "RS274NGC_STARTUP_CODE"), ""))
    return ControllerSettings(
        dialect="linuxcnc",
        speed=taken("MAX_VELOCITY"),
        acceleration=taken("MAX_ACCELERATION"),
        lost_motion=taken("BACKLASH"),
        servo_period=None if period is None else _number(period, f"{text.name}: [EMCMOT] SERVO_PERIOD") / _NS_IN_MS,
        planner={} if mode is None else {"path_tolerance_mm": float(mode[1]) * unit},
        gains=gains,
        notes=notes,
    )


Pid = Mapping[str, float]
"""Gains of one of LinuxCNC's pid by their names in an INI file, and MAX_VELOCITY where it is known."""


def _pids_of(ini: Ini, places: Mapping[str, tuple[str, str]], name: str) -> dict[str, Pid]:
    """Take the gains that an INI file keeps for its HAL files, of the joint or else of the axis."""
    return {
        axis: {
            key: _number(ini[one, key], f"{name}: [{one}] {key}")
            for one in sections
            for key in (*_PID, "MAX_VELOCITY")
            if (one, key) in ini
        }
        for axis, sections in places.items()
    }


def _hal(text: SourceText) -> ControllerSettings:
    """Take the gains that a HAL file sets, of the pid of each axis."""
    pids: dict[str, dict[str, str]] = {}
    for pid, pin, value in _HAL.findall(text.text):
        pids.setdefault(pid, {})[pin] = value
    found = {
        axis: {
            _PID_PINS[pin.lower()]: _set_number(value, f"{text.name}: {pid}.{pin}") for pin, value in pids[pid].items()
        }
        for axis, pid in _axes_of_pids(text, list(pids)).items()
    }
    gains, notes = _pid_gains(found, 1.0)
    return ControllerSettings(dialect="linuxcnc", speed={}, acceleration={}, lost_motion={}, gains=gains, notes=notes)


def _set_number(text: str, where: str) -> float:
    if text.startswith("["):
        raise InputError(where, "the number stands in the INI file", expected="that file", got=text)
    return _number(text, where)


def _axes_of_pids(text: SourceText, pids: Sequence[str]) -> dict[str, str]:
    """Find the pid of each axis: the one that its joint commands, or else the one with its letter or number as name.

    An axis may have another one for its velocity, and a spindle or a torch one of its own.
    """
    signals: dict[str, list[str]] = {}
    for signal, pins in _NET.findall(text.text):
        signals.setdefault(signal, []).extend(pins.replace("=>", " ").replace("<=", " ").split())
    claims = [
        (MACHINE_AXES[int(joint[1])], pid)
        for pins in signals.values()
        for joint in map(_COMMANDED.fullmatch, pins)
        for pid in pids
        if joint and f"{pid}.command" in pins
    ]
    if not claims:
        letters = {pid: re.search(r"(?:^|[._-])([xyz0-2])(?:$|[._-])", pid.lower()) for pid in pids}
        claims = [
            (MACHINE_AXES[int(one[1])] if one[1].isdigit() else one[1].upper(), pid)
            for pid, one in letters.items()
            if one
        ]
    found: dict[str, str] = {}
    for axis, pid in claims:
        if found.setdefault(axis, pid) != pid:
            raise InputError(
                text.name,
                f"two pids of {axis}, {found[axis]} and {pid}",
                expected=f"a net from joint.{MACHINE_AXES.index(axis)}.motor-pos-cmd to the command of one of them",
            )
    return found


def _pid_gains(pids: Mapping[str, Pid], unit: float) -> tuple[dict[str, dict[str, float]], tuple[str, ...]]:
    """Turn pids whose output is the speed of a drive into gains of a cascade, by name and axis, and notes.

    Of P e + D ė + FF1 Ẋ + FF2 Ẍ the drive takes 1 + D off its speed: all of it is divided by that. The integrator of
    the position and FF0 have no place in a cascade.
    """
    gains: dict[str, dict[str, float]] = {}
    notes = []
    for axis, pid in pids.items():
        own = pid.get("P", 0.0)
        if own <= 0.0:
            if "P" in pid:
                notes.append(f"{axis}: P of its pid is {own:g}, which holds no position: its gains are left out")
            continue
        if 0.0 < pid.get("MAX_OUTPUT", 0.0) < pid.get("MAX_VELOCITY", 0.0):
            notes.append(f"{axis}: MAX_OUTPUT is below MAX_VELOCITY: pid's output is no speed, its gains are left out")
            continue
        notes += [f"{axis}: {key} of its pid is left out, a cascade has none" for key in ("I", "FF0") if pid.get(key)]
        whole = 1.0 + pid.get("D", 0.0)
        found = {
            "position_gain": own / whole,
            "feedforward": (pid.get("FF1", 0.0) + pid.get("D", 0.0)) / whole / PERCENT,
            "acceleration_lead": pid.get("FF2", 0.0) / whole / MS,
            "deadband": pid.get("DEADBAND", 0.0) * unit,
        }
        for key, value in found.items():
            if value or key == "position_gain":
                gains.setdefault(key, {})[axis] = value
    return gains, tuple(notes)


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
