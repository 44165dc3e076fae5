"""Named parameters that the interpreter fills itself."""

from __future__ import annotations

from typing import Final

from ph_post.expand.machine import AXES, MachineState
from ph_post.expand.offsets import WorkOffsets
from ph_post.expand.values import UNKNOWN

_GROUPS: Final = {
    "_metric": ("units", 210),
    "_imperial": ("units", 200),
    "_absolute": ("distance", 900),
    "_incremental": ("distance", 910),
    "_inverse_time": ("feed_mode", 930),
    "_units_per_minute": ("feed_mode", 940),
    "_units_per_rev": ("feed_mode", 950),
    "_retract_r_plane": ("retract", 990),
    "_retract_old_z": ("retract", 980),
    "_spindle_rpm_mode": ("spindle_mode", 970),
    "_spindle_css_mode": ("spindle_mode", 960),
    "_ijk_absolute_mode": ("centres", 901),
    "_lathe_diameter_mode": ("diameter", 70),
    "_lathe_radius_mode": ("diameter", 80),
}
"""Names that tell whether a mode holds."""

_NOT_KNOWN: Final = (
    *("_tool_offset", "_speed_override", "_feed_override", "_adaptive_feed", "_feed_hold", "_remap_level", "_task"),
    *("_current_pocket", "_selected_pocket"),
)


class NamedValues:
    """Looks up named parameters of the interpreter; `value` and `returned` are those of the last subprogram.

    Parameters
    ----------
    machine : MachineState
    """

    def __init__(self, machine: MachineState) -> None:
        self._machine = machine
        self.offsets: WorkOffsets | None = None
        self.line = 0
        self.value, self.returned = 0.0, False
        self.levels = 0

    def place(self, index: int) -> float:
        """Return the place of an axis, in the program's coordinates; a compensated one is that of the tool's centre."""
        return self._machine.place[AXES[index]] if self._machine.modes["cutter"] == 400 else UNKNOWN

    def look_up(self, name: str) -> float | None:
        """Return a parameter, NaN where it is not known, None where there is none of that name."""
        if not name.startswith("_"):
            return None
        machine = self._machine
        if name in _GROUPS:
            group, code = _GROUPS[name]
            return UNKNOWN if machine.modes[group] == 0 else float(machine.modes[group] == code)
        if name in _NOT_KNOWN or name.startswith(("_ini[", "_hal[")):
            return UNKNOWN
        if len(name) == 2 and name[1] in AXES:
            return self.place(AXES.index(name[1]))
        if name.startswith("_abs_") and len(name) == 6 and name[5] in AXES and self.offsets is not None:
            return self.place(AXES.index(name[5])) + self.offsets.total(name[5])
        found: dict[str, float] = {
            "_line": float(self.line),
            "_motion_mode": float(machine.motion),
            "_plane": float(machine.modes["plane"]),
            "_ccomp": float(machine.modes["cutter"]),
            "_coord_system": float(machine.modes["system"]),
            "_spindle_on": float(machine.spindle != 0),
            "_spindle_cw": float(machine.spindle == 3),
            "_mist": float(machine.mist),
            "_flood": float(machine.flood),
            "_feed": machine.feed,
            "_rpm": abs(machine.speed),
            "_current_tool": machine.tool,
            "_selected_tool": machine.selected,
            "_value": self.value,
            "_value_returned": float(self.returned),
            "_call_level": float(self.levels),
            "_vmajor": UNKNOWN,
            "_vminor": UNKNOWN,
            "_metric_machine": UNKNOWN,
        }
        return found.get(name)
