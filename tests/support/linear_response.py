"""The response of a linear system from rest, as scipy's `lsim` has it, whose own loop over the rows is not compiled."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.signal import lti

Array = NDArray[np.float64]


def response(system: tuple[Any, ...], given: Array, t: Array) -> Array:
    """Return what a system gives at equidistant times (n,) [s] for inputs (n,) or (n, m), straight between them."""
    space = lti(*system).to_ss()
    states, inputs = space.B.shape
    taken = np.asarray(given, dtype=float).reshape(t.size, inputs)
    # The state goes on by the exponential of it, its input, and the slope of that.
    size = states + 2 * inputs
    step = np.zeros((size, size))
    step[:states, :states], step[:states, states : states + inputs] = space.A, space.B
    step[states : states + inputs, states + inputs :] = np.eye(inputs) / (t[1] - t[0])
    gone = expm(step * (t[1] - t[0]))[:states]
    on, held, slope = gone[:, :states], gone[:, states : states + inputs], gone[:, states + inputs :]
    pushed = taken[:-1] @ (held - slope).T + taken[1:] @ slope.T
    found = np.zeros((t.size, states))
    _step(np.ascontiguousarray(on), pushed, found)
    return np.asarray((found @ space.C.T + taken @ space.D.T)[:, 0])


@numba.njit(cache=True)
def _step(on, pushed, found):  # type: ignore[no-untyped-def]
    for k in range(pushed.shape[0]):
        for row in range(on.shape[0]):
            total = pushed[k, row]
            for column in range(on.shape[0]):
                total += on[row, column] * found[k, column]
            found[k + 1, row] = total
