"""Dialects by name: those of this package and those that others register as entry points."""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import EntryPoint, entry_points

from ph_post.errors import InputError
from ph_post.gcode.dialect import Dialect

GROUP = "ph_post.dialects"

BUILT_IN = {
    "grbl": "ph_post.gcode.dialects.grbl:DIALECT",
    "linuxcnc": "ph_post.gcode.dialects.linuxcnc:DIALECT",
}
"""What a source tree without installed metadata offers."""


def dialect_names() -> tuple[str, ...]:
    """Names of all dialects, sorted.

    Examples
    --------
    >>> {"grbl", "linuxcnc"} <= set(dialect_names())
    True
    """
    return tuple(sorted({*BUILT_IN, *_registered()}))


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
    if name in BUILT_IN:
        module, attribute = BUILT_IN[name].split(":")
        found = getattr(import_module(module), attribute)
    elif name in (registered := _registered()):
        found = registered[name].load()
    else:
        raise InputError(where, "no such dialect", expected=" or ".join(dialect_names()), got=repr(name))
    if not isinstance(found, Dialect):
        what = f"what is registered as dialect {name!r} is not one"
        raise InputError(where, what, expected="a Dialect record", got=type(found).__name__)
    return found


def _registered() -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=GROUP)}
