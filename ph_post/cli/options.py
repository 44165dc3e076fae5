"""Options that several commands share, each defined once."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar, cast

import click

from ph_post.bounds import LEAST_CORNER_TOLERANCE, LEAST_TOLERANCE, MOST_EFFORT
from ph_post.errors import OptionsError, out_of_range, unknown_word
from ph_post.units import MM, MM_PER_MIN, MS

F = TypeVar("F", bound=Callable[..., Any])

DEFAULT_TOLERANCE_MM = 0.005
"""ε of the windows where the user names none [mm]."""

BACKUP = ".bak"
"""Ending of a backup where the user names none."""

PER_MINUTE = "per-minute"
"""How feeds are written where the user does not say."""

MACHINE_VARIABLE = "PH_POST_MACHINE"
"""Environment variable that names the machine file where no option does."""


def _set_debug(ctx: click.Context, _parameter: click.Parameter, value: bool) -> None:
    if value:
        ctx.ensure_object(dict)["debug"] = True


debug = click.option(
    "--debug",
    is_flag=True,
    expose_value=False,
    is_eager=True,
    callback=_set_debug,
    help="Show a traceback when something goes wrong.",
)

json_output = click.option("--json", "as_json", is_flag=True, help="Print one JSON object on standard output.")

machine = click.option(
    "-m",
    "--machine",
    required=True,
    metavar="MACHINE",
    help="Machine file (.toml), or the name of a shipped one.",
)

optional_machine = click.option(
    "-m",
    "--machine",
    default=None,
    metavar="MACHINE",
    help="Machine file (.toml), or the name of a shipped one.",
)


def require_machine(name: str | None) -> str:
    """Return what :data:`optional_machine` names, where it turns out to be needed.

    Raises
    ------
    click.UsageError
        Where it names nothing.
    """
    if name is None:
        raise click.UsageError("Missing option '-m' / '--machine'")
    return name


def require_two_sources(a: str | None, b: str | None) -> None:
    """Refuse to read two programs from standard input.

    Raises
    ------
    click.UsageError
    """
    if a == b == "-":
        raise click.UsageError("standard input can give one program; got - for both")


_UNITS = {
    "tolerance": MM,
    "feed": MM_PER_MIN,
    "corner_tolerance": MM,
    "min_feed": MM_PER_MIN,
    "chord_tolerance": MM,
    "block_time": MS,
    "overshoot": MM,
    "peck_clearance": MM,
    "safe_z": MM,
    "depth": MM,
}
"""SI values of the units in which options are given, by keyword."""


def in_si(how: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a command's options are as keywords of :func:`ph_post.compensate`; those not given are left out."""
    from ph_post.api.options import CompensateOptions

    given = {name: how[name] for name in CompensateOptions.__struct_fields__ if how.get(name) is not None}
    return {name: value * _UNITS[name] if name in _UNITS else value for name, value in given.items()}


class Number(click.FloatRange):
    """A finite number, in a range where one is given; another is refused in the words of :mod:`ph_post.api`."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, _ctx: click.Context | None) -> float:
        """Read the number, and refuse words such as ``nan`` and ``inf`` too.

        Raises
        ------
        InputError
        """
        low = -math.inf if self.min is None else self.min
        high = math.inf if self.max is None else self.max
        try:
            found = float(value)
        except (ValueError, OverflowError):
            found = math.nan
        if not math.isfinite(found) or not low <= found <= high or (self.min_open and found == low):
            raise out_of_range(_name_of(param), value, low, open_low=self.min_open, high=high)
        return found

    def _describe_range(self) -> str:
        """Say nothing on the help page where any number is taken."""
        return "" if self.min is None and self.max is None else super()._describe_range()


if TYPE_CHECKING:
    _Choice = click.Choice[str]
else:
    _Choice = click.Choice  # takes no type before version 8.2


class Word(_Choice):
    """One of a few words; another is refused in the words of :mod:`ph_post.api`."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Take the word.

        Raises
        ------
        InputError
        """
        try:
            return super().convert(value, param, ctx)
        except click.BadParameter:
            raise unknown_word(_name_of(param), value, [str(word) for word in self.choices]) from None


def _name_of(param: click.Parameter | None) -> str:
    """Return what an option is called by most: its longest name."""
    return "" if param is None else max(param.opts, key=len)


positive = Number(min=0.0, min_open=True)

close = Number(min=round(LEAST_TOLERANCE / MM, 9))
"""A distance within which paths are the same."""

tolerance = click.option(
    "--tolerance",
    type=close,
    default=DEFAULT_TOLERANCE_MM,
    show_default=True,
    metavar="MM",
    help="Largest distance of the osculating circle from the path inside a window.",
)

feed = click.option(
    "--feed",
    type=positive,
    default=None,
    metavar="MM/MIN",
    help="Feed in place of that of the path; segments with their own feed keep it.",
)


dialect = click.option(
    "--dialect",
    default=None,
    metavar="NAME",
    help="Controller dialect in place of that of the machine file, for reading and writing programs.",
)


def common(function: F) -> F:
    """Add the options that every command has; options that do not go together are a usage error."""

    @functools.wraps(function)
    def command(*arguments: Any, **named: Any) -> Any:
        try:
            return function(*arguments, **named)
        except OptionsError as error:
            raise click.UsageError(str(error)) from error

    return json_output(debug(cast("F", command)))


def _coefficients(_ctx: click.Context, _parameter: click.Parameter, text: str | None) -> tuple[float, ...] | None:
    """Read ``1,1,0.2,1,1``."""
    if text is None:
        return None
    try:
        found = tuple(float(word) for word in text.split(","))
    except ValueError:
        found = (math.nan,)
    if not all(map(math.isfinite, found)):
        raise click.BadParameter(f"expected numbers separated by commas; got {text!r}")
    return found


class _StrategyOption(click.Option):
    """Lists the strategies on the help page, and loads them for no other."""

    def get_help_record(self, ctx: click.Context) -> tuple[str, str] | None:
        """Return the option's entry, with every strategy's summary."""
        from ph_post.compensate.strategies.registry import find_strategy, strategy_names

        known = ";  ".join(f"{name}: {find_strategy(name).summary}" for name in strategy_names())
        record = super().get_help_record(ctx)
        if record is None or self.help is None:
            return record
        return record[0], record[1].replace(self.help, f"{self.help} {known}.")


def strategy(default: str | None, words: str | bool = True) -> Callable[[F], F]:
    """Return the option that names the strategy; `words` say what the default is where it depends."""
    return click.option(
        "--strategy",
        cls=_StrategyOption,
        default=default,
        show_default=words,
        metavar="NAME",
        help="Method of compensation at each reversal.",
    )


carrier = click.option(
    "--carrier",
    type=Word(["table", "program"]),
    default="table",
    show_default=True,
    help="Plan for an interpolator table, or for a part program, which cannot hold everything that a table can.",
)

carrier_of_job = click.option(
    "--carrier",
    type=Word(["table", "program"]),
    help="Compare interpolator tables, or part programs; by default programs of a program, and tables of a path.",
)


def _picture(_ctx: click.Context, _parameter: click.Parameter, name: str | None) -> str | None:
    """Refuse a picture of another format before anything is worked out."""
    if name is not None:
        from ph_post.report.figures import picture_format

        picture_format(name)
    return name


def known_table(_ctx: click.Context, _parameter: click.Parameter, name: str | None) -> str | None:
    """Refuse a table of another kind before anything is worked out."""
    if name is not None:
        from ph_post.files.table import table_ending

        table_ending(name)
    return name


def plot(what: str) -> Callable[[F], F]:
    """Return the option that asks for a picture of `what`; the ending of the file's name is its format."""
    return click.option(
        "--plot",
        metavar="FILE",
        callback=_picture,
        help=f"Picture of {what}: .png, .svg or .pdf.",
    )


def report_written(warnings: Iterable[str], products: Iterable[str]) -> None:
    """Say on standard error what is to be known, and which files were written."""
    for warning in warnings:
        click.echo(f"warning: {warning}", err=True)
    for name in products:
        if name != "-":
            click.echo(f"wrote {name}", err=True)


_PLANNING = (
    tolerance,
    feed,
    click.option(
        "--corner-tolerance",
        type=Number(min=round(LEAST_CORNER_TOLERANCE / MM, 9)),
        default=None,
        metavar="MM",
        help="Round the sharp corners of a path by smooth curves within this distance, and do not stop there.",
    ),
    dialect,
    click.option(
        "--start",
        type=Word(["rest", "moving"]),
        default="rest",
        show_default=True,
        help="Begin and end at rest, or keep the feed from end to end.",
    ),
    click.option(
        "--ratio",
        type=Number(),
        metavar="NUMBER",
        help="V(1/2)/V_c, the feed at the reversal over the feed around it. [0.25; retrograde -0.3]",
    ),
    click.option("--degree", type=int, help="Degree of the feed profile, even. [10]"),
    click.option("--t-star", type=positive, metavar="S", help="Half duration of the feed profile."),
    click.option(
        "--coefficients",
        callback=_coefficients,
        metavar="V0,V1,...",
        help="V_k / V_c of Eq. (26), all of them.",
    ),
    click.option(
        "--allow-retrograde",
        is_flag=True,
        help="Allow negative feed: the tool moves back for a while.",
    ),
    click.option("--min-feed", type=positive, metavar="MM/MIN", help="Lowest feed while cutting."),
    click.option(
        "--max-slowdown",
        type=Number(min=0.0),
        default=0.1,
        show_default=True,
        metavar="FRACTION",
        help="Largest increase of the cycle time (0.1 is 10 %), for which dips are softened; not with --ratio.",
    ),
    click.option(
        "--max-standstill",
        type=Number(min=0.0),
        metavar="SECONDS",
        help="Longest time in all that the tool may stand or creep (below 2 % of the feed) on the contour of a path, "
        "beyond that of the plain motion.",
    ),
    click.option("--feed-only", is_flag=True, help="Change feeds only, not the positions of the path."),
    click.option("--no-inverse-dynamics", is_flag=True, help="Do not command the path ahead by the lag of the servos."),
)


def planning_with(effort: float) -> Callable[[F], F]:
    """Return what adds the options that say how the motion along a path is planned, but for the strategy.

    `effort` is how much is searched where the user does not say.
    """
    searched = click.option(
        "--effort",
        type=Number(min=0.0, min_open=True, max=MOST_EFFORT),
        default=effort,
        show_default=True,
        metavar="FACTOR",
        help="Search effort of `auto` and `takeup`: 1 for some ten seconds, less for a first look.",
    )

    def add(function: F) -> F:
        return _with((*_PLANNING, searched), function)

    return add


planning = planning_with(effort=1.0)


_WRITING = (
    click.option(
        "--chord-tolerance", type=positive, metavar="MM", help="Largest distance of a G1 chord from the path."
    ),
    click.option("--block-time", type=positive, metavar="MS", help="Duration of the blocks in ramps and dips."),
    click.option(
        "--safe-z",
        type=Number(),
        metavar="MM",
        help="Height at which a path of a path file is approached and left.",
    ),
    click.option(
        "--depth",
        type=Number(),
        metavar="MM",
        help="Z at which a planar path file is cut; needs --safe-z.",
    ),
    click.option(
        "--position-from",
        type=Word(["+", "-"]),
        default=None,
        help="One-sided positioning in part programs: X and Y come to holes, and to all places at which they rest while"
        " the tool cuts, always from their plus side, or from their minus side.",
    ),
    click.option(
        "--overshoot",
        type=positive,
        metavar="MM",
        help="From how far beyond its place an axis of a part program comes in the air.  [default: twice its backlash]",
    ),
    click.option(
        "--part-side",
        type=Word(["left", "right"]),
        default=None,
        help="Side of the path, seen along it, on which the part is: where a crossing in a part program cannot be"
        " exact, it then leaves the part proud, and does not cut into it.",
    ),
)

workers = click.option(
    "--workers",
    type=click.IntRange(min=1),
    metavar="N",
    help="Processes of this computer.  [default: one for each processor]",
)

scheduler = click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Address of a Dask scheduler whose workers are taken, as tcp://host:8786.",
)

force = click.option(
    "--force",
    is_flag=True,
    help="Compensate again a program that was compensated with other options or for another machine.",
)

strict = click.option("--strict", is_flag=True, help="Refuse programs with commands that ph-post does not understand.")

feed_mode = click.option(
    "--feed-mode",
    type=Word([PER_MINUTE, "inverse-time"]),
    default=PER_MINUTE,
    show_default=True,
    help="F words in mm/min (G94) or in 1/min (G93), of path files.",
)


def writing(function: F) -> F:
    """Add the options that say how a program is written."""
    return _with(_WRITING, function)


_EXPANDING = (
    click.option(
        "--expand",
        is_flag=True,
        help="Write a program out first: parameters, loops, subprograms, cycles and cutter compensation become plain "
        "motions. For LinuxCNC; subprograms, macros and cycles also for Fanuc; R parameters, repeats, loops and "
        "jumps for Siemens; Q parameters, labels, jumps and drilling cycles for Heidenhain; turned and mirrored "
        "coordinates, and corners that are rounded or chamfered, for these three.",
    ),
    click.option(
        "--subprograms",
        multiple=True,
        metavar="FOLDER",
        help="With --expand: where subprograms are that are files of their own, besides the program's folder; may be "
        "repeated.",
    ),
    click.option(
        "--parameters",
        metavar="FILE",
        help="With --expand: the controller's file of parameters (linuxcnc.var), for programs that read them.",
    ),
    click.option(
        "--tool-table",
        metavar="FILE",
        help="With --expand: the controller's table of tools (tool.tbl), for cutter compensation by G41 and G42.",
    ),
    click.option(
        "--controller-units",
        type=Word(["mm", "inch"]),
        default="mm",
        show_default=True,
        help="With --parameters and --tool-table: the units of these files, which are the machine's.",
    ),
    click.option(
        "--peck-clearance",
        type=positive,
        metavar="MM",
        help="With --expand, for Fanuc: how far G73 and G83 back off by the control's settings (parameters 5114 and "
        "5115); without it they stay.",
    ),
    click.option(
        "--controller-version",
        metavar="VERSION",
        help="With --expand: the version of LinuxCNC, as 2.9.4, for turning cycles (G71, G72) in which its versions "
        "differ; without it these stay.",
    ),
)


def expanding(function: F) -> F:
    """Add the options that say whether programs that compute are written out first."""
    return _with(_EXPANDING, function)


_PIPELINE = (
    click.option(
        "-m",
        "--machine",
        default=None,
        metavar="MACHINE",
        envvar=MACHINE_VARIABLE,
        show_envvar=True,
        help="Machine file (.toml), or the name of a shipped one.",
    ),
    strategy(None, "auto; suppress where a profile is described"),
    planning,
    writing,
    strict,
    force,
    debug,
)


def pipeline(function: F) -> F:
    """Add the options of commands that other programs call to have one file converted."""
    return _with(_PIPELINE, function)


def _with(decorators: Sequence[Callable[[F], F]], function: F) -> F:
    for decorate in reversed(decorators):
        function = decorate(function)
    return function
