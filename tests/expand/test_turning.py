"""Programs of Fanuc's lathes that are written out, beside a player that knows their cycles itself."""

import random

import pytest
from support.lathe_player import LathePlayer, random_turning

from ph_post.api.expansion import before_expansion
from ph_post.expand.expand import expand
from ph_post.expand.macro import FanucNumbers

HEAD = "G21 G18 G40 G99\nG50 S2500\nG96 S200 M3\nG0 X60. Z5.\n"
ROUGH = "G71 U1.5 R0.5\nG71 P10 Q20 U0.4 W0.1 F0.3\nN10 G0 X10. (IN)\nG1 W-10. F0.1\nG2 U10. W-5. R5.\nN20 G1 X50.\n"


def lines_of(text, **how):
    found = expand(f"O1\n{HEAD}{text}M30\n".encode(), "a.nc", language=FanucNumbers(**how))
    lines = [line for line in found.data.decode().splitlines() if "PH-POST-EXPAND" not in line]
    return lines[5:-1], found.notes


@pytest.mark.parametrize("seed", range(3))
def test_the_tool_goes_the_same_way(seed):
    rng = random.Random(seed)
    written = 0
    for _ in range(80):
        text = random_turning(rng)
        found = expand(text.encode(), "a.nc", language=FanucNumbers(decimals=9))
        assert found.notes == (), text
        lines = [line for line in found.data.decode().splitlines() if "PH-POST" not in line]
        assert not any(f"G{code}" in line.split("(")[0].split() for line in lines for code in (70, 90, 94))
        meant, went = LathePlayer().play(text), LathePlayer().play("\n".join(lines))
        assert len(meant) == len(went), text
        for one, other in zip(meant, went, strict=True):
            assert one[0] == other[0], text
            assert other[1:] == (pytest.approx(one[1:], abs=1e-6) if isinstance(one[1], float) else one[1:]), text
        written += found.data != text.encode()
    assert written > 60


def test_a_shape_is_run_and_the_tool_goes_back():
    lines, notes = lines_of(f"{ROUGH}T0202\nG0 X60. Z5.\nG70 P10 Q20 F0.08\nG0 X80.\n")
    assert notes == ()
    assert lines[:8] == [*ROUGH.splitlines(), "T0202", "G0 X60. Z5."]
    assert lines[8:] == [
        *(
            "(G70 P10 Q20 F0.08)",
            "F0.08",
            "G0 X60. Z5.",
            "G0 X10. (IN)",
            "G1 Z-5. F0.1",
            "G2 X20. Z-10. R5.",
            "G1 X50.",
        ),
        *("G0 X60. Z5.", "G0 X80."),
    ]


def test_cycles_of_one_block_last_until_another_motion():
    lines, _ = lines_of("G90 X50. W-25. F0.2\nX46. (SECOND)\nU-20. R-1.\nG94 X20. Z1. F0.1\nW-5.\nG0 X70.\n")
    assert lines == [
        *("F0.2", "G0 X50.", "G1 Z-20.", "G1 X60.", "G0 Z5."),
        *("(SECOND)", "G0 X46.", "G1 Z-20.", "G1 X60.", "G0 Z5."),
        *("G0 X38.", "G1 X40. Z-20.", "G1 X60.", "G0 Z5."),
        *("F0.1", "G0 Z1.", "G1 X20.", "G1 Z5.", "G0 X60."),
        *("G0 Z0.", "G1 X20.", "G1 Z5.", "G0 X60."),
        "G0 X70.",
    ]


def test_increments_become_places_and_the_rest_stays():
    text = "G1 U-2. W-1.5 F0.1 (A)\nG4 U1.5\nG28 U0 W0\nG1 U1.\nX5. Z0.\nW-1.\n"
    lines, _ = lines_of(text)
    assert lines == ["G1 X58. Z3.5 F0.1 (A)", "G4 U1.5", "G28 U0 W0", "G1 U1.", "X5. Z0.", "Z-1."]
    whole = f"O1\n{HEAD}{text}M30\n".encode()
    assert before_expansion(expand(whole, "a.nc", language=FanucNumbers()).data, "a.nc") == whole


def test_a_mill_keeps_its_words():
    text = b"O1\nG21 G17 G90 G99\nG0 X1. Y1. Z5.\nG1 U2. F100.\nG90 G1 X3.\nM30\n"
    assert expand(text, "a.nc", language=FanucNumbers()).data == text


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (f"{ROUGH}G70 P10 Q30\n", "the sequence numbers of the shape are not there"),
        (f"{ROUGH}N20 X60.\nG70 P10 Q20\n", "not there once"),
        (f"{ROUGH}G28 U0 W0\nG70 P10 Q20\n", "where the cycle begins"),
        (f"{ROUGH}T0202\nG70 P10 Q20\n", "where the cycle begins"),
        (f"{ROUGH.replace('G1 W', 'M8 G1 W')}G70 P10 Q20\n", "a block of the shape that does more than to move"),
        (f"{ROUGH.replace('G0 X10.', 'G0 G42 X10.')}G70 P10 Q20\n", "leaves the compensation of the tool's nose on"),
        (f"{ROUGH}G70 P10 Q20\nX70.\n", "a move behind the cycle without a word of its motion"),
        (f"{ROUGH}G70 P10 Q20 M8\n", "does not belong to it"),
        ("G90 X50. Z-20. M8\n", "does not belong to it"),
        ("G90 X50. Z-20. F0.2\nM8\nG0 X60.\n", "at which the control repeats the cycle"),
        ("G28 U0.\nG90 X50. Z-20. F0.2\n", "where the cycle begins"),
        ("G90 X50. F0.2\n", "a cycle without X or Z"),
        ("G92 X50. Z-20. F1.5\nX49.\nG0 X60.\n", "how it leaves the thread is a setting of the control"),
    ],
)
def test_what_is_not_understood_stays_and_is_named(text, why):
    data = f"O1\n{HEAD}{text}M30\n".encode()
    found = expand(
        data.replace(b"W-10.", b"Z-5.").replace(b"U10. W-5.", b"X20. Z-10."), "a.nc", language=FanucNumbers()
    )
    assert why in " ".join(found.notes)
    lines = [line for line in found.data.decode().splitlines() if "PH-POST" not in line]
    assert next(line for line in text.splitlines() if line[:3] in ("G70", "G90", "G92")) in lines


def test_a_letter_without_its_number_is_kept():
    lines, _ = lines_of("G1 U-2. F0.1\nG X5.\nU1.\nX8. Z1.\nW-1.\n")
    assert lines == ["G1 X58. F0.1", "G X5.", "U1.", "X8. Z1.", "Z0."]
