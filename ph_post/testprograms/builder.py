"""The program builder of test programs, and the test volume with its speed limits."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from itertools import combinations
from typing import Final

import msgspec

from ph_post.dialects.base import Dialect
from ph_post.drive.cascade import response_time
from ph_post.gcode.program import AXES, CENTERS, plane_of
from ph_post.types import Machine
from ph_post.units import MM, MM_PER_MIN

ARC_SHARE: Final = 0.5
"""Share of an axis' acceleration that v²/r may take: controllers keep part of it for the ends of an arc."""

TOP_SHARE: Final = 0.8
"""Share of the greatest speed that programs use where a person names no feeds: drives need some in hand."""

RADIUS_SHARE: Final = 0.3
"""Radius of the circles where a person names none, as a share of the smallest room."""

SLOWEST: Final = 1.0 * MM_PER_MIN
"""Feeds below it [m/s] take a day."""

CRAWL: Final = 0.2 * MM
"""Slowest feed [m/s] of the programs, where friction falls with speed if it does so anywhere."""


class TestVolume(msgspec.Struct, frozen=True, kw_only=True):
    """Room and speeds of test programs. SI units.

    `spans` is the room of each axis [m], in the order X, Y, Z; nothing else is moved. `radius` [m] is that of
    the circles, `feeds` [m/s] rise. `settle` [s] is the time that an axis is given to come to rest.
    """

    machine: Machine
    spans: Mapping[str, tuple[float, float]]
    radius: float
    feeds: tuple[float, ...]
    settle: float

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes that are moved."""
        return tuple(self.spans)

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Every two of them."""
        return tuple(combinations(self.axes, 2))

    def centre(self, axis: str) -> float:
        """Middle of an axis' room [m]."""
        low, high = self.spans[axis]
        return 0.5 * (low + high)

    def half(self, axis: str) -> float:
        """Way that an axis may go to either side of it [m]."""
        low, high = self.spans[axis]
        return 0.5 * (high - low)

    def top(self, *axes: str) -> float:
        """Return the greatest speed of the slowest of these axes [m/s]."""
        return top_speed(self.machine, axes)

    def slow(self, axis: str, seconds: float) -> float:
        """Feed [m/s] that takes so long from end to end of an axis, within its limits."""
        return min(2.0 * self.half(axis) / seconds, TOP_SHARE * self.top(axis))


def top_speed(machine: Machine, axes: tuple[str, ...]) -> float:
    """Return the greatest speed [m/s] that each of these axes has."""
    return min(machine.axes[axis].limits.velocity for axis in axes)


def arc_speed(machine: Machine, axes: tuple[str, ...], radius: float, share: float = ARC_SHARE) -> float:
    """Return the greatest speed [m/s] around a circle of `radius` [m], within speed, acceleration and jerk of its axes.

    The acceleration is v²/r and the jerk v³/r² on either axis, of which `share` of the limits is used.
    """
    limits = [machine.axes[axis].limits for axis in axes]
    acceleration = share * min(one.acceleration for one in limits)
    jerk = share * min(one.jerk for one in limits)
    return min(top_speed(machine, axes), math.sqrt(acceleration * radius), math.cbrt(jerk * radius * radius))


def settling_time(machine: Machine, axes: tuple[str, ...]) -> float:
    """Return the time that axes are given to come to rest [s]: ten times c, their time constant, at least 0.3."""
    return max(0.3, *(10.0 * response_time(machine.axes[axis].servo) for axis in axes))


JOINT: Final = 0.005 * MM
"""Rounding of the joints of circles [m]; one turn goes on where the last one ends."""

CHORD: Final = 0.001 * MM
"""Deviation of chords from a circle [m] where the dialect has no arcs."""

APPROACH: Final = 10.0 * MM
"""Speed [m/s] at which the axes go to where a program begins, at most a quarter of their greatest."""

WAIT: Final = 20.0
"""Time [s] that a person has at a stop where the controller has no word for it."""


class ProgramBuilder:
    """Collects the lines of one test program, which begins and ends in the middle of its volume.

    Parameters
    ----------
    volume : TestVolume
    dialect : Dialect
    height : float, optional
        Z [m] to which the program goes first, where it cuts.

    Attributes
    ----------
    volume : TestVolume
    seconds : float
        About how long the program takes [s].
    """

    def __init__(self, volume: TestVolume, dialect: Dialect, height: float | None = None) -> None:
        self.volume = volume
        self.dialect = dialect
        self.seconds = 0.0
        self._writer = dialect.line_writer(AXES, JOINT)
        self._at: dict[str, int] = {}
        if height is not None:
            self.line({"Z": height}, min(APPROACH, 0.25 * volume.top("Z")))
        self.home(min(APPROACH, 0.25 * volume.top(*volume.axes)))
        self.dwell(1.0)

    def text(self, remarks: Iterable[str], name: str = "calibration") -> str:
        """Return the program whole, `remarks` as comments at its head; it goes back to where it began."""
        self.home()
        self._writer.plane("G17")
        self._writer.path_mode(exact=True)
        head = [line for remark in remarks for line in self.dialect.comment(remark)]
        notices, own = self.dialect.notices, self.volume.machine.own_correction
        # What is measured is the machine without its controller's own compensation.
        opening = [*self.dialect.syntax.opening("G17"), *notices.guard]
        after = notices.stays_off if own is None else (notices.closing(own),) if notices.guard else ()
        lines = [*head, *opening, *self._writer.lines, *after, *self.dialect.syntax.closing]
        return "\n".join(self.dialect.finished(lines, name)) + "\n"

    def say(self, words: str) -> None:
        """Write a comment."""
        self._writer.add(self.dialect.comment(words))

    def home(self, speed: float | None = None) -> None:
        """Go to the middle of the volume, quickly where no speed is given [m/s]."""
        axes = self.volume.axes
        speed = TOP_SHARE * self.volume.top(*axes) if speed is None else speed
        self.line({axis: self.volume.centre(axis) for axis in axes}, speed)

    def dwell(self, seconds: float) -> None:
        """Let the axes stand."""
        self.seconds += seconds
        self._writer.write_dwell(seconds)

    def stop(self, words: str) -> None:
        """Stop the program until the person lets it go on; `words` say what to do. Without such a word it waits."""
        self.dwell(self.volume.settle)
        self.say(words)
        word = self.dialect.syntax.stop
        if word is None:
            self.dwell(WAIT)
        else:
            self._writer.add([word])

    def line(self, target: Mapping[str, float], speed: float) -> None:
        """Go straight to places [m] by axis, at `speed` [m/s], and stop there."""
        to = {axis: self._count(place) for axis, place in target.items()}
        moved = {axis: count for axis, count in to.items() if self._at.get(axis) != count}
        if not moved:
            return
        self._writer.path_mode(exact=True)
        self._writer.write_straight("G1", self._words(moved), self._feed(speed))
        # The first move has no known start and counts as length 0.
        steps = [count - self._at.get(axis, count) for axis, count in moved.items()]
        self._spend(math.hypot(*steps) * self.dialect.numbers.quantum, speed, tuple(moved))
        self._at |= to

    def circle(
        self,
        pair: tuple[str, str],
        radius: float,
        turn: int,
        speed: float,
        turns: int = 1,
        centre: Mapping[str, float] | None = None,
        rest: bool = True,
    ) -> None:
        """Go around a centre from the side towards plus of the first axis, and back to it.

        Parameters
        ----------
        pair : tuple of str
        radius : float
            [m].
        turn : int
            +1 from the first axis to the second, counterclockwise as the pair is drawn; -1 the other way.
        speed : float
            [m/s].
        turns : int
            How often.
        centre : mapping, optional
            By axis [m]; the middle of the volume.
        rest : bool
            Whether the axes come to rest before and behind.
        """
        first, second = pair
        middle = {axis: self.volume.centre(axis) for axis in pair} if centre is None else centre
        self.line({first: middle[first] + radius, second: middle[second]}, TOP_SHARE * self.volume.top(*pair))
        if rest:
            self.dwell(self.volume.settle)
        abilities = self.dialect.abilities
        if abilities.full_circles and abilities.writes_arcs(plane_of(pair)[0]):
            self._arcs(pair, middle, turn, speed, turns)
        else:
            self._chords(pair, middle, radius, turn, speed, turns)
        self._spend(math.tau * radius * turns, speed, pair)
        if rest:
            self.dwell(self.volume.settle)

    def _arcs(self, pair: tuple[str, str], middle: Mapping[str, float], turn: int, speed: float, turns: int) -> None:
        """Write whole turns, each with its end, which is its beginning."""
        first, second = pair
        plane, sense = plane_of(pair)
        self._writer.plane(plane)
        self._writer.path_mode(exact=False)
        end = self._words({axis: self._at[axis] for axis in pair})
        centre = self._words({CENTERS[first]: self._count(middle[first]) - self._at[first], CENTERS[second]: 0})
        for _ in range(turns):
            self._writer.arc(end, centre, turn * sense > 0, self._feed(speed))

    def _chords(
        self, pair: tuple[str, str], middle: Mapping[str, float], radius: float, turn: int, speed: float, turns: int
    ) -> None:
        """Go the same way by straight moves."""
        self._writer.path_mode(exact=False)
        count = max(8, math.ceil(math.pi / math.acos(max(1.0 - CHORD / radius, 0.0))))
        for k in range(1, turns * count + 1):
            angle = math.tau * turn * (k % count) / count
            place = (radius * math.cos(angle), radius * math.sin(angle))
            to = {axis: self._count(middle[axis] + off) for axis, off in zip(pair, place, strict=True)}
            self._writer.write_straight("G1", self._words(to), self._feed(speed))
            self._at |= to

    def _spend(self, length: float, speed: float, axes: tuple[str, ...]) -> None:
        """Count the time of a motion from rest to rest with straight ramps."""
        ramp = min(self.volume.machine.axes[axis].limits.acceleration for axis in axes)
        slow = length < speed * speed / ramp
        self.seconds += 2.0 * math.sqrt(length / ramp) if slow else length / speed + speed / ramp

    def _count(self, place: float) -> int:
        return self.dialect.numbers.count(place)

    def _words(self, counts: Mapping[str, int]) -> list[str]:
        return [letter + self.dialect.numbers.length(count) for letter, count in counts.items()]

    def _feed(self, speed: float) -> str:
        return self.dialect.numbers.feed(speed / MM_PER_MIN)
