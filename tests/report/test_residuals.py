"""Residuals in few numbers: nothing that matters is lost, and every number is what it says."""

import numpy as np
import pytest
from msgspec.structs import replace
from support.diagnoses import trail

from ph_post.report.diagnosis_page import by_position, envelope, reversals, root_mean_square, since_reversal


def test_a_peak_of_one_sample_stays_in_the_envelope():
    made = trail(60_000)
    before = made.before.copy()
    before[31_337] = 1e-3
    found = envelope(replace(made, before=before), 4000)
    assert found.t.size == 4000
    assert found.before[1].max() == 1e-3
    assert found.before[0].min() == before.min()
    group = 31_337 // 15
    assert (found.before[1].argmax(), found.t[group]) == (group, made.t[15 * group])
    # What is inside a group is between its extremes.
    wide = np.repeat(found.after, 15, axis=1)
    assert np.all((wide[0] <= made.after) & (made.after <= wide[1]))


def test_missing_samples_are_missing_only_where_a_whole_group_is():
    made = trail(100)
    before = made.before.copy()
    before[10:20] = np.nan
    before[35] = np.nan
    found = envelope(replace(made, before=before), 10)
    assert np.isnan(found.before).tolist() == [[k == 1 for k in range(10)]] * 2
    assert found.before[0, 3] == np.nanmin(before[30:40])


def test_between_the_windows_of_a_long_log_nothing_is_drawn():
    # What no reading stands for has residuals of 0: it was drawn as a model without any error.
    made = trail(100)
    read = (made.t < 0.04) | (made.t >= 0.07)
    without = replace(
        made,
        before=np.where(read, made.before, 0.0),
        after=np.where(read, made.after, 0.0),
        counted=read,
        held_out=np.zeros_like(read),
    )
    found = envelope(without, 10)
    for drawn in (found.before, found.after):
        assert np.isnan(drawn).tolist() == [[4 <= k < 7 for k in range(10)]] * 2


def test_a_short_record_is_kept_sample_by_sample():
    made = trail(50)
    found = envelope(made, 4000)
    assert np.array_equal(found.before, [made.before, made.before])


def test_reversals_stand_where_the_command_leaves_again():
    # Up for 1 s, a dwell of 0.5 s, down for 2 s, up again; rounded to 1 um, which dithers.
    t = np.arange(4500) * 1e-3
    command = 0.01 * np.interp(t, [0.0, 1.0, 1.5, 3.5, 4.5], [0.0, 1.0, 1.0, -1.0, 0.0])
    dither = 5e-7 * (-1.0) ** np.arange(t.size)
    starts, senses = reversals(command + dither)
    assert senses.tolist() == [1, -1, 1]
    assert starts[0] == 0
    assert t[starts[1]] == pytest.approx(1.5, abs=2e-3)
    assert t[starts[2]] == pytest.approx(3.5, abs=2e-3)


def test_a_command_that_stands_still_never_turns_back():
    starts, senses = reversals(np.full(10, 0.3))
    assert (starts.size, senses.size) == (0, 0)
    still = replace(trail(10), command=np.full(10, 0.3))
    assert by_position(still, 4) == {}
    assert since_reversal(still, 4) is None


def test_the_residual_by_position_is_a_mean_of_each_direction():
    # The residual is 2 um times the place in units of the amplitude, +-3 um by the direction of travel.
    made = trail(20_000)
    speed = np.gradient(made.command)
    before = 2e-6 * made.command / 0.05 + 3e-6 * np.sign(speed)
    found = by_position(replace(made, before=before, after=np.zeros_like(before)), 10)
    for way in (1, -1):
        inner = slice(1, -1)  # in the end steps the sine stays long at one end
        expected = 2e-6 * found[way].x / 0.05 + way * 3e-6
        assert found[way].x == pytest.approx(0.05 * np.arange(-0.9, 1.0, 0.2))
        assert found[way].before[inner] == pytest.approx(expected[inner], abs=2e-8)
        assert not found[way].after.any()


def test_the_residual_since_a_reversal_decays_as_it_was_made():
    found = since_reversal(trail(20_000, noise=0.0), 50)
    # A second between reversals, its last sample 0.999 s behind the first, in fifty steps.
    assert found.x[0] == pytest.approx(0.00999)
    # trail() makes 10 um exp(-t/0.05 s); the mean of its square over a step:
    tau, low, high = 0.05, found.x - 0.00999, found.x + 0.00999
    squares = (np.exp(-2 * low / tau) - np.exp(-2 * high / tau)) * tau / 2 / (high - low)
    assert found.before == pytest.approx(np.sqrt(1e-10 * squares), rel=0.03)
    assert found.after == pytest.approx(0.1 * found.before, rel=1e-9)


def test_what_does_not_count_is_in_no_mean():
    made = trail(20_000)
    before = np.where(made.counted, made.before, 1.0)
    assert since_reversal(replace(made, before=before), 50).before.max() < 1e-4
    assert max(np.nanmax(one.before) for one in by_position(replace(made, before=before), 20).values()) < 1e-4


def test_root_mean_squares_leave_out_what_is_missing():
    assert root_mean_square(np.array([3.0, np.nan, 4.0, 9.0]), np.array([True, True, True, False])) == (
        pytest.approx(np.sqrt(12.5))
    )
    assert np.isnan(root_mean_square(np.zeros(3), np.zeros(3, dtype=bool)))
