"""What a compensation gives, of a path and of a part program alike."""

from __future__ import annotations

import os
import re
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Final

from ph_post.api.expansion import WRITTEN_AS_LINUXCNC
from ph_post.api.inputs import COMPENSATED_BEFORE, Source
from ph_post.api.options import CompensateOptions
from ph_post.api.results import AxisReversals, MotionResult, ReversalCount
from ph_post.compensate.options import PlanOutput
from ph_post.compensate.plan_warnings import PASSED_SLOWER
from ph_post.compensate.strategies.registry import find_traits
from ph_post.dialects.base import Dialect
from ph_post.errors import NotCompensatedError
from ph_post.expand.writing import EXPANDED
from ph_post.files.check import counted, in_words
from ph_post.files.storage import write_atomically
from ph_post.files.table import table_content
from ph_post.gcode.codes import may_rest
from ph_post.gcode.program import PartProgram
from ph_post.gcode.read import BEHIND_THE_END
from ph_post.types import Command, Machine

REASONS: Final = 2
"""Reasons that are named where reversals are not compensated."""

_REASON: Final = re.compile(r"(?:\baxis (?P<axis>[A-Z]) )?\bnot compensated\b[^:]*: *(?P<why>.*)", re.DOTALL)
"""Warnings say by these words that something is not compensated, and after them why."""


class Compensation(ABC):
    """Result of :func:`compensate`: the motion before and after, and the outputs to write.

    `machine` and `options` are those of the request; `before` and `after` are motions of the `output`, program or
    table. The other output is planned when it is first used.
    """

    machine: Machine
    options: CompensateOptions
    output: PlanOutput

    @property
    @abstractmethod
    def before(self) -> MotionResult:
        """The plain motion, without compensation."""

    @property
    @abstractmethod
    def after(self) -> MotionResult:
        """The compensated motion."""

    @property
    @abstractmethod
    def warnings(self) -> tuple[str, ...]:
        """Warnings: what was reduced or not compensated, a sentence each."""

    @property
    @abstractmethod
    def axis_reversals(self) -> tuple[AxisReversals, ...]:
        """Numbers of reversals of every axis with backlash."""

    @property
    def reversals(self) -> ReversalCount:
        """Numbers of compensated reversals and of all, of axes with backlash."""
        rows = self.axis_reversals
        return ReversalCount(compensated=sum(row.compensated for row in rows), all=sum(row.all for row in rows))

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes with a compensated reversal."""
        return tuple(row.axis for row in self.axis_reversals if row.compensated)

    @property
    @abstractmethod
    def not_compensated(self) -> str:
        """What is not compensated, why, and what would change that; empty where all is."""

    def check_all(self) -> None:
        """Refuse a result in which a reversal at which the tool cuts is not compensated.

        Raises
        ------
        NotCompensatedError
        """
        require_all_compensated(self.axis_reversals, self.warnings)

    @abstractmethod
    def program(self) -> bytes:
        """Return the compensated part program.

        Raises
        ------
        InputError
            Where the dialect cannot write it, or an option does not fit.
        """

    @abstractmethod
    def table(self) -> Command:
        """Return the rows of the interpolator table; of a part program it is that of its longest path."""

    def write(self, target: Source) -> None:
        """Write the compensated part program to a file, whole or not at all.

        Parameters
        ----------
        target : str or path
            A file name, or ``-`` for standard output.

        Raises
        ------
        InputError
            As :meth:`program`, and where the file cannot be written.
        """
        write_atomically({os.fspath(target): self.program()})

    def write_table(self, target: Source) -> None:
        """Write the interpolator table to a file, whole or not at all.

        Parameters
        ----------
        target : str or path
            A name that ends with ``.csv``, ``.npz`` or ``.parquet``, or ``-`` for CSV on standard output.

        Raises
        ------
        InputError
            As :meth:`table`, and where the file cannot be written.
        """
        name = os.fspath(target)
        write_atomically({name: table_content(self.table(), name)})


def require_all_compensated(rows: Sequence[AxisReversals], warnings: Sequence[str]) -> None:
    """Refuse reversals at which the tool cuts and which are not compensated.

    Raises
    ------
    NotCompensatedError
        With the axes, and the first of the warnings that says why.
    """
    left = [row for row in rows if row.cut]
    if left:
        what = ", ".join(f"{row.axis} at {row.cut} of {counted(row.all, 'reversal')}" for row in left)
        why = next((f"; {word}" for word in warnings if "not compensated" in word), "")
        raise NotCompensatedError(f"--require-all: not compensated: {what}{why}; nothing was written")


_COMPUTED: Final = (
    *("parameter", "value that is computed", "O-word", "polar coordinates", "canned cycle", "modal state brought back"),
    "subprogram: ",
)
_ON_LATHES: Final = ("turning cycle", "axis other than X, Y and Z: U", "axis other than X, Y and Z: W")
_TURNED: Final = "motion in a turned, scaled, polar or diameter frame"
_WRITTEN_OUT: Final[Mapping[str, tuple[str, ...]]] = {
    **dict.fromkeys(WRITTEN_AS_LINUXCNC, _COMPUTED),
    "fanuc": (*_COMPUTED, "loop of a macro", "jump of a macro"),
    "siemens": ("repeated part", "lines of a jump"),
    "heidenhain": (
        *("repeated part", "part that is jumped", "call or jump: ", "call of a cycle", "Q parameter"),
        "place that is computed",
    ),
}
"""What begins the notes of stretches that can be written out, by dialect."""

_FLAT_FRAMES: Final = {
    "fanuc": re.compile(rb"G(?:68|51(?:\.1)?)(?![\d.])", re.IGNORECASE),
    "heidenhain": re.compile(rb"CYCL\s+DEF\s+(?:8|10)\.1", re.IGNORECASE),
    "siemens": re.compile(rb"\bA?(?:ROT|MIRROR)\b", re.IGNORECASE),
}
"""Frames that are written out, by dialect."""

_OTHER_FRAME: Final = re.compile(
    rb"CYCL\s+DEF\s+(?:11|19|26)\b|\bPLANE\b|\bTCPM\b|M\s*128(?!\d)|\bA?(?:SCALE|ROTS)\b|CROTS|CYCLE800|TRA[A-Z]+\b(?<!TRANS)"
    rb"|\bTO(?:FRAME|ROT)|PAROT|DIAMON|DIAM90|G(?:0*7\.1|12\.1|43\.[45]|68\.[234]|10[17]|112|234|254|268)(?!\d)",
    re.IGNORECASE,
)
"""What has frames besides that are not."""

_CORNERS: Final = {
    "heidenhain": re.compile(r"\b(?:RND|CHF)\b"),
    "siemens": re.compile(r"(?:RND|CHF|CHR)\s*="),
    "fanuc": re.compile(r",\s*[RC]\s*[-+.\d]"),
}
"""What notes on rounded and chamfered corners, which are written out, have in them, by dialect."""

_CUTTER: Final = "cutter compensation"


_OWN_M: Final = re.compile(r"(?:(?:unknown M (?:word|function)|M word of a program of the machine's own): )?M0*(\d+)\Z")
"""A note on an M word of which its machine's builder alone knows what it does; on Siemens's the word is all of it."""


_MACRO: Final = re.compile(r"line for the controller itself: (?![A-Za-z]\d)([A-Za-z_]\w+)")
"""A note on a macro of which its owner alone knows what it does."""

_OFTEN: Final = 5
"""Times that a macro parts cuts before it is advised to say that it moves nothing: START_PRINT comes once."""

_MANY_LINES: Final = 100
"""Lines that are passed through from which on their number is told beside that of the stretches."""


def passed_through(program: PartProgram, dialect: str, *, expand: bool = False) -> tuple[str, ...]:
    """Describe the stretches of a program that are passed through: their number, one of them, and what would help.

    `expand` says that ``--expand`` was given: it is not advised again.
    """
    base, expanded = dialect.partition("+")[0], expand or EXPANDED.first(program.data) >= 0
    notes = program.notes
    if expanded and base == "heidenhain":
        # Subprograms stand there, which are written out where they are called.
        notes = tuple(note for note in notes if not note.what.startswith(BEHIND_THE_END))
    if not notes:
        return ()
    known = (*_WRITTEN_OUT.get(base, ()), *(_ON_LATHES if program.language.diameters else ()))
    flat = _FLAT_FRAMES.get(base)
    if flat is not None and flat.search(program.data) and not _OTHER_FRAME.search(program.data):
        known += (_TURNED,)
    corner = _CORNERS.get(base)
    helped = [
        note
        for note in notes
        if not expanded and (note.what.startswith(known) or (corner is not None and corner.search(note.what)))
    ]
    # What is advised has to be true of the stretch that is named.
    named = (helped or notes)[0]
    said = [f"{program.line_words(named.first)}: {named.what}"]
    if helped:
        said.append("--expand writes it out as plain moves")
    if base in WRITTEN_AS_LINUXCNC and any(note.what.startswith(_CUTTER) for note in notes):
        said.append(f"{'' if expanded else '--expand '}--tool-table FILE works out cutter compensation")
    own = sorted({int(found[1]) for note in notes if (found := _OWN_M.match(note.what))})
    names = [f"M{number}" for number in own if may_rest(number)]
    if program.language.macros:
        macros = Counter(found[1].upper() for note in notes if (found := _MACRO.match(note.what)))
        names += sorted(name for name, count in macros.items() if count >= _OFTEN)
    if names:
        variant, moves = "".join(f"+{name.lower()}" for name in names), "moves" if len(names) == 1 else "move"
        said.append(f'dialect = "{dialect}{variant}" in the machine file says that {in_words(names)} {moves} nothing')
    stretches, lines = counted(len(notes), "stretch", "stretches"), sum(note.last - note.first + 1 for note in notes)
    stretches += f" of {lines} lines" if lines >= _MANY_LINES else ""
    return (f"{stretches} passed through unchanged ({'; '.join(said)})",)


def units_notes(program: PartProgram, dialect: Dialect) -> tuple[str, ...]:
    """Say that lengths are taken for mm where a program does not say its units, and the controller may have others."""
    said = dialect.notices.units
    if not said or program.words.g_words(*said).any():
        return ()
    return (
        f"the program says neither G{said[0]} nor G{said[1]}: its lengths are taken for mm; where the controller "
        "counts in inches, every change is 25.4 times too large",
    )


def _of_axis(axis: str | None, why: str) -> str:
    """Name the axis, if one is given, in a reason that says "its"."""
    return f"{axis}'s {why.removeprefix('its ')}" if axis and why.startswith("its ") else why


def left_words(
    rows: Sequence[AxisReversals], warnings: Sequence[str], notes: Sequence[str], strategy: str = "auto"
) -> str:
    """Say what is not compensated, why, and what would change that; nothing where all is compensated.

    Where nobody knows why, it is the time for a `strategy` that chooses, and else the strategy itself.

    Examples
    --------
    >>> row = AxisReversals(axis="Y", compensated=0, all=2, cut=2)
    >>> left_words([row], ["axis Y not compensated in line 3: it would cost 0.6 s; --max-slowdown 0.1 allows it"], ())
    'Y at 2 of 2 reversals: it would cost 0.6 s; --max-slowdown 0.1 allows it'
    >>> left_words([row], ["axis Y not compensated in line 3: its crossings would cost 0.6 s"], ())
    'Y at 2 of 2 reversals: its crossings would cost 0.6 s'
    >>> left_words([], [], ())
    ''
    """
    short = {row.axis: row for row in rows if row.compensated < row.all}
    missed = [f"{axis} at {row.all - row.compensated} of {counted(row.all, 'reversal')}" for axis, row in short.items()]
    notes = [note for note in notes if COMPENSATED_BEFORE not in note]
    if not missed and not notes:
        return ""
    found = [match for word in warnings if (match := _REASON.search(word)) and match["why"]]
    found = [match for match in found if match["axis"] in (None, *short)]
    several = len(missed) > 1
    whys = list(dict.fromkeys(_of_axis(match["axis"] if several else None, match["why"]) for match in found))
    whys.sort(key=lambda why: "--" not in why)
    reasons = "; ".join(whys[:REASONS]) if missed else ""
    if missed and not reasons and not find_traits(strategy).chooses:
        reasons = f"strategy {strategy} does not compensate them here; auto may"
    elif missed and not reasons:
        slower = any(PASSED_SLOWER in word for word in warnings)
        better = "better than less feed does" if slower else "better"
        reasons = f"nothing that was tried makes the part {better} in the time allowed; a larger --max-slowdown may"
    words = ", ".join(missed) + (f": {reasons}" if reasons else "")
    return "; ".join([*([words] if words else []), *notes])
