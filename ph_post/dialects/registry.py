"""Find dialects by name: those of this package, and those that others register as entry points."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final, NamedTuple, TypeGuard

from msgspec.structs import replace

from ph_post.errors import InputError
from ph_post.registry import Registry

if TYPE_CHECKING:
    from ph_post.dialects.base import Dialect
    from ph_post.gcode.language import Language


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
"""The dialects of this package, also in a source tree without installed metadata."""

ENDINGS: Final[Mapping[str, str]] = {".mpf": "siemens", ".spf": "siemens"}
"""Dialects by the endings of files, in small letters, that are in their language alone."""


class Signature(NamedTuple):
    """The dialect of programs whose first bytes match `beginning`, and their name in an error."""

    dialect: str
    beginning: re.Pattern[bytes]
    title: str


SIGNATURES: Final = (
    Signature("heidenhain", re.compile(rb"\s*(?:\d+\s+)?BEGIN\s+PGM\s"), "a conversational program of Heidenhain"),
)
"""Plain data beside the names, so that reading a program loads no dialect but its own."""


_RESTING: Final = re.compile(r"m0*(\d{1,4})", re.IGNORECASE)
"""Variant of any dialect: an M word that moves nothing."""

_MACRO: Final = re.compile(r"(?![a-z]\d)[a-z_]\w+", re.IGNORECASE | re.ASCII)
"""Variant of a dialect with macros: the name of one that moves nothing, and no command's."""


def dialect_names() -> tuple[str, ...]:
    """Names of all dialects, sorted.

    Examples
    --------
    >>> {"grbl", "linuxcnc"} <= set(dialect_names())
    True
    """
    return _REGISTRY.names()


def is_dialect(name: str) -> bool:
    """Return True if a dialect of that name is registered; words behind plus signs are variants.

    Examples
    --------
    >>> is_dialect("fanuc+nurbs"), is_dialect("custom")
    (True, False)
    """
    return _REGISTRY.has(name.split("+", maxsplit=1)[0])


def find_dialect(name: str, where: str = "dialect") -> Dialect:
    """Return the dialect with a name.

    Parameters
    ----------
    name : str
        Words behind plus signs are variants of the dialect: ``fanuc+nurbs``. Every dialect has one for each M word to
        which a machine's builder may give a meaning, by which it moves nothing: ``linuxcnc+m103``; Klipper's has one
        for each macro, too: ``klipper+printing_feature``.
    where : str, optional
        The file and key, or the option, that has the name, for the error.

    Raises
    ------
    InputError
        If nobody registered the name, the registered object is no dialect, or the dialect has no such variant.
    """
    base, *words = name.split("+")
    dialect = _REGISTRY.find(base, where)
    resting = [int(found[1]) for word in words if (found := _RESTING.fullmatch(word))]
    macros = frozenset[str]()
    for word in words:
        if word in dialect.variants:
            dialect = dialect.variants[word](dialect)
        elif dialect.language.macros and _MACRO.fullmatch(word):
            macros |= {word}
        elif not _RESTING.fullmatch(word):
            known = " or ".join([*dialect.variants, "an M word that moves nothing, as m103"])
            raise InputError(where, f"the dialect {base} has no such variant", expected=known, got=repr(word))
    if resting or macros:
        dialect = replace(dialect, language=_resting(dialect, resting, macros, name, where))
    return replace(dialect, name=name, options=dialect.options | {*words}) if words else dialect


def _resting(dialect: Dialect, numbers: Sequence[int], macros: frozenset[str], name: str, where: str) -> Language:
    """Return the language of a dialect of that name in which M words and macros move nothing."""
    from ph_post.gcode.codes import may_rest  # loads numpy, slow: names are completed without it

    for number in numbers:
        if not may_rest(number):
            what = f"M{number} has a meaning of its own"
            raise InputError(where, what, expected="an M word of the machine's builder", got=repr(name))
    return dialect.language.resting(frozenset(numbers), name.lower(), macros)


def _fits(found: object) -> TypeGuard[Dialect]:
    from ph_post.dialects.base import Dialect

    return isinstance(found, Dialect)


_REGISTRY: Registry[Dialect] = Registry(
    group=GROUP, noun="dialect", wanted="a Dialect record", fits=_fits, built_in=BUILT_IN
)
