"""Options of the commands that take a log."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final, TypeVar

import click

F = TypeVar("F", bound=Callable[..., Any])

STDIN: Final = "-"
"""Standard input, and standard output."""


def _sides(_ctx: click.Context, _parameter: click.Parameter, given: tuple[str, ...]) -> dict[str, str]:
    """Read ``X=unknown``, once an axis; the reader of logs knows which sides there are."""
    sides: dict[str, str] = {}
    for text in given:
        axis, equals, side = (part.strip() for part in text.partition("="))
        if not (axis and equals and side):
            raise click.BadParameter(f"expected AXIS=SIDE, such as X=unknown; got {text!r}")
        if axis in sides:
            raise click.BadParameter(f"one side an axis; got two for {axis}")
        sides[axis] = side
    return sides


_OPTIONS = (
    click.option(
        "--column",
        "columns",
        multiple=True,
        metavar="NAME=SOURCE[*FACTOR]:UNIT",
        help="Take a column from one of another name or unit, such as X_act=qm:m or X_force=vir*35.15:N; may "
        "be given several times.",
    ),
    click.option(
        "--side",
        "sides",
        multiple=True,
        callback=_sides,
        metavar="AXIS=SIDE",
        help="Where X_act was read: table, motor or unknown, such as X=unknown; may be given several times. "
        "[table, unless the log says another]",
    ),
    click.option(
        "--program",
        metavar="FILE",
        help="The part program that ran: gives the commands where the log has none, and must fit them where "
        "it has some.",
    ),
)


def log_options(function: F) -> F:
    """Add the options that say how a log is read."""
    for option in reversed(_OPTIONS):
        function = option(function)
    return function


def check_places(inputs: Mapping[str, str | None], products: Mapping[str, str | None], *, json: bool) -> None:
    """Refuse two inputs or two products in one place, and a product in place of a record.

    Parameters
    ----------
    inputs, products : mapping
        What was named, by its option; None where nothing was. The machine file alone may be written over.
    json : bool
        Whether standard output is taken by the object.

    Raises
    ------
    click.UsageError
    """
    streams = [option for option, name in inputs.items() if name == STDIN]
    if len(streams) > 1:
        raise click.UsageError(f"standard input can give one of them; got - for {' and '.join(streams)}")
    taken = {STDIN: "--json"} if json else {}
    for option, name in products.items():
        if name is None:
            continue
        if name in taken:
            place = "standard output" if name == STDIN else name
            raise click.UsageError(f"{place} can take one product; got {taken[name]} and {option}")
        taken[name] = option
        for other, read in inputs.items():
            if name == read != STDIN and other != "-m":
                raise click.UsageError(f"{option} would write over {other} ({name})")
