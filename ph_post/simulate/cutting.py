"""What cutting does to an axis: a force along the path, by the feed."""

from __future__ import annotations

from typing import Final

import numpy as np

from ph_post.drive.plant import Plant
from ph_post.types import Array, Command

STANDSTILL: Final = 1e-9
"""Feeds up to this [m/s] are rounding: nothing is cut."""


def cutting_force(plant: Plant, velocity: Array, number: int) -> Array:
    """Return what resists one axis while the tool cuts, F/K [m].

    Along the path that is F (|v|/v_0)^k, and the axis has its component of it, times v_i/|v|; at a
    standstill there is none. Nobody tells rapids and cuts apart: a rapid cuts too.

    Parameters
    ----------
    plant : Plant
        Of which only `cutting` counts: F [m], v_0 [m/s] and k of each force.
    velocity : Array, shape (n, dim)
        Of all axes of the path [m/s].
    number : int
        Column of the axis.

    Returns
    -------
    Array, shape (n,)

    Examples
    --------
    >>> plant = Plant(feedback="load", b=5e-4, c=5e-3, cutting=((1e-5, 0.01, 1.0),))
    >>> cutting_force(plant, np.array([[0.0, 0.0], [0.03, 0.04], [-0.06, 0.08]]), 0)
    array([ 0.e+00,  3.e-05, -6.e-05])
    """
    speed = np.linalg.norm(velocity, axis=1)
    cuts = speed > STANDSTILL
    feed = np.where(cuts, speed, 1.0)
    along = np.zeros(speed.size)
    for force, at, exponent in plant.cutting:
        along += force * (feed / at) ** exponent
    return np.asarray(np.where(cuts, along * velocity[:, number] / feed, 0.0))


def path_velocity(command: Command) -> Array:
    """Return the velocity of the path's points (n, dim) [m/s] by central differences of a command's rows.

    What the command has beyond the path (a gap that is crossed, a lead) is no motion of the tool.
    """
    path = command.position if command.offset is None else command.position - command.offset
    if len(path) == 1:
        return np.zeros_like(path)
    return np.asarray(np.gradient(path, command.period, axis=0))
