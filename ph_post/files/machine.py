"""Keys of a machine file (TOML), and edits of its text that leave all else as a person wrote it.

The keys are in the shop's units; :mod:`ph_post.drive.machinefile` makes a machine of them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, MutableMapping, Sequence
from typing import Annotated, Any, Final, Literal, NamedTuple

import msgspec
import tomlkit
from tomlkit.items import AoT, Item, Table

from ph_post.types import (
    FURTHER_AXES,
    LOOPS,
    ByAxis,
    EffectSetting,
    Feedback,
    GravitySide,
    Loop,
    ReferenceDirection,
    Tool,
)
from ph_post.units import MM, MS

DIGITS: Final = 7
"""Significant digits of a number that is written."""

_MINE: Final = re.compile(r"^#\s*\+- [^;]*(?:;\s*)?")
"""The beginning of a comment that an earlier change has put behind a number."""


_WAS: Final = "was "
"""What the comment of a value that is no longer there begins with."""


class EffectChange(msgspec.Struct, frozen=True, kw_only=True):
    """A change of one effect of an axis.

    `place` is its number in the file, None for one that is added; `setting` is what it becomes, None where it
    is taken out. `comments` stand behind its parameters, by key, `above` are the lines above it.
    """

    place: int | None
    setting: EffectSetting | None
    comments: Mapping[str, str] = {}
    above: tuple[str, ...] = ()


class AxisChange(msgspec.Struct, frozen=True, kw_only=True):
    """Changes of one axis.

    `keys` are new values by key of ``[axes.AXIS]`` ("control.KEY" of the table below it), None where a key is
    taken out. `comments` stand behind them, by key; `above` are the lines above the first of them.
    """

    axis: str
    keys: Mapping[str, float | str | None] = {}
    comments: Mapping[str, str] = {}
    above: tuple[str, ...] = ()
    effects: tuple[EffectChange, ...] = ()


def edit_axes(original: str, changes: Sequence[AxisChange]) -> str:
    """Change axes of a machine file; comments, order and layout of all else stay.

    Parameters
    ----------
    original : str
        A machine file that can be read.
    changes : sequence of AxisChange

    Returns
    -------
    str
        Numbers are written with seven significant digits.
    """
    text = original.replace("\r\n", "\n")
    for change in changes:
        text = _with_keys(text, change)
        text = _with_effects(text, change)
    return text.replace("\n", "\r\n") if "\r\n" in original else text


def written(value: float | str) -> float | str:
    """Return a value as it is written.

    Examples
    --------
    >>> written(0.0123456789), written("contact")
    (0.01234568, 'contact')
    """
    return value if isinstance(value, str) else float(f"{value:.{DIGITS}g}")


class Row(NamedTuple):
    """A key of a machine file, its value, and the comment behind it; `assumed` if nobody measured or answered it."""

    key: str
    value: Any
    comment: str = ""
    assumed: bool = False

    def line(self, column: int = 0) -> str:
        """Return the row as TOML, its comment at `column`, or two blanks behind the value."""
        text = f"{self.key} = {_literal(self.value)}"
        return f"{text.ljust(column - 2)}  # {self.comment}\n" if self.comment else f"{text}\n"


def machine_document(
    head: Sequence[str],
    name: str,
    controller: Sequence[Row],
    axes: Mapping[str, Sequence[Row | str]],
    column: int = 0,
) -> str:
    """Return the text of a new machine file.

    Parameters
    ----------
    head : sequence of str
        Lines of the comment at its top.
    name : str
        Name of the machine.
    controller : sequence of Row
        Keys of ``[controller]``.
    axes : mapping of str to sequence of Row or str
        Keys of each ``[axes.AXIS]``; a str is a comment on a line of its own.
    column : int, optional
        Where comments behind a value begin; without it two blanks behind the value.
    """
    tables = {"controller": controller} | {f"axes.{axis}": rows for axis, rows in axes.items()}
    text = _lines(head) + Row("name", name).line()
    for title, rows in tables.items():
        lines = [_lines([row]) if isinstance(row, str) else row.line(column) for row in rows]
        text += f"\n[{title}]\n" + "".join(lines)
    return text


def _with_keys(text: str, change: AxisChange) -> str:
    """Set the keys that the file has where they stand, and add the others behind them."""
    document = tomlkit.parse(text)
    axis: Any = document["axes"][change.axis]
    above, added = change.above, {}
    for key, value in change.keys.items():
        table, last = _table_of(axis, key)
        if value is None:
            if table is not None:
                table.pop(last, None)
        elif table is None or last not in table:
            added[key] = value
        else:
            _set(table, last, value, change.comments.get(key, ""), above)
            above = ()
    text = tomlkit.dumps(document)
    for key, value in added.items():
        text = _with_new_key(text, change, key, value, above)
        above = ()
    return text


def _table_of(axis: Any, key: str) -> tuple[Any, str]:
    """Return the table that a key belongs to, None where there is none, and the key in it."""
    *tables, last = key.split(".")
    for name in tables:
        axis = axis.get(name) if axis is not None else None
    return axis, last


def _set(
    table: MutableMapping[str, Any], key: str, value: float | str, comment: str, above: Sequence[str] = ()
) -> None:
    """Set a key, keep what a person wrote behind the value that was there, and put lines above it."""
    item, before = tomlkit.item(written(value)), table[key]
    if isinstance(before, Item):
        # What stands around the old one goes over to the new one as it takes its place.
        kept = _MINE.sub("", before.trivia.comment).lstrip("# ")
        if kept and not kept.startswith(_WAS) and item.as_string() != before.as_string():
            kept = f"{_WAS}{before.as_string()}: {kept}"
        words = "; ".join(part for part in (comment, kept) if part)
        if words:
            item.trivia.comment_ws = before.trivia.comment_ws or "  "
            item.trivia.comment = f"# {words}"
        if above and "\n" in before.trivia.trail:
            before.trivia.indent = _lines(above, before.trivia.indent) + before.trivia.indent
    table[key] = item


def _with_new_key(text: str, change: AxisChange, key: str, value: float | str, above: Sequence[str]) -> str:
    """Add a key behind the last one of its table."""
    *tables, last = key.split(".")
    own = _section(text, ("axes", change.axis, *tables))
    end, name = own or _section(text, ("axes", change.axis)), last if own else key
    if end is None:  # an inline table, or dotted keys
        document = tomlkit.parse(text)
        table: Any = document["axes"][change.axis]
        for part in tables:
            table = table.setdefault(part, tomlkit.inline_table())
        table[last] = written(value)
        return tomlkit.dumps(document)
    comment = change.comments.get(key, "")
    return _inserted(text, end, _lines(above) + Row(name, value, comment).line())


def _with_effects(text: str, change: AxisChange) -> str:
    """Change and take out effects where they stand, then add the others behind the axis' last line."""
    document = tomlkit.parse(text)
    axis: Any = document["axes"][change.axis]
    effects = axis.get("effects")
    gone = []
    for one in change.effects:
        if one.place is not None and one.setting is not None:
            _reset(effects[one.place], one)
        elif one.place is not None:
            gone.append(one.place)
    for place in sorted(gone, reverse=True):
        del effects[place]
    if gone and not effects:
        del axis["effects"]
        effects = None
    added = [one for one in change.effects if one.place is None and one.setting is not None]
    inline = (effects is not None and not isinstance(effects, AoT)) or _end(text, change.axis) is None
    if added and inline:
        _append_inline(axis, added)
        return tomlkit.dumps(document)
    text = tomlkit.dumps(document)
    for one in added:
        text = _inserted(text, _end(text, change.axis) or 0, _effect_lines(change.axis, one))
    return text


def _reset(table: Any, change: EffectChange) -> None:
    """Give an effect that stands in the file other parameters."""
    assert change.setting is not None
    parameters = change.setting.parameters
    for key in [key for key in table if key != "name" and key not in parameters]:
        del table[key]
    for key, value in parameters.items():
        if key not in table:
            table[key] = value if isinstance(value, list) else written(value)
        elif table[key] != value:
            _set(table, key, value, change.comments.get(key, ""))
    if isinstance(table, Table):
        table.trivia.indent = _lines(change.above, table.trivia.indent) + table.trivia.indent


def _append_inline(axis: Any, added: Sequence[EffectChange]) -> None:
    if "effects" not in axis:
        axis["effects"] = tomlkit.array()
    for one in added:
        assert one.setting is not None
        table = tomlkit.inline_table()
        table["name"] = one.setting.name
        for key, value in one.setting.parameters.items():
            table[key] = value if isinstance(value, list) else written(value)
        axis["effects"].append(table)


def _effect_lines(axis: str, change: EffectChange) -> str:
    assert change.setting is not None
    rows = [Row("name", change.setting.name)]
    rows += [Row(key, value, change.comments.get(key, "")) for key, value in change.setting.parameters.items()]
    lines = (row.line() for row in rows)
    return "\n" + _lines(change.above) + f"[[axes.{axis}.effects]]\n" + "".join(lines)


def _literal(value: Any) -> str:
    return tomlkit.item(value if isinstance(value, list) else written(value)).as_string()


def _lines(comments: Sequence[str], indent: str = "") -> str:
    margin = indent.rpartition("\n")[2] if not indent.strip() else ""
    return "".join(f"{margin}# {line}\n" for line in comments)


def _header(path: Sequence[str], *, below: bool) -> re.Pattern[str]:
    """Match the header of a table, or of one below it."""
    keys = r"\s*\.\s*".join(rf"(?:{key}|\"{key}\"|'{key}')" for key in path)
    end = r"[.\]]" if below else r"\]"
    return re.compile(rf"\s*\[\[?\s*{keys}\s*{end}")


def _section(text: str, path: Sequence[str], *, below: bool = False) -> int | None:
    """Return the line behind the last key of a table that has a header, None where there is no header.

    What comes after that key, blank lines and comments, belongs to the next table.
    """
    pattern, inside, end = _header(path, below=below), False, None
    for number, line in enumerate(text.split("\n")):
        if line.lstrip().startswith("["):
            inside = pattern.match(line) is not None
        if inside and line.strip() and not line.lstrip().startswith("#"):
            end = number + 1
    return end


def _end(text: str, axis: str) -> int | None:
    """Return the line behind the last key of an axis, the tables below it included."""
    return _section(text, ("axes", axis), below=True)


def _inserted(text: str, line: int, what: str) -> str:
    lines = text.split("\n")
    before = "\n".join(lines[:line]) + "\n"
    return before + what + "\n".join(lines[line:])


Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]
Fraction01 = Annotated[float, msgspec.Meta(gt=0, lt=1)]
Relative = Annotated[float, msgspec.Meta(ge=0, lt=1)]


class MachineTableRecord(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of the tables of a machine file: a key that is not known is refused."""


class ControllerRecord(MachineTableRecord, frozen=True, kw_only=True):
    """``[controller]``: what it reads, how often it commands, and its planner's settings, each of some dialects."""

    dialect: str
    servo_period_ms: Annotated[float, msgspec.Meta(ge=0.001, le=1000)]
    junction_deviation_mm: NotNegative | None = None
    arc_tolerance_mm: Annotated[float, msgspec.Meta(ge=1e-6)] | None = None
    square_corner_velocity_mm_s: NotNegative | None = None
    arc_resolution_mm: Annotated[float, msgspec.Meta(ge=1e-3)] | None = None
    max_accel_to_decel: Positive | None = None  # mm/s², by Klipper's own name
    jerk_mm_s: Positive | None = None
    arc_segment_mm: Annotated[float, msgspec.Meta(ge=1e-3)] | None = None
    path_tolerance_mm: NotNegative | None = None
    dwell_step_ms: Annotated[float, msgspec.Meta(ge=0, le=10_000)] | None = None
    tool: Tool | None = None
    own_backlash_correction: Annotated[float, msgspec.Meta(ge=0, le=1)] | None = None


PLANNER_KEYS: Final[Mapping[str, tuple[str, float]]] = {
    "junction_deviation": ("junction_deviation_mm", MM),
    "arc_tolerance": ("arc_tolerance_mm", MM),
    "square_corner_velocity": ("square_corner_velocity_mm_s", MM),
    "arc_resolution": ("arc_resolution_mm", MM),
    "max_accel_to_decel": ("max_accel_to_decel", MM),
    "jerk": ("jerk_mm_s", MM),
    "arc_segment": ("arc_segment_mm", MM),
    "path_tolerance": ("path_tolerance_mm", MM),
    "dwell_step": ("dwell_step_ms", MS),
}
"""Key of ``[controller]`` and its unit in SI, by the field of :class:`ph_post.types.planner.PlannerSettings`."""


Bandwidth = Annotated[float, msgspec.Meta(gt=0, le=1e5)]
Weight = Annotated[float, msgspec.Meta(ge=0, le=200)]
Late = Annotated[float, msgspec.Meta(ge=0, le=1000)]


class ControlRecord(MachineTableRecord, frozen=True, kw_only=True):
    """``[axes.X.control]``: the gains of a PI or PID loop, relative to the proportional gain, or those of a cascade."""

    structure: Literal["single", "cascade"] = "single"
    ki_over_kp_per_s: NotNegative = 0.0
    kd_over_kp_s: NotNegative = 0.0
    # a cascade: its loops
    position_gain_per_s: Bandwidth | None = None
    position_gain_m_per_min_mm: Bandwidth | None = None
    velocity_gain_per_s: Bandwidth | None = None
    velocity_integral_time_ms: Annotated[float, msgspec.Meta(gt=0, le=1e5)] | None = None
    velocity_feedback: Literal["motor", "load"] | None = None
    current_bandwidth_hz: Annotated[float, msgspec.Meta(ge=1, le=1e5)] | None = None
    deadband_mm: NotNegative = 0.0
    # what goes before them
    velocity_feedforward_percent: Weight = 0.0
    acceleration_feedforward_percent: Weight = 0.0
    acceleration_lead_ms: Annotated[float, msgspec.Meta(ge=-1000, le=1000)] = 0.0
    dead_time_ms: Late = 0.0
    moving_average_ms: Late = 0.0
    exponential_filter_ms: Late = 0.0
    zv_frequency_hz: Annotated[float, msgspec.Meta(ge=0.5, le=1e4)] | None = None
    zv_damping: Annotated[float, msgspec.Meta(ge=0, lt=1)] = 0.0


SINGLE_KEYS: Final = ("ki_over_kp_per_s", "kd_over_kp_s")
"""Keys of ``[axes.X.control]`` that a cascade has not."""

CASCADE_KEYS: Final = tuple(name for name in ControlRecord.__struct_fields__ if name not in ("structure", *SINGLE_KEYS))
"""Keys of ``[axes.X.control]`` that only a cascade has."""


class AxisRecord(MachineTableRecord, frozen=True, kw_only=True):
    """``[axes.X]``.

    Physical constants may be given under a name that carries the unit or, in SI units, under the paper's
    symbol: J, B, k_p, k_a, k_t, N, r. The rest has one name.
    """

    feedback: Feedback
    # Eq. (9), or the physical constants it is made of
    b: Annotated[float, msgspec.Meta(ge=0, le=100)] | None = None
    c: Annotated[float, msgspec.Meta(ge=0, le=100)] | None = None
    inertia_kg_m2: Positive | None = None
    J: Positive | None = None
    damping_kg_m2_s: Positive | None = None
    B: Positive | None = None
    position_gain_v_per_m: Positive | None = None
    k_p: Positive | None = None
    amplifier_gain_a_per_v: Positive | None = None
    k_a: Positive | None = None
    torque_constant_n_m_per_a: Positive | None = None
    k_t: Positive | None = None
    servo_stiffness_n_per_mm: Positive | None = None
    # transmission
    gear_ratio: Positive | None = None
    N: Positive | None = None
    travel_per_rad_mm: Positive | None = None
    screw_lead_mm: Positive | None = None
    r: Positive | None = None
    # the gap, and the motor alone in it
    backlash_motor_rad: NotNegative | None = None
    lost_motion_mm: Annotated[float, msgspec.Meta(ge=0, le=100)] | None = None
    inertia_fraction: Fraction01 | None = None
    motor_time_constant_s: Positive | None = None
    pickup: Literal["standstill", "momentum", "contact"] | None = None
    initial_flank: Literal["+", "-", "unknown"] = "unknown"
    reference_direction: ReferenceDirection | None = None
    gravity_side: GravitySide | None = None
    backlash_uncertainty: Relative = 0.2
    beta_uncertainty: Relative = 0.2
    gain_uncertainty: Relative = 0.2
    friction_uncertainty: Relative = 0.2
    # limits
    max_velocity_mm_s: Annotated[float, msgspec.Meta(ge=1e-3, le=1e6)]
    max_acceleration_mm_s2: Annotated[float, msgspec.Meta(ge=1e-2, le=1e9)]
    max_jerk_mm_s3: Annotated[float, msgspec.Meta(ge=1e-2, le=1e12)]
    max_motor_acceleration_rad_s2: Positive | None = None
    control: ControlRecord | None = None
    effects: list[dict[str, Any]] = []

    @property
    def loop(self) -> Loop:
        """The loop by the name that `feedback` gives it."""
        return LOOPS[self.feedback]


class FurtherRecord(MachineTableRecord, frozen=True, kw_only=True):
    """What a rotary axis and a further linear one have in common."""

    feedback: Feedback
    b: Annotated[float, msgspec.Meta(ge=0, le=100)] = 0.0
    c: Annotated[float, msgspec.Meta(ge=0, le=100)] = 0.0
    reference_direction: ReferenceDirection = "both"
    backlash_uncertainty: Relative = 0.2


class RotaryRecord(FurtherRecord, frozen=True, kw_only=True):
    """``[axes.A]``, ``B`` and ``C``."""

    lost_motion_deg: Annotated[float, msgspec.Meta(ge=0, le=45)]
    max_velocity_deg_s: Annotated[float, msgspec.Meta(ge=1e-3, le=1e6)]
    max_acceleration_deg_s2: Annotated[float, msgspec.Meta(ge=1e-2, le=1e9)]
    max_jerk_deg_s3: Annotated[float, msgspec.Meta(ge=1e-2, le=1e12)] = 1e12


class SlideRecord(FurtherRecord, frozen=True, kw_only=True):
    """``[axes.U]``, ``V`` and ``W``."""

    lost_motion_mm: Annotated[float, msgspec.Meta(ge=0, le=100)]
    max_velocity_mm_s: Annotated[float, msgspec.Meta(ge=1e-3, le=1e6)]
    max_acceleration_mm_s2: Annotated[float, msgspec.Meta(ge=1e-2, le=1e9)]
    max_jerk_mm_s3: Annotated[float, msgspec.Meta(ge=1e-2, le=1e12)] = 1e12


class AxesRecord(ByAxis[AxisRecord], frozen=True, kw_only=True, forbid_unknown_fields=True):
    """``[axes]``."""

    A: RotaryRecord | None = None
    B: RotaryRecord | None = None
    C: RotaryRecord | None = None
    U: SlideRecord | None = None
    V: SlideRecord | None = None
    W: SlideRecord | None = None

    def further(self) -> dict[str, RotaryRecord | SlideRecord]:
        """Return the axes beside X, Y and Z that are given."""
        found = {axis: getattr(self, axis) for axis in FURTHER_AXES}
        return {axis: record for axis, record in found.items() if record is not None}


class MachineRecord(MachineTableRecord, frozen=True, kw_only=True):
    """The whole file."""

    name: str | None = None
    controller: ControllerRecord
    axes: AxesRecord
