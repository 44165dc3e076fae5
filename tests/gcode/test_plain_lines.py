"""Lines of plain words, which have a pass of their own, beside the same lines with a comment, which have not."""

import random

import numpy as np
import pytest

from ph_post.gcode.read import read_program

SOME = "G0,G1,G01,G2,G3,X1,X-1.25,x2,Y.5,Y-.5,Z5.,Z-0,F100,F50.5,I1,J-.5,R5,A5,E.5,N10,P1"
FEW = (
    "G90,G91,G20,G21,G18,G93,G94,G4,G53,G80,M3,M5,M6,S100,T2,F-3,F0,X+1,X,X.,X1.2.3,X1-2,X1e5,X1E5,O100,D1,*5,#1=2,%,"
    "X123456789012345678,X1234567890123456789,X.0000000000000000001,Y-9007199254740993,X#1,X[1+2],/G1 X1,$H,"
    "X 1,X1 0,X1 .5,X- 1,\tX1,G1 G1,X1 X2,G1 G0,,  ,(c) X1,X1 (c),X1 ;c"
)


def text(seed):
    """Write a program of lines most of which are plain."""
    rng = random.Random(seed)
    lines = []
    for _ in range(80):
        words = rng.sample(SOME.split(","), rng.randint(1, 4))
        if rng.random() < 0.15:
            words.insert(rng.randrange(len(words) + 1), rng.choice(FEW.split(",")))
        lines.append(rng.choice(["", " "]).join(words) + rng.choice(["", "", " "]))
    return ["G21 G90 G17 F100", "G0 X0 Y0 Z0", *lines, "M2"]


def found(program):
    words, motions = program.words, program.motions
    yield from (words.block, words.letter, words.value, words.decimals, words.digits)
    yield from ((ends - program.lines[words.block]) for ends in (words.start, words.end))
    yield from (program.state, program.feed_word)
    yield from (
        getattr(motions, name) for name in motions.__struct_fields__ if name not in ("feeds", "control", "nurbs")
    )
    yield motions.feed


@pytest.mark.parametrize("seed", range(40))
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_comment_behind_a_line_changes_nothing(seed, end):
    plain, commented = (
        read_program("".join(line + behind + end for line in text(seed)).encode(), "a.ngc") for behind in ("", "()")
    )
    for one, other in zip(found(plain), found(commented), strict=True):
        np.testing.assert_array_equal(one, other)
    assert plain.modal == commented.modal
    assert [(one.block, one.motion, one.kind) for one in plain.breaks] == [
        (one.block, one.motion, one.kind) for one in commented.breaks
    ]
    assert [(one.first, one.last, one.why) for one in plain.notes] == [
        (one.first, one.last, one.why) for one in commented.notes
    ]
