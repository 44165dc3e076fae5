"""Evidence: sentences whose numbers are those of a residual that was made with them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import cache

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray
from support.engine_cases import make_axis
from support.residuals import MM, NOISE, PERIOD, UM, B, C, Moved, circles, decaying, to_and_fro, white

from ph_post.diagnose.evidence import SIGNATURES, evidence_of
from ph_post.diagnose.evidence.base import Evidence
from ph_post.diagnose.sentences import PLACES
from ph_post.identify.free_run import problem_of
from ph_post.identify.linear_drive import motion_of
from ph_post.testprograms.experiments import SHOWN
from ph_post.types import AxisLog, Feedback
from ph_post.types.diagnosis import Channel, ChannelQuality, LogQuality

Array = NDArray[np.float64]
NUMBER = r"(-?[\d.]+(?:e[+-]?\d+)?)"

lines = cache(to_and_fro)
rounds = cache(circles)


def exhibit(
    m: Moved,
    residuals: Mapping[Channel, Array],
    values: Mapping[str, float] | None = None,
    feedback: Feedback = "motor",
    gap: float = 0.0,
) -> Evidence:
    """A record that is the linear loop plus these residuals: the effort's is the effort itself."""
    size = m.x.size
    parts = {name: white(size, NOISE, k) + values for k, (name, values) in enumerate(residuals.items())}
    fields: dict[Channel, str] = {"act": "table", "motor": "motor", "force": "effort"}
    axis = AxisLog(
        command=m.log.axes["X"].command,
        **{fields[name]: one if name == "force" else m.x + one for name, one in parts.items()},
    )
    log = replace(m.log, axes={"X": axis, "Y": m.log.axes["Y"]})
    channels = tuple(
        ChannelQuality(axis="X", channel=name, resolution=0.0, noise=NOISE, noise_from="differences") for name in parts
    )
    quality = LogQuality(period=PERIOD, jitter=0.0, first=300, channels=channels)
    problem = problem_of(log, "X", make_axis(feedback, B, C, gap), quality)
    assert problem is not None
    return Evidence(
        problem=problem,
        motion=motion_of(log, m.machine, "X"),
        before=parts,
        after={name: white(size, NOISE, 9 + k) for k, name in enumerate(parts)},
        values=values or {},
        errors={},
        effort_unit="N" if "force" in parts else "",
    )


def told(name: str, one: Evidence, pattern: str) -> tuple[float, ...]:
    """Numbers of the sentence that a pattern finds, `#` for each."""
    sentences = evidence_of(name, one)
    form = re.escape(pattern).replace(r"\#", NUMBER)
    found = [match for sentence in sentences if (match := re.search(form, sentence))]
    assert found, (pattern, sentences)
    return tuple(map(float, found[0].groups()))


def test_friction_is_the_same_slow_and_fast_and_steps_the_force() -> None:
    m = lines()
    way = np.sign(m.v)
    one = exhibit(m, {"act": -7.0 * UM * way, "force": 20.3 * way + 200.0 * m.v + 95.0 * m.a - 3.0})
    small, slow, large, fast = told(
        "coulomb_friction",
        one,
        "with speed; here X_act is # µm behind at # mm/s, # µm behind at # mm/s",
    )
    assert (small, large) == pytest.approx((7.0, 7.0), abs=0.05)
    assert (slow, fast) == pytest.approx((20.0, 60.0), rel=0.1)
    assert told("coulomb_friction", one, "steps by # N where X reverses") == pytest.approx((40.6,), abs=0.1)


def test_evidence_does_not_claim_what_the_record_does_not_show() -> None:
    """What grows with speed is no Coulomb friction, and the sentence says so."""
    m = lines()
    first, *others = evidence_of("coulomb_friction", exhibit(m, {"act": -1e-4 * m.v}))
    assert first.startswith("Coulomb friction does not grow with speed; here not quite so: X_act is ")
    assert others[0] == "neither a second position nor a force was recorded that could confirm it"


def test_friction_holds_both_sides_and_a_gap_one() -> None:
    m = lines()
    lag = -7.0 * UM * np.sign(m.v)
    both, one = exhibit(m, {"act": lag, "motor": lag}), exhibit(m, {"act": lag, "motor": 0.0 * lag})
    words = "differ by # µm on the motor's side, # µm on the table's"
    assert told("coulomb_friction", both, words) == pytest.approx((14.0, 14.0), abs=0.05)
    motor, table = told("backlash", one, "the motor's side shows a step of # µm where the table's shows # µm")
    assert motor < 0.05
    assert table == pytest.approx(14.0, abs=0.05)
    assert told("backlash", one, "X_motor less X_act differs by # µm") == pytest.approx((14.0,), abs=0.05)


def test_viscous_friction_grows_with_speed() -> None:
    m = lines()
    one = exhibit(m, {"act": -1e-4 * m.v})
    small, slow, large, fast, times, faster = told(
        "viscous_friction",
        one,
        "in proportion to speed; here X_act is # µm behind at # mm/s, # µm behind at # mm/s: # times as "
        "much at # times the speed",
    )
    assert small == pytest.approx(0.1 * slow, rel=0.03)
    assert large == pytest.approx(0.1 * fast, rel=0.03)
    assert times == pytest.approx(faster, rel=0.05)
    assert told("viscous_friction", one, "is late by # ms")[0] == pytest.approx(0.1, abs=2e-3)


def test_friction_by_direction() -> None:
    m = lines()
    one = exhibit(m, {"act": np.where(m.v > 0.0, -2e-4, -0.5e-4) * m.v})
    found = told(
        "friction_asymmetry",
        one,
        "here X_act lags by # ms times the speed to plus and lags by # ms times it to minus",
    )
    assert found == pytest.approx((0.2, 0.05), rel=0.05)


def test_stribeck_friction_falls_with_speed() -> None:
    m = lines()
    one = exhibit(m, {"act": -(5.0 + 5.0 * np.exp(-np.abs(m.v) / 0.03)) * UM * np.sign(m.v)})
    first = evidence_of("stribeck_friction", one)[0]
    sizes = [float(size) for size in re.findall(NUMBER + " µm behind", first)]
    assert first.startswith("Stribeck friction is larger at slow speeds; here X_act")
    assert sizes == sorted(sizes, reverse=True)


def test_a_load_is_the_mean_of_both_directions() -> None:
    m = lines()
    one = exhibit(m, {"act": np.full(m.x.size, -2.0 * UM), "force": 20.0 * np.sign(m.v) - 3.2})
    assert told("load_offset", one, "the mean force of both directions is # N") == pytest.approx((-3.2,), abs=0.02)
    assert told("load_offset", one, "X_act is off by # µm") == pytest.approx((-2.0,), abs=0.02)


def test_a_period_stands_beside_the_lead_and_does_not_change_with_speed() -> None:
    """The lead is 2π times 2 mm; a turn of the motor half of it."""
    m, lead = lines(), 4.0 * math.pi * MM
    wave = 2.0 * UM * np.sin(2.0 * np.pi * m.x / lead + 1.0)
    one = exhibit(m, {"act": wave, "motor": 0.0 * wave}, {"period": lead})
    size, period, file, turn, share, small, _, large, _ = told(
        "cyclic_error",
        one,
        "at every feed; here # µm every # mm (the screw's lead is # mm and a turn of the motor # mm), # % of "
        "the residual; # µm at # mm/s, # µm at # mm/s",
    )
    assert (size, small, large) == pytest.approx((2.0, 2.0, 2.0), abs=0.03)
    assert (period, file, turn) == pytest.approx((12.57, 12.57, 6.283), rel=3e-3)
    assert share == pytest.approx(100.0 * 2.0 / (2.0 + 0.09), abs=2.0)
    motor, table = told("cyclic_error", one, "# µm of that period on the motor's side, # µm on the table's")
    assert motor < 0.05 < table


def test_a_period_that_another_effect_hides_is_that_of_the_fit() -> None:
    """Both periods go into the 40 mm of travel as whole numbers: neither holds a part of the other."""
    m = lines()
    small, large = (a * UM * np.sin(2.0 * np.pi * m.x / p) for a, p in ((1.0, 2.5 * MM), (4.0, 8.0 * MM)))
    one = exhibit(m, {"act": small + large}, {"period": 2.5 * MM})
    found = told("cyclic_error", one, "here # µm every # mm by the fit (")
    assert found == pytest.approx((1.0, 2.5), rel=0.03)
    (share,) = told("cyclic_error", one, "), # % of the residual")
    assert share == pytest.approx(100.0 / 17.0, abs=1.0)


def test_cogging_shows_in_the_force() -> None:
    m = lines()
    wave = np.sin(2.0 * np.pi * m.x / (5.0 * MM))
    one = exhibit(m, {"act": -2.0 * UM * wave, "force": 3.0 * wave + 20.0 * np.sign(m.v)}, {"period": 5.0 * MM})
    assert told("cogging", one, "the force has # N of that period") == pytest.approx((3.0,), abs=0.05)


def test_scale_and_squareness_are_slopes() -> None:
    m = rounds()
    one = exhibit(m, {"act": 2e-4 * m.x, "motor": 0.0 * m.x})
    found = told("scale_error", one, "gains # µm in 100 mm, # µm in the lower half of the travel and # µm in the upper")
    assert found == pytest.approx((20.0, 20.0, 20.0), rel=0.02)
    other = exhibit(m, {"act": -3e-4 * m.y}, {"other": 1.0})
    assert told("squareness", other, "goes off by # µm in 100 mm of Y") == pytest.approx((-30.0,), rel=0.02)
    ways = told("squareness", other, "the same both ways round; here # µm in 100 mm clockwise, # µm counterclockwise")
    assert ways == pytest.approx((-30.0, -30.0), rel=0.02)


def test_growth_has_its_course() -> None:
    m = lines()
    one = exhibit(m, {"act": 8.0 * UM * (1.0 - np.exp(-m.t / 20.0))}, {"time_constant": 20.0})
    change, lasts, half = told("thermal_growth", one, "drifts by # µm in # s, half of it after # s")
    assert change == pytest.approx(8.0 * (1.0 - math.exp(-3.0)), rel=0.03)
    assert lasts == pytest.approx(59.7, abs=0.1)
    assert half == pytest.approx(20.0 * math.log(2.0 / (1.0 + math.exp(-3.0))), rel=0.1)
    longer = evidence_of("thermal_growth", replace(one, values={"time_constant": 300.0}))
    assert any("shorter than the time constant of 300 s" in sentence for sentence in longer)


def test_a_delay_lags_by_the_velocity() -> None:
    m = lines()
    one = exhibit(m, {"act": -2e-3 * m.v})
    late = told("transport_delay", one, "X_act lags by # ms times the velocity and l")[0]
    assert late == pytest.approx(2.0, rel=1e-3)
    early = exhibit(m, {"act": 2e-3 * m.v})
    assert told("transport_delay", early, "X_act leads by # ms times")[0] == pytest.approx(2.0, rel=1e-3)


def test_a_servo_that_left_its_file() -> None:
    m = lines()
    one = exhibit(m, {"act": -1e-3 * m.v - 2e-5 * m.a}, {"c": 1.1 * C, "b": 0.95 * B})
    numbers = told("servo_mismatch", one, "c is # % larger, # times that and b is # % smaller, # times that")
    assert numbers == pytest.approx((10.0, 5.0, 5.0, 2.5))
    assert told("servo_mismatch", one, "lags by # ms times the velocity and lags by # µm per m/s²") == pytest.approx(
        (1.0, 20.0), rel=0.02
    )


def test_windup_is_read_between_the_sides() -> None:
    m = lines()
    resonance = 2.0 * math.pi * 40.0
    gives = m.a / resonance**2
    one = exhibit(m, {"act": -gives, "motor": 0.0 * gives}, {"resonance": resonance})
    predicted, read = told(
        "elastic_windup",
        one,
        "by the acceleration, # µm per m/s²; here motor and table part by # µm per m/s²",
    )
    assert predicted == pytest.approx(15.8)
    assert read == pytest.approx(predicted, rel=0.05)


def test_a_gap_inside_the_loop_shows_while_it_is_crossed() -> None:
    m = lines()
    one = exhibit(m, {"act": -5.0 * UM * decaying(m.v, 0.02)}, feedback="load", gap=20.0 * UM)
    near, far = told("backlash", one, "# µm rms within 60 ms after reversals, # µm elsewhere")
    # 2 x 5 µm exp(-t/20 ms) over 60 ms, squared and averaged.
    assert near == pytest.approx(10.0 * math.sqrt((1.0 - math.exp(-6.0)) / 6.0), rel=0.05)
    assert far < 0.5
    inside, _ = told("engagement_impact", one, "# µm rms within 60 ms after reversals of X, # µm elsewhere")
    assert inside == near


def test_a_gap_by_position() -> None:
    m = lines()
    one = exhibit(m, {"act": -0.5 * (20.0 * UM + 5e-4 * m.x) * np.sign(m.v)})
    sizes = told(
        "position_dependent_backlash",
        one,
        "the backlash that X_act shows is # µm at # mm, # µm at # mm, # µm at # mm",
    )
    for size, place in zip(sizes[::2], sizes[1::2], strict=True):
        assert size == pytest.approx(20.0 + 0.5 * place, abs=0.3)


def test_a_limit_shows_where_much_is_asked() -> None:
    m = lines()
    asked = np.abs(C * m.v + B * m.a)
    limit = float(np.quantile(asked[m.counted], 0.9))
    one = exhibit(m, {"act": np.where(asked > limit, -20.0 * UM, 0.0)}, {"limit": limit})
    above, below = told("torque_saturation", one, ": # µm rms where it asks for more, # µm elsewhere")
    assert above == pytest.approx(20.0, rel=0.01)
    assert below == pytest.approx(NOISE / UM, rel=0.05)


def test_a_cutting_force_goes_with_the_path() -> None:
    m = rounds()
    along = m.v / np.hypot(m.v, np.gradient(m.y, PERIOD))
    one = exhibit(m, {"act": -6.0 * UM * along})
    size, path, sign = told(
        "cutting_force",
        one,
        "# µm behind along the path; the path's direction explains # % of the residual, the sign of X alone # %",
    )
    assert size == pytest.approx(6.0, rel=0.05)
    # The mean of |cos| is 2/π, of its square 1/2: the sign holds 8/π² of the variance.
    assert path > 95.0
    assert sign == pytest.approx(100.0 * 8.0 / math.pi**2, abs=5.0)
    assert any("here it was found on this axis alone" in words for words in evidence_of("cutting_force", one))
    both = evidence_of("cutting_force", replace(one, too=("Y",)))
    assert "it acts on all axes that cut; here on Y too" in both


def test_every_name_tells_what_it_gains() -> None:
    m = lines()
    one = exhibit(m, {"act": -7.0 * UM * np.sign(m.v)})
    *_, last = evidence_of("somebody's own effect", one)
    assert re.fullmatch(r"without it the model is 7\.\d+ µm rms from X_act, with it 0\.30?\d? µm", last)


def test_all_of_the_catalogue_has_a_signature() -> None:
    from ph_post.diagnose.hypotheses import every_hypothesis

    names = {one.name for one in every_hypothesis(exhibit(lines(), {"act": np.zeros(lines().x.size)}).problem)}
    assert names | {"squareness"} == set(SIGNATURES)


def test_every_table_of_effects_has_all_of_them():
    assert set(SIGNATURES) == set(PLACES) == set(SHOWN)
