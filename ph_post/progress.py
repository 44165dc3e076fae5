"""The callback by which long work reports what it is doing."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[str], None]
"""Called with the name of every stage that the work enters."""


def no_progress(_stage: str) -> None:
    """Ignore progress messages."""


def prefixed(progress: Progress, prefix: str) -> Progress:
    """Report every stage with a prefix, as a part of a larger job."""
    return lambda stage: progress(f"{prefix}: {stage}")
