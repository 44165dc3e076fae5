"""Strategies by name: those of this package and those that others register as entry points."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeGuard

from ph_post.registry import Registry

if TYPE_CHECKING:  # a shell that completes names loads none of the mathematics
    from ph_post.compensate.strategies.base import Strategy, StrategyTraits

PLAIN = "none"
"""The strategy that adds nothing: the plain program."""

TAKE_UP = "takeup"
"""The strategy that only commands the reversing axis through its backlash."""

GROUP = "ph_post.strategies"

BUILT_IN = {
    "auto": "ph_post.compensate.strategies.auto:STRATEGY",
    "dwell": "ph_post.compensate.strategies.dwell:STRATEGY",
    "fly": "ph_post.compensate.strategies.fly:STRATEGY",
    "linear": "ph_post.compensate.strategies.linear:STRATEGY",
    "none": "ph_post.compensate.strategies.none:STRATEGY",
    "retrograde": "ph_post.compensate.strategies.retrograde:STRATEGY",
    "step": "ph_post.compensate.strategies.step:STRATEGY",
    "suppress": "ph_post.compensate.strategies.suppress:STRATEGY",
    "takeup": "ph_post.compensate.strategies.takeup:STRATEGY",
}
"""The strategies of a source tree without installed metadata."""


def strategy_names() -> tuple[str, ...]:
    """Names of all strategies, sorted.

    Examples
    --------
    >>> {"none", "suppress"} <= set(strategy_names())
    True
    """
    return _REGISTRY.names()


def find_strategy(name: str) -> Strategy:
    """Return the strategy of that name.

    Parameters
    ----------
    name : str

    Returns
    -------
    Strategy

    Raises
    ------
    InputError
        Where nobody registered the name, or what is registered is no strategy.
    """
    return _REGISTRY.find(name, "--strategy")


def find_traits(name: str) -> StrategyTraits:
    """Return the traits of the strategy of that name.

    Raises
    ------
    InputError
        As :func:`find_strategy` does.
    """
    from ph_post.compensate.strategies.base import traits_of

    return traits_of(find_strategy(name))


def default_strategy(*, described: bool) -> str:
    """Name the strategy where nobody does; a profile that is `described` is the same at all reversals.

    Examples
    --------
    >>> default_strategy(described=False), default_strategy(described=True)
    ('auto', 'suppress')
    """
    wanted = "profile" if described else "job"
    # One strategy, or none can be named: a copy that keeps the trait of its model is found here.
    (name,) = (name for name in BUILT_IN if find_traits(name).default_for == wanted)
    return name


def _is_strategy(found: object) -> TypeGuard[Strategy]:
    from ph_post.compensate.strategies.base import Strategy

    return isinstance(found, Strategy)


_REGISTRY: Registry[Strategy] = Registry(
    group=GROUP, noun="strategy", wanted="a Strategy", fits=_is_strategy, built_in=BUILT_IN
)
