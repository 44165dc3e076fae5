"""Programs compensated by hand, by the format that the README describes: what a judge must accept.

Each is a pair of texts. X has an encoder on the motor and 0.05 mm of lost motion, so it carries 0.025 mm the
way it moves; Y has a scale on the table, and is moved out and back by 0.03 mm where it turns.
"""

from __future__ import annotations

import hashlib

HEADER = """(ph-post 0.1.0 compensated this program)
(ph-post: original sha256 {digest})
(ph-post: machine bench, sha256 0123456789abcdef)
(ph-post: options sha256 fedcba9876543210)
{offsets}
(ph-post: {stops} stops, {dips} dips)
(ph-post: dwell 0.01 s, decimals 4, chord tolerance 0.001 mm, block time 5 ms, path mode as it is)
(ph-post: note written by hand)
"""

BRACKET = """%
O100
(bracket)
N10 G21 G90 G17 G94 G40 G49 G64 P0.01
T1 M6
G54
S1000 M3
M8
G0 X0 Y0
G0 Z5
G1 Z-1 F100
G1 X20 F600
Y10 (side)
N20 X0
Y0
G0 Z5
G0 X30 Y0
G1 Z-1 F100
G2 X30 Y0 I10 J0 F500
G0 Z5
G0 X0
/M1
T2 M6
G55
G0 X0 Y0 Z0
G4 P0.5
G1 X10 F300
G1 X20
M9
M5
G28
M2
%
"""

BRACKET_HUNKS = """%
O100
{header}(bracket)
N10 G21 G90 G17 G94 G40 G49 G64 P0.01
T1 M6
G54
S1000 M3
M8
G0 X0.025 Y0
G0 Z5
G1 Z-1 F100
G1 X20.025 F600
Y10 (side)
(ph-post: +4 -0 X turns)
G4 P0.01
G1 X19.975 F1000
G4 P0.01
F600
N20 X-0.025
Y0
G0 Z5
G0 X30.025 Y0
G1 Z-1 F100
(ph-post: +5 -1 X turns)
G2 X50.025 Y0 I10 J0 F500
G4 P0.01
G1 X49.975 F1000
G4 P0.01
G2 X29.975 Y0 I-10 J0 F500
G0 Z5
G0 X0
/M1
T2 M6
G55
G0 X0 Y0 Z0
G4 P0.5
G1 X10 F300
(ph-post: +6 -0 Y pulse)
G4 P0.01
G1 Y0.03 F200
G4 P0.01
G1 Y0 F200
G4 P0.01
F300
(ph-post: +3 -1 X dip)
G1 X13 F200
X16 F150
X20 F300
M9
M5
G28
M2
%
(ph-post: undo 1/2 QUJD)
(ph-post: undo 2/2 REVG)
"""

RELATIVE = """G20 G90 G17 G94 G64
G0 X0 Y0 Z0
G91 F20
G0 X1 Y1
G1 Z-0.1
G1 X0.5 Y0.25
G1 X-0.5
G3 X0.2 Y0.2 R0.2 (corner)
G0 Z0.1
G0 X-1.2 Y-1.45
M30
"""

RELATIVE_HUNKS = """{header}G20 G90 G17 G94 G64
G0 X0 Y0 Z0
G91 F20
G0 X1.001 Y1
G1 Z-0.1
G1 X0.5 Y0.25
(ph-post: +4 -0 X turns)
G4 P0.01
G1 X-0.002 F10
G4 P0.01
F20
G1 X-0.5
(ph-post: +4 -0 X turns)
G4 P0.01
G1 X0.002 F10
G4 P0.01
F20
G3 X0.2 Y0.2 R0.2 (corner)
G0 Z0.1
G0 X-1.201 Y-1.45
M30
"""

PLANES = """G21 G90 G90.1 G18 G94 G61
S500 M4 T7 M6
G0 X0 Y0 Z0
G1 Y-1 F200
G2 X10 Z0 I5 K0 F400
G1 Z5
G17
G3 X10 Y9 I10 J4
G1 X0
G0 X0 Y0
M5
M2
"""

PLANES_HUNKS = """{header}G21 G90 G90.1 G18 G94 G61
S500 M4 T7 M6
G0 X0.025 Y0 Z0
G1 Y-1 F200
G2 X10.025 Z0 I5.025 K0 F400
G1 Z5
G17
(ph-post: +5 -1 X turns)
G3 X15.025 Y4 I10.025 J4
G4 P0.01
G1 X14.975 F900
G4 P0.01
G3 X9.975 Y9 I9.975 J4 F400
G1 X-0.025
G0 X0 Y0
M5
M2
"""


def headed(original: str, text: str, offsets: str, stops: int, dips: int) -> tuple[bytes, bytes]:
    """Original and compensated program, the header filled in."""
    data = original.encode("latin-1")
    header = HEADER.format(digest=hashlib.sha256(data).hexdigest(), offsets=offsets, stops=stops, dips=dips).replace(
        "\n\n", "\n"
    )
    return data, text.format(header=header).encode("latin-1")


def bracket() -> tuple[bytes, bytes]:
    """Lines, a full circle, two tools, offsets of X, a pulse of Y and a dip, in absolute millimetres."""
    amounts = "(ph-post: offset X 0.025 mm)\n(ph-post: pulse Y 0.03 mm)"
    return headed(BRACKET, BRACKET_HUNKS, amounts, stops=3, dips=1)


def relative() -> tuple[bytes, bytes]:
    """Lines and an arc by its radius, in relative inches."""
    return headed(RELATIVE, RELATIVE_HUNKS, "(ph-post: offset X 0.001 inch)", stops=2, dips=0)


def planes() -> tuple[bytes, bytes]:
    """Arcs in two planes by absolute centres, exact stop, one of them split."""
    return headed(PLANES, PLANES_HUNKS, "(ph-post: offset X 0.025 mm)", stops=1, dips=0)
