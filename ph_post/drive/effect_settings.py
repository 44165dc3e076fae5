"""Check the effects of an axis of a machine file against the catalogue; their keys and numbers stay as they are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal

from msgspec import UNSET, Struct, defstruct

from ph_post.drive.effects.base import Effect, Parameter, effect_values
from ph_post.drive.effects.registry import find_effect, is_effect, known_names
from ph_post.errors import InputError
from ph_post.files.check import Keys, Refused, checked, one_line, one_of, place, shown
from ph_post.types import Axis, EffectSetting


def effect_settings(tables: Sequence[dict[str, Any]], axis: Axis, file: str, keys: Keys) -> tuple[EffectSetting, ...]:
    """Check the effects of one axis.

    An effect of the catalogue under which nothing acts yet is kept if its parameters are plain values.

    Raises
    ------
    InputError
        Where a name is missing or unknown (the nearest known one is named), a parameter is unknown, missing,
        of the wrong type, out of bounds or at odds with another, an effect cannot be felt on this loop, or
        two contradict each other.
    """
    settings = tuple(_effect(table, axis, file, (*keys, i)) for i, table in enumerate(tables))
    names = [setting.name for setting in settings]
    for number, name in enumerate(names):
        if name in names[:number] and is_effect(name) and find_effect(name).once:
            where = place(file, (*keys, number, "name"))
            raise InputError(where, "a second one on this axis", expected=f"one {name} an axis")
    return settings


def _effect(table: dict[str, Any], axis: Axis, file: str, keys: Keys) -> EffectSetting:
    name = table.get("name")
    known = known_names()
    if name is None:
        raise InputError(place(file, keys), 'key "name" is missing', expected=one_of(known))
    if name not in known:
        near = name if isinstance(name, str) else None
        raise InputError(place(file, (*keys, "name")), "unknown effect", expected=one_of(known, near), got=shown(name))
    parameters = {key: value for key, value in table.items() if key != "name"}
    if is_effect(name):
        _check(find_effect(name, place(file, (*keys, "name"))), parameters, axis, file, keys)
    else:
        for key, value in parameters.items():
            _check_plain(value, file, (*keys, one_line(key, file, keys)))
    return EffectSetting(name=name, parameters=parameters)


def _check(effect: Effect, parameters: dict[str, Any], axis: Axis, file: str, keys: Keys) -> None:
    """Refuse parameters that the effect does not know or cannot use on this axis."""
    if axis.feedback not in effect.feedbacks:
        expected = " or ".join(f'feedback "{loop}"' for loop in sorted(effect.feedbacks))
        raise InputError(
            place(file, (*keys, "name")), "does not act on this loop", expected=expected, got=f'"{axis.feedback}"'
        )
    checked(parameters, _record(effect), file, keys)
    effect_values(effect, axis, parameters, place(file, keys))


def _record(effect: Effect) -> type[Struct]:
    """Make the record that the parameters of an effect must fit one by one.

    All may be left out here: which of them are needed, :func:`effect_values` says, because one value may
    stand under several keys.
    """
    fields = [(one.name, _type(one), UNSET) for one in effect.parameters]
    return defstruct(effect.name, fields, frozen=True, kw_only=True, forbid_unknown_fields=True)


def _type(parameter: Parameter) -> Any:
    if parameter.unit is None:
        return Literal[parameter.choices]
    return Annotated[float, parameter.bounds]


def _check_plain(value: Any, file: str, keys: Keys) -> None:
    for item in value if isinstance(value, list) else [value]:
        if isinstance(item, Refused):
            raise InputError(place(file, keys), item.what, expected=item.expected, got=item.got)
        if not isinstance(item, int | float | str):
            raise InputError(
                place(file, keys), "wrong type", expected="a number, text or list of them", got=shown(item)
            )
