"""Interpolator tables: what is written, and that it reads back."""

import csv
import io
import sys

import numpy as np
import pytest

from ph_post.errors import InputError
from ph_post.files.table import CHUNK, read_table, table_content, write_table
from ph_post.types import Command
from ph_post.units import MM, MM_PER_MIN


def command(rows, axes=("X", "Y"), seed=0):
    rng = np.random.default_rng(seed)
    return Command(
        axes=axes,
        period=0.001,
        t=np.arange(rows) * 0.001,
        segment=np.arange(rows) // 7,
        xi=rng.random(rows),
        s=np.arange(rows) * 0.02 * MM,
        position=rng.normal(size=(rows, len(axes))) * 250 * MM,
        feed=rng.normal(size=rows) * 1200 * MM_PER_MIN,
        window=rng.integers(-1, 4, rows),
    )


SMALL = Command(
    axes=("X", "Y"),
    period=0.001,
    t=np.array([0.0, 0.001, 0.002]),
    segment=np.array([0, 0, 1]),
    xi=np.array([0.0, 1 / 3, 1.0]),
    s=np.array([0.0, 0.1, 200.0]) * MM,
    position=np.array([[250.0, -0.0], [250.03341707, 1e-7], [-1e-14, 12345.678]]) * MM,
    feed=np.array([7853.981634, -20.0, 0.0]) * MM_PER_MIN,
    window=np.array([-1, 0, 0]),
)


def test_the_text_of_a_small_table():
    assert table_content(SMALL, "-").decode() == (
        "t,segment,xi,s,X,Y,feed,window\n"
        "0.0,0,0.0,0.0,250.0,0.0,7853.981634,-1\n"
        "0.001,0,0.3333333333333333,0.1,250.03341707,1e-7,-20.0,0\n"
        "0.002,1,1.0,200.0,0.0,12345.678,0.0,0\n"
    )


def test_a_table_without_rows_is_its_header():
    assert table_content(command(0), "a.csv") == b"t,segment,xi,s,X,Y,feed,window\n"


@pytest.mark.parametrize("rows", [1, CHUNK, CHUNK + 1])
def test_every_number_reads_back_as_the_same_double(rows):
    given = command(rows, ("X", "Y", "Z"))
    table = list(csv.reader(io.StringIO(table_content(given, "-").decode())))
    assert len(table) == rows + 1
    read = np.array(table[1:], dtype=np.float64)
    assert np.array_equal(read[:, 2], given.xi)
    # each position is rounded once to 1e-12 mm, and before that divided by 1e-3
    assert np.abs(read[:, 4:7] - given.position / MM).max() <= 0.5e-12 + np.spacing(1500.0)


@pytest.mark.parametrize("ending", [".csv", ".npz", ".parquet"])
@pytest.mark.parametrize("axes", [("X", "Y"), ("Z", "X"), ("X", "Y", "Z")])
def test_round_trip(tmp_path, ending, axes):
    given = command(100, axes)
    write_table(given, str(tmp_path / f"table{ending}"))
    read = read_table(tmp_path / f"table{ending}")
    assert read.axes == axes
    assert read.period == pytest.approx(0.001, rel=1e-12)
    for key in ("segment", "window", "xi"):
        assert np.array_equal(getattr(read, key), getattr(given, key)), key
    for key, unit in (("t", 1.0), ("s", MM), ("position", MM), ("feed", MM_PER_MIN)):
        # half of 1e-12 units by rounding, and a few units in the last place (values up to 5000 units)
        slack = (0.5e-12 + 4 * np.spacing(5000.0)) * unit
        assert np.abs(getattr(read, key) - getattr(given, key)).max() <= slack, key
    assert read.segment.dtype == read.window.dtype == np.int64


@pytest.mark.parametrize("ending", [".csv", ".npz", ".parquet"])
def test_writing_twice_gives_the_same_bytes(ending):
    assert table_content(command(50), f"a{ending}") == table_content(command(50), f"b{ending}")


def test_an_unknown_ending_is_refused_and_nothing_is_written(tmp_path):
    with pytest.raises(
        InputError, match=r"t\.xlsx: unknown kind of table; expected one of \.csv, \.npz, \.parquet; got"
    ):
        write_table(command(2), str(tmp_path / "t.xlsx"))
    with pytest.raises(InputError, match="got no ending"):
        write_table(command(2), str(tmp_path / "table"))
    assert list(tmp_path.iterdir()) == []


def test_parquet_without_its_library_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(InputError, match=r"t\.parquet: .* not installed; expected pyarrow: pip install"):
        table_content(command(2), "t.parquet")


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.csv", b"t,s\n0,1\n", "wrong columns; expected t, segment, xi, s, X, Y, feed, window; got t, s"),
        ("a.csv", b"t,segment\n0,1,2\n", "not an interpolator table; got 3 columns under 2 names"),
        ("a.csv", b"t,segment\n0,one\n", "not an interpolator table; got could not convert"),
        ("a.csv", b"t,\xeb\n", "not a text file; expected UTF-8; got byte 0xeb"),
        ("a.csv", b"", "the file is empty"),
        ("a.npz", b"no archive", "not an interpolator table; got"),
        ("a.parquet", b"no archive", "not an interpolator table; got"),
        ("a.txt", b"", "unknown kind of table"),
    ],
)
def test_what_is_no_table_is_refused(tmp_path, name, content, words):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=words) as refusal:
        read_table(tmp_path / name)
    assert "\n" not in str(refusal.value)


def test_a_missing_table_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"a\.csv: no such file"):
        read_table(tmp_path / "a.csv")
