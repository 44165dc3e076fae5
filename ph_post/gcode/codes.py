"""Modal groups of G and M words as RS274/NGC has them, and the numbers that the compiled passes exchange.

Compiled code is cached on disk until its own file changes: whoever changes a number here has to touch
``modes.py`` and ``motions.py`` too.
"""

from __future__ import annotations

from typing import Final

import numpy as np

(
    MOTION,
    PLANE,
    UNITS,
    ABSOLUTE,
    ARC_ABSOLUTE,
    FEED_MODE,
    COMPENSATION,
    LENGTH,
    SYSTEM,
    PATH,
    PATH_P,
    PATH_Q,
    RETRACT,
    SPINDLE,
    MIST,
    FLOOD,
    TOOL,
    PREPARED,
    SPEED,
) = range(19)
"""Columns of a modal state; words such as G5.1 stand there as ten times their number."""

FEED, FEED_KNOWN, FRAME, UNITS_SAID, BENEATH = 19, 20, 21, 22, 23
"""What the state holds besides: F, whether it was given (0 no, 1 yes, 2 perhaps), whether the frame is
turned, scaled or in diameters, whether the program said its units, and the motion to which G80 leads back."""

MODES, STATE = 19, 24
NONE, UNKNOWN = -1.0, -2.0
"""A group of which the program has said nothing, and one that something not understood may have set."""

(
    REST,
    RAPID,
    LINE,
    ARC_CW,
    ARC_CCW,
    CUBIC,
    QUADRATIC,
    NURBS_POINT,
    NURBS_END,
    FORGET,
    FORGET_NAMED,
    PRESET,
    AIMED,
) = range(13)
"""What a block does to the position: the motions, and to forget it, of all or of the named axes, or to give
it another name (G92), or to pass through a motion whose end is known. `FORGET_FIRST` is added where it is
forgotten before the motion, `FORGET_LENGTH` where that of Z is."""
FORGET_FIRST, FORGET_LENGTH = 16, 32

EXPLICIT, LENIENT_LINE, OFFSET_LINE, FRAMED, KNOWN_SHIFT = 1, 2, 4, 8, 4
"""Bits of what else a block has: its own motion word, a word that takes further letters, offsets in its axis
words (G43.1), a frame that is not the machine's; and the bit from which on stands whether F is known."""

TOOL_CHANGE, PROBE, HOME, MACHINE, FRAME_CHANGE, END, LENGTH_CHANGE = 1, 2, 4, 8, 16, 32, 64
"""Bits of what separates chains; `LENGTH_CHANGE` beside `FRAME_CHANGE` where only the tool's length changes."""

(
    PARAMETER,
    EXPRESSION,
    O_WORD,
    POLAR,
    COMPENSATED,
    CYCLE,
    FURTHER_AXIS,
    UNKNOWN_G,
    UNKNOWN_M,
    DELETED,
    SUBPROGRAM,
    ARC_FROM_NOWHERE,
    SPLINE_FROM_NOWHERE,
    UNUSED_WORD,
    NO_MOTION_MODE,
    UNSURE_MODE,
    CONTROLLER_LINE,
    OTHER_FRAME,
    THREAD,
    COMMA,
    DWELL_AXES,
    SPLINE_PLANE,
    SAVED_STATE,
    LONE_SPLINE,
    STAYING_G,
    STAYING_M,
    ROTARY_PAIR,
    USER_M,
) = range(1, 29)
"""Why a block is not understood."""

FAULT, QUIET = 100, 200
"""What is added to a fault where it becomes a reason: `FAULT` where the block is passed through, and `QUIET` where
only something beside its motion is not known. Under ``--strict`` both are refused."""

(
    TWICE,
    TWO_OF_GROUP,
    NEGATIVE_FEED,
    NO_FEED,
    ZERO_FEED,
    NO_INVERSE_FEED,
    NO_CENTER,
    MIXED_CENTER,
    MISSING_CENTER,
    FOREIGN_CENTER,
    NO_RADIUS_END,
    TURNS,
    NO_DWELL,
) = range(20, 33)
"""Faults of a block."""

SKIP = 316
"""By ten times its number what stands for G31 where that is a move up to a signal, which may come anywhere on its way:
see :attr:`~ph_post.gcode.language.Language.skips`. Of the others' words it is none."""

THREADING, TAPPING = 330, 331
"""G33 and G33.1, by ten times their numbers."""

MOST_TURNS: Final = 1000
"""An arc of more turns is a slip of the pen: threads have tens."""

_GROUPS: Final[dict[int, tuple[int, ...]]] = {
    0: (40, 100, 280, 281, 300, 301, 316, 520, 530, 920, 53),
    1: (
        0,
        10,
        20,
        30,
        50,
        51,
        52,
        330,
        331,
        382,
        383,
        384,
        385,
        700,
        710,
        711,
        712,
        720,
        721,
        722,
        730,
        740,
        760,
        800,
        810,
        820,
        830,
        840,
        850,
        860,
        870,
        880,
        890,
    ),
    2: (170, 180, 190, 171, 181, 191),
    3: (900, 910),
    4: (901, 911),
    5: (930, 940, 950),
    6: (200, 210),
    7: (400, 410, 411, 420, 421),
    8: (430, 431, 432, 490),
    10: (980, 990),
    12: (540, 550, 560, 570, 580, 590, 591, 592, 593),
    13: (610, 611, 640),
    14: (960, 970),
    15: (70, 80),
    16: (921, 922, 923),
    17: (121, 131, 150, 160, 500, 501, 510, 511, 434, 435, 680, 682, 683, 684, 690),
}
GROUP = np.full(1000, -1, np.int64)
for _number, _codes in _GROUPS.items():
    GROUP[list(_codes)] = _number
FRAMES = np.array(
    [
        *([70, 80], [160, 150], [510, 500], [511, 501], [680, 690], [121, 131], [682, 690], [683, 690], [684, 690]),
        *([434, 490], [435, 490]),
    ]
)
"""Words that make the frame another, and words that end that: diameters (G7), polar coordinates (G16), scaled
(G51), mirrored (G51.1), turned (G68), a plane about a rotary axis (G12.1), tilted (G68.2 to G68.4), held at the
tip of the tool while rotary axes turn (G43.4, G43.5, up to G49)."""

STAYS, CALLS, RUNS, SWITCHES = 1, 2, 3, 4
"""Effects of words that are not of RS274/NGC: on neither axes nor modes; on any of them, as a subprogram has; what a
program beside the controller does, which moves no axis to another place of the part program's; on the kinematics, after
which the program's axes are not the machine's."""

FORGETTING = 999.0
"""G word by which readers of other dialects say that the place alone is not known behind a line: of the words that no
controller has it is the one that changes no mode."""

G_EFFECT, M_EFFECT = np.zeros(1000, np.int8), np.zeros(1000, np.int8)
"""Effects of G words, by ten times their number, and of M words; of the others (0) on the axes.

FANUC B-64484EN: G62 overrides the feed in inner corners. Haas, Mill Operator's Manual
(G-codes, M-codes): G09 exact stop is a setting; M10 and M11 clamp and
release rotary axes, M31 and M33 run the chip conveyor, M34 and M35 turn the coolant nozzle, M41 to M44 are gears,
M59 and M69 relays, M83 is the air gun, M88 and M89 coolant through the spindle; G65 calls a macro, M97 a subprogram
of the same file. FANUC B-64484EN: G65 to G67, M198 and M96 call macros and subprograms, M29 readies the spindle for
rigid tapping. Mach3, "Mach3 G and
M code reference": M47 begins the program anew. Temperatures, fans and messages of printer firmware (Marlin,
`src/gcode/gcode.cpp`: M104 to M109, M117, M140, M190) are on LinuxCNC a user's own programs, which its interpreter
takes to move nothing ("User Defined Commands M100 to M199"), and on Grbl refused.
"""
G_EFFECT[[90, 620]] = STAYS
G_EFFECT[[650, 660, 661, 670]] = CALLS
M_EFFECT[
    [10, 11, 29, 31, 33, 34, 35, 41, 42, 43, 44, 59, 69, 83, 88, 89, 104, 105, 106, 107, 108, 109, 117, 140, 190]
] = STAYS
M_EFFECT[[47, 96, 97, 198]] = CALLS
_OWN: Final = frozenset((70, 71, 72, 73, 98, 99))
"""M words beside those that keep the state and bring it back, and call subprograms and end them."""


def may_rest(number: int) -> bool:
    """Return whether an M word may be one that moves nothing, as it has no meaning of its own in RS274/NGC.

    Examples
    --------
    >>> may_rest(103), may_rest(6), may_rest(98), may_rest(1000)
    (True, False, False, False)
    """
    own = number < M_GROUP.size and M_GROUP[number] >= 0
    return number < M_EFFECT.size and not own and number not in _OWN and bool(M_EFFECT[number] != CALLS)


TAKES_AXES = (GROUP < 0) | (GROUP == 0) | (GROUP == 17)
TAKES_AXES[[431, 432, 530]] = True, True, False
"""Words that take the axis words of their block for themselves, or may, as nobody knows them (by ten times their
number); beside all others, and G53, axis words are a motion."""


def takes_axes(number: float) -> bool:
    """Return True if a G word takes the axis words of its block for itself, or is not known.

    Examples
    --------
    >>> takes_axes(68.0), takes_axes(28.0), takes_axes(54.0), takes_axes(53.0)
    (True, True, False, False)
    """
    code = 10.0 * number
    return not (0.0 <= code < GROUP.size and abs(code - round(code)) < 1e-6) or bool(TAKES_AXES[round(code)])


FIELD = np.array(
    [
        -1,
        MOTION,
        PLANE,
        ABSOLUTE,
        ARC_ABSOLUTE,
        FEED_MODE,
        UNITS,
        COMPENSATION,
        LENGTH,
        -1,
        RETRACT,
        -1,
        SYSTEM,
        PATH,
        -1,
        FRAME,
        -1,
        FRAME,
    ]
)
"""Column of the state that each group sets."""
_M_GROUPS: Final = {
    3: (70, 71),
    4: (0, 1, 2, 30, 60),
    5: (62, 63, 64, 65, 66, 67, 68),
    6: (6, 61),
    7: (3, 4, 5, 19),
    8: (7, 8, 9),
    9: (48, 49, 50, 51, 52, 53),
}
M_GROUP = np.full(100, -1, np.int64)
for _number, _codes in _M_GROUPS.items():
    M_GROUP[list(_codes)] = _number

(
    LETTER_A,
    LETTER_B,
    LETTER_C,
    LETTER_D,
    LETTER_E,
    LETTER_F,
    LETTER_G,
    LETTER_H,
    LETTER_I,
    LETTER_J,
    LETTER_K,
    LETTER_L,
    LETTER_M,
    LETTER_N,
    LETTER_O,
    LETTER_P,
    LETTER_Q,
    LETTER_R,
    LETTER_S,
    LETTER_T,
    LETTER_U,
    LETTER_V,
    LETTER_W,
    LETTER_X,
    LETTER_Y,
    LETTER_Z,
) = range(26)
"""Letters of words, as bits they are the letters that a block has."""


def letter_bits(letters: str) -> int:
    """Return letters as bits.

    Examples
    --------
    >>> letter_bits("AC")
    5
    """
    return sum(1 << ord(letter) - ord("A") for letter in letters)


AXES: Final = letter_bits("XYZ")
FURTHER: Final = letter_bits("ABCUVW")
FURTHER_LINEAR: Final = letter_bits("UVW")
ROTARY: Final = letter_bits("ABC")
CENTER: Final = letter_bits("IJK")
ALWAYS: Final = letter_bits("FGMNOST")
SPLINE_LETTERS: Final = letter_bits("XYIJPQ")
NURBS_LETTERS: Final = letter_bits("XYPL")
LENIENT: Final = letter_bits("DEHLPQR")
"""Letters of words that G4, G10, G41, G43, G64, M6x and others use."""
