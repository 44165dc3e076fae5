"""Say of a plan whether inverse dynamics changes anything, and where there was no room for it."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from ph_post.compensate import plan_warnings
from ph_post.compensate.lead import LEAST
from ph_post.compensate.offsets import command_of
from ph_post.compensate.violations import check_command
from ph_post.geometry.numeric import norm, runs
from ph_post.geometry.track import Track
from ph_post.types import Plan


def with_lead_told(plan: Plan, track: Track) -> Plan:
    """Say what the limits took of a plan's inverse dynamics; without it where it changes nothing that shows.

    Parameters
    ----------
    plan : Plan
    track : Track
        Of the plan's path.

    Returns
    -------
    Plan
    """
    if not plan.inverse_dynamics:
        return plan
    period = plan.machine.servo_period
    led, free = command_of(plan, track, period), command_of(plan, track, period, fade=False)
    missing = norm(led.position - free.position)
    places = runs(np.flatnonzero(missing >= LEAST))
    said: list[str] = []
    if places:
        worst = int(np.argmax(missing))
        said = [plan_warnings.lost_lead_warning(float(missing[worst]), len(places), float(led.s[worst]))]
    if plan.crossings or led.offset is None or norm(led.offset).max() < LEAST:
        without = replace(plan, inverse_dynamics=False)
        plain = command_of(without, track, period)
        if norm(led.position - plain.position).max() < LEAST and not check_command(plain, plan.machine):
            plan = without
    return replace(plan, warnings=(*plan.warnings, *said))
