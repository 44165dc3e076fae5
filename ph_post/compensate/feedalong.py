"""Feed of a planned motion as a function of arc length."""

from __future__ import annotations

import numpy as np

from ph_post.compensate.motion import Motion


class FeedAlong:
    """Feed of the plain plan as function of arc length, read off samples of its motion.

    Parameters
    ----------
    motion : Motion
    period : float
        Sampling period [s].
    length : float
        Length of the path [m].
    looped : bool
        Whether the motion runs through the seam of a closed path, so that the feed repeats.
    """

    def __init__(self, motion: Motion, period: float, length: float, looped: bool) -> None:
        edges = np.concatenate([motion.start, [motion.end]])
        t = np.unique(np.concatenate([np.arange(0.0, motion.end, period), edges]))
        s, feed = motion.place_and_feed(t)
        if looped:
            s, feed = np.concatenate([s - length, s, s + length]), np.tile(feed, 3)
        self.s, self.feed = np.maximum.accumulate(s), feed
        self.first, self.last = float(self.s[0]), float(self.s[-1])

    def at(self, s: float) -> float:
        """Feed at `s` [m/s]."""
        return float(np.interp(s, self.s, self.feed))

    def lowest(self, s: float, half: float) -> float:
        """Lowest feed on [s - half, s + half] [m/s]."""
        i, j = np.searchsorted(self.s, [s - half, s + half])
        inside = self.feed[i:j]
        ends = min(self.at(s - half), self.at(s + half))
        return min(ends, float(inside.min())) if inside.size else ends

    def steady_sides(self, s: float, reach: float, least: float) -> tuple[float, float]:
        """How far before and behind `s`, up to `reach`, the feed is at least `least` [m]."""
        i, centre, j = np.searchsorted(self.s, [s - reach, s, s + reach])
        before = np.flatnonzero(self.feed[i:centre] < least)
        after = np.flatnonzero(self.feed[centre:j] < least)
        ahead = s - float(self.s[i + before[-1] + 1]) if before.size else reach
        behind = float(self.s[centre + after[0] - 1]) - s if after.size else reach
        return max(min(ahead, s - self.first), 0.0), max(min(behind, self.last - s), 0.0)

    def steady_half(self, s: float, half: float, least: float) -> float:
        """Largest part of `half` for which the feed is at least `least` on [s - half, s + half]."""
        return min(self.steady_sides(s, half, least))
