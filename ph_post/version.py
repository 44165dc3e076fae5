"""The version of this package, as outputs name it."""

from __future__ import annotations

from functools import cache
from importlib.metadata import PackageNotFoundError, version


@cache
def package_version() -> str:
    """Return the version of the installed package, "source tree" where it is not installed."""
    try:
        return version("ph-post")
    except PackageNotFoundError:
        return "source tree"
