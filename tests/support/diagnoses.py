"""Diagnoses made by hand, one of each verdict, for the tests of what is told about them."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from ph_post.drive.machinefile import read_machine
from ph_post.types import EffectSetting
from ph_post.types.diagnosis import (
    ChannelQuality,
    Diagnosis,
    Estimate,
    Experiment,
    Finding,
    LogQuality,
    ResidualPlace,
    ResidualStep,
    ResidualTrace,
)

LADDER = Experiment(
    name="reversal ladder",
    why="friction lags by the same force at every feed, a gap by the same travel",
    record=("X_cmd", "X_act", "X_motor"),
    program="(reversal ladder)\nG21 G90\nG1 X10 F600 (</script><b>)\nM2\n",
)

COULOMB = Finding(
    name="coulomb_friction",
    axis="X",
    parameters={"force": Estimate(value=20.4123, stderr=0.1, unit="N")},
    where="within 40 ms after X reversals",
    evidence=("the lag after a reversal has one size at every feed: 20.1 N at 5 mm/s, 20.6 N at 50 mm/s",),
    confidence=0.99,
    setting=EffectSetting(name="coulomb_friction", parameters={"force_n": 20.4123}),
)

LOAD = Finding(
    name="load_offset",
    axis="X",
    parameters={"force": Estimate(value=-3.17, stderr=None, unit="N")},
    where="everywhere",
    evidence=("the force has this mean in both directions",),
    confidence=float("nan"),
)

AFTER_REVERSALS = ResidualPlace(
    axis="X",
    by="reversal",
    share=0.82,
    value=0.04,
    sentence="82 % of the excess lies within 40 ms after X reversals",
)

BOTH_WAYS = ResidualPlace(
    axis="X", by="direction", share=0.01, value=1.02, sentence="X: equal in both directions (1.02 to 1)"
)

QUALITY = LogQuality(
    period=1e-3,
    jitter=2e-5,
    first=350,
    channels=(
        ChannelQuality(
            axis="X", channel="act", resolution=1e-7, noise=2e-7, noise_from="repeats", missing=3, shift=2e-3
        ),
        ChannelQuality(axis="X", channel="force", resolution=0.0, noise=0.5, noise_from="differences"),
    ),
    notes=("3 samples of X_act are missing and were left out",),
)

STEPS = (
    ResidualStep(added=None, fit_rms=7.2e-6, holdout_rms=8.0e-6),
    ResidualStep(added="coulomb_friction:X", fit_rms=1.9e-6, holdout_rms=3.0e-6),
)


def trail(count: int = 20_000, channel: str = "act", axis: str = "X", noise: float = 2e-7) -> ResidualTrace:
    """Return residuals that jump by 10 µm where the command turns back, and by a tenth of it afterwards."""
    t = np.arange(count) * 1e-3
    command = 0.05 * np.sin(2.0 * np.pi * 0.5 * t)
    phase = (0.5 * t - 0.25) % 0.5 / 0.5  # 0 where the command turns back
    jump = 1e-5 * np.exp(-phase / 0.05) * np.sign(np.sin(2.0 * np.pi * (0.5 * t - 0.25)))
    blur = noise * np.random.default_rng(5).standard_normal(count)
    size = 1.0 if channel != "force" else 1e6
    return ResidualTrace(
        axis=axis,
        channel=channel,
        t=t,
        command=command,
        before=size * (jump + blur),
        after=size * (0.1 * jump + blur),
        counted=t >= 0.35,
        held_out=(t >= 0.35) & (t % 4.0 > 3.0),
    )


def diagnosis(**changes: object) -> Diagnosis:
    """Return the diagnosis of a machine whose file lacks Coulomb friction on X, changed as is said."""
    made = Diagnosis(
        verdict="named",
        findings=(COULOMB,),
        noise_floor=2e-7,
        steps=STEPS,
        quality=QUALITY,
        places=(BOTH_WAYS, AFTER_REVERSALS),
        remaining=(),
        trails=(trail(), trail(channel="force")),
        machine=read_machine("mill"),
    )
    return replace(made, **changes)


def each_verdict() -> dict[str, Diagnosis]:
    """Return a diagnosis of each verdict."""
    return {
        "named": diagnosis(findings=(COULOMB, LOAD)),
        "nothing-missing": diagnosis(
            verdict="nothing-missing",
            findings=(),
            places=(),
            steps=(ResidualStep(added=None, fit_rms=2.1e-7, holdout_rms=2.2e-7),),
        ),
        "ambiguous": diagnosis(
            verdict="ambiguous",
            steps=STEPS[:1],
            next_experiment=LADDER,
            findings=(
                replace(COULOMB, confidence=0.5, ambiguous_with=("backlash",)),
                Finding(
                    name="backlash",
                    axis="X",
                    where="after X reversals",
                    evidence=(),
                    confidence=0.5,
                    parameters={"lost_motion": Estimate(value=0.0312, stderr=0.0013, unit="mm")},
                    ambiguous_with=("coulomb_friction",),
                    keys={"lost_motion_mm": 0.0312},
                ),
            ),
        ),
        "unknown": diagnosis(verdict="unknown", findings=(), steps=STEPS[:1]),
        "not-identifiable": diagnosis(
            verdict="not-identifiable",
            findings=(),
            steps=(),
            places=(),
            trails=(),
            noise_floor=float("nan"),
            quality=replace(QUALITY, faults=("X_act moves in steps of 1 mm, and no effect is as large",)),
        ),
    }
