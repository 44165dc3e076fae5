"""Plans made by hand for tests of the part programs: an S-shaped start and stop, and dips where asked for."""

from __future__ import annotations

from collections.abc import Sequence

from ph_post.analysis.turning_points import find_turning_points
from ph_post.compensate.shapes import single
from ph_post.geometry.track import Track
from ph_post.types import (
    Axis,
    FeedProfile,
    Gap,
    Limits,
    Machine,
    Path,
    Phase,
    Plan,
    Segment,
    Servo,
    TurningPoint,
    Window,
    frozen,
)

RISE = 0.1
"""Duration of a start or stop [s]."""


def make_path(curves: Sequence, *, feed: float = 0.02, closed: bool = False, axes=None, rapid=(), name="part") -> Path:
    """A path of curves, feed in m/s; `rapid` are numbers of rapid segments."""
    segments = tuple(Segment(curve=curve, rapid=number in rapid) for number, curve in enumerate(curves))
    names = tuple(axes or ("X", "Y", "Z")[: curves[0].dimension])
    return Path(
        name=name,
        source="a test",
        axes=names,
        feed=feed,
        closed=closed,
        segments=segments,
        digest="0123456789abcdef00",
    )


def make_machine(*, lost: float = 20e-6, dialect: str = "linuxcnc", period: float = 1e-3) -> Machine:
    """A machine of three equal axes."""

    def axis(name: str) -> Axis:
        return Axis(
            name=name,
            feedback="motor",
            servo=Servo(b=1e-4, c=0.01),
            gap=Gap(lost_motion=lost),
            limits=Limits(velocity=1.0, acceleration=5.0, jerk=500.0),
        )

    return Machine(name="bench", dialect=dialect, servo_period=period, axes={name: axis(name) for name in "XYZ"})


class Timetable:
    """Phases one after the other."""

    def __init__(self) -> None:
        self.phases: list[Phase] = []
        self.t = 0.0
        self.s = 0.0

    def add(self, duration: float, speed: Sequence[float], window: int = -1) -> None:
        if duration > 0.0:
            self.phases.append(Phase(start=self.t, duration=duration, s=self.s, speed=frozen(speed), window=window))
            self.t += duration
            self.s += duration * sum(speed) / len(speed)

    def hold_until(self, s: float, speed: float) -> None:
        self.add((s - self.s) / speed, [speed])

    def rise(self, speed: float) -> None:
        self.add(RISE, [0.0, 0.0, 0.0, speed, speed, speed])

    def fall(self, speed: float) -> None:
        self.add(RISE, [speed, speed, speed, 0.0, 0.0, 0.0])

    def dip(self, cruise: float, low: float, t_star: float, window: int) -> None:
        """A dip of degree 10 whose middle coefficients are `low` times the speed, as the paper's profiles."""
        factors = [1, 1, 1, 1, low, low, low, 1, 1, 1, 1]
        self.add(2 * t_star, [cruise * factor for factor in factors], window)


def make_plan(
    track: Track,
    *,
    speed: float = 0.02,
    dips: Sequence[tuple[float, float, float]] = (),
    stops: Sequence[float] = (),
    moving: bool = False,
    machine: Machine | None = None,
) -> Plan:
    """A plan at constant `speed` [m/s] with dips (s, low, t*) and full stops at places, from rest to rest."""
    table = Timetable()
    if not moving:
        table.rise(speed)
    windows, profiles, points = [], [], list(find_turning_points(track))
    events = sorted([(s, "dip", low, t) for s, low, t in dips] + [(s, "stop", 0.0, 0.0) for s in stops])
    for s, what, low, t_star in events:
        if what == "stop":
            table.hold_until(s - speed * RISE / 2, speed)
            table.fall(speed)
            table.rise(speed)
            continue
        number = len(windows)
        half = speed * t_star * (8 + 3 * low) / 11
        table.hold_until(s - half, speed)
        table.dip(speed, low, t_star, number)
        points.append(
            TurningPoint(index=len(points), kind="smooth", segment=0, xi=0.5, axis="X", sense="max", position=0.0, s=s)
        )
        windows.append(
            Window(
                turning_point=points[-1].index,
                s=s,
                half_length=half,
                limited_by="deviation",
                estimate=half,
                contact_order=2,
                members=(points[-1].index,),
            )
        )
        ratio = (
            sum(
                w * f
                for w, f in zip(
                    [1, 10, 45, 120, 210, 252, 210, 120, 45, 10, 1],
                    [1, 1, 1, 1, low, low, low, 1, 1, 1, 1],
                    strict=True,
                )
            )
            / 1024
        )
        profiles.append(
            FeedProfile(
                window=number,
                shape=single([1, 1, 1, 1, low, low, low, 1, 1, 1, 1]),
                cruise=speed,
                t_star=t_star,
                s_star=half,
                ratio=ratio,
            )
        )
    if moving:
        table.hold_until(track.length, speed)
    else:
        table.hold_until(track.length - speed * RISE / 2, speed)
        table.fall(speed)
    nominal = (Phase(start=0.0, duration=track.length / speed, s=0.0, speed=frozen([speed])),)
    return Plan(
        path=track.path,
        machine=machine or make_machine(),
        strategy="suppress",
        turning_points=tuple(points),
        windows=tuple(windows),
        intervals=(None,) * len(points),
        profiles=tuple(profiles),
        nominal=nominal,
        phases=tuple(table.phases),
    )
