"""Programs for a machine without a log: places to read a dial indicator at, and a test cut for calipers.

A dial row is the reversal of ISO 230-2 on the smallest way: the table comes to a place from minus, goes on by
the swing, and comes back to the same place from plus. What the dial shows more there is the lost motion; what it
shows beyond has to be the swing, which tells a wrong unit, a swapped sign and an indicator that slipped.

The test cut has a circle each way and two squares. Behind play the table trails its command by half of it, so
that a square whose edges are reached from inside is too small by the play, and one whose edges are reached from
outside too large; a circle is too small by it along the axes, and 45° across it is longer one way round than the
other by the difference of both plays (times the root of 2). Before each cut the axes are brought, above the
work, to the side on which they will stand.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import msgspec
from msgspec.structs import replace

from ph_post.dialects.registry import find_dialect
from ph_post.errors import InputError, OptionsError
from ph_post.testprograms.builder import APPROACH, SLOWEST, TOP_SHARE, ProgramBuilder, TestVolume
from ph_post.testprograms.kit import choose_volume
from ph_post.types import Machine
from ph_post.types.diagnosis import Experiment
from ph_post.types.readings import STEPS
from ph_post.units import MM, MM_PER_MIN

SWING: Final = 0.5 * MM
"""Way beyond a place, by which the table goes on and comes back [m]: an indicator of 2 mm has room for it."""

SWINGS: Final = (0.05 * MM, 2.0 * MM)
"""Least and greatest swing [m]."""

REPEATS: Final = 2
"""How often a place is read from either side at one feed."""

MOST_REPEATS: Final = 20

FEEDS: Final = (60.0 * MM_PER_MIN, 600.0 * MM_PER_MIN)
"""Feeds at which the table comes to a place [m/s], where a person names none."""

GENTLE: Final = 1200.0 * MM_PER_MIN
"""Greatest feed [m/s] while an indicator touches the table."""

MOST_FEEDS: Final = 2

LEAST_SWINGS: Final = 6.0
"""Travel, in swings, that three places apart from each other need."""

PLACE_NAMES: Final = ("low end", "middle", "high end")

LEAD: Final = 2.0 * MM
"""Way in front of and behind a shape, on which the cutter goes down and comes up [m]."""

BEYOND: Final = 1.0 * MM
"""Way by which a square's edges are passed at its corners, to be reached again from outside [m]."""

WALL: Final = 2.0 * MM
"""Least that stays between two shapes [m]."""

SAFE: Final = 5.0 * MM
"""Height above the work at which the cutter moves to the next shape [m]."""

TOOLS: Final = (1.0 * MM, 25.0 * MM)
SIZES: Final = (10.0 * MM, 500.0 * MM)
USUAL_SIZE: Final = 60.0 * MM
DEPTHS: Final = (0.2 * MM, 10.0 * MM)
DEPTH: Final = 2.0 * MM
STEP: Final = 0.5 * MM
CUT_FEED: Final = 300.0 * MM_PER_MIN
PLUNGE_SHARE: Final = 0.3
"""Feed downwards, as a share of the feed around a shape."""


class DialPlace(NamedTuple):
    """A row of readings: its axis, the name and place of it [m], and the feed [m/s]."""

    axis: str
    name: str
    place: float
    feed: float


class DialTest(msgspec.Struct, frozen=True, kw_only=True):
    """The dial rows of a machine, in the order in which they are read, and how each goes; SI units."""

    rows: tuple[DialPlace, ...]
    swing: float
    repeats: int

    @property
    def steps(self) -> tuple[str, ...]:
        """What is read in a row, in order."""
        return STEPS + (self.repeats - 1) * (STEPS[0], STEPS[2])


class CutTest(msgspec.Struct, frozen=True, kw_only=True):
    """The test cut [m, m/s]: cutter, size of the shapes, depth, feed, and the centre of each shape by its name."""

    tool: float
    size: float
    depth: float
    feed: float
    centres: Mapping[str, tuple[float, float]]

    @property
    def half(self) -> float:
        """Distance of the cutter's path from the middle of a shape [m]."""
        return 0.5 * (self.size + self.tool)


class GaugeKit(NamedTuple):
    """The programs of a machine without a log, and what they are made for."""

    programs: tuple[Experiment, ...]
    dial: DialTest
    cut: CutTest | None


def gauge_kit(
    machine: Machine,
    *,
    axes: Sequence[str] = (),
    centre: Sequence[float] = (),
    travel: Sequence[float] = (),
    feeds: Sequence[float] = (),
    swing: float | None = None,
    repeats: int | None = None,
    tool: float | None = None,
    size: float | None = None,
    depth: float | None = None,
) -> GaugeKit:
    """Write the programs for a dial indicator, one an axis, and with a `tool` the test cut. SI units.

    Parameters
    ----------
    machine : Machine
    axes, centre, travel
        As of :func:`ph_post.testprograms.kit.calibration_kit`.
    feeds : sequence of float, optional
        One or two feeds of the dial test [m/s]; 60 and 600 mm/min.
    swing : float, optional
        Way beyond each place [m]; 0.5 mm.
    repeats : int, optional
        How often each place is read from either side; 2.
    tool : float, optional
        Diameter of the cutter [m]; without one there is no test cut.
    size : float, optional
        Of circles and squares [m]; as much as the room has, up to 60 mm.
    depth : float, optional
        Of the test cut [m]; 2 mm.

    Raises
    ------
    InputError
        Where the room is too small, or a number out of range.
    """
    volume = choose_volume(machine, axes, centre, travel, None, ())
    way, times = SWING if swing is None else swing, REPEATS if repeats is None else repeats
    dial = _dial_test(machine, volume, feeds, way, times)
    cut = None
    if tool is not None:
        cut = _cut_test(machine, volume, tool, size, DEPTH if depth is None else depth)
    elif size is not None or depth is not None:
        raise OptionsError("--size and --depth are those of the test cut, which needs --tool")
    tested = dict.fromkeys(row.axis for row in dial.rows)
    programs = [_dial_program(volume, dial, axis) for axis in tested]
    if cut is not None:
        programs.append(_cut_program(volume, cut))
    if not programs:
        what = "no axis shows its lost motion to a dial: scales on the table hide it"
        raise InputError("--without-log", what, expected='an axis with feedback "motor" or "none", or --tool')
    return GaugeKit(tuple(programs), dial, cut)


def _dial_test(machine: Machine, volume: TestVolume, feeds: Sequence[float], swing: float, repeats: int) -> DialTest:
    _require_in("--swing", "the swing", swing, SWINGS)
    if not 1 <= repeats <= MOST_REPEATS:
        what = "out of range"
        raise InputError("--repeats", what, expected=f"1 to {MOST_REPEATS}", got=str(repeats))
    axes = tuple(axis for axis in volume.axes if not machine.axes[axis].loop.encloses_backlash)
    if not axes:
        return DialTest(rows=(), swing=swing, repeats=repeats)
    top = min(GENTLE, TOP_SHARE * volume.top(*axes))
    chosen = sorted(set(feeds or [min(feed, top) for feed in FEEDS]))
    if len(chosen) > MOST_FEEDS or not SLOWEST <= chosen[0] <= chosen[-1] <= top:
        expected = f"one or two from 1 to {math.floor(top / MM_PER_MIN)} mm/min: the indicator is touched gently"
        got = ", ".join(f"{feed / MM_PER_MIN:g}" for feed in chosen)
        raise InputError("--feeds", "no feeds for a dial indicator", expected=expected, got=got)
    for axis in axes:
        if 2.0 * volume.half(axis) < LEAST_SWINGS * swing:
            expected = f"at least {LEAST_SWINGS * swing / MM:g} mm, or a smaller --swing"
            got = f"{2.0 * volume.half(axis) / MM:g} mm"
            raise InputError(
                "--travel", f"the travel of {axis} is too small for three places", expected=expected, got=got
            )
    rows = [
        DialPlace(axis, name, place, feed)
        for axis in axes
        for name, place in _places(volume, axis, swing)
        for feed in chosen
    ]
    return DialTest(rows=tuple(rows), swing=swing, repeats=repeats)


def _places(volume: TestVolume, axis: str, swing: float) -> tuple[tuple[str, float], ...]:
    low, high = volume.spans[axis]
    return tuple(zip(PLACE_NAMES, (low + swing, volume.centre(axis), high - swing), strict=True))


def _require_in(option: str, what: str, value: float, bounds: tuple[float, float]) -> None:
    if not bounds[0] <= value <= bounds[1]:
        expected = f"{bounds[0] / MM:g} to {bounds[1] / MM:g} mm"
        raise InputError(option, f"{what} is out of range", expected=expected, got=f"{value / MM:g} mm")


def _dial_program(volume: TestVolume, test: DialTest, axis: str) -> Experiment:
    """Write the dial rows of one axis."""
    volume = replace(volume, spans={axis: volume.spans[axis]})
    builder = ProgramBuilder(volume, find_dialect(volume.machine.dialect, "controller.dialect"))
    rows = [row for row in test.rows if row.axis == axis]
    swing, last = test.swing, math.nan
    for number, row in enumerate(rows, 1):
        before, beyond = {axis: row.place - swing}, {axis: row.place + swing}
        if row.place != last:
            builder.stop(f"take the indicator away: {axis} goes to its {row.name}, {row.place / MM:.6g}")
            builder.line(before, min(APPROACH, 0.25 * volume.top(axis)))
            builder.line({axis: row.place}, row.feed)
            builder.stop(
                f"set the indicator against the table in {axis}, pressed in by {1.5 * swing / MM:.3g} mm and free to"
                f" go as much further; it has to count up while {axis} counts up; turn it to 0".replace(";", ",")
            )
            last = row.place
        for count, step in enumerate(test.steps, 1):
            if step == STEPS[0]:
                builder.line(before, row.feed)
            elif count > 3:
                builder.line(beyond, row.feed)
            builder.line(beyond if step == STEPS[1] else {axis: row.place}, row.feed)
            builder.stop(f"{axis} {row.name} at F{row.feed / MM_PER_MIN:.4g}, row {number}, reading {count}: {step}")
    builder.stop("take the indicator away")
    seconds = f"{len(rows)} rows of {len(test.steps)} readings"
    low, high = volume.spans[axis]
    remarks = [
        f"ph-post dial test of {axis} for {volume.machine.name}: {seconds}",
        f"moves {axis} from {low / MM:g} to {high / MM:g} mm and nothing else, spindle off, TOOL AND INDICATOR CLEAR",
        f"go to {axis}{volume.centre(axis) / MM:g} by hand first: the program begins with a straight move to there",
        "it stops where the indicator is to be set, taken away and read: do what the comment says, then go on",
        "feed override 100 percent, work offset G54, the controller's own backlash and screw compensation off",
    ]
    return Experiment(
        name=f"dial_{axis.lower()}",
        why=f"lost motion of {axis} by a dial indicator, at three places and {len({row.feed for row in rows})} feeds",
        record=(f"{seconds}: see the sheet",),
        program=builder.text(remarks, "dial"),
    )


def _cut_test(machine: Machine, volume: TestVolume, tool: float, size: float | None, depth: float) -> CutTest:
    _require_in("--tool", "the cutter's diameter", tool, TOOLS)
    _require_in("--depth", "the depth", depth, DEPTHS)
    if not {"X", "Y"} <= set(volume.axes):
        raise InputError("--axes", "the test cut needs X and Y", expected="X,Y", got=",".join(volume.axes))
    if "Z" not in machine.axes:
        raise InputError("--tool", "the test cut needs a Z axis in the machine file", expected="[axes.Z]")
    room = min(volume.half("X"), volume.half("Y"))
    most = room - _room_beside(tool)
    if size is None:
        size = min(USUAL_SIZE, 5.0 * MM * math.floor(most / (5.0 * MM)))
        if size < SIZES[0]:
            least = 2.0 * (SIZES[0] + _room_beside(tool)) / MM
            what = "the travel of X and Y is too small for the test cut"
            raise InputError("--travel", what, expected=f"at least {least:g} mm", got=f"{2.0 * room / MM:g} mm")
    _require_in("--size", "the size", size, SIZES)
    if size > most:
        what = "the test cut leaves the travel"
        raise InputError("--size", what, expected=f"up to {max(most, 0.0) / MM:.3g} mm", got=f"{size / MM:g} mm")
    off = 0.5 * (size + 2.0 * tool + 2.0 * LEAD + WALL)
    x, y = volume.centre("X"), volume.centre("Y")
    centres = {
        "circle_ccw": (x - off, y - off),
        "circle_cw": (x + off, y - off),
        "square_inside": (x - off, y + off),
        "square_outside": (x + off, y + off),
    }
    feed = min(CUT_FEED, TOP_SHARE * volume.top("X", "Y"))
    return CutTest(tool=tool, size=size, depth=depth, feed=feed, centres=centres)


def _room_beside(tool: float) -> float:
    """Half of the room that two shapes need beyond their size, where the axes come from in front of a cut included."""
    return 1.5 * tool + 3.0 * LEAD + 0.5 * WALL


def plate(test: CutTest) -> float:
    """Return the side of the smallest plate that the test cut fits on [m]."""
    return 2.0 * (test.size + 2.0 * test.tool + 2.0 * LEAD + 0.5 * WALL)


def _cut_program(volume: TestVolume, test: CutTest) -> Experiment:
    """Write the test cut: its Z goes to the depth and to the height over the work, X and Y stay inside their room."""
    machine = volume.machine
    volume = replace(volume, spans={axis: volume.spans[axis] for axis in ("X", "Y")})
    builder = ProgramBuilder(volume, find_dialect(machine.dialect, "controller.dialect"), SAFE)
    builder.stop("look: the spindle runs, and no clamp or screw is in the way")
    for shape, centre in test.centres.items():
        builder.say(f"{shape.replace('_', ' ')} about X{centre[0] / MM:.6g} Y{centre[1] / MM:.6g}")
        for level in range(1, math.ceil(test.depth / STEP - 1e-9) + 1):
            _outline(builder, test, shape, min(level * STEP, test.depth))
    low, high = ({axis: volume.spans[axis][side] / MM for axis in ("X", "Y")} for side in (0, 1))
    middle = {axis: volume.centre(axis) / MM for axis in ("X", "Y")}
    remarks = [
        f"ph-post test cut for {machine.name}, about {builder.seconds / 60.0:.0f} min:"
        f" two circles and two squares of {test.size / MM:g} mm, cutter {test.tool / MM:g} mm",
        f"CUTS {test.depth / MM:g} mm deep inside X {low['X']:g} to {high['X']:g}, Y {low['Y']:g} to {high['Y']:g} mm,"
        f" Z from {-test.depth / MM:g} to {SAFE / MM:g} mm: Z0 is the top of the work",
        f"go to X{middle['X']:g} Y{middle['Y']:g} and Z{SAFE / MM:g} or above by hand first, then start the spindle:"
        " the cutter goes straight down, in wood, plastic or aluminium",
        "it cuts the outline of each shape and leaves the shape: no finishing, no cutter compensation",
        "feed override 100 percent, work offset G54, the controller's own backlash and screw compensation off",
    ]
    return Experiment(
        name="test_cut",
        why="two circles and two squares for calipers: lost motion, squareness and scale",
        record=("widths with calipers: see the sheet",),
        program=builder.text(remarks, "test cut"),
    )


def _z_speed(machine: Machine) -> float:
    return min(APPROACH, 0.25 * machine.axes["Z"].limits.velocity)


_OUTLINES: Final[Mapping[str, tuple[tuple[float, float], ...]]] = {
    "square_inside": ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)),
    "square_outside": ((-1, -1), (2, -1), (1, -1), (1, 2), (1, 1), (-2, 1), (-1, 1), (-1, -2)),
}
"""Corners of a square's way, counterclockwise; 2 is the edge's place and a little beyond."""


def _outline(builder: ProgramBuilder, test: CutTest, shape: str, depth: float) -> None:
    """Cut a shape's outline at one depth: bring the axes to their side, go down, around, and up behind it."""
    x, y = test.centres[shape]
    half, feed = test.half, test.feed

    def cut(u: float, v: float) -> None:
        builder.line({"X": x + u, "Y": y + v}, feed)

    if shape.startswith("circle"):
        turn = 1 if shape == "circle_ccw" else -1
        start, side = (half, -turn * LEAD), (-LEAD, -turn * LEAD)
    else:
        start, side = (-half - LEAD, -half), (-LEAD, LEAD if shape == "square_inside" else -LEAD)
    fast = min(APPROACH, 0.25 * builder.volume.top("X", "Y"))
    down = PLUNGE_SHARE * min(feed, builder.volume.machine.axes["Z"].limits.velocity)
    builder.line({"X": x + start[0] + side[0], "Y": y + start[1] + side[1]}, fast)
    builder.line({"X": x + start[0], "Y": y + start[1]}, fast)
    builder.dwell(builder.volume.settle)
    builder.line({"Z": -depth}, down)
    if shape.startswith("circle"):
        cut(half, 0.0)
        builder.circle(("X", "Y"), half, turn, feed, centre={"X": x, "Y": y}, rest=False)
        cut(half, turn * LEAD)
    else:
        for u, v in _OUTLINES[shape]:
            cut(_edge(u, half), _edge(v, half))
        if shape == "square_inside":
            cut(-half, -half - LEAD)
    builder.line({"Z": SAFE}, _z_speed(builder.volume.machine))


def _edge(number: float, half: float) -> float:
    """Return the place of an edge, and of what is a little beyond it."""
    return math.copysign(half + (BEYOND if abs(number) == 2 else 0.0), number)
