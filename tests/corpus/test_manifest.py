"""What becomes of each program of the corpus: a sample, always the same, against the manifest; rates of all of them.

`python -m tests.long.corpus` judges every program and writes both files.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from support.amount import sample
from support.corpus import WRITTEN, whole
from support.corpus_judge import judge

TESTS = Path(__file__).parents[1]
MANIFEST = json.loads((TESTS / "corpus" / "manifest.json").read_text())
RATES = json.loads((TESTS / "long" / "corpus.json").read_text())

ALL = {entry.name: entry for entry in whole()}
OWN = [name for name in ALL if not name.startswith("linuxcnc/")]
SHIPPED = [name for name in MANIFEST if name.startswith("linuxcnc/")]

ORIGINS = [ALL[name].origin for name in OWN]
TRIED = [OWN[number] for number in sample(ORIGINS, 1)]
TRIED += [SHIPPED[number] for number in sample([name.split("/")[1] for name in SHIPPED], 1)]


def test_the_manifest_says_what_becomes_of_every_program():
    assert set(OWN) == {name for name in MANIFEST if not name.startswith("linuxcnc/")}
    assert {name for name in ALL if name.startswith("linuxcnc/")} in (set(SHIPPED), set())
    assert len(MANIFEST) >= 200
    assert len({name.partition("/")[0] for name in MANIFEST}) >= 10


@pytest.mark.parametrize("name", TRIED)
@pytest.mark.thinned(8)
def test_a_program_becomes_what_the_manifest_says(name):
    if name not in ALL:
        pytest.skip("the program comes with Debian's linuxcnc-uspace, which is not installed")
    expected, judged = MANIFEST[name], judge(ALL[name])
    assert judged.outcome == expected["outcome"], judged.reason
    assert judged.reversals == expected["reversals"]
    assert judged.compensated >= expected["compensated"]
    assert judged.followed >= expected["followed"]
    assert judged.restored


def test_defects_are_read_and_named_and_not_refused():
    refused = [name for name in MANIFEST if MANIFEST[name]["outcome"] == "refused"]
    assert [name for name in refused if name.partition("/")[0] in WRITTEN] == ["defects/another_tool"]


@pytest.mark.parametrize(
    ("rate", "least"),
    [
        ("compensated", 0.95),
        ("rms_five_times_down", 0.9),
        ("p95_five_times_down", 0.9),
        ("within_ten_percent_of_time", 1.0),
        ("restored", 1.0),
    ],
)
def test_the_rates_over_all_programs(rate, least):
    done, every = RATES[rate]
    assert done >= least * every
    assert RATES["refused"] <= 0.03 * RATES["programs"]


ROUNDED_AWAY = "linuxcnc/nc_files/flowsnake"
"""A quarter of all reversals, in strokes of 14 µm: the motor takes 28 ms to cross 50 µm, 26 % of the program's time in
all, and strokes at 10 mm/min beside crossings on the fly would be rounded off at the speed of these. It says so, and is
compensated up to where the time allowed ends."""


def test_nearly_every_reversal_is_compensated():
    every = [one for name, one in MANIFEST.items() if name != ROUNDED_AWAY]
    assert sum(one["compensated"] for one in every) >= 0.95 * sum(one["reversals"] for one in every)
