"""Objects found by name: those of this package, and those that others register as entry points."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Generic, TypeGuard, TypeVar

import msgspec

from ph_post.errors import InputError

T = TypeVar("T")


class Registry(msgspec.Struct, Generic[T], frozen=True, kw_only=True):
    """One kind of thing.

    Parameters
    ----------
    group : str
        Group of the entry points by which others add theirs.
    noun : str
        What one of them is called in a refusal: ``dialect``.
    wanted : str
        What must be registered, for a refusal: ``a Dialect record``.
    fits : callable
        Whether what is registered is that.
    built_in : mapping of str to str
        ``module:attribute`` by name: what a source tree without installed metadata offers. No entry point
        can take one of these names.
    """

    group: str
    noun: str
    wanted: str
    fits: Callable[[object], TypeGuard[T]]
    built_in: Mapping[str, str]

    def names(self) -> tuple[str, ...]:
        """Names of all of them, sorted."""
        return tuple(sorted({*self.built_in, *self._registered()}))

    def has(self, name: str) -> bool:
        """Whether one of that name is registered."""
        return name in self.built_in or name in self._registered()

    def find(self, name: str, where: str) -> T:
        """Return the one of that name; `where` is what named it (a file and key, an option).

        Raises
        ------
        InputError
            Where nobody registered the name, or what is registered does not fit.
        """
        if name in self.built_in:
            module, attribute = self.built_in[name].split(":")
            found = getattr(import_module(module), attribute)
        elif name in (registered := self._registered()):
            found = registered[name].load()
        else:
            raise InputError(where, f"no such {self.noun}", expected=" or ".join(self.names()), got=repr(name))
        if not self.fits(found):
            what = f"what is registered as {self.noun} {name!r} is not one"
            raise InputError(where, what, expected=self.wanted, got=type(found).__name__)
        return found

    def _registered(self) -> dict[str, EntryPoint]:
        return {point.name: point for point in entry_points(group=self.group)}
