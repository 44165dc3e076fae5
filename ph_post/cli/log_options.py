"""Options of the commands that take a log."""

from __future__ import annotations

import click

from ph_post.cli import options


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


column_option = click.option(
    "--column",
    "columns",
    multiple=True,
    metavar="NAME=SOURCE[*FACTOR]:UNIT",
    help="Take a column from one of another name or unit, such as X_act=qm:m or X_force=vir*35.15:N; may "
    "be given several times. recorder=NAME takes all columns as linuxcnc, siemens, twincat or odrive name them; "
    "recorder=odrive*5 for 5 mm a turn.",
)

side_option = click.option(
    "--side",
    "sides",
    multiple=True,
    callback=_sides,
    metavar="AXIS=SIDE",
    help="Where X_act was read: table, motor or unknown, such as X=unknown; may be given several times. "
    "[table, unless the log says another]",
)

_OPTIONS = (
    column_option,
    side_option,
    click.option(
        "--program",
        metavar="FILE",
        help="The part program that ran: gives the commands where the log has none, and must fit them where "
        "it has some.",
    ),
)


def log_options(function: options.F) -> options.F:
    """Add the options that say how a log is read."""
    for option in reversed(_OPTIONS):
        function = option(function)
    return function
