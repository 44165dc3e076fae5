"""Running a program on LinuxCNC, and what it commanded the joints in every servo period."""

from __future__ import annotations

import contextlib
import json
import os
import pathlib
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

import msgspec
import numpy as np

from ph_post.audit.linuxcnc.config import write_configuration
from ph_post.audit.linuxcnc.lock import only_one
from ph_post.errors import InputError, PhPostError
from ph_post.types import Array, BoolArray, IntArray, Machine, sealed
from ph_post.units import MM

INSTALL: Final = "apt-get install linuxcnc-uspace"
"""How LinuxCNC is installed on Debian."""

TIME_LIMIT: Final = 600.0
"""Time on the wall that a program may take [s]."""

_PATH: Final = "/usr/bin:/bin:/usr/sbin:/sbin"
"""LinuxCNC's scripts want the system's Python, not one of a virtual environment."""

_NOBODY: Final = "65534"

_SHUT_DOWN: Final = 20.0
"""Time within which LinuxCNC has to shut down [s]."""

_END: Final = b"\nM2\n"
"""Other controllers take a program that just stops; behind an end of its own nothing is read any more."""

_PAGE: Final = 4096
_HERE = pathlib.Path(__file__).parent

Tell = Callable[[str], None]


class NotInstalledError(PhPostError):
    """LinuxCNC is not installed; the message says how to."""


class Recording(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """What LinuxCNC commanded, one row a servo period, from the last row before the first motion on.

    `position` (n, 3) [m]: X, Y and Z as planned; `motor` (n, 3) [m]: with LinuxCNC's own compensation of
    backlash. `line` (n,) the line of the program, from 0, -1 where none runs. `settled` (n,) whether the
    planner had nothing to do. `lockstep` says whether the program was run in lockstep, or as time passes on
    the wall, where the waits of a dwell depend on how busy the machine is.
    """

    period: float
    position: Array
    motor: Array
    line: IntArray
    settled: BoolArray
    lockstep: bool


def is_installed() -> bool:
    """Whether a LinuxCNC can be run here."""
    return all(shutil.which(name, path=_PATH) for name in ("linuxcnc", "halsampler", "rs274"))


def run_on_linuxcnc(
    program: bytes,
    name: str,
    machine: Machine,
    *,
    backlash: Mapping[str, float] | None = None,
    limit: float = TIME_LIMIT,
    tell: Tell = lambda _text: None,
) -> Recording:
    """Run a program on LinuxCNC's own interpreter, planner and servo thread.

    The machine begins at the origin of all systems. Of several callers one runs at a time, the others wait.

    Parameters
    ----------
    program : bytes
    name : str
        Its name in messages.
    machine : Machine
        Its limits and servo period are LinuxCNC's.
    backlash : mapping, optional
        Lost motion by axis [m] that LinuxCNC itself is to compensate for.
    limit : float, optional
        Time on the wall that may pass [s].
    tell : callable, optional
        Told what is being waited for.

    Raises
    ------
    NotInstalledError
        Where there is no LinuxCNC.
    InputError
        Where LinuxCNC refuses the program, or does not come to its end in time.
    """
    if not is_installed():
        raise NotInstalledError(f"LinuxCNC is not installed; install it with: {INSTALL}")
    with tempfile.TemporaryDirectory(prefix="ph-post-", ignore_cleanup_errors=True) as place, only_one(tell):
        folder = pathlib.Path(place)
        lockstep = _prepare(folder, program, machine, backlash or {}, limit)
        log = _run(folder, limit)
        _require_end(folder, name, limit, log)
        return _recording(folder, machine.servo_period, name, lockstep)


def _prepare(
    folder: pathlib.Path, program: bytes, machine: Machine, backlash: Mapping[str, float], limit: float
) -> bool:
    """Write all that LinuxCNC reads; whether it will run in lockstep."""
    folder.chmod(0o777)  # what runs beside the servo thread does so as nobody
    (folder / "program.ngc").write_bytes(program if machine.dialect == "linuxcnc" else program + _END)
    write_configuration(folder, machine, backlash)
    display = folder / "display"
    display.write_text("#!/usr/bin/python3\n" + (_HERE / "display.py").read_text())
    display.chmod(0o755)
    lockstep = _build_lockstep(folder)
    clock = folder / "clock"
    clock.write_bytes(bytes(_PAGE))
    clock.chmod(0o666)
    job = {"program": str(folder / "program.ngc"), "limit": limit, "clock": str(clock) if lockstep else ""}
    (folder / "job.json").write_text(json.dumps(job))
    return lockstep


def _build_lockstep(folder: pathlib.Path) -> bool:
    """Compile the clock that rtapi_app and milltask share, where there is a compiler.

    LinuxCNC's rtapi_app belongs to root, and is loaded with nothing added where another user starts it.
    """
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None or os.geteuid() != 0:
        return False
    source, library = _HERE / "lockstep.c", folder / "lockstep.so"
    words = [compiler, "-shared", "-fPIC", "-O2", "-o", str(library), str(source), "-ldl"]
    return subprocess.run(words, capture_output=True, check=False).returncode == 0  # noqa: S603


def _environment(folder: pathlib.Path, *, lockstep: bool = True) -> dict[str, str]:
    found = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "LD_PRELOAD")}
    found |= {"PATH": _PATH, "HOME": str(folder), "PH_POST_JOB": str(folder / "job.json")}
    if os.geteuid() == 0:  # rtapi_app refuses to stay root
        found |= {"RTAPI_UID": _NOBODY, "RTAPI_FIFO_PATH": str(folder / "rtapi_fifo")}
    if lockstep and (folder / "lockstep.so").exists():
        found |= {"LD_PRELOAD": str(folder / "lockstep.so"), "PH_POST_CLOCK": str(folder / "clock")}
    return found


def _run(folder: pathlib.Path, limit: float) -> str:
    """Run LinuxCNC from start to end; what it said. Nothing of it is left running, whatever happens."""
    log = folder / "log.txt"
    with log.open("wb") as output:
        process = subprocess.Popen(  # noqa: S603
            ["linuxcnc", "-r", str(folder / "machine.ini")],  # noqa: S607
            env=_environment(folder), stdin=subprocess.DEVNULL, stdout=output, stderr=output,
            start_new_session=True, cwd=folder,
        )  # fmt: skip
        with _stopping(process, folder), contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(limit + 3.0 * _SHUT_DOWN)
    return log.read_text(errors="replace")


@contextlib.contextmanager
def _stopping(process: subprocess.Popen[bytes], folder: pathlib.Path) -> Iterator[None]:
    """End LinuxCNC if it still runs: its display first, whose end shuts it down, and else all of it."""
    try:
        yield
    finally:
        if process.poll() is None:
            with contextlib.suppress(OSError, ValueError):
                os.kill(int((folder / "display.pid").read_text()), signal.SIGTERM)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(_SHUT_DOWN)
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            _tool(folder, "halrun", "-U")


def _require_end(folder: pathlib.Path, name: str, limit: float, log: str) -> None:
    """See what the display reported.

    Raises
    ------
    InputError
        Where the program did not come to its end.
    """
    try:
        result: dict[str, Any] = json.loads((folder / "result.json").read_text())
    except (OSError, ValueError):
        last = [line for line in log.splitlines() if line.strip()][-1:]
        said = last[0].strip() if last else "nothing"
        raise InputError(name, "LinuxCNC did not start", got=said) from None
    if result["outcome"] == "limit":
        raise InputError(name, f"LinuxCNC did not come to the end within {limit:.0f} s on the wall")
    if result["outcome"] != "ok":
        messages = [text for text in result["messages"] if text] or ["an error without a message"]
        line = result["line"] or _refused_line(folder)
        where = f"{name}:{line}" if line else name
        raise InputError(where, "LinuxCNC refuses the program", got="; ".join(messages))


def _refused_line(folder: pathlib.Path) -> int:
    """Find the number of the line that the interpreter stops at, from 1; 0 where that cannot be told.

    LinuxCNC forgets it before its display can ask; the interpreter alone says what stands on that line.
    """
    done = _tool(folder, "rs274", "-g", str(folder / "program.ngc"))
    said = done.stderr.splitlines()
    lines = (folder / "program.ngc").read_bytes().splitlines()
    found = [
        number for number, text in enumerate(lines, start=1) if said and text.strip() == said[-1].strip()
    ]
    return found[0] if done.returncode and len(found) == 1 else 0


def _tool(folder: pathlib.Path, *words: str) -> subprocess.CompletedProcess[bytes]:
    """Run one of LinuxCNC's own commands to its end."""
    environment = _environment(folder, lockstep=False)
    return subprocess.run(words, env=environment, capture_output=True, timeout=_SHUT_DOWN, check=False)  # noqa: S603


def _recording(folder: pathlib.Path, period: float, name: str, lockstep: bool) -> Recording:
    lines = (folder / "rows.txt").read_bytes().splitlines()
    lost = sum(b"overrun" in line for line in lines)
    if lost:
        raise InputError(name, f"the recording has {lost} gaps; the machine is too busy, try again")
    table = np.loadtxt(folder / "rows.txt", ndmin=2)
    position, motor = table[:, 1:4] * MM, table[:, 4:7] * MM
    moving = np.flatnonzero((np.diff(motor, axis=0) != 0.0).any(axis=1))
    if moving.size == 0:
        raise InputError(name, "the program moves nothing")
    rows = slice(int(moving[0]), int(moving[-1]) + 2)
    return Recording(
        period=period, position=sealed(position[rows].copy()), motor=sealed(motor[rows].copy()),
        line=table[rows, 7].astype(np.int64) - 1, settled=table[rows, 8] > 0.5, lockstep=lockstep,
    )  # fmt: skip
