"""Random programs of Fanuc that are written out, beside a player that knows cycles and turned coordinates itself."""

import random

import pytest
from support.fanuc_player import Player, random_program

from ph_post.expand.expand import expand
from ph_post.expand.macro import FanucNumbers


@pytest.mark.parametrize("seed", range(3))
def test_the_tool_goes_the_same_way(seed):
    rng = random.Random(seed)
    written = 0
    for _ in range(80):
        text = random_program(rng)
        found = expand(text.encode(), "a.nc", language=FanucNumbers(decimals=9))
        lines = [line for line in found.data.decode().splitlines() if "PH-POST" not in line]
        meant, went = Player().play(text), Player().play("\n".join(lines))
        assert len(meant) == len(went), text
        for one, other in zip(meant, went, strict=True):
            assert other == pytest.approx(one, abs=1e-6), text
        written += found.data != text.encode()
    assert written > 60
