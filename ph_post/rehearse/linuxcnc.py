"""Run a program on an installed LinuxCNC without a screen, and record the joint commands of every servo period."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import pathlib
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping
from typing import IO, Any, Final

import msgspec
import numpy as np

from ph_post.errors import InputError, PhPostError
from ph_post.progress import Progress, no_progress
from ph_post.rehearse.configuration import IDEAL, write_configuration
from ph_post.types import Array, IntArray, Machine, sealed
from ph_post.units import MM

_HERE = pathlib.Path(__file__).parent


LOCK: Final = "ph-post-linuxcnc.lock"
"""In the folder for temporary files, so that all users meet at it."""

FOREIGN: Final = ("milltask", "linuxcncsvr", "rtapi_app")
"""Processes of a LinuxCNC that somebody else started."""

ENDED: Final = ("Z", "X")
"""States of processes that are over, though nobody has asked for their status."""

_LOOK: Final = 0.2


@contextlib.contextmanager
def exclusive_linuxcnc(progress: Progress) -> Iterator[None]:
    """Wait until no other LinuxCNC runs on this machine, and hold it for oneself."""
    with _opened() as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            progress("waiting for another rehearsal to end")
            fcntl.flock(file, fcntl.LOCK_EX)
        if _foreign():
            progress(f"waiting for the LinuxCNC that runs here to end ({', '.join(_foreign())})")
        while _foreign():
            time.sleep(_LOOK)
        yield


def _opened() -> IO[bytes]:
    place = pathlib.Path(tempfile.gettempdir()) / LOCK
    file = place.open("ab")
    with contextlib.suppress(PermissionError):
        place.chmod(0o666)
    return file


def _foreign() -> list[str]:
    """Names of LinuxCNC's processes that run."""
    found = set()
    for process in pathlib.Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            name, _, rest = process.read_text(errors="replace").partition("(")[2].rpartition(")")
            if not rest.split()[0].startswith(ENDED):
                found.add(name)
    return sorted(found & set(FOREIGN))


INSTALL: Final = "apt-get install linuxcnc-uspace"
"""Command that installs LinuxCNC on Debian."""

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


class NotInstalledError(PhPostError):
    """LinuxCNC is not installed; the message says how to."""


class PlannerRecording(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Commands of LinuxCNC, one row a servo period, from the last row before the first motion on.

    `position` (n, 3) [m]: X, Y and Z as planned; `motor` (n, 3) [m]: with LinuxCNC's own compensation of
    backlash. `line` (n,) the line of the program, from 0, -1 where none runs. `lockstep` says whether
    the program was run in lockstep, or as time passes on the wall, where the waits of a dwell depend on how busy the
    machine is.
    """

    period: float
    position: Array
    motor: Array
    line: IntArray
    lockstep: bool


def is_installed() -> bool:
    """Return true where LinuxCNC can be run on this computer."""
    return all(shutil.which(name, path=_PATH) for name in ("linuxcnc", "halsampler", "rs274"))


def run_on_linuxcnc(
    program: bytes,
    name: str,
    machine: Machine,
    *,
    backlash: Mapping[str, float] | None = None,
    limit: float = TIME_LIMIT,
    progress: Progress = no_progress,
) -> PlannerRecording:
    """Run a program on LinuxCNC's own interpreter, planner and servo thread, with ideal motors.

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
    progress : Progress, optional
        Called with what is being done.

    Raises
    ------
    NotInstalledError
        Where there is no LinuxCNC.
    InputError
        Where LinuxCNC refuses the program, or does not come to its end in time.
    """
    rows, lockstep = record_on_linuxcnc(program, name, machine, backlash=backlash or {}, limit=limit, progress=progress)
    return _recording(rows, machine.servo_period, name, lockstep)


def record_on_linuxcnc(
    program: bytes,
    name: str,
    machine: Machine,
    *,
    hal: pathlib.Path = IDEAL,
    backlash: Mapping[str, float],
    limit: float = TIME_LIMIT,
    progress: Progress = no_progress,
) -> tuple[bytes, bool]:
    """Run a program on LinuxCNC with a HAL file; what `halsampler` wrote, and whether it ran in lockstep.

    The HAL file has to load kinematics, motion and one sampler; the rest is as for :func:`run_on_linuxcnc`.
    """
    if not is_installed():
        raise NotInstalledError(f"LinuxCNC is not installed; install it with: {INSTALL}")
    with (
        tempfile.TemporaryDirectory(prefix="ph-post-", ignore_cleanup_errors=True) as place,
        exclusive_linuxcnc(progress),
    ):
        folder = pathlib.Path(place)
        write_configuration(folder, machine, backlash, hal)
        lockstep = _prepare(folder, program if machine.dialect == "linuxcnc" else program + _END, limit)
        log = _run(folder, limit)
        _require_end(folder, name, limit, log)
        return (folder / "rows.txt").read_bytes(), lockstep


def _prepare(folder: pathlib.Path, program: bytes, limit: float) -> bool:
    """Write the program and what runs it; whether it will run in lockstep."""
    folder.chmod(0o777)  # what runs beside the servo thread does so as nobody
    (folder / "program.ngc").write_bytes(program)
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
            env=_environment(folder),
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            start_new_session=True,
            cwd=folder,
        )
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
    """Find the number of the line that the interpreter stops at, from 1; 0 where it is not found.

    LinuxCNC forgets it before its display can ask; the interpreter alone says what stands on that line.
    """
    done = _tool(folder, "rs274", "-g", str(folder / "program.ngc"))
    said = done.stderr.splitlines()
    lines = (folder / "program.ngc").read_bytes().splitlines()
    found = [number for number, text in enumerate(lines, start=1) if said and text.strip() == said[-1].strip()]
    return found[0] if done.returncode and len(found) == 1 else 0


def _tool(folder: pathlib.Path, *words: str) -> subprocess.CompletedProcess[bytes]:
    """Run one of LinuxCNC's own commands to its end."""
    environment = _environment(folder, lockstep=False)
    return subprocess.run(words, env=environment, capture_output=True, timeout=_SHUT_DOWN, check=False)  # noqa: S603


def _recording(rows: bytes, period: float, name: str, lockstep: bool) -> PlannerRecording:
    lines = rows.splitlines()
    lost = sum(b"overrun" in line for line in lines)
    if lost:
        raise InputError(name, f"the recording has {lost} gaps; the machine is too busy, try again")
    table = np.loadtxt(lines, ndmin=2)
    position, motor = table[:, 1:4] * MM, table[:, 4:7] * MM
    moving = np.flatnonzero((np.diff(motor, axis=0) != 0.0).any(axis=1))
    if moving.size == 0:
        raise InputError(name, "the program moves nothing")
    moved = slice(int(moving[0]), int(moving[-1]) + 2)
    return PlannerRecording(
        period=period,
        position=sealed(position[moved].copy()),
        motor=sealed(motor[moved].copy()),
        line=table[moved, 7].astype(np.int64) - 1,
        lockstep=lockstep,
    )
