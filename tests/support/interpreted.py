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
        folder = Path(name)
        file, ini, table = (folder / one for one in ("program.ngc", "machine.ini", "tool.tbl"))
        file.write_bytes(data)
        table.write_text(tools, encoding="ascii")
        places = ":".join(map(str, folders))
        prefix = f"[DISPLAY]\nPROGRAM_PREFIX = {folders[0]}\n" if folders else ""
        ini.write_text(f"[RS274NGC]\nSUBROUTINE_PATH = {places}\n{prefix}", encoding="utf-8")
        home = {**os.environ, "HOME": name, "INI_FILE_NAME": str(ini)}
        how = {"capture_output": True, "cwd": name, "env": home, "timeout": 60}
        # It leaves the table of tools that the module reads.
        shown = subprocess.run(["rs274", "-t", str(table), "-i", str(ini), "-g", str(file)], check=False, **how)
        status = _run_module(folder)
        if status != 0:
            said = (folder / "said.txt").read_bytes()[-200:]
            return Interpreted([], [], f"the module ended with {status}: {said!r}")
        found = json.loads((folder / "calls.json").read_bytes())
    lines = [match[1] for match in map(_CALL.match, shown.stdout.decode("utf-8", "replace").splitlines()) if match]
    calls = [one for one in lines if not one.startswith(("COMMENT", "ON_RESET"))]
    return Interpreted(found["calls"], calls, found["refusal"])


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
