"""The motion of the paper's example, X = a sin Ωt.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z, section 4.2; its drive is the shipped machine ``paper``.
"""

from __future__ import annotations

import math
from typing import Final

AMPLITUDE: Final = 0.25
"""a [m], and ρ_0 in section 6."""

BETWEEN_REVERSALS: Final = 6.0
"""T [s]."""

OMEGA: Final = math.pi / BETWEEN_REVERSALS
"""Ω [1/s]; V_c = aΩ in section 6."""
