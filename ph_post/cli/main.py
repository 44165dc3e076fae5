"""Console script: loads each command when it is called, and reports every failure in one line."""

from __future__ import annotations

import atexit
import gc
import importlib
import keyword
import os
import signal
import sys
import traceback
from collections.abc import Sequence

import click

from ph_post.errors import PhPostError, is_interrupt, printable

COMMANDS = (
    "convert",
    "filter",
    "slicer",
    "batch",
    "import",
    "inspect",
    "simulate",
    "compare",
    "verify",
    "diff",
    "rehearse",
    "report",
    "sweep",
    "identify",
    "fleet",
    "diagnose",
    "calibrate",
    "machines",
    "machine",
    "completion",
    "freecad",
    "demo",
    "paper",
)
"""Every command, in the order of the help page; each in the module of its name, `import` in `import_`."""

COMPLETE_VARIABLE = "_PH_POST_COMPLETE"
"""Where a shell says that it wants words to be completed; the name is click's for a program `ph-post`."""

OBJECTS_BETWEEN_COLLECTIONS = 200_000
"""New objects after which Python looks for cycles. What a start makes is hardly more, and nearly all of it stays."""

INTERRUPTED = 130
"""Exit status of a command that Ctrl-C has ended."""

_HELP_PAGE = getattr(click.exceptions, "NoArgsIsHelpError", ())
"""How newer click says that nothing but its name was given; older ones print the help page themselves."""


class LazyGroup(click.Group):
    """A group that imports a command's module when the command is asked for."""

    def list_commands(self, _ctx: click.Context) -> list[str]:
        """Names of all commands."""
        return list(COMMANDS)

    def get_command(self, _ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return one command."""
        if cmd_name not in COMMANDS:
            return None
        module = f"{cmd_name}_" if keyword.iskeyword(cmd_name) else cmd_name
        command: click.Command = importlib.import_module(f"ph_post.cli.{module}").command
        if COMPLETE_VARIABLE in os.environ:
            from ph_post.cli.completion import complete_by_metavar

            complete_by_metavar(command)
        return command


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="ph-post", prog_name="ph-post")
def cli() -> None:
    """Remove the marks that backlash leaves where an axis reverses.

    ph-post finds the reversals of a toolpath or a part program, computes what backlash does there, and writes
    a part program or an interpolator table in which the axes take up their backlash at the right places.

    Start with:  ph-post demo
    """


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status: 0 done, 1 difference or miss, 2 bad usage or input."""
    state: dict[str, bool] = {}  # what a command says of itself: "debug", "one_line"
    try:
        result = cli.main(arguments, prog_name="ph-post", standalone_mode=False, obj=state)
    except click.ClickException as error:
        return _show_or_refuse(error)
    except (click.Abort, KeyboardInterrupt):
        return _interrupted()
    except OSError as error:
        if state.get("debug"):
            traceback.print_exc()
        return _refuse_stream(error)
    except PhPostError as error:
        if state.get("debug"):
            traceback.print_exc()
        excerpt = "" if state.get("one_line") else getattr(error, "excerpt", "")
        return _refuse(str(error), error.status, excerpt)
    except Exception as error:
        if state.get("debug"):
            traceback.print_exc()
        internal = f"internal error: {type(error).__name__}: {error}; --debug shows where"
        return _interrupted() if is_interrupt(error) else _refuse(internal)
    return result if isinstance(result, int) else 0


def console_main() -> int:
    """Run ``ph-post`` in a process of its own."""
    return _process(sys.argv[1:])


def filter_main() -> int:
    """Run ``ph-post-filter``, the command that the screens of LinuxCNC call."""
    return _process(["filter", *sys.argv[1:]])


def slicer_main() -> int:
    """Run ``ph-post-slicer``, the command that slicers call."""
    return _process(["slicer", *sys.argv[1:]])


def _process(arguments: Sequence[str]) -> int:
    """Run the command line as all that a process does."""
    # Before numpy loads: of matrices as small as ours, threads only wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    gc.set_threshold(OBJECTS_BETWEEN_COLLECTIONS)
    atexit.register(gc.freeze)  # a process that ends has no use for a last look at them
    status = main(arguments)
    if status == INTERRUPTED:  # it ends already, and what ends with it is not to be broken off
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    return status


def _interrupted() -> int:
    return _refuse("interrupted; nothing more was written", status=INTERRUPTED)


def _refuse_stream(error: OSError) -> int:
    """End where nothing more can be printed: at its reader's wish, or for want of room."""
    sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123, SIM115 - stays open for the flush at exit
    if isinstance(error, BrokenPipeError):
        return 0
    place, reason = error.filename or "standard output", error.strerror or str(error)
    return _refuse(f"{place}: cannot be read or written; got {reason}")


def _show_or_refuse(error: click.ClickException) -> int:
    """Print the help page where nothing was asked, as click does; else say what is wrong, in one line."""
    if isinstance(error, _HELP_PAGE):
        error.show()
        return int(error.exit_code)
    return _refuse(_usage_line(error))


def _usage_line(error: click.ClickException) -> str:
    """Fold click's message into one line and name the help page."""
    context = getattr(error, "ctx", None)
    page = f"; see {context.command_path} --help" if context is not None else ""
    return " ".join(error.format_message().split()).rstrip(".") + page


def _refuse(message: str, status: int = 2, excerpt: str = "") -> int:
    print(f"ph-post: {printable(' '.join(message.split()))}", file=sys.stderr)  # noqa: T201 - the one line on stderr
    if excerpt:
        print(excerpt, file=sys.stderr)  # noqa: T201 - and the place it is about
    return status
