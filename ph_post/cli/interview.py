"""Ask the questions of ``ph-post machine new``: by option, answer file, terminal or pipe.

A question that an option or file answers is not asked. At a terminal a bad answer is reported and asked again;
elsewhere it ends the command, and so does the end of the input. Nothing is written here.
"""

from __future__ import annotations

import sys
import textwrap
import tomllib
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from ph_post.cli.answers import WordChoice, by_axis
from ph_post.cli.questions import CASCADE, QUESTIONS, Question, State
from ph_post.errors import InputError

if TYPE_CHECKING:
    from ph_post.identify.newmachine import Answers


WELCOME: Final = """\
Enter takes what stands in [ ]. Of several axes: one value for all, one each (0.03 0.05 0.02), or by name
(X=0.03 Y=0.05 Z=0.02). Inches as 0.002in. Ctrl-C writes nothing."""


_SCREEN: Final = 100
"""Width of what is printed, in characters."""


AskedAxes = Sequence[str] | None
"""AskedAxes that a question is asked for, None for one that is about the machine."""

Settings = Mapping[str, Mapping[str, str]]
"""What a controller's settings answer, by question and axis ("" for the machine); "notes" say what is left out."""


class GivenAnswer(NamedTuple):
    """An answer that came with the command, and where it stands."""

    text: str
    where: str


class InterviewResult(NamedTuple):
    """Values by question, and the questions whose default was taken."""

    state: State
    taken: frozenset[str]


def answers_of(source: str) -> dict[str, GivenAnswer]:
    """Read a file of answers (TOML): question = answer, or a table of axes with one each.

    Raises
    ------
    InputError
        Where it is no TOML, or has a question that is none.
    """
    from ph_post.files.check import one_of
    from ph_post.files.storage import read_source

    file = read_source(source)
    try:
        raw = tomllib.loads(file.text)
    except ValueError as error:
        raise InputError(file.name, f"not valid TOML: {error}") from None
    known = [question.key for question in QUESTIONS]
    for key in raw:
        if key not in known:
            raise InputError(f"{file.name}: {key}", "no such question", expected=one_of(known, key))
    return {key: GivenAnswer(_text(value, f"{file.name}: {key}"), f"{file.name}: {key}") for key, value in raw.items()}


def settings_of(source: str) -> Settings:
    """Read a controller's own settings, as defaults of the questions that they answer.

    Raises
    ------
    InputError
        Where there are none in the file.
    """
    from ph_post.files.storage import read_source
    from ph_post.identify.settings import controller_settings

    found = controller_settings(read_source(source))
    settings = {
        "speed": {axis: f"{value:.7g}mm/s" for axis, value in found.speed.items()},
        "acceleration": {axis: f"{value:.7g}mm/s2" for axis, value in found.acceleration.items()},
        "lost_motion": {axis: f"{value:.7g}mm" for axis, value in found.lost_motion.items()},
        "dialect": {"": found.dialect},
        "axes": {"": "".join(axis for axis in found.speed if axis in found.acceleration) or "XYZ"},
    }
    for key, by_axis_name in found.gains.items():
        unit = {"position_gain": "/s", "feedforward": "%"}.get(key, "")
        settings[key] = {axis: f"{value:.7g}{unit}" for axis, value in by_axis_name.items()}
    if found.servo_period is not None:
        settings["servo_period"] = {"": f"{found.servo_period:.7g}ms"}
    if found.notes:
        settings["notes"] = {str(number): note for number, note in enumerate(found.notes)}
    if found.planner:
        settings["planner"] = {key: f"{value:.7g}" for key, value in found.planner.items()}
    return settings


def twice_compensated(name: str, settings: Settings) -> list[str]:
    """Warn of a controller that takes the lost motion back by itself: both would be too much."""
    axes = [axis for axis, text in settings.get("lost_motion", {}).items() if text != "0mm"]
    if not axes:
        return []
    return [f"{name} has BACKLASH of {', '.join(axes)}: the controller compensates too; set it to 0 there"]


def conduct(given: Mapping[str, GivenAnswer], defaults: bool, settings: Settings | None = None) -> InterviewResult:
    """Return a value for every question that applies.

    Parameters
    ----------
    given : mapping of str to GivenAnswer
        What need not be asked, by key.
    defaults : bool
        Take the default of everything else instead of asking.
    settings : mapping, optional
        Defaults of this machine, by key and axis, in place of the shipped machine's.

    Raises
    ------
    InputError
        Where an answer is bad or missing, and nobody can be asked again.
    """
    state: dict[str, Any] = {}
    taken = set()
    terminal = sys.stdin is not None and sys.stdin.isatty()
    welcome = terminal and not defaults
    for question in QUESTIONS:
        axes = question.axes(state) if question.axes is not None else None
        answer = given.get(question.key)
        if axes is not None and not axes:
            _refuse_idle(question, answer)
            continue
        if question.silent and answer is None:
            axes = [axis for axis in axes or () if axis in (settings or {}).get(question.key, {})]
            if not axes:
                continue
        default, own = _default(question, state, axes, settings or {})
        if answer is not None or defaults or question.silent:
            place = f"--settings, {question.key}" if own else question.option
            text, where = (default, place) if answer is None else answer
            state[question.key] = _value(question, text, axes, where)
            untouched = answer is None
        else:
            if welcome:
                show(WELCOME)
                welcome = False
            state[question.key], untouched = _asked(question, axes, default, terminal)
        if untouched and not own:
            taken.add(question.key)
    if settings is not None and settings.get("dialect", {}).get("") == state["dialect"]:
        state["planner"] = {key: float(text) for key, text in settings.get("planner", {}).items()}
    return InterviewResult(state, frozenset(taken))


def machine_answers(outcome: InterviewResult) -> Answers:
    """Sort what was answered by axis."""
    from ph_post.identify.newmachine import Answers, AxisAnswers

    state, taken = outcome
    gains = {question.key: state.get(question.key, {}) for question in CASCADE}
    _check_gains(state, gains)
    axes = {
        axis: AxisAnswers(
            feedback=state["loop"][axis],
            lost_motion_mm=state["lost_motion"][axis],
            max_velocity_mm_s=state["speed"][axis],
            max_acceleration_mm_s2=state["acceleration"][axis],
            c_s=state.get("following_error", {}).get(axis),
            screw_lead_mm=state.get("lead", {}).get(axis),
            gear_ratio=state.get("gear", {}).get(axis),
            gains={key: found[axis] for key, found in gains.items() if axis in found},
            taken=taken,
        )
        for axis in state["axes"]
    }
    return Answers(
        name=state["name"],
        dialect=state["dialect"],
        servo_period_ms=state["servo_period"],
        axes=axes,
        planner=state.get("planner", {}),
    )


def _check_gains(state: State, gains: Mapping[str, Mapping[str, float]]) -> None:
    """Refuse a following error beside the gains of a cascade.

    Raises
    ------
    InputError
    """
    for axis in gains["position_gain"]:
        if state.get("following_error", {}).get(axis) is not None:
            what = f"the cascade of axis {axis} has one of its own"
            raise InputError("--following-error", what, expected="--position-gain alone")


def _default(question: Question, state: State, axes: AskedAxes, settings: Settings) -> tuple[str, bool]:
    """Return what is taken for an empty answer, and whether it is this machine's own."""
    known = settings.get(question.key, {})
    names = [""] if axes is None else axes
    if known and set(names) <= set(known):
        return " ".join(f"{name}={known[name]}" if name else known[name] for name in names), True
    return question.default(state, axes or state.get("axes", ())), False


def _asked(question: Question, axes: AskedAxes, default: str, terminal: bool) -> tuple[Any, bool]:
    """Ask until there is an answer, of a pipe once; also tell whether it was the default."""
    where = f"standard input, {question.key}"
    if terminal:
        _show(question, axes)
    while True:
        if terminal:
            show(f"  [{default}] ", end="")
        line = next_line(where)
        try:
            return _value(question, line or default, axes, question.key if terminal else where), not line
        except InputError as error:
            if not terminal:
                raise
            show(f"  {error}")


def _show(question: Question, axes: AskedAxes) -> None:
    """Put a question on the screen."""
    about = f"{', '.join(axes)}: " if axes else ""
    kind = question.kind
    hint = f"{question.hint} {kind.words.capitalize()}." if isinstance(kind, WordChoice) else question.hint
    indented = textwrap.fill(hint, _SCREEN, initial_indent="  ", subsequent_indent="  ")
    show(f"\n{about}{question.ask}\n{indented}")


def show(text: str, end: str = "\n") -> None:
    """Talk on standard error: standard output is for the product."""
    sys.stderr.write(text + end)
    sys.stderr.flush()


def next_line(where: str, expected: str = "a line, or --yes for defaults") -> str:
    """Return the next line without its ends; `expected` is what is said where the input has ended.

    Raises
    ------
    InputError
        Where there is none, or it is no text.
    """
    try:
        line = "" if sys.stdin is None else sys.stdin.readline()
    except UnicodeDecodeError as error:
        byte = f"byte 0x{error.object[error.start]:02x}"
        raise InputError(where, "not text", expected="UTF-8", got=byte) from None
    if not line:
        if sys.stdin is not None and sys.stdin.isatty():
            show("")  # what is said stands below the question, not behind it
        raise InputError(where, "no answer", expected=expected, got="the end of the input")
    return line.strip()


def _value(question: Question, text: str, axes: AskedAxes, where: str) -> Any:
    return question.kind.one(text, where) if axes is None else by_axis(question.kind, text, axes, where)


def _refuse_idle(question: Question, answer: GivenAnswer | None) -> None:
    """Refuse the answer to a question that this machine does not have: it was meant for another."""
    if answer is not None:
        what = "not used by a machine with these loops"
        if question.silent:
            what = "belongs to a cascade, which this machine has not"
        expected = "--position-gain as well" if question.silent else "it left out"
        raise InputError(answer.where, what, expected=expected, got=repr(answer.text))


def _text(value: Any, where: str) -> str:
    """Return a value of an answer file as a person would type it.

    Raises
    ------
    InputError
        Where it is no text, number, list or table of these.
    """
    if isinstance(value, dict):
        return " ".join(f"{axis}={_text(one, where)}" for axis, one in value.items())
    if isinstance(value, list):
        return "; ".join(_text(one, where) for one in value)
    if isinstance(value, str | int | float) and not isinstance(value, bool):
        return str(value)
    raise InputError(where, "wrong type", expected="a text, a number, or one by axis", got=type(value).__name__)
