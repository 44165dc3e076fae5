"""What a command says, without what depends on how busy the machine is."""

from __future__ import annotations


def without_progress(text: str) -> str:
    """Leave out the lines that name the stage a command is in."""
    return "".join(line for line in text.splitlines(keepends=True) if not line.endswith(" ...\n"))
