"""The time of a log: one period, whatever was rounded and lost."""

import numpy as np
import pytest

from ph_post.errors import InputError
from ph_post.files.logcolumns import clock_of
from ph_post.files.logsheet import Sheet


def sheet():
    return Sheet(name="a", stem="a", digest="", names=(), rows=0, load=dict, where=lambda row: f"a:{row}", header="a:0")


@pytest.mark.parametrize(("rate", "decimals"), [(1000, 3), (3000, 3), (3000, 6), (700, 3), (400, 3), (8000, 9)])
def test_rounded_times_are_at_one_period(rate, decimals):
    k = np.arange(20000)
    clock = clock_of(np.round(5.0 + k / rate, decimals), sheet())
    assert np.array_equal(clock.place, k)
    assert clock.period == pytest.approx(1.0 / rate, rel=1e-7)
    assert clock.jitter <= 0.51 * 10.0**-decimals


def test_holes_are_seen_in_rounded_times():
    k = np.delete(np.arange(20000), [100, 5000, 5001])
    clock = clock_of(np.round(k / 400, 3), sheet())
    assert np.array_equal(clock.place, k)
    assert clock.period == pytest.approx(1.0 / 400, rel=1e-7)


@pytest.mark.parametrize(("jitter", "taken"), [(0.09, True), (0.13, False)])
def test_a_sample_may_be_off_by_a_tenth_of_the_period(jitter, taken):
    t = 0.001 * np.arange(2000)
    t[777] += jitter * 0.001
    if taken:
        assert clock_of(t, sheet()).jitter == pytest.approx(jitter * 0.001, rel=0.01)
        return
    with pytest.raises(InputError, match="a:777: the sampling period is not constant"):
        clock_of(t, sheet())


def test_times_of_day_keep_their_period():
    clock = clock_of(1.7e9 + 0.001 * np.arange(5000), sheet())
    assert clock.period == pytest.approx(0.001, rel=1e-9)
    assert clock.start == 1.7e9


@pytest.mark.parametrize(
    ("t", "words"),
    [
        (np.zeros(300), "a:1: time repeats; expected t > 0 s; got 0 s"),
        (np.r_[0:50, 51, 50, 52:300] * 0.001, "a:51: time runs backwards; expected t > 0.051 s; got 0.05 s"),
        (
            np.r_[0:100, 100.3:300] * 0.001,
            "a:100: the sampling period is not constant; expected t = 0.1 s, at a period of 0.001 s; got 0.1003 s",
        ),
        (
            np.r_[0:200, 0:200] * 0.001,
            "a:200: time starts again: another recording in the same file?; expected one recording a file, or"
            " t > 0.199 s; got 0 s",
        ),
        (-0.001 * np.arange(300), "a:1: time runs backwards; expected t > 0 s; got -0.001 s"),
    ],
    ids=["still", "swapped", "half a period", "begun again", "reversed"],
)
def test_no_constant_period_is_refused_where_it_fails(t, words):
    with pytest.raises(InputError) as refusal:
        clock_of(t, sheet())
    assert str(refusal.value) == words


def test_rounding_is_no_excuse_where_it_moves_nothing():
    t = 0.005 * np.arange(1000)
    t[77] += 0.001
    with pytest.raises(InputError, match=r"a:77: .* expected t = 0\.385.*; got 0\.386 s"):
        clock_of(np.round(t, 3), sheet())
