"""An effect by the recipe: a spring that pulls the table with a constant force."""

from msgspec.structs import replace

from ph_post.drive.effects.base import MILLIMETRE, Effect, Parameter, Values
from ph_post.drive.plant import Plant


def _apply(plant: Plant, values: Values) -> Plant:
    return replace(plant, load=plant.load + values["pull"])


EFFECT = Effect(
    name="toy_spring",
    kind="force",
    summary="a constant pull towards minus",
    source="none: a toy",
    parameters=(Parameter(name="pull_mm", gives="pull", unit=MILLIMETRE, meaning="following error of the pull"),),
    apply=_apply,
)
