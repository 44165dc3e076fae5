"""A part program as it is drawn: run as it was and as compensated, on models of controller and drives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import PurePath

import numpy as np
from msgspec.structs import replace

from ph_post.audit.deliver import Delivery
from ph_post.compensate.strategies.base import silent
from ph_post.gcode.controller.error import CutPath, program_error
from ph_post.gcode.controller.run import run_program
from ph_post.gcode.reader.record import PartProgram
from ph_post.report.deliveries import warnings_of
from ph_post.report.programwindows import TurningPlace, turning_places
from ph_post.report.traces import CHORDS, Mark, Picture, Trace
from ph_post.simulate.contour import turning_errors
from ph_post.types import Array, Machine, TurningPoint
from ph_post.units import MM


def program_picture(
    delivery: Delivery,
    machine: Machine,
    tolerance: float,
    strategy: str,
    tell: Callable[[str], None] = silent,
) -> Picture:
    """Run a program as it was and as compensated on the models of controller and drives."""
    original = delivery.before
    path = CutPath(original, machine)
    tell("locating turning points, windows and backlash intervals")
    turns = turning_places(delivery, machine, tolerance)
    places = [_places_of(one, path) for one in turns]
    points = [
        replace(one.point, s=s, index=k) for k, (one, (s, *_)) in enumerate(zip(turns, places, strict=True))
    ]
    both = [("as it is", original)]
    both += [("compensated", delivery.after)] if delivery.after.data != original.data else []
    traces = []
    for name, program in both:
        tell(f"running the program {name} on the models of controller and drives")
        traces.append(_program_trace(name, program, original, machine, path, points))
    axes = traces[0].run.axes
    at = path.points(np.array([point.s for point in points]), axes).tolist()
    marks = tuple(
        _program_mark(*one, delivery.done) for one in zip(turns, places, map(tuple, at), strict=True)
    )
    rapid = np.flatnonzero(path.legs.rapid == 1.0)
    return Picture(
        name=PurePath(original.name).name, kind="program", axes=axes, closed=False,
        length=float(path.starts[-1]), points=lambda s: path.points(s, axes), joints=_joints(path),
        marks=marks, traces=tuple(traces),
        machine=machine, strategy=strategy, warnings=warnings_of(delivery),
        rapids=tuple((float(path.starts[k]), float(path.starts[k + 1])) for k in rapid.tolist()),
    )  # fmt: skip


def _places_of(turn: TurningPlace, path: CutPath) -> tuple[float, float, float]:
    """Place a turning point on the program, and the ends of its window, if it has one [m]."""
    window = turn.window
    reach = 0.0 if window is None else window.half_length
    middle = turn.point.s if window is None else window.s
    wanted = np.array([turn.point.s, middle - reach, middle + reach])
    s, low, high = path.place_of(*turn.path.to_motions(wanted)).tolist()
    return s, low, high


def _program_mark(
    turn: TurningPlace, places: tuple[float, float, float], point: tuple[float, ...], done: bool
) -> Mark:
    """Tell of a turning point; of a program compensated before nobody knows what was done where."""
    s, low, high = places
    profile = turn.view["profile"]
    told = {
        **turn.view, "s": s / MM, "ratio": None if profile is None else profile["ratio"],
        "notes": () if profile is None else profile["notes"],
        **({"strategy": "compensated before"} if done else {}),
    }  # fmt: skip
    return Mark(s=s, window=None if turn.window is None else (low, high), view=told, point=point)


def _program_trace(
    name: str, program: PartProgram, original: PartProgram, machine: Machine, path: CutPath,
    points: Sequence[TurningPoint],
) -> Trace:  # fmt: skip
    command = run_program(program, machine)
    found = program_error(command, machine, original)
    _, feet = path.feet(found.run, found.place)
    foot = path.points(feet, found.run.axes)
    rows = found.counted
    return Trace(
        name=name, t=command.t, s=found.place, feed=command.feed, foot=foot, away=found.run.executed - foot,
        error=found.distance, counted=rows, size=found.error, worst=found.error_worst,
        worst_scenario=found.worst, run=found.run,
        turning=turning_errors(found.distance[rows], found.place[rows], points),
        line=original.motions.block[found.motion].astype(np.int64) + 1,
    )  # fmt: skip


def _joints(path: CutPath) -> Array:
    """Places between which a program is drawn with straight lines: ends of legs, and points on arcs."""
    turns = np.abs(path.legs.sweep) / (2.0 * np.pi)
    parts = np.where(path.legs.radius > 0.0, np.ceil(CHORDS * turns), 1.0).astype(np.int64)
    leg = np.repeat(np.arange(parts.size), parts)
    share = (np.arange(leg.size) - (np.cumsum(parts) - parts)[leg]) / parts[leg]
    return np.append(path.starts[leg] + share * path.legs.length[leg], path.starts[-1])
