"""One file converted as other programs want it: bytes in, the whole program out, and the words about it."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

import msgspec

from ph_post.cli import options
from ph_post.cli.programs import PATH_ONLY, deliver_program, refuse_path_options
from ph_post.io.source import Raw

DEFAULTS: Final[Mapping[str, Any]] = {"interval_table": None, "feed_mode": options.PER_MINUTE}
"""Options of ``convert`` that the commands for other programs do not have."""

_LEFT_OUT: Final[Mapping[str, Any]] = {**dict.fromkeys(PATH_ONLY), "feed_mode": options.PER_MINUTE}
"""What part programs leave out: one line with the options of path files serves both."""


class Converted(msgspec.Struct, frozen=True, kw_only=True):
    """A program to be written, and what there is to say about it.

    `said` is one line about what was done, `warnings` what was left alone or has to be known. `original` are
    the bytes that it was made of, where it is a part program; `done` says that the input was this very
    compensation already.
    """

    data: bytes
    said: str
    warnings: tuple[str, ...] = ()
    original: bytes | None = None
    done: bool = False

    @property
    def lines(self) -> tuple[str, ...]:
        """All of it, a line each."""
        return (self.said, *(f"warning: {word}" for word in self.warnings))


def convert_input(
    raw: Raw, how: Mapping[str, Any], stage: Callable[[str], None], *, noted: bool = False
) -> Converted:
    """Convert a path file or a part program into a compensated program.

    Parameters
    ----------
    raw : Raw
    how : mapping
        Options of ``convert`` by name; those of :data:`DEFAULTS` may be missing.
    stage : callable
        Told what is being done.
    noted : bool, optional
        Whether the program itself is to tell the warnings, in comments at its head.

    Raises
    ------
    InputError
        Where the input or the machine file are bad.
    click.UsageError
        Where an option does not fit a part program.
    """
    from ph_post.io.inputs import is_program

    if is_program(raw):
        return convert_part(raw, {**how, **_LEFT_OUT}, stage, noted=noted)
    return _convert_path(raw, {**DEFAULTS, **how}, stage, noted=noted)


def convert_part(
    raw: Raw, how: Mapping[str, Any], stage: Callable[[str], None], *, noted: bool = False
) -> Converted:
    """Convert a part program, whatever its name ends with; as :func:`convert_input`."""
    from ph_post.report.deliveries import summary, warnings_of

    refuse_path_options(how)
    found, _, _ = deliver_program(raw.name, raw.data, how, stage, noted=noted)
    return Converted(
        data=found.after.data, said=summary(found, None), warnings=warnings_of(found),
        original=found.before.data, done=found.done,
    )  # fmt: skip


def _convert_path(
    raw: Raw, how: Mapping[str, Any], stage: Callable[[str], None], *, noted: bool
) -> Converted:
    from ph_post.cli.job import (
        default_strategy,
        effect_warnings,
        load_and_analyse,
        plan_options,
        program_of,
        program_options,
        with_warnings,
    )
    from ph_post.compensate.plan import make_plan
    from ph_post.report.tables import plan_summary

    how = {**how, "strategy": how["strategy"] or default_strategy(how)}
    analysis = load_and_analyse(
        raw, how["machine"], how["tolerance"], stage,
        feed=how["feed"], dialect=how["dialect"], intervals=how["interval_table"],
    )  # fmt: skip
    assert analysis.machine is not None
    stage("planning the program")
    plan = make_plan(analysis, plan_options(how, "program"), stage)
    plan = with_warnings(plan, *effect_warnings(analysis.machine, analysis.path.axes))
    stage("writing the program")
    text, plan = program_of(analysis, plan, program_options(how))
    if noted:
        text = _noted(text, plan.warnings, plan.machine.dialect)
    return Converted(data=text.encode(), said=plan_summary(plan), warnings=plan.warnings)


def _noted(program: str, warnings: tuple[str, ...], dialect: str) -> str:
    """Put warnings at the head of a program."""
    from ph_post.gcode.registry import find_dialect

    remark = find_dialect(dialect).remark
    notes = [line for word in warnings for line in remark(f"warning: {word}")]
    return "".join(f"{line}\n" for line in notes) + program


@contextlib.contextmanager
def hushed() -> Iterator[None]:
    """Keep both streams free of whatever is said on the way: who called reads them."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        yield
