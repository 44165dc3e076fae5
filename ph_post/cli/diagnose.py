"""``ph-post diagnose``: names the effect that a machine file lacks, and adds it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import click

from ph_post.cli import options
from ph_post.cli.log_options import log_options

if TYPE_CHECKING:
    from ph_post.api.measurements import LogDiagnosis
    from ph_post.files.storage import Content


@click.command()
@click.argument("source", metavar="LOG")
@options.machine
@click.option(
    "-o",
    "--output",
    metavar="BETTER.toml",
    help="Write the machine file with the effects found; - for standard output.",
)
@click.option("--html", metavar="FILE", help="Write a page with the residuals; it needs no network.")
@options.plot("the residuals, step by step and over time")
@click.option("--next", "following", metavar="FILE", help="Write the part program of the next test.")
@log_options
@options.common
def command(source: str, machine: str, as_json: bool, **how: Any) -> int:
    """Find the physical effect that makes a measured log differ from the simulation.

    LOG was measured while the machine ran: a table (.csv, LinuxCNC's halsampler, .mat, .npz, .parquet) or -
    for standard input, with t [s], X_cmd, X_act [mm] and likewise for other axes, and perhaps X_motor [mm],
    X_force [N] or X_current [A]. --column maps other names and units.

    The first line is one of five verdicts. An effect is missing: its name, parameters and standard errors.
    Nothing is missing: log and model differ by no more than the noise. Effects cannot be separated: all of
    them are named. No known effect explains the residual: it is described. The log cannot show it: the reason
    is given. Then comes the residual between log and model after every step, on fitted and on held-out data.
    If another run would answer more, --next writes its part program.

    -o writes the machine file with the effects found, with standard errors and origin as comments. If nothing
    is added, it is the unchanged machine file, with a note on standard error.

    Exit status 0: done, whatever the verdict. 2: the log or the machine file cannot be read, or they do not
    belong together.

    \b
    Examples:
      ph-post diagnose run.csv -m router.toml
      ph-post diagnose run.csv -m router.toml -o better.toml --html run.html
      ph-post diagnose run.csv -m router.toml --program part.ngc --side X=unknown --next ladder.ngc
      ph-post diagnose run.mat -m axis.toml --column X_cmd=qg:m --column X_act=qm:m --json
      ph-post diagnose run.csv -m router.toml -o - | ph-post convert part.ngc -m - -o compensated.ngc

    \b
    JSON:
      verdict          named, nothing-missing, ambiguous, unknown or not-identifiable
      effects          a list of {name, axis, parameters, where, confidence, ambiguous_with}
      gap              {unit, noise_floor, steps}
      next_experiment  what would tell more, else null
      words            the evidence, in sentences
      places           where the log departs from the model
      remaining        what is left that nothing explains
      dropped          names that explain much, and do not agree with themselves
      quality          what the log can show
      notes, warnings  lists of sentences
    """
    import ph_post as ph
    from ph_post.api.inputs import any_machine
    from ph_post.cli.outputs import check_places
    from ph_post.cli.progress import ProgressPrinter
    from ph_post.files.storage import write_atomically
    from ph_post.report.diagnoses import diagnosis_lines, diagnosis_view, effort_units
    from ph_post.report.tables import print_json

    places = {"-o": how["output"], "--html": how["html"], "--plot": how["plot"], "--next": how["following"]}
    inputs = {"LOG": source, "-m": machine, "--program": how["program"]}
    check_places(inputs, places, json=as_json, renews="-m")
    with ProgressPrinter() as progress:
        progress("reading")
        drives, _ = any_machine(machine)
        log = ph.read_log(source, columns=how["columns"], sides=how["sides"], program=how["program"], machine=drives)
        found = ph.diagnose(log, drives, progress=progress)
        progress("writing")
        products = _products(found, how)
        write_atomically(products)
    if as_json:
        print_json({**diagnosis_view(found, effort_units(log)), "warnings": list(log.warnings)})
    else:
        given = [option for option, place in places.items() if place is not None]
        for line in diagnosis_lines(found, effort_units(log), given):
            click.echo(line, err="-" in products)
    for line in _messages(found, how, products):
        click.echo(line, err=True)
    return 0


def _products(found: LogDiagnosis, how: dict[str, Any]) -> dict[str, Content]:
    """Return what was asked for, by the name of its file."""
    from ph_post.report.diagnoses import effort_units
    from ph_post.report.diagnosis_figures import draw_diagnosis
    from ph_post.report.diagnosis_page import diagnosis_page
    from ph_post.report.figures import write_figure

    efforts = effort_units(found.log)
    products: dict[str, Content] = {}
    if how["output"] is not None:
        products[how["output"]] = found.machine_file()
    if how["html"] is not None:
        products[how["html"]] = diagnosis_page(found, found.log.name, efforts)
    if how["plot"] is not None:
        products[how["plot"]] = write_figure(draw_diagnosis(found, efforts), how["plot"])
    if how["following"] is not None and found.next_experiment is not None:
        products[how["following"]] = found.next_experiment.program
    return products


def _messages(found: LogDiagnosis, how: dict[str, Any], products: dict[str, Content]) -> Iterator[str]:
    """Say what the reader had to do, and what was written where."""
    yield from (f"warning: {warning}" for warning in found.log.warnings)
    if how["following"] is not None and found.next_experiment is None:
        yield f"no other run is proposed: {how['following']} is not written"
    for name, content in products.items():
        place = "standard output" if name == "-" else name
        if name == how["output"] and found.source is not None and content == found.source.text:
            yield f"nothing was added: {place} is the machine file as it was"
        elif name != "-":
            yield f"wrote {name}"
