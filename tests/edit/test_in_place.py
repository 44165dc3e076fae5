"""What holds of programs changed in place in every language of its own."""

from __future__ import annotations

import numpy as np
import pytest
from support.in_place import ISO, KLARTEXT, SIEMENS, InPlace

from ph_post.dialects.declaration import declared_language
from ph_post.dialects.registry import find_dialect
from ph_post.edit.edits import EditOptions
from ph_post.edit.undo import undo
from ph_post.gcode.read import reread
from ph_post.verify.verify import verify

CASES = [
    pytest.param(language, name, id=f"{language.dialect}-{name}")
    for language in (KLARTEXT, ISO, SIEMENS)
    for name in language.programs
]


@pytest.mark.parametrize(("language", "name"), CASES)
@pytest.mark.thinned(2)
def test_the_table_follows_the_original_within_micrometres(language: InPlace, name: str) -> None:
    plain, text = language.programs[name], language.changed(name).text.decode()
    original, run = language.run(plain), language.run(text)
    for side in (-1.0, 1.0):
        before, after = (language.away(one, original, side) for one in (plain, text))
        assert after.max() < 0.0045
        assert np.sqrt((before**2).mean()) > 0.02
        assert np.sqrt((after**2).mean()) < 0.0005
    assert run.seconds < 1.1 * original.seconds
    if language is not SIEMENS:
        assert run.functions == original.functions


@pytest.mark.parametrize(("language", "name"), CASES)
def test_the_check_passes_and_undo_gives_every_byte_back(language: InPlace, name: str) -> None:
    one = language.changed(name)
    after = reread(one.program, one.text)
    verdict = verify(one.program, after, tolerance=EditOptions().tolerance, machine=language.machine)
    assert verdict.ok, verdict
    assert undo(one.text, f"part{language.ending}") == language.programs[name].encode()
    assert declared_language(one.text) == find_dialect(language.dialect).language
