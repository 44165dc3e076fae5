"""What tells effects apart that one record could not: motions, channels and the physics, name by name."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import Final

import msgspec

from ph_post.diagnose.record import Channel


class Separation(msgspec.Struct, frozen=True, kw_only=True):
    """What tells effects apart, or shows one.

    `parts` are motions of :data:`ph_post.diagnose.kitparts.PARTS`, `record` the channels without which they
    tell nothing, `why` the physics in a sentence.
    """

    parts: tuple[str, ...]
    record: tuple[Channel, ...]
    why: str


def _see(parts: str, record: str, why: str) -> Separation:
    return Separation(parts=_words(parts), record=_channels(record), why=why)


def _words(text: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in text.split(","))


def _channels(text: str) -> tuple[Channel, ...]:
    known: tuple[Channel, ...] = ("act", "motor", "force")
    return tuple(channel for channel in known if channel in text.split())


SHOWN: Final[Mapping[str, Separation]] = {
    "backlash": _see("ladder", "act motor", "play is what the table lacks of the motor's way"),
    "coulomb_friction": _see("ladder, speeds", "force", "dry friction is a force of one size by direction"),
    "stribeck_friction": _see("speeds", "act force", "friction that falls with speed shows in a crawl"),
    "viscous_friction": _see("speeds", "force", "viscous friction is a force in proportion to speed"),
    "friction_asymmetry": _see("speeds", "force", "such friction has another slope in the other direction"),
    "load_offset": _see("ladder, speeds", "force", "a load is a force that stays when the direction changes"),
    "elastic_windup": _see("fast, small circles", "act motor", "a spring gives way with acceleration"),
    "engagement_impact": _see(
        "ladder, circles", "act motor", "the table starts with a jump where the motor picks it up at speed"
    ),
    "position_dependent_backlash": _see("places, sweeps", "act motor", "such a gap differs along the axis"),
    "cyclic_error": _see("sweeps", "act", "an error of the screw repeats with its lead at any feed"),
    "scale_error": _see("sweeps", "act", "a wrong scale grows with the way, at any time"),
    "thermal_growth": _see("warm-up", "act", "warmth shifts the reading as time goes by"),
    "squareness": _see("diagonals", "act", "an angle makes one diagonal longer and the other shorter"),
    "servo_mismatch": _see("small circles, stops", "act", "b acts with acceleration, c with speed"),
    "transport_delay": _see("small circles, stops", "act", "a delay shifts everything by one time"),
    "torque_saturation": _see("fast, small circles", "force", "a limit shows above one acceleration only"),
    "cogging": _see(
        "sweeps", "motor force", "a cogging force is filtered by the loop: its trace goes by feed"
    ),
    "cutting_force": _see("circles, sweeps", "force", "in air there is no cutting force"),
}
"""How each effect of the catalogue shows best."""

READINGS: Final = frozenset(("cyclic_error", "scale_error", "thermal_growth", "squareness"))
"""Effects on what is read outside of the loop: the scale that the loop itself follows cannot show them."""

_FRICTION = ("coulomb_friction", "stribeck_friction")
_GAP = ("backlash", "position_dependent_backlash")
_FORCES = (*_FRICTION, "viscous_friction", "friction_asymmetry")
_LOOP = ("servo_mismatch", "transport_delay")
_AIR = "sweeps, circles"

_TABLE: Final = (
    (_FRICTION, (*_GAP, "engagement_impact"), _see(
        "ladder, circles", "act motor force",
        "play is a difference between motor and table and takes no force, friction is a force and leaves"
        " motor and table together; steps below and above the gap, and other feeds",
    )),
    (("viscous_friction", "friction_asymmetry"), _LOOP, _see(
        "small circles, speeds, stops", "act force",
        "viscous friction takes force at constant speed, a wrong c and a delay take none; what b does grows"
        " with acceleration, a delay with every frequency alike: small fast circles, steady speeds, stops",
    )),
    (("servo_mismatch",), ("transport_delay",), _see(
        "small circles, stops, speeds", "act",
        "at one speed a delay and a wrong c are the same lag: high accelerations tell them apart, as a delay"
        " turns the phase of a circle and leaves its radius, b and c change both",
    )),
    (("scale_error",), ("thermal_growth",), _see(
        "warm-up", "act",
        "the same sweep cold and warm: a wrong scale is there from the beginning, growth comes with time",
    )),
    (("cyclic_error",), ("cogging",), _see(
        "sweeps", "act motor",
        "at two very different feeds an error of the screw stays and leaves the motor's side alone, a cogging"
        " force moves the motor, and less the faster it goes by",
    )),
    (("load_offset",), (*_FORCES, *_GAP, *_LOOP, "scale_error", "thermal_growth"), _see(
        "ladder, speeds", "force",
        "in positions a load is a shifted origin: only force or current shows it, alike in both directions",
    )),
    (("squareness",), ("scale_error", "thermal_growth", "cyclic_error"), _see(
        "diagonals, sweeps", "act",
        "an angle lengthens one diagonal and shortens the other, a wrong scale lengthens both alike",
    )),
    (("elastic_windup",), _LOOP, _see(
        "fast, small circles, stops", "act motor",
        "with high acceleration a spring opens a difference between motor and table that swings after a stop,"
        " a wrong servo and a delay leave them together",
    )),
    (("elastic_windup",), (*_FRICTION, *_GAP), _see(
        "ladder, fast, small circles", "act motor force",
        "a spring gives way with force and comes back, a gap stays open at rest, friction stays a force",
    )),
    (("friction_asymmetry",), (*_FRICTION, "viscous_friction"), _see(
        "speeds", "act force",
        "both directions at many speeds: whose force has another slope in plus than in minus",
    )),
    (("viscous_friction",), _FRICTION, _see(
        "speeds", "act force", "many speeds: viscous friction grows with speed, dry friction does not",
    )),
    (("engagement_impact",), _GAP, _see(
        "ladder, circles, small circles", "act motor",
        "the size of a gap shows at standstill after small steps, what the pick-up keeps of the motor's"
        " momentum grows with the speed across it: several feeds and accelerations",
    )),
    (("cutting_force",), (*_FORCES, *_LOOP, "load_offset", "torque_saturation"), _see(
        _AIR, "act force",
        "in air there is no cutting force, and everything else is as before; run the program of this record"
        " once more in air, too",
    )),
    (("position_dependent_backlash",), ("backlash",), _see(
        "places", "act motor", "reversals at several places: one gap everywhere, or another at each",
    )),
    (("position_dependent_backlash",), ("cyclic_error", "scale_error"), _see(
        "places, sweeps", "act motor",
        "an error of the screw is the same in both directions, a gap is what differs between them",
    )),
    (("stribeck_friction",), ("coulomb_friction",), _see(
        "speeds", "act force", "very slow strokes: only there does more friction at rest than in motion show",
    )),
    (("torque_saturation",), ("elastic_windup", *_LOOP), _see(
        "small circles, fast", "act motor force",
        "a ladder of accelerations: saturation begins at one of them and flattens the force, the others grow"
        " in proportion",
    )),
    (("cyclic_error",), ("scale_error", "thermal_growth"), _see(
        "sweeps, warm-up", "act",
        "over all of the way one repeats with the lead of the screw, one grows with the way, one with time",
    )),
)  # fmt: skip

BETWEEN: Final[Mapping[frozenset[str], Separation]] = {
    frozenset(pair): separation for one, other, separation in _TABLE for pair in product(one, other)
}
"""What tells two effects apart."""


def separation(one: str, other: str) -> Separation:
    """Return what tells two effects of the catalogue apart: of the table, or what shows each of them.

    Examples
    --------
    >>> separation("thermal_growth", "scale_error").parts
    ('warm-up',)
    >>> separation("squareness", "torque_saturation").parts
    ('diagonals', 'fast', 'small circles')
    """
    found = BETWEEN.get(frozenset((one, other)))
    if found is not None:
        return found
    first, second = SHOWN[one], SHOWN[other]
    whys = dict.fromkeys((first.why, second.why))
    return Separation(
        parts=tuple(dict.fromkeys((*first.parts, *second.parts))),
        record=_channels(" ".join((*first.record, *second.record))),
        why="; ".join(whys),
    )
