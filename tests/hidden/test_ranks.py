"""The rank test: what physics says that a record cannot tell, and what it can."""

from __future__ import annotations

import pytest

from tests.support.plants.draw import draw_case
from tests.support.plants.ranks import ALIKE, alike, tell_apart


@pytest.mark.parametrize(
    ("hidden", "channels", "seed", "other", "same"),
    [
        # Friction by speed adds to c, and nothing else.
        ("viscous_friction", ("act",), 0, "servo_mismatch", True),
        # Dry friction holds the motor back, a play behind it does not.
        ("coulomb_friction", ("act", "motor"), 0, "backlash", False),
        # A weight shifts the origin, which nobody knows.
        ("load_offset", ("act",), 0, "nothing", True),
        # With the force it does not.
        ("load_offset", ("act", "force"), 0, "nothing", False),
        ("scale_error", ("act",), 0, "coulomb_friction", False),
    ],
)
@pytest.mark.thinned(4)
def test_names_are_alike_where_physics_says_so(
    hidden: str, channels: tuple[str, ...], seed: int, other: str, same: bool
) -> None:
    apart = tell_apart(draw_case([hidden], channels, "motor", seed), (other,))[hidden]
    assert (other in alike(apart)) is same


def test_what_takes_no_more_than_the_constants_do_is_not_like_the_truth() -> None:
    assert alike({"nothing": 20.0, "backlash": 19.0, "servo_mismatch": 1.0}) == {"servo_mismatch"}
    assert alike({"nothing": 1e6, "backlash": 0.9 * ALIKE, "scale_error": 1e4}) == {"backlash"}
    assert "nothing" in alike({"nothing": 4.0})
