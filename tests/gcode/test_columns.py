"""Columns of programs that take less memory than what they stand for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ph_post.bounds import MANY_LINES
from ph_post.gcode.program import feed_runs, narrowed
from ph_post.gcode.read import read_program
from ph_post.types import unwritten

STATM = Path("/proc/self/statm")
PAGE = 4096


def resident() -> int:
    """Memory of this process [bytes]."""
    return int(STATM.read_text(encoding="ascii").split()[1]) * PAGE


@pytest.mark.parametrize("shape", [0, 3, (5, 3), 100_000, (100_000, 3)])
@pytest.mark.parametrize("dtype", [np.float64, np.int16, np.bool_])
def test_unwritten_is_what_zeros_are(shape, dtype):
    found = unwritten(shape, dtype)
    assert found.dtype == dtype
    assert np.array_equal(found, np.zeros(shape, dtype))
    found[...] = 1
    assert found.all()


@pytest.mark.skipif(not STATM.exists(), reason="memory is read where Linux tells it")
def test_what_is_not_written_takes_no_memory_however_it_is_read():
    np.ones(1_000_000)  # what is freed is taken by the next zeros of numpy's
    before = resident()
    found = unwritten((4_000_000, 3))
    assert found.sum() == 0.0
    assert resident() - before < 0.05 * found.nbytes
    found[:1_000_000] = 1.0
    assert found.sum() == 3_000_000.0


@pytest.mark.parametrize("often", [0.0, 0.01, 0.3, 0.9, 1.0])
def test_feeds_of_lines_are_those_that_were_kept(often):
    rng = np.random.default_rng(7)
    values, feed = [], np.nan
    for new in rng.random(500) < often:
        feed = float(rng.integers(1, 9)) if new else feed
        values.append(feed)
    feeds = feed_runs(np.array(values))
    lines = rng.integers(0, 500, 800)
    for kind in (np.int32, np.int64):
        assert np.array_equal(feeds.of(lines.astype(kind)), np.array(values)[lines], equal_nan=True)
    for rows in (slice(None), slice(7), slice(120, 300), slice(499, 700), slice(30, 20), slice(-4, None)):
        assert np.array_equal(feeds.of(rows), np.array(values)[rows], equal_nan=True)
    assert np.array_equal([feeds.at(line) for line in range(500)], values, equal_nan=True)
    assert feeds.count == 500
    assert feeds.value.size <= 500


def test_a_program_says_its_feed_after_each_line():
    for some in (b"F100 ", b""):
        lines = [b"G21 G90 G94", b"G1 X1 F300"]
        lines += [b"G1 " + (b"F%d " % k if some else b"") + b"X%d" % k for k in range(2, 50)]
        program = read_program(b"\n".join([*lines, b"M2", b""]), "feeds")
        expected = [np.nan, 300.0, *(float(k) if some else 300.0 for k in range(2, 50))]
        assert np.array_equal(program.feed_word[:50], expected, equal_nan=True)
        assert [program.feed_after(k) for k in range(1, 50)] == expected[1:]


def test_motions_of_few_feeds_take_no_room_for_them():
    lines = [b"G1 X%d Y1" % (k % 2) for k in range(5000)]
    program = read_program(b"\n".join([b"G21 G90 G94 F600", *lines, b"G0 X9", b"G1 X5", b"M2", b""]), "feeds")
    feeds = program.motions.feeds
    assert feeds.value.tolist() == [0.01, 0.0, 0.01]
    assert program.motions.feed.tolist() == [*[0.01] * 5000, 0.0, 0.01]


@pytest.mark.parametrize("most", [0, 127, 128, 32767, 32768, 2_000_000])
def test_narrow_numbers_are_the_same_numbers(most):
    numbers = np.array([0, most, most // 2], dtype=np.int64)
    found = narrowed(numbers)
    assert found.tolist() == numbers.tolist()
    assert found.itemsize == (1 if most < 128 else 2 if most < 32768 else 4)


def test_a_long_program_names_what_a_short_one_names():
    # While it is read its words are without their places, by which what is passed through is named.
    tail = "G1 X1 Y1\nG77.7 X2 Q3\nG1 X#5\nG2 X4 Y4\nM2\n"
    short, long = (
        read_program(f"G21 G90\nF100\n{'G1 X0 Y0' + chr(10)}".encode() + b"G1 X1\nG1 X0\n" * count + tail.encode(), "a")
        for count in (1, MANY_LINES)
    )
    more = long.blocks - short.blocks
    assert [(one.first - more, one.column, one.what) for one in long.notes] == [
        (one.first, one.column, one.what) for one in short.notes
    ]
    assert long.notes
    last = slice(-8, None)
    for name in ("letter", "value", "decimals"):
        np.testing.assert_array_equal(getattr(long.words, name)[last], getattr(short.words, name)[last])
    assert long.words.end[-1] == len(long.data) - 1
