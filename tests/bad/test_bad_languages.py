"""Bad programs in other languages than RS274, and the exact lines with which each is refused."""

from pathlib import Path

import pytest

from ph_post.dialects.reading import read_program_file
from ph_post.errors import InputError

HERE = Path(__file__).parent / "languages"
DIALECTS = {".h": "heidenhain", ".i": "heidenhain-iso", ".nc": "fanuc"}
CASES = sorted(file for file in HERE.iterdir() if file.suffix in DIALECTS)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_a_bad_program_is_refused_in_its_line_with_a_caret(case, monkeypatch):
    monkeypatch.chdir(HERE)
    with pytest.raises(InputError) as refusal:
        read_program_file(case.name, dialect=DIALECTS[case.suffix], strict=True)
    shown = "".join(f"{part}\n" for part in (str(refusal.value), refusal.value.excerpt) if part)
    assert shown == (HERE / f"{case.name}.error").read_text(encoding="utf-8")
