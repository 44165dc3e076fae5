"""What ``verify`` is for: every kind of damage to a compensated program is found, and called by its name.

The programs are compensated by hand (support.compensated), so that neither the damage nor what it spoils
comes from the writer. Each case changes some bytes of the compensated text; the last of its three entries is
the kind of failure that this must give.
"""

import pytest
from support.compensated import bracket, planes, relative

from ph_post.errors import InputError
from ph_post.gcode.read import read_program
from ph_post.units import MM
from ph_post.verify.verify import verify

TOLERANCE = 0.005 * MM

OUTWARD = "G4 P0.01\nG1 X19.975 F1000\nG4 P0.01\nF600\n"
PULSE = "G1 Y0.03 F200\nG4 P0.01\nG1 Y0 F200\nG4 P0.01\n"
FIRST_ARC, SECOND_ARC = "G2 X50.025 Y0 I10 J0 F500\n", "G2 X29.975 Y0 I-10 J0 F500\n"

BRACKET = {
    # The header
    "hash too long": ("original sha256 ", "original sha256 0", "header"),
    "hash lost": ("(ph-post: original", "(ph-post: notes", "original"),
    "header lost": ("(ph-post 0.1.0 compensated this program)\n", "", "undeclared"),
    "declared offset is another one": ("offset X 0.025", "offset X 0.0251", "offset"),
    "declared offset is of another axis": ("offset X 0.025", "offset Z 0.025", "text"),
    "declared offset is in inches": ("offset X 0.025 mm", "offset X 0.025 inch", "offset"),
    "offset not declared": ("(ph-post: offset X 0.025 mm)\n", "", "text"),
    "offset declared twice": (
        "(ph-post: offset X 0.025 mm)\n",
        "(ph-post: offset X 0.025 mm)\n" * 2,
        "header",
    ),
    "pulse not declared": ("(ph-post: pulse Y 0.03 mm)\n", "", "jog"),
    "pulse larger than declared": ("pulse Y 0.03", "pulse Y 0.02", "jog"),
    "number of stops is wrong": ("3 stops", "2 stops", "count"),
    "dips not declared": ("1 dips", "0 dips", "count"),
    "number of stops is not told": ("(ph-post: 3 stops, 1 dips)\n", "", "header"),
    "the declared dwell is no number": ("dwell 0.01 s, decimals", "dwell -.- s, decimals", "header"),
    "undo lines out of order": ("undo 1/2 QUJD", "undo 2/2 QUJD", "header"),
    "an undo line is lost": ("(ph-post: undo 1/2 QUJD)\n", "", "header"),
    # Text outside changes
    "coordinate off by its last digit": ("G1 X20.025 F600", "G1 X20.0251 F600", "offset"),
    "offset of the wrong sign": ("G1 X20.025 F600", "G1 X19.975 F600", "direction"),
    "coordinate of another axis": ("Y10 (side)", "Y10.025 (side)", "text"),
    "offset dropped in one block": ("N20 X-0.025", "N20 X0", "offset"),
    "offset twice": ("N20 X-0.025", "N20 X-0.05", "offset"),
    "Z word lost": ("G1 Z-1 F100\nG1 X20.025", "G1 F100\nG1 X20.025", "text"),
    "Z depth changed": ("G1 Z-1 F100\nG1 X20.025", "G1 Z-1.5 F100\nG1 X20.025", "text"),
    "F changed outside a change": ("G1 X20.025 F600", "G1 X20.025 F6000", "text"),
    "F lost outside a change": ("G1 X20.025 F600", "G1 X20.025", "text"),
    "comment lost": ("Y10 (side)", "Y10", "text"),
    "comment changed": ("(bracket)", "(Bracket)", "text"),
    "blank added": ("Y10 (side)", "Y10  (side)", "text"),
    "number written in another way": ("G0 Z5\nG1 Z-1 F100\nG1 X20", "G0 Z5.0\nG1 Z-1 F100\nG1 X20", "text"),
    "N word changed": ("N20 X-0.025", "N30 X-0.025", "text"),
    "N word lost": ("N20 X-0.025", "X-0.025", "text"),
    "block delete lost": ("/M1", "M1", "text"),
    "block delete added": ("M9\n", "/M9\n", "text"),
    "line end changed": ("Y10 (side)\n", "Y10 (side)\r\n", "text"),
    "bytes behind the end": ("REVG)\n", "REVG)\nM3", "lines"),
    "second program behind the first": (
        "(ph-post: undo 1/2 QUJD)",
        "%\nG0 X99\nM2\n(ph-post: undo 1/2 QUJD)",
        "lines",
    ),
    "line added": ("M9\n", "M9\nM9\n", "lines"),
    "line lost": ("Y10 (side)\n", "", "lines"),
    "blocks swapped": ("M9\nM5\n", "M5\nM9\n", "text"),
    "moves swapped": ("G1 Z-1 F100\nG1 X20.025 F600\n", "G1 X20.025 F600\nG1 Z-1 F100\n", "text"),
    "block twice in place of another": ("M9\nM5\n", "M9\nM9\n", "text"),
    "M5 lost": ("M5\n", "", "lines"),
    "M5 became M3": ("M5\n", "M3\n", "text"),
    "M8 lost": ("M8\n", "", "lines"),
    "M2 lost": ("M2\n", "", "lines"),
    "G54 became G55": ("G54\n", "G55\n", "text"),
    "G54 lost from its line": ("G54\n", "\n", "text"),
    "tool change lost": ("T2 M6\n", "T2\n", "text"),
    "another tool": ("T2 M6\n", "T3 M6\n", "text"),
    "S changed": ("S1000 M3", "S1001 M3", "text"),
    "spindle turns the other way": ("S1000 M3", "S1000 M4", "text"),
    "G0 became G1": ("G0 X30.025 Y0", "G1 X30.025 Y0", "text"),
    "G1 became G0": ("G1 X20.025 F600", "G0 X20.025 F600", "text"),
    "plane changed": ("G17 G94", "G18 G94", "text"),
    "inches in place of millimetres": ("N10 G21", "N10 G20", "text"),
    "path mode lost": ("G64 P0.01", "G64", "text"),
    "dwell of the original shorter": ("G4 P0.5", "G4 P0.05", "text"),
    "dwell of the original lost": ("G4 P0.5\n", "", "lines"),
    "G28 lost": ("G28\n", "", "lines"),
    # Offsets that last too long
    "offset not taken back before a tool change": ("G0 X0\n/M1", "G0 X0.025\n/M1", "return"),
    "offset taken up before homing": ("X20 F300\nM9", "X20.025 F300\nM9", "path"),
    "offset in the second part, where homing follows": ("G55\nG0 X0 Y0 Z0", "G55\nG0 X0.025 Y0 Z0", "offset"),
    "offset does not change with the direction": (
        OUTWARD + "N20 X-0.025",
        "(none)\n" * 3 + "F600\nN20 X0.025",
        "direction",
    ),
    # Stops
    "jog of twice the amount": ("G1 X19.975 F1000", "G1 X19.925 F1000", "jog"),
    "jog off by its last digit": ("G1 X19.975 F1000", "G1 X19.9751 F1000", "jog"),
    "jog the wrong way": ("G1 X19.975 F1000", "G1 X20.075 F1000", "offset"),
    "jog without a dwell before it": ("G4 P0.01\nG1 X19.975", "G1 X19.975", "lines"),
    "jog of another axis": ("G1 X19.975 F1000", "G1 Y9.95 F1000", "jog"),
    "jog of two axes": ("G1 X19.975 F1000", "G1 X19.975 Y9.95 F1000", "path"),
    "jog as a rapid": ("G1 X19.975 F1000", "G0 X19.975", "path"),
    "jog lost": (OUTWARD, "G4 P0.01\n(none)\nG4 P0.01\nF600\n", "offset"),
    "dwell before a jog lost": (OUTWARD, "(none)\nG1 X19.975 F1000\nG4 P0.01\nF600\n", "jog"),
    "dwell behind a jog lost": (OUTWARD, "G4 P0.01\nG1 X19.975 F1000\n(none)\nF600\n", "jog"),
    "dwell too short to stand still": ("G4 P0.01\nG1 X19.975", "G4 P0.001\nG1 X19.975", "jog"),
    "dwell longer than declared": ("G4 P0.01\nG1 X19.975", "G4 P1.01\nG1 X19.975", "dwell"),
    "F lost behind a stop": (OUTWARD, OUTWARD.replace("F600", "(F600)"), "state"),
    "F of another number behind a stop": (OUTWARD, OUTWARD.replace("F600", "F700"), "state"),
    "pulse does not come back": (PULSE, PULSE.replace("Y0 ", "Y0.03 "), "pulse"),
    "pulse comes back short": (PULSE, PULSE.replace("Y0 ", "Y0.001 "), "pulse"),
    "pulse too far": (PULSE, PULSE.replace("Y0.03", "Y0.06"), "jog"),
    "pulse of another axis": (PULSE, PULSE.replace("Y0.03", "Z0.03").replace("Y0 ", "Z0 "), "jog"),
    "undeclared pulse": ("F300\n(ph-post: +3", "G1 Z0.5\nG1 Z0 F300\n(ph-post: +3", "lines"),
    "move hidden in a stop": (OUTWARD, OUTWARD.replace("F600", "G1 Z-3 F600"), "offset"),
    "move there and back hidden in a stop": (
        "+4 -0 X turns)\n" + OUTWARD,
        "+6 -0 X turns)\n" + OUTWARD + "G1 Z-3\nG1 Z-1\n",
        "jog",
    ),
    "detour hidden in a stop": (
        "+4 -0 X turns)\n" + OUTWARD,
        "+6 -0 X turns)\n" + OUTWARD + "X18 Y9\nX19.975 Y10\n",
        "path",
    ),
    "modal G91 left on": ("G4 P0.01\nF300\n", "G4 P0.01\nG91 F300\n", "state"),
    "spindle stopped in a change": (OUTWARD, OUTWARD.replace("F600", "F600 M5"), "command"),
    "spindle stopped and started again in a change": (OUTWARD, OUTWARD.replace("F600", "F600 M5 M8"), "state"),
    "coolant switched in a change": (OUTWARD, OUTWARD.replace("F600", "F600 M9"), "command"),
    "G61 left on": (OUTWARD, OUTWARD.replace("F600", "G61 F600"), "state"),
    "inverse time left on": ("G4 P0.01\nF300\n", "G4 P0.01\nG93 F300\n", "state"),
    "units switched in a change": (OUTWARD, OUTWARD.replace("F600", "G20 F600"), "state"),
    "work system switched in a change": (OUTWARD, OUTWARD.replace("F600", "G55 F600"), "break"),
    "plane switched in a change": (OUTWARD, OUTWARD.replace("F600", "G18 F600"), "state"),
    "motion mode left changed": (OUTWARD, OUTWARD.replace("F600", "G0 F600"), "path"),
    "change says one line more": ("+4 -0 X", "+5 -0 X", "lines"),
    "change says one line fewer": ("+4 -0 X", "+3 -0 X", "lines"),
    "change says another number of lines replaced": ("+5 -1 X", "+5 -2 X", "lines"),
    "change marker lost": ("(ph-post: +4 -0 X turns)\n", "", "lines"),
    "change longer than the program": ("+3 -1 X dip", "+300 -1 X dip", "lines"),
    # Arcs in pieces
    "arc centre changed": (FIRST_ARC, FIRST_ARC.replace("I10", "I10.01"), "path"),
    "arc centre of the second part changed": (SECOND_ARC, SECOND_ARC.replace("J0", "J0.5"), "path"),
    "sense of an arc reversed": (FIRST_ARC, FIRST_ARC.replace("G2", "G3"), "path"),
    "second part of an arc missing": (SECOND_ARC, "(none)\n", "path"),
    "first part of an arc missing": (FIRST_ARC, "(none)\n", "jog"),
    "part of an arc twice": (
        "+5 -1 X turns)\n" + FIRST_ARC,
        "+6 -1 X turns)\n" + FIRST_ARC + "G2 X50.025 Y0 I-10 J0\n",
        "path",
    ),
    "arc cut by a chord": (FIRST_ARC, "G1 X50.025 Y0 F500\n", "path"),
    "arc in three parts, one of them back": (
        "+5 -1 X turns)\n" + FIRST_ARC,
        "+7 -1 X turns)\n" + FIRST_ARC + "G3 X40.025 Y10 I-10 J0\nG2 X50.025 Y0 I0 J-10\n",
        "path",
    ),
    "end of an arc off by its last digit": (SECOND_ARC, SECOND_ARC.replace("29.975", "29.9751"), "path"),
    "full circle becomes nothing": (
        FIRST_ARC + "G4 P0.01\nG1 X49.975 F1000\nG4 P0.01\n" + SECOND_ARC,
        "(none)\n" * 4 + "G1 X30.025 F500\n",
        "path",
    ),
    "offset changed inside a cut": (
        FIRST_ARC + "G4 P0.01\nG1 X49.975 F1000\nG4 P0.01\n",
        "G2 X49.975 Y0 R9.975 F500\n" + "(none)\n" * 3,
        "path",
    ),
    "F in a split arc above the original's": (FIRST_ARC, FIRST_ARC.replace("F500", "F520"), "feed"),
    # Dips
    "feed in a dip above the original's": ("X16 F150", "X16 F310", "feed"),
    "feed in a dip in another unit": ("X16 F150", "X16 F3810", "feed"),
    "F not restored behind a dip": ("X20 F300\nM9", "X20 F150\nM9", "state"),
    "a part of the path cut off": ("X16 F150\nX20 F300", "X16 F150\nX19 F300", "path"),
    "end of a dip off by its last digit": ("X16 F150\nX20 F300", "X16 F150\nX20.0001 F300", "path"),
    "path leaves the line in a dip": ("X16 F150", "X16 Y0.01 F150", "path"),
    "path goes back in a dip": ("X16 F150", "X12.5 F150", "path"),
    "dwell hidden in a dip": ("X16 F150\n", "G4 P5\n", "dwell"),
    "rapid in a dip": ("X16 F150", "G0 X16 F150", "path"),
}

RELATIVE = {
    "offset not taken up by the rapid": ("G0 X1.001 Y1", "G0 X1 Y1", "offset"),
    "offset of a rapid twice": ("G0 X1.001 Y1", "G0 X1.002 Y1", "offset"),
    "offset not taken back at the end": ("X-1.201", "X-1.2", "return"),
    "relative cut changed by the offset": ("G1 X-0.5\n", "G1 X-0.499\n", "text"),
    "relative jog half": ("G1 X-0.002 F10", "G1 X-0.001 F10", "direction"),
    "jog there and back again lost": ("G1 X0.002 F10", "G1 X-0.002 F10", "offset"),
    "absolute in place of relative": ("G91 F20", "G90 F20", "text"),
    "sign of R reversed": ("R0.2", "R-0.2", "text"),
    "arc centre in place of R": ("R0.2", "J0.2", "text"),
    "F in inches not restored": ("G1 X0.002 F10\nG4 P0.01\nF20", "G1 X0.002 F10\nG4 P0.01\nF508", "state"),
    "comment behind an arc lost": (" (corner)", "", "text"),
}

PLANES = {
    "absolute centre shifted by something else": ("I5.025", "I5.02", "offset"),
    "absolute centre of another axis shifted": ("K0", "K0.025", "text"),
    "exact stop lost": ("G61", "G64", "text"),
    "exact stop left off behind a change": ("I9.975 J4 F400", "I9.975 J4 F400 G64", "state"),
    "offset left at the end": ("G0 X0 Y0\nM5", "G0 X-0.025 Y0\nM5", "return"),
    "tool prepared is another one": ("T7", "T8", "text"),
}


def damages():
    for maker, table in ((bracket, BRACKET), (relative, RELATIVE), (planes, PLANES)):
        for name, change in table.items():
            yield pytest.param(maker, *change, id=f"{maker.__name__}: {name}")


def judged(original, compensated):
    programs = (read_program(original, "original"), read_program(compensated, "compensated"))
    return verify(*programs, tolerance=TOLERANCE)


@pytest.mark.parametrize(("maker", "old", "new", "kind"), list(damages()))
def test_damage_is_found(maker, old, new, kind):
    original, compensated = maker()
    text = compensated.decode()
    assert text.count(old) == 1
    verdict = judged(original, text.replace(old, new).encode())
    assert kind in {failure.kind for failure in verdict.failures}


@pytest.mark.parametrize("maker", [bracket, relative, planes])
def test_what_is_not_damaged_passes(maker):
    verdict = judged(*maker())
    assert [failure.sentence() for failure in verdict.failures] == []
    assert verdict.checked["jogs"] > 0


@pytest.mark.parametrize("maker", [bracket, relative, planes])
def test_every_line_counts(maker):
    """Whichever line of the program is lost, it is noticed."""
    original, compensated = maker()
    lines = compensated.splitlines(keepends=True)
    harmless = (b"(ph-post: machine", b"(ph-post: options", b"(ph-post: note")
    for number, line in enumerate(lines):
        if line.startswith(harmless):
            continue
        rest = b"".join(lines[:number] + lines[number + 1 :])
        try:
            program = read_program(rest, "compensated")
            verdict = verify(read_program(original, "original"), program, tolerance=TOLERANCE)
        except InputError:
            continue
        assert not verdict.ok, line


@pytest.mark.parametrize("maker", [bracket, relative, planes])
def test_another_original_is_told(maker):
    original, compensated = maker()
    verdict = judged(original + b"\n", compensated)
    assert [failure.kind for failure in verdict.failures] == ["original"]
