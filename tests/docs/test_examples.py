"""Examples in the docstrings of the package come out as they say."""

from __future__ import annotations

import doctest
import importlib
from pathlib import Path

import pytest

import ph_post

ROOT = Path(ph_post.__file__).parent
WITH_EXAMPLES = sorted(path for path in ROOT.rglob("*.py") if ">>> " in path.read_text(encoding="utf-8"))
WITH_WORKERS = ROOT / "batch" / "run.py"


@pytest.mark.parametrize(
    "path",
    [pytest.param(path, marks=[pytest.mark.slow] if path == WITH_WORKERS else []) for path in WITH_EXAMPLES],
    ids=lambda path: path.relative_to(ROOT).as_posix(),
)
def test_examples_come_out_as_they_say(path: Path) -> None:
    name = ".".join(path.relative_to(ROOT.parent).with_suffix("").parts).removesuffix(".__init__")
    found = doctest.testmod(importlib.import_module(name), optionflags=doctest.NORMALIZE_WHITESPACE)
    assert found.attempted
    assert not found.failed
