"""Lines of a compensated program that stand for lines of its original: kept ones differ from these in numbers alone."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from ph_post.dialects.declaration import line_origins
from ph_post.edit.undo import original_of
from ph_post.gcode.read import read_program

EDITED = Path(__file__).resolve().parents[1] / "edited"
CASES = sorted(folder for folder in EDITED.iterdir() if folder.is_dir())


def letters(line: bytes) -> bytes:
    return re.sub(rb"[-+.\d\s]", b"", line)


@pytest.mark.parametrize("case", CASES, ids=lambda folder: folder.name)
def test_every_line_of_the_original_is_kept_or_in_one_change(case: Path) -> None:
    program = read_program((case / "compensated.ngc").read_bytes(), case.name)
    original = original_of(program)
    assert original is not None
    found = line_origins(program, original)
    assert found is not None
    kept = np.flatnonzero(~found.changed & (found.end > found.first))
    assert kept.size > 3
    for line in kept.tolist():
        assert found.end[line] == found.first[line] + 1
        assert letters(program.text(line)) == letters(original.text(int(found.first[line])))
    begins = dict(zip(found.first.tolist(), found.end.tolist(), strict=True))
    spans = [(0, 0), *sorted((first, end) for first, end in begins.items() if end > first)]
    assert all(one[1] == other[0] for one, other in pairwise(spans))
    assert spans[-1][1] == original.blocks


def test_another_original_or_other_lines_are_not_known() -> None:
    data = (CASES[0] / "compensated.ngc").read_bytes()
    program = read_program(data, "part")
    original = original_of(program)
    assert original is not None
    other = read_program(original.data + b"\n", "other")
    assert line_origins(program, other) is None
    assert line_origins(original, original) is None
    longer = read_program(data.replace(b"M2\n", b"M9\nM2\n"), "longer")
    assert longer.blocks > program.blocks
    assert line_origins(longer, original) is None
