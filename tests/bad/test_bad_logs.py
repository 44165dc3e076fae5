"""Bad logs and the exact line with which each is refused: ``NAME.error`` beside the log."""

from pathlib import Path

import pytest

from ph_post.errors import InputError
from ph_post.identify.logprogram import read_log

HERE = Path(__file__).parent / "logs"
CASES = sorted(HERE.glob("*.error"))
COLUMNS = {"overrun": ("X_cmd=1", "X_act=2")}
"""Mappings of those that have no header."""


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.stem)
def test_a_bad_log_is_refused_in_its_one_line(case, monkeypatch):
    monkeypatch.chdir(HERE)
    (log,) = (file.name for file in HERE.glob(f"{case.stem}.*") if file != case)
    with pytest.raises(InputError) as refusal:
        read_log(log, columns=COLUMNS.get(case.stem, ()))
    assert f"{refusal.value}\n" == case.read_text(encoding="utf-8")


def test_every_bad_log_has_its_line():
    logs = {file.stem for file in HERE.iterdir() if file.suffix != ".error"}
    assert logs == {case.stem for case in CASES}


@pytest.mark.parametrize(
    ("mapping", "words"),
    [
        ("X_act", "not a mapping of a column; expected NAME=SOURCE[*FACTOR]:UNIT, such as X_act=qm:m"),
        ("X_akt=pos:mm", 'not the name of a column; expected X_act; got "X_akt"'),
        (
            "A_act=pos:mm",
            "axis A cannot be taken: drives are known of straight axes only; expected X, Y or Z; got A_act",
        ),
        ("X_act=pos:N", 'not a unit of X_act; expected one of mm, m, um, µm, μm, inch; got "N"'),
        ("t=pos:min", 'not a unit of t; expected one of s, ms, us; got "min"'),
        (
            "X_force=vir:V",
            'not a unit of X_force; expected a factor to N, such as X_force=vir*35.15:N; got "V"',
        ),
        ("X_force=vir*0:N", 'no factor; expected a number other than 0; got "0"'),
        ("X_force=vir*two:N", 'no factor; expected a number other than 0; got "two"'),
    ],
)
def test_a_bad_mapping_is_refused_in_one_line(mapping, words, monkeypatch):
    monkeypatch.chdir(HERE)
    with pytest.raises(InputError) as refusal:
        read_log("ragged.csv", columns=[mapping])
    assert str(refusal.value) == f'--column "{mapping}": {words}'


def test_a_mapping_of_what_is_not_there_lists_the_columns(monkeypatch):
    monkeypatch.chdir(HERE)
    with pytest.raises(InputError) as refusal:
        read_log("ragged.csv", columns=["X_act=q:m"])
    words = 'no column "q" for X_act; expected one of those that are there; got t, X_cmd, X_act'
    assert str(refusal.value) == f"ragged.csv:1: {words}"


def test_a_name_is_mapped_once():
    with pytest.raises(InputError, match="a second column for one name; got t"):
        read_log(HERE / "ragged.csv", columns=["t=a", "t=b"])


def test_the_side_of_a_column_that_is_not_there_cannot_be_told():
    with pytest.raises(InputError, match="no column Y_act whose side could be given"):
        read_log(HERE / "far.csv", sides={"Y": "unknown"})
