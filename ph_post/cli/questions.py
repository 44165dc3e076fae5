"""What `ph-post machine new` asks: each question once, for the terminal, for options and for answer files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from ph_post.io.quantity import (
    ACCELERATION_UNITS,
    LENGTH_UNITS,
    RATE_UNITS,
    SPEED_UNITS,
    TIME_UNITS,
    Axes,
    Choice,
    Kind,
    Lag,
    Quantity,
    Ratio,
    Words,
)

LOOPS: Final = Choice(
    ("load", "motor", "none"),
    {
        "scale": "load", "scales": "load", "glass": "load", "table": "load",
        "encoder": "motor", "servo": "motor", "neither": "none", "stepper": "none", "steppers": "none",
    },
)  # fmt: skip
"""Loops, by the names of machine files and by what stands on the machine."""

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
    kind : Kind, or callable that makes it
    default : callable
        ``default(state, axes)``: the answer that is taken for an empty one, as a person would write it.
    axes : callable, optional
        ``axes(state)``: those it is asked for; none at all where it does not apply. Absent: of the machine.
    """

    def __init__(
        self, key: str, metavar: str, ask: str, hint: str, kind: Kind | Callable[[], Kind],
        default: Callable[[State, Sequence[str]], str],
        axes: Callable[[State], Sequence[str]] | None = None,
    ) -> None:  # fmt: skip
        self.key, self.metavar, self.ask, self.hint = key, metavar, ask, hint
        self._kind, self.default, self.axes = kind, default, axes

    @property
    def kind(self) -> Kind:
        """What reads an answer."""
        return self._kind if isinstance(self._kind, Kind) else self._kind()

    @property
    def option(self) -> str:
        """Its name on the command line."""
        return "--" + self.key.replace("_", "-")


def _dialects() -> Kind:
    from ph_post.gcode.registry import dialect_names

    return Choice(dialect_names())


def _every(state: State) -> Sequence[str]:
    axes: Sequence[str] = state["axes"]
    return axes


def _with(*loops: str) -> Callable[[State], Sequence[str]]:
    """Return what chooses the axes with one of these loops."""
    return lambda state: [axis for axis in state["axes"] if state["loop"][axis] in loops]


def _dialect_default(state: State, _axes: Sequence[str]) -> str:
    return "grbl" if set(state["loop"].values()) == {"none"} else "linuxcnc"


def _shipped(key: str, unit: str = "") -> Callable[[State, Sequence[str]], str]:
    """Return what takes the answer from the shipped machine of the same loop."""

    def default(state: State, axes: Sequence[str]) -> str:
        from ph_post.io.newmachine import defaults

        values = [f"{defaults(state['loop'][axis], axis)[key]:g}{unit}" for axis in axes]
        return values[0] if len(set(values)) == 1 else " ".join(values)

    return default


def _period_default(state: State, _axes: Sequence[str]) -> str:
    from ph_post.io.newmachine import default_period

    return f"{default_period(state['loop'][state['axes'][0]]):g}ms"


QUESTIONS: Final = (
    Question(
        "name", "TEXT", "What is the machine called?", "It stands in reports.",
        Words(), lambda _state, _axes: "my machine",
    ),
    Question(
        "axes", "XYZ", "Which axes does it have that shall be looked after?", "One to three of X, Y and Z.",
        Axes(), lambda _state, _axes: "XYZ",
    ),
    Question(
        "loop", "LOOP",
        "Is there a glass scale on the table (load), an encoder on the motor (motor), or neither (none)?",
        "What the drive closes its loop over; a stepper without encoder has none.",
        LOOPS, lambda _state, _axes: "none", _every,
    ),
    Question(
        "dialect", "NAME", "Which controller, that is which words of G-code?",
        "Grbl boards take grbl; where none is yours, the nearest: linuxcnc has most words.",
        _dialects, _dialect_default,
    ),
    Question(
        "lost_motion", "MM", "How much does the axis lose when it turns round? [mm]",
        "Dial indicator on the table: creep to plus until it moves, zero it, step back by 0.01 mm; what you "
        "command until it moves again is lost. A glass scale hides that: drive off, turn the screw by hand; "
        "the part of a turn before the table moves, times the lead. 0: none, or not measured yet.",
        Quantity("a length", LENGTH_UNITS, "mm", "mm", 0.0, 10.0), _shipped("lost_motion"), _every,
    ),
    Question(
        "lead", "MM", "How far does one turn of the screw move the table? [mm; 5tpi for turns per inch]",
        "Stamped on the screw, or measured over ten turns; of a rack, one turn of the pinion.",
        Quantity("a length", LENGTH_UNITS, "mm", "mm", 0.1, 1000.0, inverse={"tpi": 25.4}),
        _shipped("lead"), _with("load"),
    ),
    Question(
        "gear", "RATIO", "How many turns does the motor make for one of the screw?",
        "1: coupled directly; teeth on the screw over teeth on the motor of a belt: 40:20.",
        Ratio(), _shipped("gear"), _with("load"),
    ),
    Question(
        "speed", "SPEED", "How fast may it move at most? [with its unit: 100mm/s, 6000mm/min, 200in/min]",
        "The controller's setting: grbl $110 to $112 in mm/min, LinuxCNC MAX_VELOCITY in units/s.",
        Quantity("a speed", SPEED_UNITS, None, "mm/s", 0.01, 10_000.0), _shipped("speed", "mm/s"), _every,
    ),
    Question(
        "acceleration", "MM/S2", "How hard may it accelerate? [mm/s2]",
        "The controller's setting: grbl $120 to $122 in mm/s2, LinuxCNC MAX_ACCELERATION in units/s2.",
        Quantity("an acceleration", ACCELERATION_UNITS, "mm/s2", "mm/s2", 0.1, 100_000.0),
        _shipped("acceleration"), _every,
    ),
    Question(
        "following_error", "E@F",
        "How far does it lag behind its command at a steady feed? [0.4 at 1000: mm, mm/min; or a gain: 40/s]",
        "The controller's following error while it runs straight; LinuxCNC shows joint.N.f-error. "
        "?: nobody knows, take that of the shipped machine.",
        Lag(), lambda _state, _axes: "?", _with("load", "motor"),
    ),
    Question(
        "servo_period", "MS", "How often does the controller command its axes? [ms]",
        "LinuxCNC SERVO_PERIOD; of steppers only tables use it.",
        Quantity("a time", TIME_UNITS, "ms", "ms", 0.05, 100.0, inverse=RATE_UNITS),
        _period_default,
    ),
)  # fmt: skip
"""Every question, in the order in which they are asked."""
