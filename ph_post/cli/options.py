"""Options that several commands share, each defined once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import click

F = TypeVar("F", bound=Callable[..., Any])

DEFAULT_TOLERANCE_MM = 0.005
"""ε of the windows where the user names none [mm]."""

BACKUP = ".bak"
"""Ending of a backup where the user names none."""


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


dialect = click.option(
    "--dialect", default=None, metavar="NAME",
    help="Controller dialect in place of the machine file's; programs are read and written by its words.",
)  # fmt: skip


def common(function: F) -> F:
    """Add the options that every command has."""
    return json_output(debug(function))


def _coefficients(
    _ctx: click.Context, _parameter: click.Parameter, text: str | None
) -> tuple[float, ...] | None:
    """Read ``1,1,0.2,1,1``."""
    if text is None:
        return None
    try:
        return tuple(float(word) for word in text.split(","))
    except ValueError as error:
        raise click.BadParameter(f"expected numbers separated by commas; got {text!r}") from error


class _StrategyOption(click.Option):
    """Lists the strategies on the help page, and loads them for no other."""

    def get_help_record(self, ctx: click.Context) -> tuple[str, str] | None:
        """Return the option's entry, with every strategy's summary."""
        from ph_post.compensate.strategies.registry import find_strategy, strategy_names

        known = ";  ".join(f"{name}: {find_strategy(name).summary}" for name in strategy_names())
        self.help = f"What is done at each turning point. {known}."
        return super().get_help_record(ctx)


def strategy(default: str | None, words: str | bool = True) -> Callable[[F], F]:
    """Return the option that names the strategy; `words` say what the default is where it depends."""
    return click.option(
        "--strategy", cls=_StrategyOption, default=default, show_default=words, metavar="NAME",
        help="What is done at each turning point.",
    )  # fmt: skip


carrier = click.option(
    "--carrier", type=click.Choice(["table", "program"]), default="table", show_default=True,
    help="Plan for an interpolator table, or for a part program, which cannot carry all that a table can.",
)  # fmt: skip


_PLANNING = (
    tolerance,
    feed,
    dialect,
    click.option(
        "--start", type=click.Choice(["rest", "moving"]), default="rest", show_default=True,
        help="Begin and end at rest, or hold the feed from end to end.",
    ),
    click.option(
        "--ratio", type=float,
        help="V(1/2)/V_c, the feed at the turning point over the feed around it. [0.25; retrograde -0.3]",
    ),
    click.option("--degree", type=click.IntRange(min=4), help="Degree of the feed profile, even. [10]"),
    click.option("--t-star", type=positive, metavar="S", help="Half duration of the feed profile."),
    click.option(
        "--coefficients", callback=_coefficients, metavar="V0,V1,...",
        help="V_k / V_c of Eq. (26), all of them.",
    ),
    click.option(
        "--allow-retrograde", is_flag=True,
        help="Let the feed become negative: the tool moves back for a while.",
    ),
    click.option("--min-feed", type=positive, metavar="MM/MIN", help="No slower than this while cutting."),
    click.option(
        "--max-slowdown", type=click.FloatRange(min=0.0), default=0.1, show_default=True, metavar="FRACTION",
        help="Soften the dips until the cycle time grows by no more than this; not where --ratio is given.",
    ),
    click.option(
        "--feed-only", is_flag=True, help="Leave the path as it is: nothing is added to its positions."
    ),
    click.option(
        "--effort", type=positive, default=1.0, show_default=True, metavar="FACTOR",
        help="How much `auto` and `takeup` search: 1 for some ten seconds, less where a first look will do.",
    ),
    click.option(
        "--no-inverse-dynamics", is_flag=True, help="Do not lead the path by what the servos lag behind it."
    ),
)  # fmt: skip


def planning(function: F) -> F:
    """Add the options that say how the motion along a path is planned, but for the strategy."""
    for option in reversed(_PLANNING):
        function = option(function)
    return function
