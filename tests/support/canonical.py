"""What LinuxCNC's own interpreter makes of a program."""

from __future__ import annotations

import os
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path

_MOVES = ("STRAIGHT_FEED", "STRAIGHT_TRAVERSE", "ARC_FEED", "NURBS_FEED")
_ADDED = (*_MOVES, "COMMENT", "DWELL", "SET_FEED_RATE")
_NUMBER = re.compile(r"^\s*\d+\s+N\S+\s+")


@dataclass(frozen=True)
class Calls:
    """Canonical calls: the moves, and those that a compensation has no business with."""

    moves: tuple[str, ...]
    others: tuple[str, ...]


def canonical_calls(program: bytes, folder: Path) -> Calls | None:
    """Run ``rs274 -g``; None where it refuses the program."""
    source = folder / "program.ngc"
    source.write_bytes(program)
    command = ["rs274", "-v", str(folder / "rs274.var"), "-g", str(source)]
    # Its table of tools lies in the home folder, where interpreters that run side by side would share it.
    home = {**os.environ, "HOME": str(folder)}
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder, timeout=60, env=home)
    if done.returncode != 0:
        return None
    calls = [_NUMBER.sub("", line) for line in done.stdout.splitlines() if _NUMBER.match(line)]
    return Calls(
        moves=tuple(call for call in calls if call.startswith(_MOVES)),
        others=tuple(call for call in calls if not call.startswith(_ADDED)),
    )
