"""The exact interpolator: positions on the path at the servo period, from the plan's polynomials."""

from __future__ import annotations

from collections.abc import Sequence

from ph_post.compensate.motion import Motion, row_times
from ph_post.geometry.track import Track
from ph_post.types import Array, Command, Phase, Plan


def sample(plan: Plan, track: Track, period: float) -> Command:
    """Sample a plan, one row a servo period from t = 0.

    Arc length and feed come from the plan's polynomials and the position from the path at that arc length, so
    that no error adds up from row to row. A plan that ends at rest gets as many rows as bring it to its end:
    what is left of the last period is spent at rest there. One that ends moving ends with its last whole
    period, so that every row is a place the tool runs through at its feed.

    Parameters
    ----------
    plan : Plan
    track : Track
        Of the plan's path.
    period : float
        Servo period [s].

    Returns
    -------
    Command
    """
    motion = Motion.from_phases(plan.phases)
    t = row_times(motion, period)
    s, feed = motion.place_and_feed(t)
    window = motion.window[motion.phase_at(t)]
    if motion.ends_at_rest:
        s[-1] = track.length
        window[-1] = -1
    piece, u = track.locate(s)
    segment, xi = track.to_xi(piece, u)
    return Command(
        axes=plan.path.axes, period=period, t=t, segment=segment, xi=xi, s=s,
        position=track.derivatives(piece, u, 0)[0], feed=feed, window=window,
        flanks=plan.flanks,
    )  # fmt: skip


def place_and_feed(phases: Sequence[Phase], t: Array) -> tuple[Array, Array]:
    """Arc length [m] and feed [m/s] of a plan's phases at any instants `t` [s]."""
    return Motion.from_phases(phases).place_and_feed(t)
