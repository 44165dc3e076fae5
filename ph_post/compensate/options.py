"""Options of a plan."""

from __future__ import annotations

from typing import Literal

import msgspec

PlanOutput = Literal["table", "program"]
"""The outputs that a plan can be written as."""


class PlanOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Options of a plan of the feed.

    Parameters
    ----------
    strategy : str
        Name of a registered strategy.
    start : {"rest", "moving"}
        Begin and end at rest, or hold the feed from end to end.
    ratio : float, optional
        V(½) / V_c of every profile; 0.25 where neither it nor `coefficients` is given.
    degree : int, optional
        n of Eq. (26), even; 10 where not given.
    t_star : float, optional
        Half duration of every profile [s]; the smaller of the window and four backlash intervals by default.
    coefficients : tuple of float, optional
        All V_k / V_c of Eq. (26), in place of `ratio` and `degree`.
    allow_retrograde : bool
        Whether the feed may become negative.
    min_feed : float, optional
        Lowest feed in a profile [m/s].
    max_slowdown : float
        How much the cycle time may grow, relative; not for a `ratio` or `coefficients` of the user's own.
    max_standstill : float, optional
        How much longer than in the plain motion the tool may stand or creep on the contour, in all [s].
    inverse_dynamics : bool
        Whether the command leads the path by what the servo lags behind.
    feed_only : bool
        Whether the path is left as it is: no inverse dynamics, no crossings.
    carrier : {"table", "program"}
        What the plan is written as; what is added to the path in a part program are jogs at full stops.
    pushes_first : bool
        Whether a table may push axes onto their sides before the path begins, with the tool off the part.
    effort : float
        How much strategies search that do so, 1 for some ten seconds.
    """

    strategy: str
    start: Literal["rest", "moving"] = "rest"
    ratio: float | None = None
    degree: int | None = None
    t_star: float | None = None
    coefficients: tuple[float, ...] | None = None
    allow_retrograde: bool = False
    min_feed: float | None = None
    max_slowdown: float = 0.1
    max_standstill: float | None = None
    inverse_dynamics: bool = False
    feed_only: bool = False
    carrier: PlanOutput = "table"
    pushes_first: bool = True
    effort: float = 1.0

    @property
    def writes_program(self) -> bool:
        """True where the plan becomes a part program, not an interpolator table."""
        return self.carrier == "program"

    @property
    def chosen_by_user(self) -> bool:
        """True where the depth of the profiles is the user's own."""
        return self.ratio is not None or self.coefficients is not None
