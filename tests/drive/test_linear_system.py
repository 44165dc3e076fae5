"""The response of a linear system, beside scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lsim
from support.linear_response import response

from ph_post.drive.linear_system import respond


@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("period", [5e-5, 1e-3])
def test_it_is_that_of_scipy(order: int, period: float) -> None:
    """Real and complex poles, with and without a part that goes through at once."""
    rng = np.random.default_rng(order)
    command = np.cumsum(rng.normal(size=500))
    t = np.linspace(0.0, 499 * period, 500)
    for zeros in range(order + 1):
        poles = -rng.uniform(5.0, 3000.0, order).astype(complex)
        if order > 1:
            poles[:2] = [-80.0 + 300.0j, -80.0 - 300.0j]
        taken = np.real(np.poly(poles))
        given = np.atleast_1d(np.real(np.poly(-rng.uniform(5.0, 3000.0, zeros))))
        given *= taken[-1] / given[-1]
        expected = lsim((given, taken), command, t)[1]
        assert np.abs(respond(given, taken, command, period) - expected).max() < 1e-9 * np.abs(expected).max()
        assert np.abs(response((given, taken), command, t) - expected).max() < 1e-9 * np.abs(expected).max()


def test_without_a_pole_it_is_the_command() -> None:
    assert respond(np.array([2.0]), np.array([4.0]), np.arange(3.0), 1e-3).tolist() == [0.0, 0.5, 1.0]
