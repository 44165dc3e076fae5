"""Dialects by name: those of this package and those that others register as entry points."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeGuard

from ph_post.registry import Registry

if TYPE_CHECKING:  # a shell that completes names loads none of the mathematics
    from ph_post.gcode.dialect import Dialect

GROUP = "ph_post.dialects"

BUILT_IN = {
    "grbl": "ph_post.gcode.dialects.grbl:DIALECT",
    "grblhal": "ph_post.gcode.dialects.grblhal:DIALECT",
    "klipper": "ph_post.gcode.dialects.klipper:DIALECT",
    "linuxcnc": "ph_post.gcode.dialects.linuxcnc:DIALECT",
    "marlin": "ph_post.gcode.dialects.marlin:DIALECT",
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
    from ph_post.gcode.dialect import Dialect

    return isinstance(found, Dialect)


_REGISTRY: Registry[Dialect] = Registry(
    group=GROUP, noun="dialect", wanted="a Dialect record", fits=_is_dialect, built_in=BUILT_IN
)
