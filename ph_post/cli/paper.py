"""``ph-post paper``: computes the numbers and figures of the paper, and compares them."""

from __future__ import annotations

import click

from ph_post.cli import options


@click.command()
@click.option("--figures", "--plot", "figures", metavar="FOLDER", help="Draw Figures 1, 2 and 5 to 11 into FOLDER.")
@options.common
def command(figures: str | None, as_json: bool) -> int:
    """Compute the printed numbers of the paper and show the error of each.

    The reference is the printed number, the printed formula evaluated exactly, or more digits of it computed
    beforehand. A number agrees when, rounded to the digits of its reference, it is the reference; errors of
    simulated motions, when they are within 2 % of it, or 3 % for the whole machine. Exit status 1 if a number
    does not agree.

    Figures 5 to 10 follow the paper: backlash on x only, opened at t = 0. Figure 11 also shows a machine whose
    backlash opens at every reversal of both axes.

    \b
    Examples:
      ph-post paper
      ph-post paper --figures figures

    \b
    JSON:
      numbers  a list of {where, name, value, reference, error, agrees}
    """
    from ph_post.cli.progress import ProgressPrinter
    from ph_post.files.storage import make_folder, write_atomically
    from ph_post.report.paper import number_view, paper_numbers
    from ph_post.report.paper_figures import paper_pictures
    from ph_post.report.tables import format_table, print_json

    with ProgressPrinter() as progress:
        progress("computing the paper's numbers")
        numbers = paper_numbers()
        if figures is not None:
            pictures = paper_pictures(progress)
            folder = make_folder(figures)
            write_atomically({str(folder / name): picture for name, picture in pictures.items()})
    if as_json:
        print_json({"numbers": [number_view(number) for number in numbers]})
    else:
        header = ("where", "quantity", "computed", "reference", "error", "")
        rows = [(n.where, n.name, f"{n.value:.10g}", n.reference, f"{n.error:.1e}", n.verdict) for n in numbers]
        click.echo(format_table(header, rows))
    return 0 if all(number.agrees for number in numbers) else 1
