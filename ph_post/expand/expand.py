"""Write a program out: what it computes becomes plain motions, and all else stays in order."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple, TypeVar

import msgspec
import numpy as np

from ph_post.expand.fanuc import FanucRunner
from ph_post.expand.faults import ExpandError
from ph_post.expand.frame_writer import FrameWriter
from ph_post.expand.iso_corners import IsoCorners
from ph_post.expand.klartext import KlartextRunner
from ph_post.expand.klartext_corners import KlartextCorners
from ph_post.expand.klartext_frames import KlartextFrames
from ph_post.expand.lines import Source
from ph_post.expand.machine import Version
from ph_post.expand.macro import FanucNumbers
from ph_post.expand.progress import WrittenLines
from ph_post.expand.run import ProgramRunner
from ph_post.expand.sinumerik import SinumerikRunner
from ph_post.expand.sinumerik_frames import SinumerikFrames
from ph_post.expand.tools import ToolShape
from ph_post.expand.turning import is_turned
from ph_post.expand.writing import DECIMALS, EXPANDED, Spoken, Written, head_line
from ph_post.gcode.numbers import COMMENT, SEMICOLON, Comments
from ph_post.types import IntArray

_NEEDED: Final = re.compile(
    rb"#|\[|^[ \t]*/?[ \t]*(?:N[ \t\d.]*)?O[ \t]*[<\d]|"
    rb"G[ \t]*(?:7[0-4]|7[12]\.[12]|8[1-9]|4[12](?:\.1)?)(?![\d.])|M[ \t]*(?:98|99|7[0-3])(?!\d)|[@^]",
    re.IGNORECASE | re.MULTILINE,
)
"""What a program that computes has somewhere."""

_MACRO: Final = re.compile(
    rb"#|\[|M[ \t]*0*98(?!\d)|G[ \t]*(?:0*65|68|51(?:\.1)?|7[0346]|8[1-9])(?![\d.])|GOTO|,[ \t]*[RC]", re.IGNORECASE
)
_TURNED: Final = re.compile(rb"[UW][ \t]*[-+.\d]|G[ \t]*9[024](?!\d)", re.IGNORECASE)
"""What a lathe's program has besides."""

_STRUCTURED: Final = re.compile(
    rb"\bR\d+\s*=|=\s*\S*\bR\d+\b|\b(?:REPEATB?|GOTO[FBC]?|FOR|WHILE|LOOP|IF|DEF|A?ROT|A?MIRROR)\b"
    rb"|\b(?:RND|CHF|CHR)[ \t]*=",
    re.IGNORECASE,
)
"""What a program of Siemens that computes has somewhere."""

_CONVERSATIONAL: Final = re.compile(
    rb"\bCALL\s+LBL|GOTO\b|CYCL\s+(?:CALL|DEF\s+(?:8|10)\.)|Q[LR]?\d|M\s*99(?!\d)|\b(?:RND|CHF|LP|CT)\b",
    re.IGNORECASE,
)
"""What a conversational program of Heidenhain that computes has somewhere."""

_COMPUTING: Final = {"linuxcnc": _NEEDED, "siemens": _STRUCTURED, "heidenhain": _CONVERSATIONAL}

_TOP: Final = re.compile(r"\s*(?:%|;\$PATH=|[Oo:]\s*\d+\s*(?:\(.*)?$|(?:\d+\s+)?BEGIN\s+PGM\b)", re.IGNORECASE)
"""Lines that have to stand first."""

_BOTTOM: Final = re.compile(r"\s*(?:\d+\s+)?END\s+PGM\b", re.IGNORECASE)
"""The line that has to stand last."""

_MOST_STANDING: Final = 20
"""Stretches of one program that are tried in vain."""

_R = TypeVar("_R", ProgramRunner, FanucRunner, SinumerikRunner, KlartextRunner)

_FANUC_FILES: Final = ("", ".nc", ".NC", ".cnc", ".CNC", ".txt", ".TXT", ".tap", ".ngc")


class Expansion(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A program that was written out: its text, and what has to be known of it, a sentence each.

    `origins` (n,) are the lines of the program, from 0, that the lines of the text come of, and of what is added before
    some, that of these; None where nothing is written out.
    """

    data: bytes
    notes: tuple[str, ...] = ()
    origins: IntArray | None = None


class Folders:
    """Finds the files of subprograms, and keeps what was read.

    Parameters
    ----------
    folders : sequence of Path
        Where to look, in order.
    known : mapping of str to bytes
        Texts of files that are known already; then no folder is looked into.
    """

    def __init__(self, folders: tuple[Path, ...] = (), known: Mapping[str, bytes] | None = None) -> None:
        self._folders, self._known = folders, known
        self.read: dict[str, bytes] = {}
        self._sources: dict[str, Source | None] = {}

    def find(self, label: str, endings: tuple[str, ...] = (".ngc",)) -> Source | None:
        """Return the file of a subprogram, by the first of `endings` that finds one; None where there is none."""
        return next((found for ending in endings if (found := self._look(f"{label}{ending}")) is not None), None)

    def _look(self, name: str) -> Source | None:
        if name not in self._sources:
            self._sources[name] = self._read(name)
        return self._sources[name]

    def _read(self, name: str) -> Source | None:
        data: bytes | None = None
        if self._known is not None:
            data = self._known.get(name)
        elif Path(name).name == name:
            for folder in self._folders:
                try:
                    data = (folder / name).read_bytes()
                    break
                except OSError:
                    continue
        if data is None:
            return None
        self.read[name] = data
        return Source(name, data.decode("latin-1"))


def expand(
    data: bytes,
    name: str,
    folders: Folders | None = None,
    *,
    language: Spoken = "linuxcnc",
    parameters: Mapping[int, float] | None = None,
    tools: Mapping[int, ToolShape] | None = None,
    inches: bool = False,
    version: Version | None = None,
) -> Expansion:
    r"""Write out a program of LinuxCNC's language, of Fanuc's, Siemens's or Heidenhain's.

    Parameters
    ----------
    data : bytes
    name : str
        For messages.
    folders : Folders, optional
        Where subprograms are that are files of their own.
    language : {"linuxcnc", "siemens", "heidenhain"} or FanucNumbers
        Of Siemens R parameters, repeats, loops, choices and jumps are written out; of Heidenhain's conversational
        programs Q parameters, jumps, labels and drilling cycles; of both turned and mirrored coordinates; of Fanuc, by
        how its control counts, M98 and M99, G65, the statements of custom macro B, cycles and turned coordinates, and
        what stands behind the end of the main program stays.
    parameters : mapping of int to float, optional
        The controller's own file of parameters, for LinuxCNC.
    tools : mapping of int to ToolShape, optional
        Tools of the controller's table, for LinuxCNC; without it only radii that the program gives are known.
    inches : bool
        Whether the controller's files count in inches, as the machine then does.
    version : tuple of int, optional
        Of the controller's LinuxCNC, as (2, 9, 4), for turning cycles, in which its versions differ.

    Returns
    -------
    Expansion
        With the program's own bytes where there is nothing to write out.

    Raises
    ------
    ExpandError
        Where that is not possible, with file and line.

    Examples
    --------
    >>> found = expand(b"o1 sub\nG1 X#1 F60\no1 endsub\nG21 G90\no1 call [2*3]\nM2\n", "a.ngc")
    >>> found.data.split(b"\n")[1:4]
    [b'G21 G90', b'G1 X6 F60', b'M2']
    >>> found = expand(b"O1\nG21 M98 P2 L2\nM30\nO2\n#1=#1+2.5\nG91 G1 X#1\nM99\n", "a.nc", language=FanucNumbers())
    >>> found.data.split(b"\n")[2:7]
    [b'G21', b'G91 G1 X2.5', b'G91 G1 X5.', b'M30', b'O2']
    """
    fanuc, bare = language if isinstance(language, FanucNumbers) else None, COMMENT.sub(b"", data).upper()
    lathe = fanuc is not None and (fanuc.lathe or is_turned(data, bare))
    pattern = _MACRO if isinstance(language, FanucNumbers) else _COMPUTING[language]
    if EXPANDED.first(data) >= 0 or not (pattern.search(bare) or (lathe and _TURNED.search(bare))):
        return Expansion(data=data)
    folders, source = folders or Folders(), Source(name, data.decode("latin-1"))
    corners: IsoCorners | KlartextCorners | None = None
    if fanuc is not None:
        found = _fanuc(source, folders, msgspec.structs.replace(fanuc, lathe=lathe))
        # Corners are followed in X and Y, which a lathe's are not in.
        corners = None if lathe else IsoCorners(found.lines, fanuc)
    elif language == "siemens":
        found = _siemens(source)
        corners = IsoCorners(found.lines, None)
    elif language == "heidenhain":
        found = _heidenhain(source)
        corners = KlartextCorners(found.lines)
    else:
        found = _linuxcnc(source, folders, parameters, tools or {}, inches=inches, version=version)
    if corners is not None:
        found = _with_more(found, corners, name)
    if language in ("heidenhain", "siemens"):
        frames = KlartextFrames(found.lines) if language == "heidenhain" else SinumerikFrames(found.lines)
        found = _with_more(found, frames, name)
    if not found.changed:
        return Expansion(data=data, notes=found.notes)
    written = Written(
        original=data,
        digest="",
        fanuc=fanuc,
        sinumerik=language == "siemens",
        klartext=language == "heidenhain",
        files=folders.read,
        parameters=None if parameters is None else dict(parameters),
        tools=dict(tools or {}),
        inches=inches,
        version=version,
    )
    text, origins = _joined(data, found.lines, found.origins, written)
    return Expansion(data=text, notes=found.notes, origins=origins)


class _Lines(NamedTuple):
    """A program that was run: its lines and what each comes of, whether anything was written out, and notes."""

    lines: list[str]
    origins: list[int]
    changed: bool
    notes: tuple[str, ...] = ()


def _siemens(source: Source) -> _Lines:
    runner, lines = _run(lambda _: SinumerikRunner(source))
    return _Lines(*lines, runner.changed)


def _heidenhain(source: Source) -> _Lines:
    runner, lines = _run(lambda _: KlartextRunner(source))
    return _Lines(*lines, runner.changed, tuple(runner.notes))


def _fanuc(source: Source, folders: Folders, numbers: FanucNumbers) -> _Lines:
    find = partial(folders.find, endings=_FANUC_FILES)
    runner, lines = _run(lambda standing: FanucRunner(source, find, numbers, standing))
    return _Lines(*lines, runner.blocks.changed, tuple(runner.blocks.notes))


def _linuxcnc(
    source: Source,
    folders: Folders,
    parameters: Mapping[int, float] | None,
    tools: Mapping[int, ToolShape],
    *,
    inches: bool,
    version: Version | None,
) -> _Lines:
    find = folders.find
    runner, lines = _run(
        lambda standing: ProgramRunner(
            source, find, DECIMALS, parameters, tools, standing, inches=inches, version=version
        )
    )
    notes = runner.notes
    assumed = sorted(runner.store.assumed)
    if assumed and parameters is None:
        named = ", ".join(f"#{key}" for key in assumed[:8]) + (", …" if len(assumed) > 8 else "")
        notes = [f"taken to be 0, as nothing was put there before they were read: {named}", *notes]
    return _Lines(*lines, runner.blocks.changed, tuple(notes))


def _with_more(found: _Lines, more: IsoCorners | KlartextCorners | FrameWriter, name: str) -> _Lines:
    """Write the corners or frames of a program out; those that stay are named."""
    lines, origins = more.written()
    notes = (f"{name}:{found.origins[line - 1] + 1}: {note}" for note, line in more.notes.items())
    changed = found.changed or lines != found.lines
    return _Lines(lines, [found.origins[line] for line in origins], changed, (*found.notes, *notes))


def _run(made: Callable[[Mapping[tuple[str, int], str]], _R]) -> tuple[_R, WrittenLines]:
    """Run a program: anew, with it left as it is, where a stretch (by file and line) cannot be written out."""
    standing: dict[tuple[str, int], str] = {}
    while True:
        runner = made(standing)
        try:
            return runner, runner.run()
        except ExpandError as error:
            begun = runner.begun
            if begun is None or len(standing) == _MOST_STANDING:
                raise
            where = f"line {error.line}" if error.file == begun[0] else f"{error.file}:{error.line}"
            standing[begun] = f"{error.what} ({where})"


def _joined(data: bytes, lines: list[str], origins: list[int], written: Written) -> tuple[bytes, IntArray]:
    """Put lines together, with the comments that keep the original; return what each line comes of, too."""
    end = b"\r\n" if b"\r\n" in data else b"\n"
    at = 0
    while at < len(lines) and (not lines[at].strip() or _TOP.match(lines[at])):
        at += 1
    style = SEMICOLON if written.sinumerik or written.klartext else Comments(upper=written.fanuc is not None)
    head = head_line(hashlib.sha256(data).hexdigest(), style)
    last = len(lines)
    while written.klartext and last > at and (not lines[last - 1].strip() or _BOTTOM.match(lines[last - 1])):
        last -= 1

    def joined(part: list[str]) -> bytes:
        return b"".join(line.encode("latin-1") + end for line in part)

    text = joined([*lines[:at], head, *lines[at:last]])
    digest = hashlib.sha256(text).hexdigest()
    made = EXPANDED.add(text, msgspec.structs.replace(written, digest=digest), end, style)
    comments, behind = made.count(b"\n") - last - 1, [*origins, *(origins[-1:] or [0])]
    found = [*origins[:at], behind[at], *origins[at:last], *[behind[last]] * comments, *origins[last:]]
    return made + joined(lines[last:]), np.array(found, dtype=np.int64)


__all__ = ["ExpandError", "Expansion", "Folders", "expand"]
