"""Random paths as programs that cross on the fly, on random machines: is what is said of them what a machine does?"""

from __future__ import annotations

import os
from itertools import product

import numpy as np
import pytest
from msgspec.structs import replace
from support.amount import ALL
from support.commanded import largest_errors
from support.random_jobs import random_job

import ph_post as ph
from ph_post.geometry.track import Track

FIRST, PAIRS, PART = 2026, 300, 40
RULES = ("standstill", "momentum", "contact")
MICROMETRE = 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("number", range(FIRST, FIRST + PAIRS, 1 if os.environ.get(ALL) else PART))
def test_what_a_program_says_is_what_a_machine_does(number: int) -> None:
    """Never worse than the plain program, in the time that is allowed, and as good as it says."""
    job = random_job(number)
    allowed = job.options.max_slowdown
    machine = replace(job.machine, dialect="linuxcnc")
    result = ph.compensate(job.path, machine, max_slowdown=allowed, effort=0.05)
    if result.crossed is None or result.after.error is None:
        return
    before, after = result.before.error, result.after.error
    assert result.after.time <= (1.0 + allowed + 0.0051) * result.before.time
    assert after.max <= 1.01 * before.max + 0.5 * MICROMETRE
    assert after.rms <= 1.01 * before.rms + 0.5 * MICROMETRE
    open_rules = any(axis.feedback == "load" and axis.gap.pickup is None for axis in machine.axes.values())
    tried = product(product((1, -1), repeat=len(job.path.axes)), RULES if open_rules else RULES[:1])
    track = Track(job.path)
    cut, every = np.array([largest_errors(result, track, side, rule) for side, rule in tried]).max(axis=0)
    assert 0.9 * cut - MICROMETRE <= after.max <= 1.1 * max(cut, every) + MICROMETRE
