"""No word that firmware refuses: goldens, and what is spliced into samples and real programs."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest
from support.corpus import compensated, stepper
from support.firmware import LINES, commands, travel

from ph_post.dialects.reading import read_as
from ph_post.dialects.registry import find_dialect

ROOT = Path(__file__).resolve().parents[2]
GOLDEN = ROOT / "tests" / "golden"


def _dialect(folder: Path) -> str:
    """Dialect of a golden case, empty where it is that of its machine."""
    words = (folder / "arguments.txt").read_text().split()
    return words[words.index("--dialect") + 1] if "--dialect" in words else ""


FOLDERS = {folder: _dialect(folder) for folder in sorted(file.parent for file in GOLDEN.glob("*/arguments.txt"))}
CASES = [(folder, dialect) for folder, dialect in FOLDERS.items() if dialect in LINES]


def test_goldens_of_three_kinds_of_firmware_are_there() -> None:
    assert {dialect for _, dialect in CASES} >= {"grbl", "marlin", "klipper"}


@pytest.mark.parametrize(("folder", "firmware"), CASES, ids=lambda one: getattr(one, "name", one))
def test_no_golden_has_a_word_that_firmware_refuses(folder: Path, firmware: str) -> None:
    lines = (folder / "program.ngc").read_text().splitlines()
    words = {word for line in lines for word, _ in commands(line, firmware)}
    assert "G1" in words
    if firmware in ("marlin", "klipper"):
        assert travel("\n".join(lines), firmware).feeds


MILLED = [
    *sorted((ROOT / "samples" / "programs").glob("*.ngc")),
    *sorted((ROOT / "tests" / "corpus" / "freecad").glob("*_grbl.ngc")),
]
PRINTED = sorted((ROOT / "tests" / "slicers").glob("*.gcode"))
SPLICED = [(file, firmware) for file in MILLED for firmware in ("grbl", "grblhal")]
SPLICED += [(file, firmware) for file in PRINTED for firmware in ("marlin", "klipper")]

UNCHANGED = ("to_and_fro", "drilling_grbl")
"""Programs in which no axis has to be offset: nothing of them is milled behind a reversal."""


@pytest.mark.parametrize(("file", "firmware"), SPLICED, ids=lambda one: getattr(one, "stem", one))
@pytest.mark.thinned(16)
def test_nothing_is_spliced_in_that_firmware_refuses(file: Path, firmware: str) -> None:
    """Lines that were not there before; what the program held itself is the user's."""
    data = file.read_bytes()
    program = read_as(firmware, data, file.name)
    after = compensated(program, stepper(), find_dialect(firmware)).decode().splitlines()
    added = Counter(after) - Counter(data.decode().splitlines())
    assert bool(added) == (file.stem not in UNCHANGED)
    for line in added:
        commands(line, firmware)
