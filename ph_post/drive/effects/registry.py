"""Effects by name: those of this package, those that others register as entry points, and reserved names."""

from __future__ import annotations

from typing import TypeGuard

from ph_post.drive.effects.base import Effect
from ph_post.registry import Registry

GROUP = "ph_post.effects"

CATALOGUE = (
    "backlash",
    "coulomb_friction",
    "stribeck_friction",
    "viscous_friction",
    "friction_asymmetry",
    "load_offset",
    "elastic_windup",
    "engagement_impact",
    "position_dependent_backlash",
    "cyclic_error",
    "scale_error",
    "thermal_growth",
    "squareness",
    "servo_mismatch",
    "command_filter",
    "transport_delay",
    "torque_saturation",
    "cogging",
    "cutting_force",
)
"""Names whose meaning is fixed, whether or not something acts under them yet."""

_RESERVED = frozenset(("backlash", "servo_mismatch", "command_filter"))
BUILT_IN = {name: f"ph_post.drive.effects.{name}:EFFECT" for name in CATALOGUE if name not in _RESERVED}
"""The effects of this package: a module of the name for each, which defines its EFFECT."""


def effect_names() -> tuple[str, ...]:
    """Names of all effects that act, sorted.

    Examples
    --------
    >>> "coulomb_friction" in effect_names()
    True
    """
    return _REGISTRY.names()


def known_names() -> tuple[str, ...]:
    """Names that a machine file may have: the catalogue, then what others add.

    Examples
    --------
    >>> "servo_mismatch" in known_names(), "servo_mismatch" in effect_names()
    (True, False)
    """
    return (*CATALOGUE, *(name for name in effect_names() if name not in CATALOGUE))


def is_effect(name: str) -> bool:
    """Return True if an effect acts under the name."""
    return _REGISTRY.has(name)


def find_effect(name: str, where: str = "effect") -> Effect:
    """Return the effect with the name.

    Parameters
    ----------
    name : str
    where : str, optional
        What named it (a file and key), for the refusal.

    Raises
    ------
    InputError
        Where nothing acts under the name, or what is registered is not an effect.
    """
    return _REGISTRY.find(name, where)


def _fits(found: object) -> TypeGuard[Effect]:
    return isinstance(found, Effect)


_REGISTRY: Registry[Effect] = Registry(
    group=GROUP, noun="effect", wanted="an Effect record", fits=_fits, built_in=BUILT_IN
)
