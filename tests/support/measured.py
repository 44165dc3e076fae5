"""Real measurements beside the project, where they are there; none of them is copied into it."""

from __future__ import annotations

from pathlib import Path

import pytest

EMPS = Path(__file__).parents[3] / "shared" / "data" / "emps" / "DATA_EMPS.mat"
"""The Electro-Mechanical Positioning System of Janot, Gautier and Brunot (2019)."""

needs_emps = pytest.mark.skipif(not EMPS.is_file(), reason="the measured data are not beside the project")
