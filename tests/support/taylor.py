"""Interpolators by Taylor expansion, as the literature has them: baselines, with the feed error they make.

From one servo period T to the next the parameter u of a piece is advanced by

    u_{k+1} = u_k + V T / σ                                        (first order, [1]_)
              + (V' / σ - V² σ' / σ³) T² / 2                       (second order, [2]_),

V and V' = dV/dt being those of the plan at t_k, σ and σ' those of the piece at u_k. The error of every step
stays in all that follow; the exact interpolator of :mod:`ph_post.compensate.motion` has none.

References
----------
.. [1] M. Shpitalni, Y. Koren, C. C. Lo, Realtime curve interpolators, Comput. Aided Design 26 (1994) 832-838.
.. [2] S-S. Yeh, P-L. Hsu, The speed-controlled interpolator for machining parametric curves,
   Comput. Aided Design 31 (1999) 349-357.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from ph_post.compensate.motion import MotionLaw, row_times
from ph_post.errors import SolveError
from ph_post.geometry import frenet
from ph_post.geometry.track import Track
from ph_post.types import Array, Command, Plan


def taylor_sample(plan: Plan, track: Track, period: float, order: Literal[1, 2]) -> Command:
    """Interpolate a plan by Taylor expansion, one row a period from t = 0.

    Parameters
    ----------
    plan : Plan
    track : Track
        Of the plan's path, regular: its parametric speed vanishes nowhere.
    period : float
        T [s].
    order : {1, 2}

    Returns
    -------
    Command
        `feed` is the plan's; where the rows are instead of where they should be shows in `s`.

    Raises
    ------
    SolveError
        Where the parametric speed vanishes, so that the expansion does not exist.
    """
    motion = MotionLaw.from_phases(plan.phases)
    t = row_times(motion, period)
    _, feed = motion.place_and_feed(t)
    change = motion.acceleration(t)
    piece, u = np.zeros(t.size, dtype=np.int64), np.zeros(t.size)
    for k in range(t.size - 1):
        piece[k + 1], u[k + 1] = _advance(
            track,
            int(piece[k]),
            float(u[k]),
            float(feed[k]),
            float(change[k]) if order == 2 else None,
            period,
        )
    segment, xi = track.to_xi(piece, u)
    return Command(
        axes=plan.path.axes,
        period=period,
        t=t,
        segment=segment,
        xi=xi,
        s=track.arc_length(piece, u),
        position=track.derivatives(piece, u, 0)[0],
        feed=feed,
        window=motion.window[motion.phase_at(t)],
    )


def feed_error(command: Command, plan: Plan) -> Array:
    """Mean feed between rows less the plan's [m/s], shape (rows - 1,): what an interpolator does wrong."""
    s, _ = MotionLaw.from_phases(plan.phases).place_and_feed(command.t)
    error: Array = np.diff(command.s - s) / command.period
    return error


def _advance(track: Track, piece: int, u: float, feed: float, change: float | None, period: float) -> tuple[int, float]:
    """Take one step; what is left of it at a joint goes on in the next piece, at that piece's speed."""
    speed, slope = _speed(track, piece, u)
    step = feed * period / speed
    if change is not None:
        step += 0.5 * period**2 * (change / speed - feed**2 * slope / speed**3)
    u += step
    while u > 1.0 and piece + 1 < len(track.pieces):
        left = (u - 1.0) * _speed(track, piece, 1.0)[0]
        piece += 1
        u = left / _speed(track, piece, 0.0)[0]
    return piece, min(max(u, 0.0), 1.0)


def _speed(track: Track, piece: int, u: float) -> tuple[float, float]:
    """Parametric speed σ and σ' of a piece."""
    derivatives = track.derivatives(np.array([piece]), np.array([u]), 2)
    if not np.any(derivatives[1]):
        raise SolveError(f"the parametric speed vanishes on piece {piece} at u = {u:g}: no Taylor expansion there")
    sigma = frenet.speed(derivatives)
    return float(sigma[0, 0]), float(sigma[1, 0])
