"""The line writer's modal state: every motion runs at its own feed, in its own plane."""

from __future__ import annotations

import pytest

from ph_post.dialects.registry import find_dialect


@pytest.mark.parametrize("name", ["fanuc", "grbl", "linuxcnc", "marlin", "siemens"])
def test_a_line_behind_an_arc_has_its_own_feed(name: str) -> None:
    writer = find_dialect(name).line_writer("XYZ", 1e-5)
    writer.write_straight("G1", ["X30"], "24000")
    writer.arc(["X30", "Y0"], ["I-30", "J0"], True, "1200")
    writer.arc(["X30", "Y0"], ["I-30", "J0"], False, "1200")
    writer.write_straight("G1", ["X0"], "24000")
    lines = [line.replace(" ", "") for line in writer.lines]
    assert lines == ["G1X30F24000", "G3X30Y0I-30J0F1200", "G2X30Y0I-30J0", "G1X0F24000"]


def test_a_terse_dialect_repeats_no_arc_word() -> None:
    writer = find_dialect("grbl").line_writer("XYZ", 1e-5)
    for _ in range(2):
        writer.arc(["X30", "Y0"], ["I-30", "J0"], True, "1200")
    assert writer.lines == ["G3X30Y0I-30J0F1200", "X30Y0I-30J0"]


def test_a_plane_is_written_where_it_changes() -> None:
    writer = find_dialect("linuxcnc").line_writer("XYZ", 1e-5)
    for word in ("G17", "G18", "G18", "G17"):
        writer.plane(word)
    assert writer.lines == ["G18", "G17"]
    turned = find_dialect("linuxcnc").line_writer("XZ", 1e-5)
    turned.plane("G18")
    assert turned.lines == []
