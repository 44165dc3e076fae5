"""The effects of a machine file: known by name, their parameters kept as they are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ph_post.errors import InputError
from ph_post.io.check import Keys, one_line, one_of, place, shown
from ph_post.io.exact import Refused
from ph_post.io.machinerecord import EFFECTS
from ph_post.types import EffectSetting


def effect_settings(tables: Sequence[dict[str, Any]], file: str, keys: Keys) -> tuple[EffectSetting, ...]:
    """Check the names of effects and that their parameters are plain values.

    Raises
    ------
    InputError
        Where a name is missing or unknown (the nearest known one is told), or a parameter is no number, text,
        truth value or list of numbers.
    """
    return tuple(_effect(table, file, (*keys, number)) for number, table in enumerate(tables))


def _effect(table: dict[str, Any], file: str, keys: Keys) -> EffectSetting:
    name = table.get("name")
    if name is None:
        raise InputError(place(file, keys), 'key "name" is missing', expected=one_of(EFFECTS))
    if name not in EFFECTS:
        near = name if isinstance(name, str) else None
        raise InputError(
            place(file, (*keys, "name")), "unknown effect", expected=one_of(EFFECTS, near), got=shown(name)
        )
    parameters = {key: value for key, value in table.items() if key != "name"}
    for key, value in parameters.items():
        _check_parameter(value, file, (*keys, one_line(key, file, keys)))
    return EffectSetting(name=name, parameters=parameters)


def _check_parameter(value: Any, file: str, keys: Keys) -> None:
    for item in value if isinstance(value, list) else [value]:
        if isinstance(item, Refused):
            raise InputError(place(file, keys), item.what, expected=item.expected, got=item.got)
        if not isinstance(item, int | float | str):
            raise InputError(
                place(file, keys), "wrong type", expected="a number, text or list of them", got=shown(item)
            )
