"""Blocks that a rehearsal compares with the plan."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from ph_post.dialects.reading import read_as
from ph_post.rehearse.rehearse import changed_blocks

WRITTEN = Path(__file__).resolve().parents[1] / "golden" / "v0_1_0"


@pytest.mark.parametrize("dialect", ["linuxcnc", "klipper", "fanuc"])
def test_changed_blocks_are_found_in_parentheses_behind_semicolons_and_in_capitals(dialect: str) -> None:
    program = read_as(dialect, (WRITTEN / dialect / "compensated.ngc").read_bytes(), "part.ngc")
    found = changed_blocks(program)
    marks = [re.search(rb"ph-post: \+(\d+) -", program.text(k), re.IGNORECASE) for k in range(program.blocks)]
    assert sum(int(mark[1]) for mark in marks if mark) == found.sum() > 0
    first = np.flatnonzero(found)[0]
    assert marks[first - 1]
    assert not found[first - 1]
