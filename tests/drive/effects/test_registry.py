"""Effects: what each does to the plant, from hand-derived physics, and how they are found, read and combined.

The axis: b = 5e-4 s², c = 5e-3 s, N = 25, r = 1 m/rad, η = 0.35, K = 5e5 N/m.
"""

import math
import re
from importlib.metadata import EntryPoint
from itertools import permutations
from pathlib import Path

import msgspec
import pytest
from msgspec.structs import replace

from ph_post.drive.effects.active import active_effects, ignored_effects, plant_of
from ph_post.drive.effects.base import MILLIMETRE, Effect, EffectFault, Parameter
from ph_post.drive.effects.registry import BUILT_IN, CATALOGUE, GROUP, effect_names, find_effect
from ph_post.drive.machinefile import read_machine
from ph_post.drive.plant import GapProfile, Plant, TableReading, base_plant
from ph_post.errors import InputError
from ph_post.types import Axis, EffectSetting, Gap, Limits, Scenario, Servo

ROOT = Path(__file__).parents[3]
THIS_STEP = {
    "coulomb_friction",
    "stribeck_friction",
    "viscous_friction",
    "load_offset",
    "elastic_windup",
    "engagement_impact",
    "transport_delay",
    "torque_saturation",
    "cyclic_error",
    "scale_error",
    "thermal_growth",
    "squareness",
    "friction_asymmetry",
    "cogging",
    "cutting_force",
    "position_dependent_backlash",
}
AXIS = Axis(
    name="X",
    feedback="load",
    servo=Servo(b=5e-4, c=5e-3, stiffness=5e5),
    gap=Gap(lost_motion=5e-3, motor_angle=0.125, gear_ratio=25.0, travel_per_rad=1.0, inertia_fraction=0.35),
    limits=Limits(velocity=0.5, acceleration=5.0, jerk=100.0),
)


def changed(*effects, axis=AXIS, scenario=Scenario()):  # noqa: B008
    """What effects, given as (name, parameters), change in the plant of `axis`."""
    settings = tuple(EffectSetting(name=name, parameters=given) for name, given in effects)
    before = msgspec.structs.asdict(base_plant(axis, scenario))
    after = msgspec.structs.asdict(plant_of(replace(axis, effects=settings), scenario))
    return {key: value for key, value in after.items() if value != before[key]}


def test_the_catalogue_of_this_step():
    assert set(effect_names()) >= THIS_STEP
    assert set(CATALOGUE) >= THIS_STEP


@pytest.mark.parametrize("name", sorted(THIS_STEP))
def test_every_effect_says_what_it_is_and_where_it_comes_from(name):
    effect = find_effect(name)
    assert effect.name == name
    assert effect.kind in {"command", "force", "state", "reading", "across axes"}
    assert effect.summary
    assert re.search(r"doi:10\.\d{4}/|\d{4}$", effect.source)
    assert len({one.name for one in effect.parameters}) == len(effect.parameters)
    for one in effect.parameters:
        assert one.meaning
        assert (one.unit is None) == bool(one.choices)


def test_what_has_a_sign():
    unbounded = {
        (name, one.name)
        for name in THIS_STEP
        for one in find_effect(name).parameters
        if one.unit is not None and one.bounds.ge is None and one.bounds.gt is None
    }
    assert unbounded == {
        ("load_offset", "force_n"),
        ("load_offset", "following_error_mm"),
        ("cyclic_error", "amplitude_mm"),
        ("cyclic_error", "phase_deg"),
        ("thermal_growth", "growth_mm"),
        ("friction_asymmetry", "plus_n_s_per_mm"),
        ("friction_asymmetry", "plus_following_error_s"),
        ("friction_asymmetry", "minus_n_s_per_mm"),
        ("friction_asymmetry", "minus_following_error_s"),
        ("cogging", "force_n"),
        ("cogging", "following_error_mm"),
        ("cogging", "phase_deg"),
        ("cutting_force", "force_n"),
        ("cutting_force", "following_error_mm"),
        ("position_dependent_backlash", "slope_mm_per_mm"),
        ("position_dependent_backlash", "reference_mm"),
        ("position_dependent_backlash", "bump_mm"),
        ("position_dependent_backlash", "centre_mm"),
    }


@pytest.mark.parametrize(
    ("name", "given", "expected"),
    [
        # 20 N / 5e5 N/m
        ("coulomb_friction", {"force_n": 20}, {"coulomb_plus": 4e-5, "coulomb_minus": 4e-5}),
        ("coulomb_friction", {"following_error_mm": 0.04}, {"coulomb_plus": 4e-5, "coulomb_minus": 4e-5}),
        # F_s - F = 15 N
        (
            "stribeck_friction",
            {"force_n": 20, "static_force_n": 35, "stribeck_velocity_mm_s": 2},
            {"coulomb_plus": 4e-5, "coulomb_minus": 4e-5, "static": 3e-5, "stribeck_speed": 2e-3},
        ),
        (
            "stribeck_friction",
            {"following_error_mm": 0.04, "static_force_n": 35, "stribeck_velocity_mm_s": 2},
            {"coulomb_plus": 4e-5, "coulomb_minus": 4e-5, "static": 3e-5, "stribeck_speed": 2e-3},
        ),
        # 0.5 N s/mm = 500 N s/m; at 0.1 m/s that is 50 N, held by an error of 1e-4 m = 0.1 m/s * 1e-3 s
        ("viscous_friction", {"coefficient_n_s_per_mm": 0.5}, {"viscous_plus": 1e-3, "viscous_minus": 1e-3}),
        ("viscous_friction", {"following_error_s": 1e-3}, {"viscous_plus": 1e-3, "viscous_minus": 1e-3}),
        (
            "friction_asymmetry",
            {"plus_n_s_per_mm": 0.5, "minus_following_error_s": -1e-3},
            {"viscous_plus": 1e-3, "viscous_minus": -1e-3},
        ),
        # Even at 50 mm/s: half of the difference, 1e-3 s, times that.
        (
            "friction_asymmetry",
            {"plus_following_error_s": 1e-3, "minus_following_error_s": -1e-3, "even_at_mm_s": 50},
            {"viscous_plus": 1e-3, "viscous_minus": -1e-3, "load": -5e-5},
        ),
        ("load_offset", {"force_n": -150}, {"load": -3e-4}),
        ("load_offset", {"following_error_mm": 0.3}, {"load": 3e-4}),
        (
            "elastic_windup",
            {"resonance_hz": 50, "damping_ratio": 0.03},
            {"windup_frequency": 314.1592653589793, "windup_damping": 0.03},
        ),
        ("engagement_impact", {"kept": 0.5}, {"pickup": "momentum", "kept": 0.5}),
        ("engagement_impact", {}, {"pickup": "momentum"}),
        ("transport_delay", {"delay_ms": 3}, {"command_delay": 3e-3}),
        ("transport_delay", {"delay_ms": 3, "where": "command"}, {"command_delay": 3e-3}),
        ("transport_delay", {"delay_ms": 3, "where": "reading"}, {"reading_delay": 3e-3}),
        (
            "cyclic_error",
            {"amplitude_mm": 0.004, "period_mm": 5, "phase_deg": 90},
            {"reading": TableReading(cycles=((4e-6, 5e-3, math.pi / 2),))},
        ),
        (
            "cyclic_error",
            {"amplitude_mm": -0.004, "period_mm": 5},
            {"reading": TableReading(cycles=((-4e-6, 5e-3, 0.0),))},
        ),
        # 5° of the motor are 5 π/180 · r/N of travel
        (
            "cogging",
            {"force_n": 20, "period_motor_deg": 5, "phase_deg": -90},
            {"cogging": (pytest.approx((4e-5, math.pi / 900, -math.pi / 2), rel=1e-14),)},
        ),
        (
            "cogging",
            {"following_error_mm": 0.04, "period_mm": 2},
            {"cogging": (pytest.approx((4e-5, 2e-3, 0.0), rel=1e-14),)},
        ),
        ("cutting_force", {"force_n": 20}, {"cutting": (pytest.approx((4e-5, 1 / 60, 0.0), rel=1e-14),)}),
        (
            "cutting_force",
            {"following_error_mm": -0.04, "feed_mm_min": 600, "exponent": 0.7},
            {"cutting": (pytest.approx((-4e-5, 0.01, 0.7), rel=1e-14),)},
        ),
        (
            "position_dependent_backlash",
            {"slope_mm_per_mm": 1e-4, "reference_mm": 200},
            {"widening": GapProfile(slope=1e-4, reference=0.2, width=0.1)},
        ),
        (
            "position_dependent_backlash",
            {"bump_mm": 0.03, "centre_mm": -40, "width_mm": 25},
            {"widening": GapProfile(bump=3e-5, centre=-0.04, width=0.025)},
        ),
        ("scale_error", {"error": -2e-5}, {"reading": TableReading(scale=-2e-5)}),
        (
            "thermal_growth",
            {"growth_mm": 0.03, "time_constant_s": 1200},
            {"reading": TableReading(growths=((3e-5, 1200.0),))},
        ),
        ("squareness", {"angle_rad": 1e-4}, {"reading": TableReading(others=(("Y", 1e-4),))}),
        ("squareness", {"angle_rad": 1e-4, "other": "Z"}, {"reading": TableReading(others=(("Z", 1e-4),))}),
        # a torque T at the motor is a force T N / r at the table: 2 N m -> 50 N -> 1e-4 m
        ("torque_saturation", {"torque_n_m": 2}, {"saturation": 1e-4}),
        ("torque_saturation", {"following_error_mm": 0.1}, {"saturation": 1e-4}),
        # Eq. (16): the free motor's acceleration is C u, C = N / (η r b) = 142857.14; 4000 / C
        ("torque_saturation", {"motor_acceleration_rad_s2": 4000}, {"saturation": 0.028}),
    ],
)
def test_what_an_effect_does_to_the_plant(name, given, expected):
    found = changed((name, given))
    assert found.keys() == expected.keys()
    for key, value in expected.items():
        exact = isinstance(value, str | TableReading | GapProfile | tuple)
        assert found[key] == (value if exact else pytest.approx(value, rel=1e-14))


def test_the_largest_torque_moves_the_whole_axis_as_newton_says():
    """Engaged, b ẍ = u; the mass is K b, so that a force F accelerates by F / (K b)."""
    u = changed(("torque_saturation", {"torque_n_m": 2}))["saturation"]
    force, mass = 2 * 25.0 / 1.0, 5e5 * 5e-4
    assert u / AXIS.servo.b == pytest.approx(force / mass, rel=1e-14)


def test_the_torque_and_the_acceleration_of_the_free_motor_are_one_limit():
    """J_m = η J, and J = b K r² / N² by Eq. (9) with K = k_p k_a k_t N / r."""
    inertia = 0.35 * 5e-4 * 5e5 * 1.0**2 / 25.0**2
    by_torque = changed(("torque_saturation", {"torque_n_m": inertia * 4000}))
    by_acceleration = changed(("torque_saturation", {"motor_acceleration_rad_s2": 4000}))
    assert by_torque["saturation"] == pytest.approx(by_acceleration["saturation"], rel=1e-14)


@pytest.mark.parametrize("pickup", ["momentum", "contact"])
def test_an_impact_leaves_a_rule_that_keeps_momentum(pickup):
    assert changed(("engagement_impact", {"kept": 0.5}), scenario=Scenario(pickup=pickup)) == {"kept": 0.5}


ALL = (
    ("coulomb_friction", {"force_n": 20}),
    ("stribeck_friction", {"force_n": 5, "static_force_n": 10, "stribeck_velocity_mm_s": 2}),
    ("viscous_friction", {"following_error_s": 1e-3}),
    ("load_offset", {"force_n": 150}),
    ("elastic_windup", {"resonance_hz": 50, "damping_ratio": 0.03}),
    ("engagement_impact", {"kept": 0.5}),
    ("transport_delay", {"delay_ms": 3}),
    ("torque_saturation", {"following_error_mm": 0.1}),
    ("cyclic_error", {"amplitude_mm": 0.004, "period_mm": 5}),
    ("scale_error", {"error": 1e-5}),
    ("thermal_growth", {"growth_mm": 0.03, "time_constant_s": 1200}),
    ("squareness", {"angle_rad": 1e-4}),
    ("friction_asymmetry", {"plus_following_error_s": 5e-4, "minus_following_error_s": -5e-4}),
    ("cogging", {"following_error_mm": 0.04, "period_mm": 2}),
    ("cutting_force", {"following_error_mm": 0.03, "feed_mm_min": 600}),
    ("position_dependent_backlash", {"slope_mm_per_mm": 1e-4}),
)


def test_effects_of_all_kinds_act_together():
    assert {name for name, _ in ALL} == THIS_STEP
    found = changed(*ALL)
    assert found.pop("pickup") == "momentum"
    assert found.pop("reading") == TableReading(
        cycles=((4e-6, 5e-3, 0.0),), scale=1e-5, growths=((3e-5, 1200.0),), others=(("Y", 1e-4),)
    )
    assert found.pop("cogging") == (pytest.approx((4e-5, 2e-3, 0.0)),)
    assert found.pop("cutting") == (pytest.approx((3e-5, 0.01, 0.0)),)
    assert found.pop("widening") == GapProfile(slope=1e-4, width=0.1)
    assert found == pytest.approx(
        {
            "coulomb_plus": 5e-5,
            "coulomb_minus": 5e-5,
            "static": 1e-5,
            "stribeck_speed": 2e-3,
            "viscous_plus": 1.5e-3,
            "viscous_minus": 5e-4,
            "load": 3e-4,
            "windup_frequency": 100 * math.pi,
            "windup_damping": 0.03,
            "kept": 0.5,
            "command_delay": 3e-3,
            "saturation": 1e-4,
        },
        rel=1e-14,
    )


def test_no_effect_changes_nothing():
    assert changed() == {}
    assert plant_of(AXIS, Scenario(gap=0.5, gain=1.2)) == base_plant(AXIS, Scenario(gap=0.5, gain=1.2))


@pytest.mark.parametrize(
    ("effects", "expected"),
    [
        (
            [("coulomb_friction", {"force_n": force}) for force in (10, 20, 40)],
            {"coulomb_plus": 1.4e-4, "coulomb_minus": 1.4e-4},
        ),
        ([("load_offset", {"force_n": force}) for force in (100, -30, 5)], {"load": 1.5e-4}),
        (
            [("viscous_friction", {"following_error_s": lag}) for lag in (1e-3, 2e-3)],
            {"viscous_plus": 3e-3, "viscous_minus": 3e-3},
        ),
        (
            [("transport_delay", {"delay_ms": ms, "where": at}) for ms, at in ((1, "command"), (2, "reading"))]
            + [("transport_delay", {"delay_ms": 4})],
            {"command_delay": 5e-3, "reading_delay": 2e-3},
        ),
        (
            [("torque_saturation", {"following_error_mm": error}) for error in (0.3, 0.1, 0.2)],
            {"saturation": 1e-4},
        ),
    ],
)
def test_several_of_a_kind_in_any_order(effects, expected):
    for order in permutations(effects):
        assert changed(*order) == pytest.approx(expected, rel=1e-14)


def test_a_scenario_keeps_its_factors_beside_effects():
    found = plant_of(
        replace(AXIS, effects=(EffectSetting(name="load_offset", parameters={"force_n": 50}),)),
        Scenario(gap=0.5, gain=0.5),
    )
    assert (found.gap, found.eta, found.load) == pytest.approx((2.5e-3, 0.7, 1e-4), rel=1e-14)


def test_what_acts_and_what_does_not():
    names = ("backlash", "coulomb_friction", "servo_mismatch", "engagement_impact")
    given = {"coulomb_friction": {"force_n": 20}}
    settings = tuple(EffectSetting(name=name, parameters=given.get(name, {})) for name in names)
    axis = replace(AXIS, effects=settings)
    assert [one.effect.name for one in active_effects(axis)] == ["coulomb_friction", "engagement_impact"]
    assert [dict(one.values) for one in active_effects(axis)] == [
        {"force": pytest.approx(4e-5)},
        {"kept": 1.0},
    ]
    assert ignored_effects(axis) == ("backlash", "servo_mismatch")
    # A loop over the motor does not feel how the table is picked up.
    assert ignored_effects(replace(axis, feedback="motor")) == (
        "backlash",
        "servo_mismatch",
        "engagement_impact",
    )


def test_records_made_by_hand_are_refused_as_files_are():
    axis = replace(AXIS, effects=(EffectSetting(name="load_offset", parameters={}),))
    with pytest.raises(InputError, match=r"^axis X: effects\[0\]: key \"force_n\" is missing"):
        plant_of(axis, Scenario())
    soft = replace(
        AXIS,
        servo=Servo(b=5e-4, c=5e-3),
        effects=(EffectSetting(name="load_offset", parameters={"force_n": 3}),),
    )
    with pytest.raises(InputError, match=r"^axis X: effects\[0\]\.force_n: N cannot be converted"):
        plant_of(soft, Scenario())


@pytest.mark.parametrize("missing", ["gear_ratio", "travel_per_rad", "inertia_fraction", "b"])
def test_a_limit_by_acceleration_needs_the_motors_constants(missing):
    servo = replace(AXIS.servo, b=0.0) if missing == "b" else AXIS.servo
    gap = AXIS.gap if missing == "b" else replace(AXIS.gap, **{missing: None})
    setting = EffectSetting(name="torque_saturation", parameters={"motor_acceleration_rad_s2": 1000})
    with pytest.raises(InputError, match=r"rad/s² cannot be converted on this axis; expected b > 0"):
        plant_of(replace(AXIS, servo=servo, gap=gap, effects=(setting,)), Scenario())


# An effect of somebody else, under a name of its own and under a reserved one.


def _bump(plant, values):
    return replace(plant, forces=(*plant.forces, lambda t, x, v, sense: values["size"]))


def _no_hundred(axis, values):
    if values["size"] == pytest.approx(0.1):
        return EffectFault(gives="size", what="a hundred", expected="anything else")
    return None


SIZE = Parameter(name="size_mm", gives="size", unit=MILLIMETRE, default=0.25, meaning="how much")
BUMP = Effect(
    name="bump",
    kind="force",
    summary="a bump",
    source="this test, 2024",
    parameters=(SIZE,),
    apply=_bump,
    fault=_no_hundred,
)
MISMATCH = replace(BUMP, name="servo_mismatch")


class Entry:
    def __init__(self, name, effect):
        self.name = name
        self.effect = effect

    def load(self):
        return self.effect


@pytest.fixture
def plugged_in(monkeypatch):
    points = [Entry("bump", BUMP), Entry("servo_mismatch", MISMATCH), Entry("wrong", "a string")]
    monkeypatch.setattr("ph_post.registry.entry_points", lambda group: points if group == "ph_post.effects" else [])


@pytest.fixture
def read(tmp_path):
    def read_axis(effects):
        paper = Path(__file__).parents[3] / "samples" / "machines" / "paper.toml"
        head = paper.read_text(encoding="utf-8").split("[axes.Y]")[0]
        file = tmp_path / "machine.toml"
        file.write_text(head + effects, encoding="utf-8")
        return read_machine(file).axes["X"]

    return read_axis


@pytest.mark.usefixtures("plugged_in")
@pytest.mark.parametrize("name", ["bump", "servo_mismatch"])
def test_others_register_by_entry_point(read, name):
    assert name in effect_names()
    axis = read(f'[[axes.X.effects]]\nname = "{name}"\nsize_mm = 3\n[[axes.X.effects]]\nname = "{name}"\n')
    assert ignored_effects(axis) == ()
    plant = plant_of(axis, Scenario())
    assert [force(0.0, 0.0, 0.0, 1.0) for force in plant.forces] == pytest.approx([3e-3, 2.5e-4], rel=1e-14)
    with pytest.raises(InputError, match=r'effects\[0\]: unknown key "size"; expected size_mm'):
        read(f'[[axes.X.effects]]\nname = "{name}"\nsize = 3\n')
    with pytest.raises(InputError, match=r"effects\[0\]\.size_mm: a hundred; expected anything else; got 100"):
        read(f'[[axes.X.effects]]\nname = "{name}"\nsize_mm = 100\n')


@pytest.mark.usefixtures("plugged_in")
def test_what_is_registered_must_be_an_effect(read):
    with pytest.raises(
        InputError, match=r"effects\[0\]\.name: the entry point 'wrong' is no effect; expected an Effect record"
    ):
        read('[[axes.X.effects]]\nname = "wrong"\n')


def test_a_real_entry_point_of_a_built_in_name_does_not_replace_it(monkeypatch):
    point = EntryPoint("load_offset", "ph_post.drive.effects.coulomb_friction:EFFECT", GROUP)
    monkeypatch.setattr("ph_post.registry.entry_points", lambda group: [point])
    assert find_effect("load_offset").name == "load_offset"


def test_every_effect_of_the_package_is_built_in():

    folder = ROOT / "ph_post" / "drive" / "effects"
    assert {file.stem for file in folder.glob("*.py") if "\nEFFECT = " in file.read_text(encoding="utf-8")} == set(
        BUILT_IN
    )
    assert set(BUILT_IN) == THIS_STEP


def test_the_old_mill():
    axes = read_machine("old_mill").axes
    x, y, z = (plant_of(axes[name], Scenario()) for name in "XYZ")
    # 80 N / 2000 N/mm, and 150 N and 120 N / 3000 N/mm
    assert (x.coulomb_plus, x.coulomb_minus) == pytest.approx((40e-6, 40e-6), rel=1e-14)
    assert (y.coulomb_plus, y.coulomb_minus) == pytest.approx((60e-6, 60e-6), rel=1e-14)
    assert (z.coulomb_plus, z.load) == pytest.approx((50e-6, 40e-6), rel=1e-14)
    assert {plant.feedback for plant in (x, y, z)} == {"load"}
    assert not any(ignored_effects(axis) for axis in axes.values())


def test_a_plant_is_not_changed_in_place():
    plant = Plant(feedback="load", b=1.0, c=1.0)
    find_effect("load_offset").apply(plant, {"force": 1.0})
    assert plant == Plant(feedback="load", b=1.0, c=1.0)
