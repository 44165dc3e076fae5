"""Find dialects by name: those of this package, and those that others register as entry points."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, TypeGuard

from msgspec.structs import replace

from ph_post.errors import InputError
from ph_post.registry import Registry

if TYPE_CHECKING:
    from ph_post.dialects.base import Dialect


GROUP = "ph_post.dialects"

BUILT_IN = {
    "fanuc": "ph_post.dialects.fanuc.dialect:DIALECT",
    "grbl": "ph_post.dialects.grbl:DIALECT",
    "grblhal": "ph_post.dialects.grblhal:DIALECT",
    "heidenhain": "ph_post.dialects.heidenhain.dialect:DIALECT",
    "heidenhain-iso": "ph_post.dialects.heidenhain.dialect:ISO_DIALECT",
    "klipper": "ph_post.dialects.klipper:DIALECT",
    "linuxcnc": "ph_post.dialects.linuxcnc:DIALECT",
    "marlin": "ph_post.dialects.marlin:DIALECT",
    "siemens": "ph_post.dialects.siemens.dialect:DIALECT",
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
        Words behind plus signs name what the machine has besides: ``fanuc+nurbs``.
    where : str, optional
        What named it (a file and key, an option), for the refusal.

    Raises
    ------
    InputError
        Where nobody registered the name, or what is registered is not a dialect, or it has no such variant.
    """
    base, *words = name.split("+")
    dialect = _REGISTRY.find(base, where)
    for word in words:
        if word not in dialect.variants:
            known = " or ".join(dialect.variants) or "none"
            raise InputError(where, f"the dialect {base} has no such variant", expected=known, got=repr(word))
        dialect = dialect.variants[word](dialect)
    return replace(dialect, name=name, options=dialect.options | {*words}) if words else dialect


def built_in_dialects() -> Iterator[Dialect]:
    """Yield the dialects of this package."""
    return (find_dialect(name) for name in BUILT_IN)


def _is_dialect(found: object) -> TypeGuard[Dialect]:
    from ph_post.dialects.base import Dialect

    return isinstance(found, Dialect)


_REGISTRY: Registry[Dialect] = Registry(
    group=GROUP, noun="dialect", wanted="a Dialect record", fits=_is_dialect, built_in=BUILT_IN
)
