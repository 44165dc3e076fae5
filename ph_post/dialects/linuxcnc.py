"""LinuxCNC: computes in double precision, has G5, and rounds joints by as much as G64 allows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ph_post.dialects.base import (
    READ_WITH,
    Abilities,
    CubicAbility,
    Dialect,
    Notices,
    NumberFormat,
    Recording,
    Syntax,
    metric_opening,
)
from ph_post.gcode import codes
from ph_post.gcode.language import Language
from ph_post.gcode.numbers import decimal_text, to_counts
from ph_post.gcode.program import AXES
from ph_post.geometry.bernstein import basis
from ph_post.types import Array, Machine

_DECIMALS = 6
"""1 nm: below the resolution of any scale, and in the deepest dips still a small part of a block."""

_MAX_LINE = 251
"""Its interpreter reads 253 characters of a line with the end, which may be of two, and stops at a longer one."""

_USERS = [number for number in range(100, 200) if codes.M_EFFECT[number] != codes.STAYS]
"""M words that run a file of that name while the machine waits, and can be given no other meaning; the interpreter goes
on from the place where it was ("M-Codes", M100-M199; "Remap: Extending G-Code"). What the file does to the machine,
as to turn an axis back by an offset from outside, nobody knows."""

_KINEMATICS = (428, 429, 430)
"""M words by which machines with rotary axes switch their kinematics, as LinuxCNC's own configurations do ("Switchable
Kinematics"); which of them is the one in which X, Y and Z are joints is the machine's choice."""

_SPANS = 16
"""LinuxCNC plays a G5 as 16 pairs of arcs at equal steps of the parameter (its emccanon.cc)."""

_LEAST_TURN = 1e-4
"""Least turn of the tangent [rad] over one of the 16 spans. The arcs come out of a quadratic equation whose
leading coefficient is 2 (cos(turn) - 1); where that vanishes LinuxCNC up to 2.9 divides zero by zero, and
near it the root has lost its digits: its relative error is about 1e-15 / turn², 1e-7 here."""

_MOST_TURN = 0.5
"""Largest turn [rad] over one span; a span that turns more has no business in a smooth program."""

_PROBES = np.linspace(0.0, 1.0, 9)[1:-1]


def _path_mode(tolerance: float | None) -> str:
    """G61, or G64 with Q0: without it blocks of equal F are joined into one within P (NaiveCAM)."""
    if tolerance is None:
        return "G61"
    return f"G64 P{decimal_text(int(to_counts(tolerance, _DECIMALS)), _DECIMALS)} Q0"


def spline_deviation(control: Array) -> Array:
    """Return the distance [m] by which LinuxCNC's own rendering of a G5 leaves the curve.

    Parameters
    ----------
    control : Array, shape (m, 4, 2)
        Control points of cubic Béziers [m].

    Returns
    -------
    Array, shape (m,)
        Largest distance found at seven places of each of the 16 spans; infinite where the tangent turns
        too little, too much or both ways in a span, which LinuxCNC cannot be trusted with.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        knots = np.arange(_SPANS + 1) / _SPANS
        point, tangent = basis(3, knots) @ control, _unit(basis(2, knots) @ np.diff(control, axis=1))
        p0, p4, ts, te = point[:, :-1], point[:, 1:], tangent[:, :-1], tangent[:, 1:]
        turn = np.arctan2(ts[..., 0] * te[..., 1] - ts[..., 1] * te[..., 0], (ts * te).sum(-1))
        p2, tm = _biarc_joint(p0, p4, ts, te)
        places = (knots[:-1, None] + _PROBES / _SPANS).ravel()
        curve = (basis(3, places) @ control).reshape(*p0.shape[:2], _PROBES.size, 2)
        first = _distance_to_arc(curve, p0, ts, p2)
        second = _distance_to_arc(curve, p2, tm, p4)
        before = ((curve - p2[:, :, None]) * tm[:, :, None]).sum(-1) < 0
    deviation = np.where(before, first, second).max(axis=(1, 2))
    same_way = (np.sign(turn) == np.sign(turn[:, :1])).all(axis=1)
    size = np.abs(turn)
    safe = same_way & (size.min(axis=1) >= _LEAST_TURN) & (size.max(axis=1) <= _MOST_TURN)
    return np.asarray(np.where(safe, deviation, np.inf))


def _biarc_joint(p0: Array, p4: Array, ts: Array, te: Array) -> tuple[Array, Array]:
    """Return the joint of the two arcs of a span, and their direction there; names as in LinuxCNC's ``biarc``."""
    v = p0 - p4
    c = (v * v).sum(-1)
    b = 2 * (v * (ts + te)).sum(-1)
    a = 2 * ((ts * te).sum(-1) - 1)
    beta = (2 * c / (np.sqrt(np.maximum(b * b - 4 * a * c, 0.0)) - b))[..., None]
    p1, p3 = p0 + beta * ts, p4 - beta * te
    p2 = (p1 + p3) / 2
    return p2, _unit(p3 - p2)


def _distance_to_arc(points: Array, start: Array, tangent: Array, end: Array) -> Array:
    """Distance of points (…, k, 2) to the circle through `start` and `end` with `tangent` at the start."""
    chord = end - start
    normal = np.stack([-tangent[..., 1], tangent[..., 0]], axis=-1)
    radius = (chord * chord).sum(-1) / (2 * (chord * normal).sum(-1))
    center = start + radius[..., None] * normal
    offset = points - center[..., None, :]
    return np.asarray(np.abs(np.hypot(offset[..., 0], offset[..., 1]) - np.abs(radius)[..., None]))


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.hypot(vectors[..., 0], vectors[..., 1])[..., None])


MARGIN = 60.0
"""Time that is recorded beyond that of a test program [s]; a person starts one after the other."""

STORE = 10.0
"""Time that LinuxCNC's sampler holds until it is read [s]."""


def halsampler_lines(machine: Machine, axes: Sequence[str], seconds: float, name: str, gauge: bool) -> list[str]:
    """Return lines for a shell with which LinuxCNC records its joints every servo period.

    The joints are taken to be numbered as the axes are; their positions are those of the machine, not of the
    work offset. Where a gauge is read only the person who wired it knows: its pin is a word in capitals.
    """
    pins = _pins(machine, axes, gauge)
    blind = [axis for axis in axes if machine.axes[axis].loop.own_channel == "motor"]
    depth, rows = (round(span / machine.servo_period) for span in (STORE, seconds + MARGIN))
    lines = [
        "halcmd unloadrt sampler || true",
        f"halcmd loadrt sampler depth={depth} cfg={'f' * len(pins)}",
        "halcmd addf sampler.0 servo-thread",
        *(f"halcmd net {_signal(column, pin)} {pin} sampler.0.pin.{k}" for k, (column, pin) in enumerate(pins)),
        f"halsampler -t -n {rows} {name}.txt",
        "more channels: one f more in cfg, one net each, and one --column more below",
        # The sample's number is the first column.
        READ_WITH + " ".join(f"--column {column}={k}:mm" for k, (column, _) in enumerate(pins, 2)),
    ]
    if blind:
        lines.insert(
            -1,
            f"where nothing reads the table of {' or '.join(blind)}, leave out the net of its gauge and its --column:"
            " the log shows the drive, and a dial indicator the backlash (ph-post calibrate --without-log)",
        )
    return lines


def _signal(column: str, pin: str) -> str:
    """Name a signal of HAL: one that has a writer already can take no other."""
    side = "gauge" if "GAUGE" in pin else column[2:]
    return f"kit-{column[0].lower()}-{side}"


def _pins(machine: Machine, axes: Sequence[str], gauge: bool) -> list[tuple[str, str]]:
    """Columns of LinuxCNC's log, and where in HAL they come from: gauges last, which a person may have to leave out."""
    known = [axis for axis in AXES if axis in machine.axes]
    pins, gauges = [], []
    for axis in axes:
        joint = f"joint.{known.index(axis)}"
        own = machine.axes[axis].loop.own_channel
        pins.append((f"{axis}_cmd", f"{joint}.pos-cmd"))
        if own == "motor" or (own == "act" and not gauge):
            pins.append((f"{axis}_{own}", f"{joint}.pos-fb"))
        if own != "act" or gauge:
            gauges.append((f"{axis}_act", f"PIN_OF_THE_{axis}_GAUGE"))
    return [*pins, *gauges]


DIALECT = Dialect(
    name="linuxcnc",
    syntax=Syntax(opening=metric_opening, closing=("M2",), max_line=_MAX_LINE, path_mode=_path_mode),
    abilities=Abilities(
        cubic=CubicAbility(deviation=spline_deviation, pieces=2 * _SPANS),
        # Under G93 LinuxCNC computes no feed for a G5: the rate of the block before stays in force.
        inverse_time=frozenset(("line", "arc")),
        drills=True,
    ),
    numbers=NumberFormat(decimals=_DECIMALS, feed_digits=7),
    notices=Notices(
        own_compensation="BACKLASH in LinuxCNC's ini file",
        own_tables="BACKLASH and COMP_FILE in the ini file",
        units=(20, 21),
        # "Positive numbers will move the axis in a positive direction" (INI configuration, "[AXIS_<letter>]").
        signed_turns="WRAPPED_ROTARY in LinuxCNC's ini file",
    ),
    recording=Recording(lines=halsampler_lines, ending=".txt", has_command=True),
    language=Language(
        effects=dict.fromkeys(_USERS, codes.RUNS) | dict.fromkeys(_KINEMATICS, codes.SWITCHES),
        # Mach3's word, which a machine of LinuxCNC has only where its owner has given it (REMAP).
        skips=True,
        threads=True,
        spindles=True,
    ),
)
"""The LinuxCNC dialect."""
