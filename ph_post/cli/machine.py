"""``ph-post machine``: writes machine files, `new` from questions; `measure` stands in a module of its own."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING

import click

from ph_post.cli import options
from ph_post.cli.measure import command as measure
from ph_post.cli.questions import QUESTIONS

if TYPE_CHECKING:
    from ph_post.cli.interview import GivenAnswer
    from ph_post.identify.newmachine import NewMachine


def _answers(function: options.F) -> options.F:
    """Add an option for every question."""
    for question in reversed(QUESTIONS):
        flag = click.option(question.option, question.key, metavar=question.metavar, help=question.ask)
        function = flag(function)
    return function


@click.group(name="machine", no_args_is_help=False)
def command() -> None:
    """Write machine files; `ph-post machines` lists the shipped ones.

    A machine file says where the loop of each axis is closed, how much the axis loses when it turns round,
    and what the machine and its controller can. Every command that plans or simulates needs one, behind -m.

    \b
    Examples:
      ph-post machine new --help
      ph-post machine measure --help
    """


command.add_command(measure, "measure")


@command.command()
@click.argument("output", metavar="[FILE]", default="-")
@_answers
@click.option("--answers", metavar="FILE", help="Answers (TOML), by the names of the options: lost_motion = 0.03.")
@click.option(
    "--settings",
    metavar="FILE",
    help="Defaults from the controller's own settings: a listing of Grbl's $$, or LinuxCNC's .ini or .hal file.",
)
@click.option("--yes", is_flag=True, help="Ask nothing: what no option and no file answers takes its default.")
@click.option("--force", is_flag=True, help="Replace FILE where it is there already.")
@options.common
def new(
    output: str,
    answers: str | None,
    settings: str | None,
    yes: bool,
    force: bool,
    as_json: bool,
    **given: str | None,
) -> int:
    """Ask what a machinist knows, and write a machine file of it.

    Asked are the axes, where each loop is closed, the controller, what a dial indicator loses at a reversal,
    screw and gear where there is a glass scale, speed and acceleration, the following error, and the servo
    period. Every question says where the answer is found, and has a default. What cannot be asked is taken
    from the shipped machine with the same loop, and marked in the file: measure it with calibrate and
    identify. Gains of a drive or of LinuxCNC's pid, by option or out of --settings, make a cascade; nobody is asked for
    them. Every line has a comment. The file is read back before it is written to FILE, or to standard
    output.

    An option answers its question beforehand: one value for all axes, one each ("0.03 0.05 0.02"), or by name
    ("X=0.03 Y=0.05 Z=0.02"); lengths in mm or as 0.002in. At a terminal a question is asked again where its
    answer is bad. Elsewhere the questions that are left take a line each of standard input, an empty one for
    the default.

    \b
    Examples:
      ph-post machine new my_mill.toml
      ph-post machine new my_router.toml --yes --loop motor --lost-motion "0.12 0.08 0.01" --speed 7200mm/min
      ph-post machine new small_router.toml --yes --axes XY --loop none --lost-motion 0.002in --json
      ph-post machine new --answers answers.toml --yes > old_mill.toml
      ph-post machine new my_stepper.toml --settings grbl_settings.txt
      ph-post machine new my_servo.toml --yes --loop motor --position-gain 2.4m/min/mm --feedforward 95%

    \b
    JSON:
      file, text  where the machine file went; its text where that is standard output, else null
      machine     title, dialect, servo_period [ms], axes
      assumed     by axis, the keys that nobody answered
      warnings    what is to be put right before the file is used
    """
    from ph_post.cli.interview import conduct, machine_answers, settings_of, twice_compensated
    from ph_post.cli.outputs import refuse_existing
    from ph_post.identify.newmachine import new_machine

    refuse_existing(output, force)  # before anybody answers a question for it
    own = {} if settings is None else settings_of(settings)
    made = new_machine(machine_answers(conduct(_known(answers, given), yes, own)))
    if not (output == "-" and as_json):
        _write(output, made, force)
    left_out = [f"{settings}: {note}" for note in own.get("notes", {}).values()]
    warnings = [*_warnings(made), *twice_compensated(settings or "", own), *left_out]
    if as_json:
        _print_view(output, made, warnings)
    for line in warnings:
        click.echo(f"warning: {line}", err=True)
    if output != "-":
        click.echo(
            f"wrote {output}; it goes behind -m, as in: ph-post convert part.ngc -m {output} -o part_compensated.ngc",
            err=True,
        )
    return 0


def _known(answers: str | None, given: Mapping[str, str | None]) -> dict[str, GivenAnswer]:
    """Gather what need not be asked: options come before the file of answers."""
    from ph_post.cli.interview import GivenAnswer, answers_of

    known = {} if answers is None else answers_of(answers)
    for question in QUESTIONS:
        text = given[question.key]
        if text is not None:
            known[question.key] = GivenAnswer(text, question.option)
    return known


def _print_view(output: str, made: NewMachine, warnings: list[str]) -> None:
    from ph_post.report.tables import print_json
    from ph_post.report.views import machine_view

    printed = output == "-"
    print_json(
        {
            "file": None if printed else output,
            "text": made.text if printed else None,
            "machine": machine_view(made.machine),
            "assumed": made.assumed,
            "warnings": warnings,
        }
    )


def _write(output: str, made: NewMachine, force: bool) -> None:
    """Write the file; what was answered at a terminal is shown where that fails, so that it is not lost."""
    from ph_post.cli.outputs import refuse_existing
    from ph_post.errors import InputError
    from ph_post.files.storage import write_atomically

    try:
        refuse_existing(output, force)
        write_atomically({output: made.text})
    except InputError:
        if output != "-" and sys.stdin is not None and sys.stdin.isatty():
            click.echo(made.text)
        raise


def _warnings(made: NewMachine) -> list[str]:
    """Say what is to be put right before the machine file is of use."""
    warnings = []
    if still := _axes_with(made, "lost_motion_mm"):
        warnings.append(
            f"no lost motion of {still}: nothing is compensated until a number stands in the file; ph-post calibrate"
            " --without-log says how to measure it"
        )
    if guessed := _axes_with(made, "c"):
        warnings.append(
            f"nobody said how far {guessed} {'lags' if len(guessed) == 1 else 'lag'} behind: b and c there are those of"
            " another machine; ph-post identify measures them, before a table leads by them"
        )
    if guessed := _axes_with(made, "control.velocity_gain_per_s"):
        warnings.append(
            f"nobody said how quick the velocity loop of {guessed} is: with speed fed forward that decides how far an"
            " axis runs over its goal, and what can be compensated; state --velocity-gain, or measure it by identify"
        )
    cascades = {name: axis.servo.cascade for name, axis in made.machine.axes.items()}
    if banded := ", ".join(name for name, one in cascades.items() if one is not None and one.deadband > 0.0):
        warnings.append(
            f"the deadband of {banded} counts as certain: identify and diagnose do not fit it, and find other gains"
            " where the pid has none; take it out of the file then"
        )
    limits = [_axes_with(made, key) for key in ("max_velocity_mm_s", "max_acceleration_mm_s2")]
    if guessed := max(limits, key=len):
        warnings.append(
            f"nobody said how fast {guessed} may move and accelerate: another machine's limits stand there, by which"
            " times are reckoned and plans are made; state --speed and --acceleration"
        )
    return warnings


def _axes_with(made: NewMachine, key: str) -> str:
    return ", ".join(axis for axis, keys in made.assumed.items() if key in keys)
