"""What all tests share: the helpers in tests/support, and the renewal of golden files."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import hypothesis
import pytest

sys.path.insert(0, str(Path(__file__).parent))

# No test fails on a time: how long an example takes depends on who else uses the machine.
hypothesis.settings.register_profile("ph_post", deadline=None)
hypothesis.settings.load_profile("ph_post")


ALL = "PH_POST_ALL_TESTS"
"""Environment variable that asks for the slow tests too, as `.ci/run` does."""

SLOW_FOLDERS = ("pages", "diagnose")
"""Folders whose tests drive a browser, or hide effects in plants and look for them."""


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave the slow tests out where nobody asks for them, or for one of them by its file."""
    here = Path(__file__).parent
    named = any(Path(word.partition("::")[0]).suffix == ".py" for word in config.args)
    for item in items:
        if item.path.is_relative_to(here) and item.path.relative_to(here).parts[0] in SLOW_FOLDERS:
            item.add_marker(pytest.mark.slow)
        if item.get_closest_marker("slow") and not (named or os.environ.get(ALL)):
            item.add_marker(pytest.mark.skip(reason=f"slow: runs with {ALL}=1, or where its file is named"))


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--renew-golden` writes the programs of tests/golden anew instead of comparing them."""
    parser.addoption(
        "--renew-golden",
        action="store_true",
        help="write the expected files in tests/golden anew; read the difference before committing it",
    )
