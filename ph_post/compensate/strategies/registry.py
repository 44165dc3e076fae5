"""Strategies by name: those of this package and those that others register as entry points."""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import EntryPoint, entry_points

from ph_post.compensate.strategies.base import Strategy
from ph_post.errors import InputError

GROUP = "ph_post.strategies"

BUILT_IN = {
    "none": "ph_post.compensate.strategies.none:STRATEGY",
    "suppress": "ph_post.compensate.strategies.suppress:STRATEGY",
}
"""What a source tree without installed metadata offers."""


def strategy_names() -> tuple[str, ...]:
    """Names of all strategies, sorted.

    Examples
    --------
    >>> {"none", "suppress"} <= set(strategy_names())
    True
    """
    return tuple(sorted({*BUILT_IN, *_registered()}))


def find_strategy(name: str, where: str = "--strategy") -> Strategy:
    """Return the strategy of that name.

    Parameters
    ----------
    name : str
    where : str, optional
        What named it, for the refusal.

    Raises
    ------
    InputError
        Where nobody registered the name, or what is registered is no strategy.
    """
    if name in BUILT_IN:
        module, attribute = BUILT_IN[name].split(":")
        found = getattr(import_module(module), attribute)
    elif name in (registered := _registered()):
        found = registered[name].load()
    else:
        raise InputError(where, "no such strategy", expected=" or ".join(strategy_names()), got=repr(name))
    if not isinstance(found, Strategy):
        what = f"what is registered as strategy {name!r} is not one"
        raise InputError(where, what, expected="a Strategy", got=type(found).__name__)
    return found


def _registered() -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=GROUP)}
