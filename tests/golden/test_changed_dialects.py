"""Siemens and Heidenhain programs changed in place: every byte is read.

After a change that is meant, ``pytest tests/golden/test_changed_dialects.py --renew-golden`` writes them anew; read the
difference before it is committed. The words and their sources stand in ``docs/dialects.md``.
"""

import re
from pathlib import Path

import pytest
from msgspec.structs import replace
from support.editing import compensate

from ph_post.drive.machinefile import read_machine

HERE = Path(__file__).parents[1] / "changed_dialects"
DIALECTS = {".mpf": "siemens", ".h": "heidenhain", ".i": "heidenhain-iso"}
CASES = sorted(file for file in HERE.iterdir() if file.suffix in DIALECTS and not file.stem.endswith(".changed"))


@pytest.mark.parametrize("case", CASES, ids=lambda file: file.name)
def test_a_program_is_changed_as_it_was(case, request):
    dialect = DIALECTS[case.suffix]
    text = compensate(case.read_bytes(), replace(read_machine("stepper"), dialect=dialect), dialect=dialect).text
    # The payload is compressed, and may differ with the library.
    made = re.sub(r"ph-post: undo (\d+/\d+) \S+", r"ph-post: undo \1 …", text.decode())
    made = re.sub(r"ph-post \d\S* compensated", "ph-post VERSION compensated", made)
    expected = case.with_name(f"{case.stem}.changed{case.suffix}")
    if request.config.getoption("--renew-golden"):
        expected.write_text(made, encoding="utf-8")
    assert made == expected.read_text(encoding="utf-8")
