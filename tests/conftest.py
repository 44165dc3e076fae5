"""What all tests share: the helpers in tests/support, and the renewal of golden files."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--renew-golden` writes the programs of tests/golden anew instead of comparing them."""
    parser.addoption(
        "--renew-golden",
        action="store_true",
        help="write the expected files in tests/golden anew; read the difference before committing it",
    )
