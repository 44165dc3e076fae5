"""Transport delay: a command that arrives, or a reading that is known, late by a fixed time."""

from __future__ import annotations

from msgspec.structs import replace

from ph_post.drive.effects.base import MILLISECOND, NOT_NEGATIVE, Effect, EffectFault, Parameter, Values
from ph_post.drive.plant import Plant
from ph_post.types import Axis

_COMMAND, _READING = 0, 1


def _apply(plant: Plant, values: Values) -> Plant:
    if values["where"] == _READING:
        return replace(plant, reading_delay=plant.reading_delay + values["delay"])
    return replace(plant, command_delay=plant.command_delay + values["delay"])


def _fault(axis: Axis, values: Values) -> EffectFault | None:
    if not axis.loop.has_controller and values["where"] == _READING:
        return EffectFault(gives="where", what="an open loop reads nothing", expected='"command"')
    return None


EFFECT = Effect(
    name="transport_delay",
    kind="command",
    summary="command or reading late by a fixed time; several in one place add up",
    source="K. J. Åström, B. Wittenmark: Computer-Controlled Systems, 3rd ed., Prentice Hall 1997",
    parameters=(
        Parameter(name="delay_ms", gives="delay", unit=MILLISECOND, bounds=NOT_NEGATIVE, meaning="by how much"),
        Parameter(
            name="where",
            gives="where",
            choices=("command", "reading"),
            default="command",
            meaning="what is late",
        ),
    ),
    apply=_apply,
    fault=_fault,
)
