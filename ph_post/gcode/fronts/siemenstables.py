"""Which words of Siemens language are which in RS274, which move nothing, and records of what RS274 has not.

The words are those of the manuals that :mod:`ph_post.gcode.dialects.siemens` names.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import msgspec

from ph_post.gcode.fronts.translated import Remark

SAME: Final = (0, 1, 2, 3, 17, 18, 19, 40, 41, 42, 53, 54, 55, 56, 57, 64, 93, 94, 95)
"""G words that are the same in both."""

G_WORDS: Final[Mapping[str, str]] = {
    **{f"G{number}": f"G{number}" for number in SAME},
    **{f"G64{kind}": "G64" for kind in range(1, 7)},
    "G60": "G61", "G9": "", "G601": "", "G602": "", "G603": "",
    "G71": "G21", "G710": "G21", "G700": "G20",
    "G74": "G28", "G75": "G28", "G153": "G53", "G500": "G59.1",
    "G96": "G95", "G97": "G95", "G961": "G94", "G971": "G94",
    "G290": "", "G450": "", "G451": "", "G460": "", "G461": "", "G462": "",
}  # fmt: skip
"""What G words are in RS274; those of measures (G90, G91), dwells and frames are told apart."""

MOTIONS: Final = frozenset(("G0", "G1", "G2", "G3"))
OTHER_MOTIONS: Final = frozenset(("ASPLINE", "BSPLINE", "CSPLINE", "CT", "INVCW", "INVCCW"))
LIMITS: Final = frozenset(("G25", "G26"))
"""Limits of speeds and working areas: their axis words are no motion."""

M_WORDS: Final = frozenset((0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 30))
ENDS: Final = frozenset((17,))
QUIET_M: Final = frozenset((40, 41, 42, 43, 44, 45, 70))
"""M words of the spindle's gears."""

QUIET: Final = frozenset((
    "COMPOF", "COMPON", "COMPCURV", "COMPCAD", "COMPSURF", "SOFT", "BRISK", "DRIVE", "SPATH", "FFWON",
    "FFWOF", "CFC", "CFTCP", "CFIN", "DYNNORM", "DYNPOS", "DYNROUGH", "DYNSEMIFIN", "DYNFINISH",
    "DYNPREC", "NORM", "KONT", "CDOF", "CDON", "STOPRE", "STARTFIFO", "STOPFIFO", "FIFOCTRL", "WALIMON",
    "WALIMOF", "RTLION", "RTLIOF", "TRAFOOF", "SAVE", "DISPLOF", "DISPLON", "SBLOF", "SBLON", "CPRECON",
    "CPRECOF",
))  # fmt: skip
"""Words that change how the axes follow: none of them is a motion."""

QUIET_CALLS: Final = frozenset(
    ("MSG", "WORKPIECE", "GROUP_BEGIN", "GROUP_END", "GROUP_ADDEND", "CYCLE832", "SETMS")
)
QUIET_NAMES: Final = frozenset(["ADIS", "ADISPOS", "CTOL", "OTOL", "ATOL", "SPOS", "SPOSA", "SVC"])
DECLARATIONS: Final = frozenset(["DEF", "PROC", "EXTERN"])
CYCLES: Final = ("CYCLE", "HOLES", "POCKET", "SLOT", "LONGHOLE", "E_")
"""How the names of cycles begin that leave the modes as they were."""

FRAMES: Final[Mapping[str, str]] = {
    "TRANS": "G69", "ATRANS": "", "G58": "", "G59": "", "TOROTOF": "", "PAROTOF": "",
    **dict.fromkeys((
        "ROT", "AROT", "ROTS", "AROTS", "CROTS", "SCALE", "ASCALE", "MIRROR", "AMIRROR", "TRAORI",
        "TRANSMIT", "TRACYL", "TRAANG", "TRAFOON", "CYCLE800", "TOFRAME", "TOFRAMEX", "TOFRAMEY",
        "TOFRAMEZ", "TOROT", "TOROTX", "TOROTY", "TOROTZ", "PAROT",
    ), "G68"),
}  # fmt: skip
"""Words that move the frame (empty), turn it (G68), or replace it by one that is only moved (G69)."""

DIAMETERS: Final[Mapping[str, str]] = {"DIAMON": "G7", "DIAM90": "G7", "DIAMOF": "G8"}


class Polynomial(msgspec.Struct, frozen=True, kw_only=True):
    """A POLY block over [0, `length`].

    `axes` has each axis' coefficients of p², p³, …; `below` the denominator's value at the end and then those
    of its own, empty where there is none.
    """

    axes: Mapping[str, tuple[float, ...]]
    below: tuple[float, ...]
    length: float


class Circle(msgspec.Struct, frozen=True, kw_only=True):
    """A circle through a point: by axis in the program's units, from the start where it is not absolute."""

    point: Mapping[str, float]
    absolute: bool


class Profile(msgspec.Struct, frozen=True, kw_only=True):
    """Feed of a block in the program's units: its end, and the coefficients of p² and p³."""

    end: float
    quad: float = 0.0
    cub: float = 0.0


class Extras(msgspec.Struct, frozen=True, kw_only=True):
    """By line, what RS274 has no words for, and what is not understood."""

    polynomials: dict[int, Polynomial]
    circles: dict[int, Circle]
    profiles: dict[int, Profile]
    remarks: dict[int, Remark]
