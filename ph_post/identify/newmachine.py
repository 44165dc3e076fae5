"""Write new machine files from what a machinist can answer or a controller's settings show.

Every line carries its unit and its source. What cannot be asked (the servo's b, and on a `load` loop the
motor's part of the inertia and its time constant) is taken over from the shipped machine of the same loop, and
said to be.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Final

import msgspec

from ph_post.dialects.planners import settings_of, values_of
from ph_post.dialects.registry import find_dialect
from ph_post.drive.machinefile import machine_of, read_machine
from ph_post.files.machine import PLANNER_KEYS
from ph_post.files.machine_text import Row, machine_document, written
from ph_post.files.storage import source_of
from ph_post.types import LOOPS, USUAL_REFERENCE, Axis, Feedback, Loop, Machine
from ph_post.units import MINUTE, MM, MM_PER_MIN, MS

_COLUMN: Final = 38
"""Column at which comments begin."""

_HEAD: Final = """\
A machine file of ph-post: what it knows of a machine, in mm and s. Written by `ph-post machine new`.
Values marked "assumed" were neither measured nor answered: they are those of a shipped machine with the
same loop. `ph-post calibrate` writes test programs and says what to record, `ph-post identify` takes b, c and
the backlash from the log, `ph-post diagnose` finds what else the machine does and writes it in here."""


class AxisAnswers(msgspec.Struct, frozen=True, kw_only=True):
    """Answers for one axis, in the shop's units: mm, mm/s, mm/s².

    `c_s` [s] is following error over speed, None where nobody knows it. `screw_lead_mm` and `gear_ratio` are
    needed on a `load` loop alone. `gains` are those of a cascade: position_gain and velocity_gain [1/s], integral_time
    and acceleration_lead [ms], feedforward [%], deadband [mm]; without a position gain it is none. `taken` are the keys
    that nobody answered: the shipped machine's.
    """

    feedback: Feedback
    lost_motion_mm: float
    max_velocity_mm_s: float
    max_acceleration_mm_s2: float
    c_s: float | None = None
    screw_lead_mm: float | None = None
    gear_ratio: float | None = None
    gains: Mapping[str, float] = {}
    taken: frozenset[str] = frozenset()

    @property
    def loop(self) -> Loop:
        """The loop by the name that `feedback` gives it."""
        return LOOPS[self.feedback]


class Answers(msgspec.Struct, frozen=True, kw_only=True):
    """Answers for a machine; `planner` by key of ``[controller]``, as the controller's own settings have them."""

    name: str
    dialect: str
    servo_period_ms: float
    axes: Mapping[str, AxisAnswers]
    planner: Mapping[str, float] = {}


class NewMachine(msgspec.Struct, frozen=True, kw_only=True):
    """A machine file: its text, the machine it reads back as, and the assumed keys by axis."""

    text: str
    machine: Machine
    assumed: Mapping[str, tuple[str, ...]]


def model_axis(feedback: Feedback, axis: str) -> Axis:
    """Return an axis of the shipped machine that stands for a loop."""
    return read_machine(LOOPS[feedback].model).axes[axis]


def new_machine(answers: Answers) -> NewMachine:
    """Write a machine file.

    Raises
    ------
    InputError
        Where the machine cannot be: what the project's own reader says of it.
    """
    rows = {name: tuple(_axis_rows(name, axis)) for name, axis in answers.axes.items()}
    controller = (
        Row("dialect", answers.dialect, "the words its programs are written in"),
        Row(
            "servo_period_ms",
            answers.servo_period_ms,
            "how often the controller commands its axes; a row of an interpolator table",
        ),
        *_planner_rows(answers),
    )
    text = machine_document(_HEAD.splitlines(), answers.name, controller, rows, _COLUMN)
    return NewMachine(
        text=text,
        machine=machine_of(source_of(text, answers.name, answers.name)),
        assumed={name: tuple(row.key for row in those if row.assumed) for name, those in rows.items()},
    )


_PLANNER_WORDS: Final = {
    "junction_deviation_mm": "how fast corners are passed: Grbl $11, Marlin M205 J",
    "arc_tolerance_mm": "how far chords are off arcs: Grbl $12",
    "square_corner_velocity_mm_s": "how fast a corner of 90 degrees is passed",
    "arc_resolution_mm": "length of chords of arcs: resolution of [gcode_arcs]",
    "arc_segment_mm": "length of chords of arcs: MAX_ARC_SEGMENT_MM",
    "path_tolerance_mm": "how far corners are rounded where a program does not say: P of G64",
}


def _planner_rows(answers: Answers) -> Iterator[Row]:
    """Yield what the controller's planner needs: its own settings, or else the firmware's defaults."""
    planner = find_dialect(answers.dialect).planner
    own = {name: answers.planner[key] for name, (key, _) in PLANNER_KEYS.items() if key in answers.planner}
    for name, value in values_of(planner).items():
        key, unit = PLANNER_KEYS[name]
        if name not in own:
            yield Row(key, value / unit, f"{_PLANNER_WORDS[key]}; assumed: the default of {answers.dialect}")
    for name, number in own.items():
        if name in settings_of(planner):
            yield Row(PLANNER_KEYS[name][0], number, _PLANNER_WORDS[PLANNER_KEYS[name][0]])


def _axis_rows(name: str, axis: AxisAnswers) -> Iterator[Row]:
    """Yield the lines of one axis."""
    model = model_axis(axis.feedback, name)
    yield Row("feedback", axis.feedback, axis.loop.comment)
    yield from _servo_rows(axis, model)
    if axis.loop.encloses_backlash:
        yield from _drive_rows(axis, model)
    yield _backlash_row(axis)
    flank = 'the way it moved last before the program: "+", "-" or not known'
    yield Row("initial_flank", "unknown", flank, assumed=True)
    if not axis.loop.encloses_backlash:
        zero = 'the way it moves when its zero is taken: "+", "-" or "both"'
        yield Row("reference_direction", USUAL_REFERENCE[name], zero, assumed=True)
    yield from _limit_rows(axis, model)


def _servo_rows(axis: AxisAnswers, model: Axis) -> Iterator[Row]:
    """Yield b and c of Eq. (9): c as answered, b in the ratio to c² that the shipped machine has."""
    if not axis.loop.has_controller:
        yield Row("b", 0.0, "s², steps follow the command at once,")
        yield Row("c", 0.0, "s, as long as none is lost")
        return
    shipped = f"assumed ({axis.loop.model}.toml), identify measures it"
    if axis.gains:
        yield from _cascade_rows(axis, model)
        return
    c = model.servo.c if axis.c_s is None else axis.c_s
    ratio = model.servo.b / model.servo.c**2
    yield Row("b", ratio * c * c, f"s², how fast the loop answers; {ratio:.2g} c² {shipped}", assumed=True)
    if axis.c_s is None:
        yield Row("c", c, f"s, following error / speed; {shipped}", assumed=True)
    else:
        lag = c * MM_PER_MIN / MM * 1000.0
        yield Row("c", c, f"s, following error / speed: {lag:.4g} mm at 1000 mm/min, gain {1 / c:.4g}/s")


_CASCADE_ROWS: Final = (
    ("integral_time", "velocity_integral_time_ms", "T_n of the velocity loop"),
    ("feedforward", "velocity_feedforward_percent", "weight of the command's speed"),
    ("acceleration_lead", "acceleration_lead_ms", "acceleration fed forward to the velocity loop"),
    ("deadband", "deadband_mm", "position error that is passed over"),
)


def _cascade_rows(axis: AxisAnswers, model: Axis) -> Iterator[Row]:
    """Yield the gains of a cascade; its velocity loop, where nobody knows it, is as quick as the shipped machine's."""
    gains = axis.gains
    gain = gains["position_gain"]
    yield Row("control.structure", "cascade", "P position loop around a PI velocity loop")
    lag = f"K_v, {gain * MINUTE * MM:.4g} m/min/mm"
    yield Row("control.position_gain_per_s", gain, lag)
    words = "bandwidth of the velocity loop"
    if "velocity_gain" in gains:
        yield Row("control.velocity_gain_per_s", gains["velocity_gain"], words)
    else:
        quicker = model.servo.c**2 / model.servo.b
        words = f"{words}; {quicker:.2g} K_v assumed ({axis.loop.model}.toml)"
        yield Row("control.velocity_gain_per_s", quicker * gain, words, assumed=True)
    for key, name, meaning in _CASCADE_ROWS:
        if key in gains:
            yield Row(f"control.{name}", gains[key], meaning)


def _drive_rows(axis: AxisAnswers, model: Axis) -> Iterator[Row]:
    """Yield screw, gear and the motor alone, which crosses the backlash inside a loop."""
    gap, shipped = model.gap, f"assumed ({axis.loop.model}.toml), identify measures it"
    assert axis.gear_ratio is not None
    assert axis.screw_lead_mm is not None
    assert gap.inertia_fraction is not None
    assert gap.beta is not None
    yield _answered("gear_ratio", axis.gear_ratio, "motor turns per turn of the screw", "gear", axis)
    yield _answered("screw_lead_mm", axis.screw_lead_mm, "mm a turn of the screw or pinion", "lead", axis)
    part = f"the motor's part of all that is moved; {shipped}"
    yield Row("inertia_fraction", gap.inertia_fraction, part, assumed=True)
    alone = f"s in which the motor alone runs out; {shipped}"
    yield Row("motor_time_constant_s", 1.0 / gap.beta, alone, assumed=True)


def _backlash_row(axis: AxisAnswers) -> Row:
    """Return the backlash; where nobody has measured it, it is 0, which does no harm."""
    words = "mm that the dial indicator loses where the axis turns round"
    untouched = "lost_motion" in axis.taken
    if untouched:
        words = "mm; assumed: nothing is compensated until the dial indicator's number stands here"
    return Row("lost_motion_mm", axis.lost_motion_mm, words, untouched)


def _limit_rows(axis: AxisAnswers, model: Axis) -> Iterator[Row]:
    """Yield the limits; the jerk stands to the acceleration as on the shipped machine."""
    speed = f"the fastest it may move: {axis.max_velocity_mm_s * MM / MM_PER_MIN:.6g} mm/min"
    yield _answered("max_velocity_mm_s", axis.max_velocity_mm_s, speed, "speed", axis)
    acceleration = axis.max_acceleration_mm_s2
    yield _answered("max_acceleration_mm_s2", acceleration, "the most it may accelerate", "acceleration", axis)
    rise = model.limits.acceleration / model.limits.jerk
    jerk = f"full acceleration after {rise / MS:.3g} ms; assumed ({axis.loop.model}.toml)"
    yield Row("max_jerk_mm_s3", acceleration / rise, jerk, assumed=True)
    if axis.loop.encloses_backlash and axis.gear_ratio and axis.screw_lead_mm and not axis.gains:
        motor = acceleration * axis.gear_ratio / axis.screw_lead_mm * math.tau
        words = "assumed: no more than the table's acceleration takes"
        yield Row("max_motor_acceleration_rad_s2", motor, words, assumed=True)


def _answered(key: str, value: float, words: str, question: str, axis: AxisAnswers) -> Row:
    """Return the line of a number that was asked for, marked where the default was taken."""
    if question not in axis.taken:
        return Row(key, value, words)
    return Row(key, value, f"{words}; assumed ({axis.loop.model}.toml)", assumed=True)


def defaults(feedback: Feedback, axis: str) -> Mapping[str, float]:
    """Return the numbers of the shipped machine that stand for an axis nobody has answered for.

    Keys are those of the questions; mm, mm/s, mm/s². The backlash is 0: the size of another machine's would do harm.
    """
    model = model_axis(feedback, axis)
    numbers = {
        "lost_motion": 0.0,
        "speed": model.limits.velocity / MM,
        "acceleration": model.limits.acceleration / MM,
    }
    if model.gap.gear_ratio is not None and model.gap.travel_per_rad is not None:
        numbers["gear"] = model.gap.gear_ratio
        numbers["lead"] = model.gap.travel_per_rad / MM * math.tau
    return {key: float(written(value)) for key, value in numbers.items()}


def default_period(feedback: Feedback) -> float:
    """Return the servo period of the shipped machine that stands for a loop [ms]."""
    return float(written(read_machine(LOOPS[feedback].model).servo_period / MS))
