"""Objects found by name: those of this package, and those that others register as entry points."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Generic, TypeGuard, TypeVar

import msgspec

from ph_post.errors import InputError

T = TypeVar("T")


class Registry(msgspec.Struct, Generic[T], frozen=True, kw_only=True):
    """Things of one kind by name.

    Parameters
    ----------
    group : str
        Group of the entry points by which others add theirs.
    noun : str
        Word for one of them in a refusal: ``dialect``.
    wanted : str
        What must be registered, for a refusal: ``a Dialect record``.
    fits : callable
        Type guard for a registered object.
    built_in : mapping of str to str
        ``module:attribute`` by name of those of this package. No entry point can take one of these names.
    """

    group: str
    noun: str
    wanted: str
    fits: Callable[[object], TypeGuard[T]]
    built_in: Mapping[str, str]

    def names(self) -> tuple[str, ...]:
        """Return all names, sorted."""
        return tuple(sorted({*self.built_in, *self._registered()}))

    def has(self, name: str) -> bool:
        """Return True if the name is known."""
        return name in self.built_in or name in self._registered()

    def find(self, name: str, where: str) -> T:
        """Return the object with a name; `where` is the file and key, or the option, that has the name.

        Raises
        ------
        InputError
            If nobody registered the name, or the registered object does not fit.
        """
        if name in self.built_in:
            module, attribute = self.built_in[name].split(":")
            found = getattr(import_module(module), attribute)
        elif name in (registered := self._registered()):
            found = registered[name].load()
        else:
            raise InputError(where, f"no such {self.noun}", expected=" or ".join(self.names()), got=repr(name))
        if not self.fits(found):
            raise InputError(
                where, f"the entry point {name!r} is no {self.noun}", expected=self.wanted, got=type(found).__name__
            )
        return found

    def _registered(self) -> Mapping[str, EntryPoint]:
        return _points(entry_points, self.group)


@cache
def _points(look: Callable[..., Iterable[EntryPoint]], group: str) -> Mapping[str, EntryPoint]:
    """Return the entry points of a group by name, looked for once: that reads a file of every installed package."""
    return {point.name: point for point in look(group=group)}
