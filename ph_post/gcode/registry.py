"""Dialects by name: those of this package and those that others register as entry points."""

from __future__ import annotations

from typing import TypeGuard

from ph_post.gcode.dialect import Dialect
from ph_post.registry import Registry

GROUP = "ph_post.dialects"

BUILT_IN = {
    "grbl": "ph_post.gcode.dialects.grbl:DIALECT",
    "grblhal": "ph_post.gcode.dialects.grblhal:DIALECT",
    "linuxcnc": "ph_post.gcode.dialects.linuxcnc:DIALECT",
    "siemens": "ph_post.gcode.dialects.siemens:DIALECT",
}
"""What a source tree without installed metadata offers."""


def dialect_names() -> tuple[str, ...]:
    """Names of all dialects, sorted.

    Examples
    --------
    >>> {"grbl", "linuxcnc"} <= set(dialect_names())
    True
    """
    return _REGISTRY.names()


def find_dialect(name: str, where: str = "dialect") -> Dialect:
    """Return the dialect of that name.

    Parameters
    ----------
    name : str
    where : str, optional
        What named it (a file and key, an option), for the refusal.

    Raises
    ------
    InputError
        Where nobody registered the name, or what is registered is not a dialect.
    """
    return _REGISTRY.find(name, where)


def _is_dialect(found: object) -> TypeGuard[Dialect]:
    return isinstance(found, Dialect)


_REGISTRY: Registry[Dialect] = Registry(
    group=GROUP, noun="dialect", wanted="a Dialect record", fits=_is_dialect, built_in=BUILT_IN
)
