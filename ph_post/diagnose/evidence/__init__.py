"""Evidence for an effect: the prediction of physics beside the numbers of the log."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Final

from ph_post.diagnose.evidence import drives, forces, readings
from ph_post.diagnose.evidence.base import Evidence, rms
from ph_post.diagnose.sentences import length

SIGNATURES: Final[Mapping[str, Callable[[Evidence], Iterator[str]]]] = {
    "backlash": drives.backlash,
    "position_dependent_backlash": drives.by_place,
    "servo_mismatch": drives.servo,
    "command_filter": drives.command_filter,
    "elastic_windup": drives.windup,
    "engagement_impact": drives.impact,
    "torque_saturation": drives.saturation,
    "coulomb_friction": forces.coulomb,
    "stribeck_friction": forces.stribeck,
    "viscous_friction": forces.viscous,
    "friction_asymmetry": forces.asymmetry,
    "load_offset": forces.load,
    "cogging": forces.cogging,
    "cutting_force": forces.cutting,
    "cyclic_error": readings.cyclic,
    "scale_error": readings.scale,
    "thermal_growth": readings.thermal,
    "squareness": readings.squareness,
    "transport_delay": readings.delay,
}
"""By the names of the catalogue."""


VISIBLE: Final = 0.02
"""Part by which a residual must fall for the gain to be given."""


def evidence_of(name: str, evidence: Evidence) -> tuple[str, ...]:
    """Say what speaks for an effect, in sentences.

    Parameters
    ----------
    name : str
        Of the effect; of one that is not in the catalogue only the gain is given.
    evidence : Evidence

    Returns
    -------
    tuple of str
    """
    found = SIGNATURES.get(name)
    sentences = [] if found is None else list(found(evidence))
    return (*sentences, *_gain(evidence))


def _gain(evidence: Evidence) -> Iterator[str]:
    """Yield how much smaller the residuals are with the effect than without."""
    said = []
    for one in evidence.problem.observed:
        use = evidence.use(one.channel)
        sizes = rms(evidence.before[one.channel], use), rms(evidence.after[one.channel], use)
        if sizes[0] is not None and sizes[1] is not None:
            write = evidence.effort if one.channel == "force" else length
            if sizes[1] < (1.0 - VISIBLE) * sizes[0]:
                column = evidence.column(one.channel)
                said.append(f"{write(sizes[0])} rms from {column}, with it {write(sizes[1])}")
    if said:
        yield f"without it the model is {'; '.join(said)}"
