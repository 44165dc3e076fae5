"""The head of a compensated program, damaged."""

import pytest

from ph_post.dialects.declaration import read_declaration

HEAD = (
    b"(ph-post 0.1.0 compensated this program)\n(ph-post: original sha256 " + b"0" * 64 + b")\n"
    b"(ph-post: offset X 0.03 mm)\n"
    b"(ph-post: dwell 0.01 s, decimals 6, chord tolerance 0.001 mm, block time 5 ms)\n"
)


def test_a_head_tells_offsets_and_dwells():
    assert (read_declaration(HEAD).offset, read_declaration(HEAD).dwell) == ({"X": 3e-5}, 0.01)


@pytest.mark.parametrize(
    ("good", "bad"),
    [(b"X 0.03 mm", b"X 0.0.3 mm"), (b"dwell 0.01 s", b"dwell 0.c1 s"), (b"dwell 0.01", b"dwell x")],
)
def test_a_damaged_number_is_not_read_as_one(good, bad):
    found = read_declaration(HEAD.replace(good, bad))
    assert found.offset == {} or found.dwell == 0.0
