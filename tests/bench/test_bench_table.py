"""Interpolator table rows of a PH path: arc length to place, against a scipy.optimize.brentq call per row."""

import sys
import time

import numpy as np
from scipy.optimize import brentq

from ph_post.geometry import bernstein
from ph_post.geometry.ph import ph_hermite
from ph_post.geometry.track import Track

EPS = np.finfo(float).eps
ROWS, SAMPLE = 400_000, 1_000
AIM = 100


def oval(count=40, a=0.05, b=0.03):
    """Points and derivatives of an ellipse, interpolated by PH quintics."""
    t = np.linspace(0, 2 * np.pi, count + 1)
    points = np.stack([a * np.cos(t), b * np.sin(t)], axis=1)
    slopes = np.stack([-a * np.sin(t), b * np.cos(t)], axis=1) * (t[1] - t[0])
    return [ph_hermite(points[k : k + 2], slopes[k : k + 2]) for k in range(count)]


def row_by_row(track, s):
    """Solve s(u) = s on each row's piece by brentq, then evaluate the curve."""
    integrals = [bernstein.to_power(bernstein.integrate(piece.speed))[::-1] for piece in track.pieces]
    curves = [bernstein.to_power(piece.control.T).T[::-1] for piece in track.pieces]
    places = []
    for target in s.tolist():
        k = min(int(np.searchsorted(track.starts, target, side="right")) - 1, len(curves) - 1)
        local = min(target - track.starts[k], integrals[k].sum())
        u = brentq(
            lambda x, k=k, local=local: np.polyval(integrals[k], x) - local,
            0.0,
            1.0,
            xtol=4 * EPS,
            rtol=4 * EPS,
        )
        places.append(np.polyval(curves[k], u))
    return np.array(places)


def test_rows_of_a_table_against_brentq():
    track = Track.from_curves(oval(), closed=True)
    s = np.linspace(0.0, track.length, ROWS)
    track.locate(s[:2])
    start = time.perf_counter()
    ours = track.derivatives(*track.locate(s))[0]
    fast = (time.perf_counter() - start) / ROWS
    some = np.linspace(0, ROWS - 1, SAMPLE).astype(int)
    start = time.perf_counter()
    theirs = row_by_row(track, s[some])
    slow = (time.perf_counter() - start) / SAMPLE
    assert np.abs(ours[some] - theirs).max() < 1e-14
    sys.stdout.write(f"\nrow: {fast * 1e6:.3f} µs, with brentq {slow * 1e6:.1f} µs: {slow / fast:.0f} times\n")
    assert slow / fast >= AIM
