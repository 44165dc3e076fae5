"""Records of motion that was simulated or measured: runs, their events, and logs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import msgspec

from ph_post.types.arrays import Array, BoolArray
from ph_post.types.machine import Scenario

EventKind = Literal["opens", "picks up", "falls back", "sticks", "slips", "saturates", "recovers", "chatters"]


class Event(msgspec.Struct, frozen=True, kw_only=True):
    """Event inside an axis at `t` [s].

    The gap `opens`; the motor `picks up` the table on the other side, or `falls back` on the old one; the
    table `sticks` and `slips` where there is friction; the motor's torque `saturates` and `recovers`; an axis
    `chatters` where more happens within a sample than is followed.
    """

    t: float
    axis: str
    kind: EventKind


class Run(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A simulated motion, one row a sample, SI units.

    `commanded`, `executed` and `motor` [m], shape (n, dimension): `executed` is the table, `motor` the
    motor's side in units of the table; they differ by at most half the gap, referred to its middle. `s` [m]
    is where on the path the command stands.
    """

    axes: tuple[str, ...]
    period: float
    scenario: Scenario
    t: Array
    s: Array
    commanded: Array
    executed: Array
    motor: Array
    events: tuple[Event, ...]


LogSide = Literal["table", "unknown"]
EffortUnit = Literal["N", "A"]


class AxisLog(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Log of one axis, a value a sample, shape (n,); NaN where a sample is missing.

    `command` [m], never NaN; `table` [m] (`_act`) and `motor` [m] (`_motor`, in units of the table); `effort`
    in `effort_unit`, the force on the table or the motor's current. None where there is no such column.
    `side` is "unknown" where nobody knows whether `table` was read at the table or at the motor.
    """

    command: Array
    table: Array | None = None
    motor: Array | None = None
    effort: Array | None = None
    effort_unit: EffortUnit = "N"
    side: LogSide = "table"


class Log(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A measured or simulated record at a constant period [s]; `t` [s] begins where the record does.

    `remarks` are its ``# key: value`` lines; `digest` is the hash of the bytes it was read from; `jitter` [s]
    is the largest departure of a sample from the constant period, `missing` how many rows were filled in as
    missing; `warnings` say what the reader had to do. Of an excerpt `windows` are the times [s] of the record
    that it holds, and `counted` (n,) marks its samples, None for all: the others join the windows.
    """

    name: str
    t: Array
    period: float
    axes: Mapping[str, AxisLog]
    digest: str = ""
    jitter: float = 0.0
    missing: int = 0
    remarks: Mapping[str, str] = {}
    warnings: tuple[str, ...] = ()
    windows: tuple[tuple[float, float], ...] = ()
    counted: BoolArray | None = None
