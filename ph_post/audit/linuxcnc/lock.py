"""One LinuxCNC at a time: its shared memory has the same name for all."""

from __future__ import annotations

import contextlib
import fcntl
import pathlib
import tempfile
import time
from collections.abc import Callable, Iterator
from typing import IO, Final

LOCK: Final = "ph-post-linuxcnc.lock"
"""In the folder for temporary files, so that all users meet at it."""

FOREIGN: Final = ("milltask", "linuxcncsvr", "rtapi_app")
"""Processes of a LinuxCNC that somebody else started."""

ENDED: Final = ("Z", "X")
"""States of processes that are over, though nobody has asked for their status."""

_LOOK: Final = 0.2


@contextlib.contextmanager
def only_one(tell: Callable[[str], None]) -> Iterator[None]:
    """Wait until no other LinuxCNC runs on this machine, and hold it for oneself."""
    with _opened() as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            tell("waiting for another rehearsal to end")
            fcntl.flock(file, fcntl.LOCK_EX)
        if _foreign():
            tell(f"waiting for the LinuxCNC that runs here to end ({', '.join(_foreign())})")
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
