"""``ph-post paper``: the numbers and figures of the paper, computed and compared."""

from __future__ import annotations

import click

from ph_post.cli import options


@click.command()
@click.option("--plot", metavar="FOLDER", help="Draw Figures 1 and 2 into FOLDER.")
@options.common
def command(plot: str | None, as_json: bool) -> int:
    """Compute the printed numbers of the paper and show the error of each.

    The reference is the printed number, the printed formula evaluated exactly, or more digits of it computed
    beforehand. A number agrees when, rounded to the digits of its reference, it is the reference. Exit
    status 1 if one does not.
    """
    from ph_post.io.atomic import make_folder, write_atomically
    from ph_post.report.figures import render
    from ph_post.report.paper import figure_1_analysis, figure_1_windows, number_view, paper_numbers
    from ph_post.report.paper_figures import draw_figure_1, draw_figure_2
    from ph_post.report.tables import format_table, print_json

    numbers = paper_numbers()
    if plot is not None:
        folder = make_folder(plot)
        analysis = figure_1_analysis()
        figures = {"figure1": draw_figure_1(analysis), "figure2": draw_figure_2(analysis, figure_1_windows())}
        write_atomically({str(folder / f"{name}.png"): render(figures[name], "png") for name in figures})
    if as_json:
        print_json({"numbers": [number_view(number) for number in numbers]})
    else:
        header = ("where", "quantity", "computed", "reference", "error", "")
        rows = [
            (n.where, n.name, f"{n.value:.10g}", n.reference, f"{n.error:.1e}", n.verdict) for n in numbers
        ]
        click.echo(format_table(header, rows))
    return 0 if all(number.agrees for number in numbers) else 1
