"""Files opened in the AXIS screen of LinuxCNC, through the filter."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from support.axis import MISSING, PATIENCE, WHY_NOT, Axis, running_axis
from support.pipelines import ROOT
from support.shop import SLOT

from ph_post.edit.undo import undo

pytestmark = [pytest.mark.skipif(bool(MISSING), reason=WHY_NOT), pytest.mark.slow]

QUICK = "--effort 0.05"

FILTER = [
    "PROGRAM_EXTENSION = .ngc,.json Programs and paths",
    f"ngc = @FILTER@ -m router.toml --max-slowdown 1 {QUICK}",
    f"json = @FILTER@ --strategy suppress --safe-z 5 --depth -1 {QUICK}",
]
"""One names its machine file, by a name beside the INI file; the other finds the one that is there."""


@pytest.fixture(scope="module")
def axis() -> Iterator[Axis]:
    machines = ROOT / "samples" / "machines"
    files = {
        "router.toml": (machines / "router.toml").read_text(),
        "ph-post.toml": (machines / "mill.toml").read_text(),
    }
    with running_axis(FILTER, files) as found:
        yield found


def opened(axis: Axis, program: Path) -> tuple[Path, str]:
    """Open a file; what LinuxCNC has loaded then, and the program as the screen shows it."""
    with axis.opening(program) as process:
        assert process.wait(PATIENCE) == 0
    seen = axis.look()
    assert not seen["dialog"], seen["dialog"]
    return Path(seen["file"]), without_numbers(seen["shown"])


def message(axis: Axis) -> dict[str, Any]:
    """Wait until a message stands in front of the screen."""
    end = time.monotonic() + PATIENCE
    while not (seen := axis.look())["dialog"]:
        assert time.monotonic() < end
        time.sleep(0.5)
    return seen


def without_numbers(shown: str) -> str:
    """Take the line numbers off that the screen puts before every line."""
    return re.sub(r"(?m)^ *\d+: ", "", shown).rstrip("\n") + "\n"


def test_a_part_program_is_loaded_compensated(axis: Axis) -> None:
    """From a folder and by a name with blanks and quotes."""
    folder = axis.folder / "it's a folder"
    folder.mkdir()
    program = folder / 'the "slot" 1.ngc'
    program.write_text(SLOT)
    loaded, shown = opened(axis, program)
    assert (loaded.name, loaded.parent != program.parent) == (program.name, True)
    text = loaded.read_bytes()
    assert b"compensated this program)" in text
    assert b"note warning: axes X, Y" in text
    assert undo(text, "slot") == SLOT.encode()
    assert shown == text.decode()


def test_a_path_file_is_opened_like_a_program(axis: Axis) -> None:
    path = axis.folder / "a path.json"
    path.write_bytes((ROOT / "paths" / "circle.json").read_bytes())
    loaded, shown = opened(axis, path)
    text = loaded.read_text()
    assert loaded.name == path.name
    assert "(machine retrofitted mill with scales, sha256" in text
    assert re.search(r"(?m)^G1 Z-1", text)
    assert shown == text


def test_what_is_no_arc_is_told_by_linuxcnc(axis: Axis) -> None:
    """As it is of a program that goes through no filter."""
    bad = axis.folder / "bad.ngc"
    bad.write_text(SLOT.replace("G3 X30 Y12 I0 J6", "G3 X30 Y12 I0 J7"))
    with axis.opening(bad):
        seen = message(axis)
        text = "\n".join(seen["dialog"])
        # The filter passes the line through, and LinuxCNC tells of it.
        assert "Radius to end of arc differs from radius to start" in text
        assert "FILTER_PROGRESS" not in text
        assert Path(axis.look("close")["file"]).name == bad.name
