"""Questions of ``ph-post machine new``: each with its hint, what reads its answer, and its default."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from ph_post.cli.answers import (
    ACCELERATION_UNITS,
    LENGTH_UNITS,
    RATE_UNITS,
    SPEED_UNITS,
    TIME_UNITS,
    AnswerKind,
    Axes,
    Gain,
    Percentage,
    Quantity,
    Ratio,
    ServoLag,
    TextLine,
    WordChoice,
)

State = Mapping[str, Any]
"""What was answered so far, by key; by axis where the question is one for each."""


class Question:
    """One question.

    Parameters
    ----------
    key : str
        In answer files; with strokes the option.
    metavar : str
        What stands behind the option.
    ask : str
        The question, in one line.
    hint : str
        Where the answer is found on the machine.
    kind : AnswerKind, or callable that makes it
    default : callable
        ``default(state, axes)``: the answer that is taken for an empty one, as a person would write it.
    axes : callable, optional
        ``axes(state)``: those it is asked for; none at all where it does not apply. Absent: of the machine.
    silent : bool, optional
        Nobody is asked: an option, a file of answers or the controller's settings answer it, or nothing does.
    """

    def __init__(
        self,
        key: str,
        metavar: str,
        ask: str,
        hint: str,
        kind: AnswerKind | Callable[[], AnswerKind],
        default: Callable[[State, Sequence[str]], str],
        axes: Callable[[State], Sequence[str]] | None = None,
        *,
        silent: bool = False,
    ) -> None:
        self.key, self.metavar, self.ask, self.hint, self.silent = key, metavar, ask, hint, silent
        self._kind, self.default, self.axes = kind, default, axes

    @property
    def kind(self) -> AnswerKind:
        """What reads an answer."""
        return self._kind if isinstance(self._kind, AnswerKind) else self._kind()

    @property
    def option(self) -> str:
        """Its name on the command line."""
        return "--" + self.key.replace("_", "-")


def _dialects() -> AnswerKind:
    from ph_post.dialects.registry import dialect_names

    return WordChoice(dialect_names())


def loop_kind() -> WordChoice:
    """Return the loops, by their names in machine files and by what stands on the machine."""
    from ph_post.types import LOOPS

    return WordChoice(tuple(LOOPS), {word: name for name, loop in LOOPS.items() for word in loop.synonyms})


def _every(state: State) -> Sequence[str]:
    axes: Sequence[str] = state["axes"]
    return axes


def _enclosing(state: State) -> Sequence[str]:
    from ph_post.types import LOOPS

    return [axis for axis in state["axes"] if LOOPS[state["loop"][axis]].encloses_backlash]


def _controlled(state: State) -> Sequence[str]:
    from ph_post.types import LOOPS

    return [axis for axis in state["axes"] if LOOPS[state["loop"][axis]].has_controller]


def _cascaded(state: State) -> Sequence[str]:
    return [axis for axis in state["axes"] if axis in state.get("position_gain", {})]


def _dialect_default(state: State, _axes: Sequence[str]) -> str:
    return "linuxcnc" if _controlled(state) else "grbl"


def _shipped(key: str, unit: str = "") -> Callable[[State, Sequence[str]], str]:
    """Return what takes the answer from the shipped machine of the same loop."""

    def default(state: State, axes: Sequence[str]) -> str:
        from ph_post.identify.newmachine import defaults

        values = [f"{defaults(state['loop'][axis], axis)[key]:g}{unit}" for axis in axes]
        return values[0] if len(set(values)) == 1 else " ".join(values)

    return default


def _period_default(state: State, _axes: Sequence[str]) -> str:
    from ph_post.identify.newmachine import default_period

    return f"{default_period(state['loop'][state['axes'][0]]):g}ms"


def _gain(key: str, metavar: str, ask: str, kind: AnswerKind) -> Question:
    """Return the question for a gain of a cascade, which few people know."""
    axes = _controlled if key == "position_gain" else _cascaded
    return Question(key, metavar, ask, "", kind, lambda _state, _axes: "", axes, silent=True)


CASCADE: Final = (
    _gain(
        "position_gain",
        "KV",
        "K_v of a cascade, from the drive or the control: 40/s, 2.4m/min/mm (SINUMERIK MD32200, HEIDENHAIN kvFactor, "
        "P of LinuxCNC's pid). The following error is then that of the cascade.",
        Gain("a position gain"),
    ),
    _gain(
        "velocity_gain",
        "WV",
        "Bandwidth of its velocity loop: 250/s, 40Hz. Without it what the shipped machine has to its K_v.",
        Gain("a gain of the velocity loop", hertz=True),
    ),
    _gain(
        "integral_time",
        "TN",
        "T_n of its velocity loop: 12ms. Without it a P velocity loop.",
        Quantity("a time", TIME_UNITS, "ms", "ms", 0.01, 10_000.0),
    ),
    _gain(
        "feedforward",
        "PERCENT",
        "Weight of its velocity feed-forward: 95% (100 times VELO_FFW_WEIGHT, feedForwardFactor or FF1).",
        Percentage("a weight", 200.0),
    ),
    _gain(
        "acceleration_lead",
        "MS",
        "Acceleration that is fed forward to its velocity loop: 2ms (accForwardFactor, FF2).",
        Quantity("a time", TIME_UNITS, "ms", "ms", -1000.0, 1000.0),
    ),
    _gain(
        "deadband",
        "MM",
        "Position error that its position loop passes over: 0.002mm (DEADBAND).",
        Quantity("a length", LENGTH_UNITS, "mm", "mm", 0.0, 10.0),
    ),
)


QUESTIONS: Final = (
    Question(
        "name",
        "TEXT",
        "What is the machine called?",
        "It stands in reports.",
        TextLine(),
        lambda _state, _axes: "my machine",
    ),
    Question(
        "axes",
        "XYZ",
        "Which axes do its programs move?",
        "One to three of X, Y and Z, every one that moves; one without lost motion is left alone.",
        Axes(),
        lambda _state, _axes: "XYZ",
    ),
    Question(
        "loop",
        "LOOP",
        "Is there a glass scale on the table (load), an encoder on the motor (motor), or neither (none)?",
        "What the drive closes its loop over; a stepper without encoder has none.",
        loop_kind,
        lambda _state, _axes: "none",
        _every,
    ),
    Question(
        "dialect",
        "NAME",
        "Which controller runs its programs?",
        "Grbl boards take grbl; where none is yours, the nearest: linuxcnc has most words.",
        _dialects,
        _dialect_default,
    ),
    Question(
        "lost_motion",
        "MM",
        "How much does the axis lose when it turns round? [mm]",
        "Dial indicator on the table: creep to plus until it moves, zero it, step back by 0.01 mm; what you "
        "command until it moves again is lost. A glass scale hides that: drive off, turn the screw by hand; "
        "the part of a turn before the table moves, times the lead. 0: none, or not measured yet.",
        Quantity("a length", LENGTH_UNITS, "mm", "mm", 0.0, 10.0),
        _shipped("lost_motion"),
        _every,
    ),
    Question(
        "lead",
        "MM",
        "How far does one turn of the screw move the table? [mm; 5tpi for turns per inch]",
        "Stamped on the screw, or measured over ten turns; of a rack, one turn of the pinion.",
        Quantity("a length", LENGTH_UNITS, "mm", "mm", 0.1, 1000.0, inverse={"tpi": LENGTH_UNITS["inch"]}),
        _shipped("lead"),
        _enclosing,
    ),
    Question(
        "gear",
        "RATIO",
        "How many turns does the motor make for one of the screw?",
        "1: coupled directly; teeth on the screw over teeth on the motor of a belt: 40:20.",
        Ratio(),
        _shipped("gear"),
        _enclosing,
    ),
    Question(
        "speed",
        "SPEED",
        "How fast may it move at most? [with its unit: 100mm/s, 6000mm/min, 200in/min]",
        "The controller's setting: grbl $110 to $112 in mm/min, LinuxCNC MAX_VELOCITY in units/s.",
        Quantity("a speed", SPEED_UNITS, None, "mm/s", 0.01, 10_000.0),
        _shipped("speed", "mm/s"),
        _every,
    ),
    Question(
        "acceleration",
        "MM/S2",
        "How hard may it accelerate? [mm/s2]",
        "The controller's setting: grbl $120 to $122 in mm/s2, LinuxCNC MAX_ACCELERATION in units/s2.",
        Quantity("an acceleration", ACCELERATION_UNITS, "mm/s2", "mm/s2", 0.1, 100_000.0),
        _shipped("acceleration"),
        _every,
    ),
    Question(
        "following_error",
        "E@F",
        "How far does it lag behind its command at a steady feed? [0.4 at 1000: mm, mm/min; or a gain: 40/s]",
        "The controller's following error while it runs straight; LinuxCNC shows joint.N.f-error. "
        "?: nobody knows, take that of the shipped machine.",
        ServoLag(),
        lambda _state, _axes: "?",
        _controlled,
    ),
    Question(
        "servo_period",
        "MS",
        "How often does the controller command its axes? [ms]",
        "LinuxCNC SERVO_PERIOD; of steppers only tables use it.",
        Quantity("a time", TIME_UNITS, "ms", "ms", 0.05, 100.0, inverse=RATE_UNITS),
        _period_default,
    ),
    *CASCADE,
)
"""Every question, in the order in which they are asked; those for a cascade are not."""
