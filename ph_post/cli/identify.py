"""``ph-post identify``: identifies the drive parameters of a machine from a log."""

from __future__ import annotations

from typing import Any

import click

from ph_post.cli import options
from ph_post.cli.log_options import log_options


def _loops(_ctx: click.Context, _parameter: click.Parameter, given: tuple[str, ...]) -> dict[str, str]:
    """Read ``motor`` or ``X=motor``; what names its axis goes before what does not."""
    from ph_post.types import LOOPS, MACHINE_AXES

    every: dict[str, str] = {}
    own: dict[str, str] = {}
    for text in given:
        name, equals, kind = (part.strip() for part in text.rpartition("="))
        if kind not in LOOPS or (equals and name not in MACHINE_AXES):
            raise click.BadParameter(f"expected load, motor or none, or AXIS=one of them; got {text!r}")
        into, names = (own, (name,)) if equals else (every, MACHINE_AXES)
        if any(one in into for one in names):
            raise click.BadParameter(f"one feedback an axis; got two for {name or 'all'}")
        into.update(dict.fromkeys(names, kind))
    return every | own


feedback_option = click.option(
    "--feedback",
    multiple=True,
    callback=_loops,
    metavar="[AXIS=]LOOP",
    help="Where the loop closes, without -m: load, motor or none, for all axes or such as Y=load; may be "
    "given several times. [assumed from the sides in the log, with a note]",
)


def transmission_options(function: options.F) -> options.F:
    """Add the options that say how the motor drives the screw."""
    for option in reversed(_TRANSMISSION):
        function = option(function)
    return function


_TRANSMISSION = (
    click.option(
        "--gear-ratio",
        type=options.positive,
        metavar="N",
        help="Motor turns per turn of the screw; a new file for a load loop needs it.",
    ),
    click.option(
        "--screw-lead",
        type=options.positive,
        metavar="MM",
        help="Lead of the screw; a new file for a load loop needs it.",
    ),
)


@click.command()
@click.argument("source", metavar="LOG")
@options.optional_machine
@click.option(
    "-o",
    "--output",
    metavar="MACHINE.toml",
    help="Write the machine file with the identified parameters; - for standard output.",
)
@feedback_option
@transmission_options
@options.plot("the residual between the log and the identified machine")
@log_options
@options.common
def command(source: str, machine: str | None, output: str | None, plot: str | None, as_json: bool, **how: Any) -> int:
    """Identify b, c and the backlash of every axis from a log, with standard errors.

    LOG holds what was measured while the machine ran; `ph-post diagnose --help` describes its columns. With -m
    the machine file gives limits, controller, effects and what the log does not show, and -o writes the same
    file with the new numbers. Without -m it writes a new file. Its limits are the largest values in the log;
    replace them by the machine's.

    Backlash is accepted where it explains samples that it was not fitted to; otherwise the report says how
    wide it could be unseen. A load loop shows more, where both sides were read: the motor's share of the
    inertia and its time constant. A stretch in which the axis coasts down without drive gives the time constant
    too. A force or a current gives the stiffness of the servo.

    What a log cannot separate is reported, and the file's value is kept: from positions on one side the
    backlash of a load loop is known only as Δθ_m/C.

    Exit status 0: done. 2: the log or the machine file cannot be read, they do not belong together, or the
    log shows no parameter at all.

    \b
    Examples:
      ph-post identify run.csv -m router.toml -o identified.toml --plot run.png
      ph-post identify run.csv --feedback motor -o machine.toml
      ph-post identify run.csv --feedback load --gear-ratio 2 --screw-lead 5 -o machine.toml
      ph-post identify run.mat --feedback motor --column X_cmd=qg:m --column X_motor=qm:m --json

    \b
    JSON:
      axes             parameters with value, stderr and unit, by axis
      fit              {unit, rms, noise_floor} by axis
      identifiability  what the log separates, by axis
      notes, warnings  lists of sentences
    """
    import ph_post as ph
    from ph_post.api.inputs import any_machine
    from ph_post.cli.outputs import check_places
    from ph_post.cli.progress import ProgressPrinter
    from ph_post.files.storage import Content, write_atomically
    from ph_post.report.diagnoses import fit_view, identification_lines, identification_view, unshown_words
    from ph_post.report.figures import write_figure
    from ph_post.report.tables import print_json
    from ph_post.units import MM

    inputs = {"LOG": source, "-m": machine, "--program": how["program"]}
    check_places(inputs, {"-o": output, "--plot": plot}, json=as_json, renews="-m")
    with ProgressPrinter() as progress:
        progress("reading")
        drives = None if machine is None else any_machine(machine)[0]
        log = ph.read_log(source, columns=how["columns"], sides=how["sides"], program=how["program"], machine=drives)
        found = ph.identify(
            log,
            drives,
            feedback=how["feedback"],
            gear_ratio=how["gear_ratio"],
            screw_lead=None if how["screw_lead"] is None else how["screw_lead"] * MM,
            for_file=output is not None,
            progress=progress,
        )
        products: dict[str, Content] = {}
        if output is not None:
            progress("writing")
            products[output] = found.machine_file()
        if plot is not None:
            from ph_post.report.diagnosis_figures import draw_identification

            progress("drawing")
            products[plot] = write_figure(draw_identification(found), plot)
        write_atomically(products)
    warnings = [*log.warnings, *unshown_words(found.axes)]
    if as_json:
        view = identification_view(found.axes, found.sentences)
        print_json({**view, **fit_view(found), "warnings": warnings})
    else:
        for line in identification_lines(found.axes, found.sentences):
            click.echo(line, err="-" in products)
    options.report_written(warnings, products)
    return 0
