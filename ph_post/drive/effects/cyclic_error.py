"""Cyclic error: screw or scale read too much and too little in turn, once a turn of the screw or a line."""

from __future__ import annotations

from msgspec.structs import replace

from ph_post.drive.effects.base import DEGREES, MILLIMETRE, POSITIONING, POSITIVE, Effect, Parameter, Values
from ph_post.drive.plant import Plant


def _apply(plant: Plant, values: Values) -> Plant:
    cycle = (values["amplitude"], values["period"], values["phase"])
    return replace(plant, reading=replace(plant.reading, cycles=(*plant.reading.cycles, cycle)))


EFFECT = Effect(
    name="cyclic_error",
    kind="reading",
    summary="the table's reading is A sin(2π x/p + φ) too large; several add up",
    source=POSITIONING,
    parameters=(
        Parameter(name="amplitude_mm", gives="amplitude", unit=MILLIMETRE, meaning="A"),
        Parameter(
            name="period_mm",
            gives="period",
            unit=MILLIMETRE,
            bounds=POSITIVE,
            meaning="p, travel from one crest to the next",
        ),
        Parameter(name="phase_deg", gives="phase", unit=DEGREES, default=0.0, meaning="φ, at position 0"),
    ),
    apply=_apply,
)
