"""Thermal growth: warm-up moves the reading slowly towards a limit."""

from __future__ import annotations

from msgspec.structs import replace

from ph_post.drive.effects.base import MILLIMETRE, POSITIVE, SECOND, THERMAL, Effect, Parameter, Values
from ph_post.drive.plant import Plant


def _apply(plant: Plant, values: Values) -> Plant:
    growth = (values["growth"], values["time_constant"])
    return replace(plant, reading=replace(plant.reading, growths=(*plant.reading.growths, growth)))


EFFECT = Effect(
    name="thermal_growth",
    kind="reading",
    summary="the table's reading drifts by G (1 - exp(-t/τ)) from the beginning on; several add up",
    source=THERMAL,
    parameters=(
        Parameter(name="growth_mm", gives="growth", unit=MILLIMETRE, meaning="G, what it comes to in the end"),
        Parameter(name="time_constant_s", gives="time_constant", unit=SECOND, bounds=POSITIVE, meaning="τ"),
    ),
    apply=_apply,
)
