"""Machine files: units, the ways of giving one thing, and what each kind of feedback needs.

The refusals are in tests/bad/machines; here is what must be accepted and what it becomes.
"""

import hashlib
import io
import math
import sys

import pytest
from msgspec.structs import astuple, replace

from ph_post.dialects.planners import planner_notes, planner_of
from ph_post.drive.effects.registry import CATALOGUE, effect_names, known_names
from ph_post.drive.machinefile import read_machine
from ph_post.errors import InputError
from ph_post.types import RoundedPath

HEAD = '[controller]\ndialect = "grbl"\nservo_period_ms = 2.0\n'
LIMITS = "max_velocity_mm_s = 500\nmax_acceleration_mm_s2 = 5000\nmax_jerk_mm_s3 = 100000\n"
SERVO = "b = 0.0005\nc = 0.005\n"
DRIVE = "gear_ratio = 25.0\ntravel_per_rad_mm = 1000.0\ninertia_fraction = 0.35\nmotor_time_constant_s = 2.0\n"
GAP = "backlash_motor_rad = 0.125\n"
PHYSICAL = "J = 2e-4\nB = 2e-3\nk_p = 10.0\nk_a = 2.0\nk_t = 0.5\n"


@pytest.fixture
def read(tmp_path):
    def read_axis(*parts, feedback="load", tail=""):
        text = f'{HEAD}[axes.X]\nfeedback = "{feedback}"\n{"".join(parts)}{LIMITS}{tail}'
        file = tmp_path / "machine.toml"
        file.write_text(text, encoding="utf-8")
        return read_machine(file).axes["X"]

    return read_axis


def test_everything_arrives_in_si(tmp_path):
    text = f"""
name = "all of it"
{HEAD}
[axes.Y]
feedback = "load"
{SERVO}{DRIVE}{GAP}{LIMITS}
pickup = "momentum"
initial_flank = "-"
backlash_uncertainty = 0.1
beta_uncertainty = 0
gain_uncertainty = 0.3
friction_uncertainty = 0.4
max_motor_acceleration_rad_s2 = 4000
[axes.Y.control]
ki_over_kp_per_s = 2.0
kd_over_kp_s = 0.001
[[axes.Y.effects]]
name = "servo_mismatch"
amplitude_mm = 0.003
harmonics = [1, 2]
"""
    file = tmp_path / "all.toml"
    file.write_text(text, encoding="utf-8")
    machine = read_machine(file)
    assert (machine.name, machine.dialect, machine.servo_period) == ("all of it", "grbl", 0.002)
    assert machine.digest == hashlib.sha256(text.encode()).hexdigest()
    axis = machine.axes["Y"]
    assert (axis.name, axis.feedback) == ("Y", "load")
    assert (axis.servo.b, axis.servo.c, axis.servo.ki_over_kp, axis.servo.kd_over_kp) == (
        0.0005,
        0.005,
        2.0,
        0.001,
    )
    gap = axis.gap
    assert (gap.motor_angle, gap.gear_ratio, gap.travel_per_rad) == (0.125, 25.0, 1.0)
    assert (gap.lost_motion, gap.inertia_fraction, gap.beta) == (0.005, 0.35, 0.5)
    assert (gap.pickup, gap.initial_flank) == ("momentum", "-")
    limits = axis.limits
    assert (limits.velocity, limits.acceleration, limits.jerk, limits.motor_acceleration) == (
        0.5,
        5.0,
        100.0,
        4000.0,
    )
    assert (axis.uncertainty.backlash, axis.uncertainty.beta, axis.uncertainty.gain) == (0.1, 0.0, 0.3)
    assert axis.uncertainty.friction == 0.4
    (effect,) = axis.effects
    assert (effect.name, effect.parameters) == (
        "servo_mismatch",
        {"amplitude_mm": 0.003, "harmonics": [1, 2]},
    )


def test_what_may_be_left_out_has_its_default(read):
    axis = read(SERVO, DRIVE, GAP)
    assert (axis.gap.pickup, axis.gap.initial_flank, axis.limits.motor_acceleration) == (
        None,
        "unknown",
        None,
    )
    assert (axis.uncertainty.backlash, axis.uncertainty.beta, axis.uncertainty.gain) == (0.2, 0.2, 0.2)
    assert axis.uncertainty.friction == 0.2
    assert (axis.servo.ki_over_kp, axis.servo.kd_over_kp, axis.effects) == (0.0, 0.0, ())


def test_a_machine_without_a_name_has_its_files(tmp_path):
    file = tmp_path / "lathe.toml"
    file.write_text(f'{HEAD}[axes.X]\nfeedback = "none"\nb = 0\nc = 0\nlost_motion_mm = 0\n{LIMITS}', encoding="utf-8")
    assert read_machine(file).name == "lathe"


PLANNERS = {
    "grbl": ("junction_deviation_mm = 0.02\narc_tolerance_mm = 0.005\ndwell_step_ms = 20", (2e-5, 5e-6, 0.02)),
    "klipper": (
        "square_corner_velocity_mm_s = 8\narc_resolution_mm = 0.1\nmax_accel_to_decel = 900",
        (8e-3, 1e-4, 0.0),
    ),
    "marlin": ("jerk_mm_s = 8\narc_segment_mm = 0.05", ((8e-3, 8e-3, 3e-4), 5e-5, 0.0)),
}


@pytest.mark.parametrize("dialect", PLANNERS)
def test_the_file_states_the_planner_in_place_of_the_firmwares_defaults(tmp_path, dialect):
    keys, (corner, chord, step) = PLANNERS[dialect]
    file = tmp_path / "machine.toml"
    head = f'[controller]\ndialect = "{dialect}"\nservo_period_ms = 1\n{keys}\n'
    file.write_text(f'{head}[axes.X]\nfeedback = "none"\nb = 0\nc = 0\nlost_motion_mm = 0\n{LIMITS}')
    machine = read_machine(file)
    planner = planner_of(machine)
    assert next(value for value in astuple(planner.corner)) == pytest.approx(corner)
    assert next(value for value in astuple(planner.chords)) == pytest.approx(chord)
    assert planner.dwell_step == pytest.approx(step)
    assert planner_notes(machine) == ()
    other = planner_of(replace(machine, dialect="linuxcnc"))
    assert other == RoundedPath(dwell_step=pytest.approx(step)), "settings of another planner mean nothing to it"
    assert planner_of(replace(machine, dialect="nobody's")) == other


def test_an_unknown_dialect_may_have_any_planner(tmp_path):
    file = tmp_path / "machine.toml"
    head = '[controller]\ndialect = "nobody"\nservo_period_ms = 1\njunction_deviation_mm = 0.02\n'
    file.write_text(f'{head}[axes.X]\nfeedback = "none"\nb = 0\nc = 0\nlost_motion_mm = 0\n{LIMITS}')
    assert read_machine(file).planner.junction_deviation == 2e-5


def test_what_the_planner_lacks_is_said_once_with_the_defaults(tmp_path):
    file = tmp_path / "machine.toml"
    file.write_text(
        f'{HEAD}arc_tolerance_mm = 0.01\n[axes.X]\nfeedback = "none"\nb = 0\nc = 0\nlost_motion_mm = 0\n{LIMITS}'
    )
    assert planner_notes(read_machine(file)) == (
        "the machine file does not state junction_deviation_mm (0.01): defaults of grbl",
    )
    assert planner_notes(read_machine("mill")) == ()


def test_standard_input(monkeypatch, tmp_path):
    text = f'{HEAD}[axes.X]\nfeedback = "none"\nb = 0\nc = 0\nlost_motion_mm = 0.1\n{LIMITS}'
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(text.encode())))
    assert read_machine("-").axes["X"].gap.lost_motion == 1e-4
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"[")))
    with pytest.raises(InputError, match=r"^stdin:1"):
        read_machine("-")


def test_b_and_c_from_the_physical_constants(read):
    # Eq. (9): N J / (k_p k_a k_t r) with N = 25, r = 1 m/rad, k_p k_a k_t = 10
    axis = read(PHYSICAL, DRIVE, GAP)
    assert axis.servo.b == pytest.approx(25 * 2e-4 / 10, rel=4e-16)
    assert axis.servo.c == pytest.approx(25 * 2e-3 / 10, rel=4e-16)


def test_the_long_names_of_the_physical_constants_are_the_short_ones(read):
    long = (
        "inertia_kg_m2 = 2e-4\ndamping_kg_m2_s = 2e-3\nposition_gain_v_per_m = 10.0\n"
        "amplifier_gain_a_per_v = 2.0\ntorque_constant_n_m_per_a = 0.5\n"
    )
    short = "N = 25.0\nr = 1.0\ninertia_fraction = 0.35\nmotor_time_constant_s = 2.0\n"
    assert read(long, DRIVE, GAP) == read(PHYSICAL, DRIVE, GAP) == read(PHYSICAL, short, GAP)


def test_the_same_thing_given_twice_may_differ_by_rounding(read):
    once = read(SERVO, DRIVE, GAP, "servo_stiffness_n_per_mm = 0.25\n")
    lead = f"screw_lead_mm = {2000 * math.pi:.6g}\n"
    assert read(SERVO, DRIVE, GAP, lead, "lost_motion_mm = 5.001\n", PHYSICAL, "N = 25.01\n") == once


def test_the_lead_is_the_travel_of_a_turn(read):
    turned = DRIVE.replace("travel_per_rad_mm = 1000.0", "screw_lead_mm = 5.0")
    axis = read(SERVO, turned, "lost_motion_mm = 0.03\n")
    assert axis.gap.travel_per_rad == pytest.approx(0.005 / (2 * math.pi), rel=4e-16)
    assert axis.gap.motor_angle == pytest.approx(0.03e-3 * 25 * 2 * math.pi / 0.005, rel=1e-15)


@pytest.mark.parametrize("gap", ["backlash_motor_rad = 0.0\n", "lost_motion_mm = 0\n"])
def test_a_gap_of_zero(read, gap):
    axis = read(SERVO, DRIVE, gap)
    assert (axis.gap.lost_motion, axis.gap.motor_angle) == (0.0, 0.0)


@pytest.mark.parametrize("feedback", ["motor", "none"])
def test_motor_and_open_loop_need_only_the_lost_motion(read, feedback):
    axis = read(SERVO, "lost_motion_mm = 0.05\n", feedback=feedback)
    assert axis.gap.lost_motion == pytest.approx(5e-5, rel=4e-16)
    assert (axis.gap.motor_angle, axis.gap.gear_ratio, axis.gap.beta) == (None, None, None)


def test_a_motor_angle_needs_gear_and_lead_only(read):
    axis = read(SERVO, "gear_ratio = 25\nr = 1.0\n", GAP, feedback="motor")
    assert axis.gap.lost_motion == 0.005


def test_an_ideal_stepper(read):
    axis = read("b = 0\nc = 0.0\n", "lost_motion_mm = 0.05\n", feedback="none")
    assert (axis.servo.b, axis.servo.c) == (0.0, 0.0)


@pytest.mark.parametrize(("c", "ok"), [(0.0005 * 0.35 / 2.0, True), (0.0005 * 0.35 / 2.0 * 0.999, False)])
def test_the_damping_of_the_load_may_be_zero_but_not_less(read, c, ok):
    servo = f"b = 0.0005\nc = {c!r}\n"
    if ok:
        assert read(servo, DRIVE, GAP).servo.c == c
        return
    with pytest.raises(InputError, match=r"axes\.X\.c: the load would have negative damping"):
        read(servo, DRIVE, GAP)


@pytest.mark.parametrize(("ki", "ok"), [(9.99, True), (10.0, False)])
def test_the_loop_must_settle(read, ki, ok):
    """b s³ + c s² + s + ki has its roots on the left exactly for ki < c / b (Routh)."""
    tail = f"[axes.X.control]\nki_over_kp_per_s = {ki}\n"
    if ok:
        assert read(SERVO, DRIVE, GAP, tail=tail).servo.ki_over_kp == ki
        return
    with pytest.raises(InputError, match=r"axes\.X\.control\.ki_over_kp_per_s: the loop is unstable"):
        read(SERVO, DRIVE, GAP, tail=tail)


@pytest.mark.parametrize("name", sorted(set(CATALOGUE) - set(effect_names())))
def test_an_effect_that_nothing_acts_under_yet_is_kept(read, name):
    axis = read(SERVO, DRIVE, GAP, tail=f'[[axes.X.effects]]\nname = "{name}"\nkind = "x"\n')
    assert [(effect.name, effect.parameters) for effect in axis.effects] == [(name, {"kind": "x"})]


def test_every_effect_that_acts_is_known():
    assert set(effect_names()) <= set(known_names())
    assert known_names()[: len(CATALOGUE)] == CATALOGUE


def test_an_effect_keeps_the_keys_and_numbers_of_the_file(read):
    tail = '[[axes.X.effects]]\nname = "coulomb_friction"\nforce_n = 20\n'
    axis = read(SERVO, DRIVE, GAP, "servo_stiffness_n_per_mm = 500\n", tail=tail)
    assert [(effect.name, effect.parameters) for effect in axis.effects] == [("coulomb_friction", {"force_n": 20})]


def test_an_effect_may_be_given_in_two_ways_that_agree(read):
    tail = '[[axes.X.effects]]\nname = "coulomb_friction"\nforce_n = 20\nfollowing_error_mm = 0.04\n'
    (effect,) = read(SERVO, DRIVE, GAP, "servo_stiffness_n_per_mm = 500\n", tail=tail).effects
    assert effect.parameters == {"force_n": 20, "following_error_mm": 0.04}


def test_the_stiffness_of_the_servo(read):
    assert read(SERVO, DRIVE, GAP).servo.stiffness is None
    direct = read(SERVO, DRIVE, GAP, "servo_stiffness_n_per_mm = 500\n")
    assert direct.servo.stiffness == pytest.approx(5e5, rel=4e-16)
    # K = k_p k_a k_t N / r = 10 V/m * 2 A/V * 0.5 N m/A * 25 / (1 m/rad)
    made = read(PHYSICAL, DRIVE, GAP)
    assert made.servo.stiffness == pytest.approx(250.0, rel=4e-16)
    assert read(PHYSICAL, DRIVE, GAP, "servo_stiffness_n_per_mm = 0.25\n") == made
