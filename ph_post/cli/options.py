"""Options that several commands share, each defined once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import click

F = TypeVar("F", bound=Callable[..., Any])

DEFAULT_TOLERANCE_MM = 0.005
"""ε of the windows where the user names none [mm]."""


def _set_debug(ctx: click.Context, _parameter: click.Parameter, value: bool) -> None:
    if value:
        ctx.ensure_object(dict)["debug"] = True


debug = click.option(
    "--debug", is_flag=True, expose_value=False, is_eager=True, callback=_set_debug,
    help="Show a traceback when something goes wrong.",
)  # fmt: skip

json_output = click.option(
    "--json", "as_json", is_flag=True, help="Print one JSON object on standard output."
)

machine = click.option(
    "-m", "--machine", required=True, metavar="MACHINE",
    help="Machine file (.toml), or the name of a shipped one.",
)  # fmt: skip

optional_machine = click.option(
    "-m",
    "--machine",
    default=None,
    metavar="MACHINE",
    help="Machine file (.toml), or the name of a shipped one.",
)

positive = click.FloatRange(min=0.0, min_open=True)

tolerance = click.option(
    "--tolerance", type=positive, default=DEFAULT_TOLERANCE_MM, show_default=True, metavar="MM",
    help="How far the osculating circle may leave the path inside a window.",
)  # fmt: skip

feed = click.option(
    "--feed", type=positive, default=None, metavar="MM/MIN",
    help="Feed in place of the path's; segments with a feed of their own keep it.",
)  # fmt: skip


def common(function: F) -> F:
    """Add the options that every command has."""
    return json_output(debug(function))
