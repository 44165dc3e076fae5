"""Canonical calls of LinuxCNC's interpreter, all of them by rs274 and the numbers in full by its Python module."""

from __future__ import annotations

import atexit
import json
import os
import re
import subprocess
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

FULL = Path(__file__).with_name("full_canon.py")
PYTHON = Path("/usr/bin/python3")
_CALL = re.compile(r"\s*\d+\s+N\S+\s+(.*)")
_NUMBER = re.compile(r"-?\d+\.\d+")
_TABLE = ".tool.mmap"
"""Where rs274 leaves a table of tools in its home."""

_TOOLS = "".join(f"T{n} P{n} Z0 D0.1\n" for n in range(1, 101))
PATH_MODE = ("SET_MOTION_CONTROL", "SET_NAIVECAM", "DWELL(0.0000)")
"""A cycle is run with G61 by LinuxCNC; where the mode to come back to is not known, stops stand for it."""


@dataclass(frozen=True)
class Interpreted:
    """Calls in full precision, calls of rs274 with four decimals, and why the program is refused."""

    full: list[list]
    calls: list[str]
    refusal: str


@cache
def _server() -> subprocess.Popen[str]:
    """Return the process that has LinuxCNC's module, one for each process of the tests."""
    server = subprocess.Popen([str(PYTHON), str(FULL)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    atexit.register(server.communicate)  # it ends where its input does
    return server


def _run_module(folder: Path) -> int:
    """Interpret the program of a folder in full precision; return the status of the process that did."""
    server = _server()
    server.stdin.write(f"{folder}\n")
    server.stdin.flush()
    return int(server.stdout.readline())


def interpret(data: bytes, folders: tuple[Path, ...] = (), tools: str = _TOOLS) -> Interpreted:
    with tempfile.TemporaryDirectory() as name:
        # It leaves the table of tools that the module reads.
        shown = _run_rs274(Path(name), data, folders, tools)
        found = _interpret_in(Path(name))
    lines = [match[1] for match in map(_CALL.match, shown.decode("utf-8", "replace").splitlines()) if match]
    calls = [one for one in lines if not one.startswith(("COMMENT", "ON_RESET"))]
    return Interpreted(found.full, calls, found.refusal)


def interpret_in_full(data: bytes, tools: str) -> Interpreted:
    """Interpret a program by the module alone, with a table of tools that no program has changed."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _write(folder, data, (), tools)
        (folder / _TABLE).write_bytes(_table(tools))
        return _interpret_in(folder)


@cache
def _table(tools: str) -> bytes:
    """Return what rs274 makes of a table of tools."""
    with tempfile.TemporaryDirectory() as name:
        _run_rs274(Path(name), b"M2\n", (), tools)
        return (Path(name) / _TABLE).read_bytes()


def _write(folder: Path, data: bytes, folders: tuple[Path, ...], tools: str) -> None:
    (folder / "program.ngc").write_bytes(data)
    (folder / "tool.tbl").write_text(tools, encoding="ascii")
    places = ":".join(map(str, folders))
    prefix = f"[DISPLAY]\nPROGRAM_PREFIX = {folders[0]}\n" if folders else ""
    (folder / "machine.ini").write_text(f"[RS274NGC]\nSUBROUTINE_PATH = {places}\n{prefix}", encoding="utf-8")


def _run_rs274(folder: Path, data: bytes, folders: tuple[Path, ...], tools: str) -> bytes:
    """Return what rs274 prints; a folder is its home."""
    _write(folder, data, folders, tools)
    home = {**os.environ, "HOME": str(folder), "INI_FILE_NAME": str(folder / "machine.ini")}
    words = ["rs274", "-t", "tool.tbl", "-i", "machine.ini", "-g", str(folder / "program.ngc")]
    return subprocess.run(words, check=False, capture_output=True, cwd=folder, env=home, timeout=60).stdout


def _interpret_in(folder: Path) -> Interpreted:
    """Interpret the program of a folder by the module."""
    status = _run_module(folder)
    if status != 0:
        said = (folder / "said.txt").read_bytes()[-200:]
        return Interpreted([], [], f"the module ended with {status}: {said!r}")
    found = json.loads((folder / "calls.json").read_bytes())
    return Interpreted(found["calls"], [], found["refusal"])


@cache
def installed_version() -> tuple[int, int, int]:
    """Return the version of the LinuxCNC that is the reference."""
    data = b"G21 G90\nG0 X[ROUND[#<_vmajor>*10]] Y[ROUND[#<_vminor>*10]]\nM2\n"
    (found,) = (call for call in interpret(data).full if call[0] == "straight_traverse")
    major, minor = (round(25.4 * value) for value in found[1:3])
    return (major // 10, major % 10, minor)


def difference(a: Interpreted, b: Interpreted) -> str:
    """What differs, path modes aside: numbers by more than 1e-6 mm (rs274's by a digit), or another call."""
    stops = ["dwell", 0.0]
    first, second = ([call for call in one.full if call != stops] for one in (a, b))
    for one, other in zip(first, second, strict=False):
        if not _same(one, other):
            return f"{one} became {other}"
    if len(first) != len(second):
        return f"{len(first)} calls became {len(second)}"
    shown = ([call for call in one.calls if not call.startswith(PATH_MODE)] for one in (a, b))
    return _text_difference(*shown)


def _same(one: list, other: list) -> bool:
    def equal(p, q):
        if isinstance(p, str) or isinstance(q, str):
            return p == q
        least = max(1.0, abs(p)) if one[0] == "set_feed_rate" else 1.0
        return abs(p - q) <= 1e-6 / 25.4 * least  # inches

    return len(one) == len(other) and all(map(equal, one, other))


def _text_difference(first: list[str], second: list[str]) -> str:
    if len(first) != len(second):
        return f"{len(first)} calls of rs274 became {len(second)}"
    for one, other in zip(first, second, strict=True):
        if _NUMBER.sub("#", one) != _NUMBER.sub("#", other):
            return f"{one} became {other}"
        pairs = zip(_NUMBER.findall(one), _NUMBER.findall(other), strict=True)
        if any(abs(float(p) - float(q)) > 1.01e-4 for p, q in pairs):
            return f"{one} became {other}"
    return ""
