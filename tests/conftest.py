"""What all tests share: the helpers in tests/support, and the renewal of golden files."""

from __future__ import annotations

import sys
from pathlib import Path

import hypothesis
import pytest

sys.path.insert(0, str(Path(__file__).parent))

# No test fails on a time: how long an example takes depends on who else uses the machine.
hypothesis.settings.register_profile("ph_post", deadline=None)
hypothesis.settings.load_profile("ph_post")


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--renew-golden` writes the programs of tests/golden anew instead of comparing them."""
    parser.addoption(
        "--renew-golden",
        action="store_true",
        help="write the expected files in tests/golden anew; read the difference before committing it",
    )
