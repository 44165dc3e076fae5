"""What the controller of an axis sees, from which the force of its motor follows."""

from __future__ import annotations

import numpy as np

from ph_post.drive.plant import Plant
from ph_post.types import Array


def delayed(values: Array, samples: float) -> Array:
    """Values as they were so many samples before, linear in between; before the first there is the first.

    A negative number of samples looks ahead: behind the last there is the last.

    Examples
    --------
    >>> delayed(np.array([0.0, 1.0, 2.0]), 0.5)
    array([0. , 0.5, 1.5])
    """
    if samples == 0.0:
        return values
    rows = np.arange(values.size, dtype=np.float64)
    return np.interp(rows - samples, rows, values)


def following_error(plant: Plant, command: Array, table: Array, motor: Array, period: float) -> Array:
    """Return the following error e at the side over which the loop closes [m], shape (n,).

    That is the table of a `load` loop and the motor of the others, less the command as it arrives. The force
    that the motor gives, as a recorded channel has it, is then F/K = e - c_e v with v the speed of that side
    and c_e the part of c that is electronic (the rest is friction, which the motor overcomes); with an
    integrator or a derivative e + (k_i/k_p) ∫e + (k_d/k_p) ė stands for e, and no torque is beyond the
    saturation. K is the stiffness of the servo.

    Parameters
    ----------
    plant : Plant
    command : Array, shape (n,)
        As it was sent [m]; `command_delay` is added here.
    table, motor : Array, shape (n,)
        Of :func:`ph_post.simulate.machine.run_plant` [m]. Its table is told late by `reading_delay`, which
        the loop itself does not see: that is taken back here, and over the last samples, whose reading is not
        yet there, the table is taken to stand.
    period : float
        [s].

    Examples
    --------
    >>> plant = Plant(feedback="motor", b=5e-4, c=5e-3, command_delay=1e-3)
    >>> following_error(plant, np.array([1.0, 2.0, 4.0]), np.zeros(3), np.array([1.0, 1.0, 1.5]), 1e-3)
    array([0. , 0. , 0.5])
    """
    arrives = delayed(command, plant.command_delay / period)
    side = delayed(table, -plant.reading_delay / period) if plant.feedback == "load" else motor
    return arrives - side
