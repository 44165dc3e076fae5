"""Courses that excite what a diagnosis needs to see, 12 to 20 s each, drawn at random."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tests.support.plants.tracks import Track

ALONG_X, ALONG_Y = (1.0, 0.0), (0.0, 1.0)
DIAGONAL = (math.sqrt(0.5), math.sqrt(0.5))
AGAINST = (math.sqrt(0.5), -math.sqrt(0.5))


@dataclass(frozen=True)
class Pace:
    """Root mean squares of an axis' command: place about its mean [m], velocity and acceleration."""

    place: float
    velocity: float
    acceleration: float
    middle: float


def draw_course(rng: np.random.Generator, two: bool) -> Track:
    """Rest, sweeps, a ladder of reversals, a slow sweep, circles both ways at two feeds, rest."""
    length = rng.uniform(0.03, 0.07)
    fast, brisk = rng.uniform(0.06, 0.11), rng.uniform(0.025, 0.05)
    gain = rng.uniform(0.8, 2.5)
    track = Track().rest(rng.uniform(0.4, 0.7))
    for direction in (DIAGONAL, AGAINST) if two else (ALONG_X,):
        sweep(track, direction, length, fast, gain)
    for direction in (ALONG_X, ALONG_Y) if two else (ALONG_X,):
        sweep(track, direction, 0.6 * length, brisk, 0.5 * gain)
    for direction in (DIAGONAL, AGAINST) if two else (ALONG_X,):
        ladder(track, direction, length, rng)
    move(track, DIAGONAL if two else ALONG_X, rng.uniform(0.015, 0.022), rng.uniform(0.011, 0.015), 0.2)
    radius = rng.uniform(0.006, 0.01)
    quick, calm = rng.uniform(0.045, 0.07), rng.uniform(0.02, 0.03)
    for side, feed, turns in ((1, quick, 2.0), (-1, quick, 2.0), (1, calm, 1.0), (-1, calm, 1.0)):
        track.circle(side * radius, feed, turns, 0.25)
    return track.rest(rng.uniform(0.4, 0.6))


def move(track: Track, direction: tuple[float, float], way: float, speed: float, gain: float) -> None:
    track.move((direction[0] * way, direction[1] * way), speed, gain)


def sweep(track: Track, direction: tuple[float, float], way: float, speed: float, gain: float) -> None:
    move(track, direction, way, speed, gain)
    track.rest(0.08)
    move(track, direction, -way, speed, gain)


def ladder(track: Track, direction: tuple[float, float], length: float, rng: np.random.Generator) -> None:
    """Short moves to and fro, each farther on, and back in one go."""
    steps = 3
    for i in range(steps):
        for way in rng.permutation([3e-4, 1e-3, 3e-3]).tolist():
            speed = float(rng.uniform(0.006, 0.025))
            move(track, direction, way, speed, 0.4)
            move(track, direction, -way, speed, 0.4)
        if i < steps - 1:
            move(track, direction, length / (steps - 1), 0.08, 1.5)
    move(track, direction, -length, 0.08, 1.5)


def pace(track: Track, axis: int) -> Pace:
    times = np.arange(0.0, track.end, 0.01).tolist()
    command = track.command(axis)
    places = np.array([command(t) for t in times])
    motions = np.array([track.motion(axis, t) for t in times])
    size = np.sqrt(np.mean(motions**2, axis=0))
    return Pace(float(np.std(places)), float(size[0]), float(size[1]), float(np.mean(places)))
