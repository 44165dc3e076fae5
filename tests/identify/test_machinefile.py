"""Machine files with what a diagnosis found: a person's text stays, and reads back as the machine found."""

import difflib
import tomllib

import numpy as np
import pytest
from msgspec.structs import replace

from ph_post.diagnose.findings import improved_axis
from ph_post.drive.machinefile import machine_of, machine_source
from ph_post.errors import SolveError
from ph_post.files.machine_text import AxisChange, edit_axes
from ph_post.files.storage import SourceText, source_of
from ph_post.identify.machinefile import diagnosed_machine
from ph_post.types import AxisLog, EffectSetting, Log, frozen
from ph_post.types.diagnosis import Diagnosis, Estimate, Finding, LogQuality, ResidualStep

LIMITS = "max_velocity_mm_s = 100\nmax_acceleration_mm_s2 = 500\nmax_jerk_mm_s3 = 5000\n"
CONTROLLER = '[controller]\ndialect = "linuxcnc"\nservo_period_ms = 1.0\n\n'
COULOMB = EffectSetting(name="coulomb_friction", parameters={"force_n": 20.412345678})
FORCE = {"force": Estimate(value=20.412345678, stderr=0.104, unit="N")}


def source(text):
    return SourceText(name="mine.toml", stem="mine", text=text, digest="0")


def motor(body="", tail=""):
    return source(
        f'{CONTROLLER}[axes.X]\nfeedback = "motor"\n{body}{LIMITS}{tail}'
        f"\n# the saddle\n[axes.Y] # as it is\nfeedback = 'motor'\nb = 1e-4\nc = 0.01\n"
        f"lost_motion_mm = 0\n{LIMITS}"
    )


PLAIN = "b = 1e-4 # s2\nc = 0.01\nlost_motion_mm = 0.030   # indicator\nservo_stiffness_n_per_mm = 1000\n"


def log():
    axis = AxisLog(command=frozen(np.zeros(3)), table=frozen(np.zeros(3)))
    return Log(name="run.csv", t=frozen([0, 1, 2]), period=1.0, axes={"X": axis}, digest="abc123")


def finding(name="coulomb_friction", parameters=FORCE, setting=COULOMB, **other):
    return Finding(
        name=name,
        axis="X",
        parameters=parameters,
        where="",
        evidence=(),
        confidence=0.99,
        setting=setting,
        **other,
    )


def diagnosis(machine, *findings):
    steps = [ResidualStep(added=None, fit_rms=7.2e-6, holdout_rms=8.04e-6)]
    steps += [ResidualStep(added=f"{one.name}:{one.axis}", fit_rms=1.9e-6, holdout_rms=3e-6) for one in findings]
    quality = LogQuality(period=1.0, jitter=0.0, first=0, channels=())
    return Diagnosis(
        verdict="named",
        findings=findings,
        noise_floor=0.0,
        steps=tuple(steps),
        quality=quality,
        places=(),
        remaining=(),
        trails=(),
        machine=machine,
    )


def with_axis(machine, **changes):
    return replace(machine, axes={**machine.axes, "X": replace(machine.axes["X"], **changes)})


def changed_lines(original, text):
    lines = difflib.ndiff(original.text.splitlines(), text.splitlines())
    return [line for line in lines if line[0] in "+-"]


def test_nothing_found_is_the_same_text():
    original = machine_source("mill")
    assert diagnosed_machine(original, diagnosis(machine_of(original)), log()) == original.text


def test_an_effect_stands_behind_its_axis_and_says_where_it_comes_from():
    original = motor(PLAIN)
    machine = machine_of(original)
    better = with_axis(machine, effects=(COULOMB,))
    text = diagnosed_machine(original, diagnosis(better, finding()), log())
    assert text == original.text.replace(
        "5000\n\n# the saddle",
        "5000\n\n# coulomb_friction, diagnosed from run.csv (sha256 abc123)\n"
        "# residual on held-out data 8.04 -> 3 um\n"
        '[[axes.X.effects]]\nname = "coulomb_friction"\nforce_n = 20.41235  # +- 0.1 N\n\n# the saddle',
    )
    assert machine_of(source_of(text, "mine.toml", "mine")).axes["X"].effects == (
        EffectSetting(name="coulomb_friction", parameters={"force_n": 20.41235}),
    )


def test_a_number_changes_where_it_stands_and_keeps_its_comment():
    original = motor(PLAIN)
    machine = machine_of(original)
    better = with_axis(machine, gap=replace(machine.axes["X"].gap, lost_motion=31.234567891e-6))
    size = {"lost_motion": Estimate(value=31.234567891e-3, stderr=4.04e-4, unit="mm")}
    found = finding("backlash", size, None, keys={"lost_motion_mm": 31.234567891e-3})
    text = diagnosed_machine(original, diagnosis(better, found), log())
    assert changed_lines(original, text) == [
        "- lost_motion_mm = 0.030   # indicator",
        "+ # backlash, diagnosed from run.csv (sha256 abc123)",
        "+ # residual on held-out data 8.04 -> 3 um",
        "+ lost_motion_mm = 0.03123457   # +- 0.0004 mm; was 0.030: indicator",
    ]


def test_an_axis_that_shows_backlash_is_not_held_by_gravity():
    original = motor(PLAIN + 'reference_direction = "+"\ngravity_side = "-"  # it hangs\n')
    machine = machine_of(original)
    axis = machine.axes["X"]
    size = {"lost_motion": Estimate(value=0.031, stderr=4e-4, unit="mm")}
    found = finding("backlash", size, None, keys={"lost_motion_mm": 0.031})
    better = replace(machine, axes={**machine.axes, "X": improved_axis(axis, (found,))})
    text = diagnosed_machine(original, diagnosis(better, found), log())
    gone = [line for line in changed_lines(original, text) if line[0] == "-"]
    assert gone == ["- lost_motion_mm = 0.030   # indicator", '- gravity_side = "-"  # it hangs']
    read = machine_of(source_of(text, "mine.toml", "mine")).axes["X"]
    assert (read.gravity_side, read.reference_direction, read.gap.lost_motion) == (None, "+", pytest.approx(31e-6))
    worn = EffectSetting(name="position_dependent_backlash", parameters={"slope_mm_per_mm": 1e-4, "reference_mm": 0.0})
    assert improved_axis(axis, (finding("position_dependent_backlash", {}, worn),)).gravity_side is None
    assert improved_axis(axis, (finding(),)).gravity_side == "-"


def test_a_second_diagnosis_replaces_the_standard_error_of_the_first():
    original = motor(PLAIN.replace("# indicator", "# +- 0.0007 mm; indicator"))
    machine = machine_of(original)
    better = with_axis(machine, gap=replace(machine.axes["X"].gap, lost_motion=31e-6))
    size = {"lost_motion_mm": Estimate(value=0.031, stderr=4e-4, unit="mm")}
    text = diagnosed_machine(original, diagnosis(better, finding("backlash", size, None)), log())
    assert "lost_motion_mm = 0.031   # +- 0.0004 mm; was 0.030: indicator\n" in text


def test_keys_of_a_cascade_among_others_keep_their_comments_as_of_what_was():
    """Dotted keys with others in between, as `machine new` writes them."""
    head = 'feedback = "motor"\ncontrol.structure = "cascade"\n'
    text = f"{head}lost_motion_mm = 0.03\ncontrol.position_gain_per_s = 40.0  # K_v\n"
    keys = {"control.position_gain_per_s": 38.5, "lost_motion_mm": 0.04}
    change = AxisChange(axis="X", keys=keys, comments={"control.position_gain_per_s": "+- 0.4 1/s"}, above=("found",))
    changed = edit_axes(f"[axes.X]\n{text}", [change])
    assert "\n# found\ncontrol.position_gain_per_s = 38.5  # +- 0.4 1/s; was 40.0: K_v\n" in changed
    assert "\nlost_motion_mm = 0.04\n" in changed
    again = edit_axes(changed, [AxisChange(axis="X", keys={"control.position_gain_per_s": 38.0})])
    assert "control.position_gain_per_s = 38.0  # was 40.0: K_v\n" in again


def test_a_gap_given_as_an_angle_is_changed_as_an_angle():
    original = machine_source("paper")
    machine = machine_of(original)
    gap = machine.axes["X"].gap
    better = with_axis(machine, gap=replace(gap, lost_motion=4e-3, motor_angle=0.1))
    size = {"lost_motion": Estimate(value=4.0, stderr=0.04, unit="mm")}
    text = diagnosed_machine(original, diagnosis(better, finding("backlash", size, None)), log())
    stated = tomllib.loads(text)["axes"]["X"]
    assert stated["backlash_motor_rad"] == pytest.approx(4e-3 * 25.0 / 1.0, rel=1e-6)  # r Δθ_m / N, N = 25, r = 1 m
    assert "lost_motion_mm" not in stated
    assert "backlash_motor_rad = 0.1         # +- 1 %; was 0.125664: Δθ_m\n" in text


PHYSICAL = "N = 2.0\nr = 0.001\nJ = 0.01\nB = 1.0\nk_p = 500.0\nk_a = 1.0\nk_t = 0.5\nlost_motion_mm = 0.01\n"


def test_physical_constants_change_so_that_b_c_and_stiffness_come_out():
    original = motor(PHYSICAL)
    machine = machine_of(original)
    servo = machine.axes["X"].servo
    assert servo.stiffness == pytest.approx(500.0 * 0.5 * 2.0 / 0.001)
    better = with_axis(machine, servo=replace(servo, b=servo.b * 1.1, c=servo.c * 0.9, stiffness=servo.stiffness * 1.2))
    text = diagnosed_machine(original, diagnosis(better, finding("servo_mismatch", {}, None)), log())
    stated = tomllib.loads(text)["axes"]["X"]
    N, r, J, B = (stated[key] for key in "NrJB")
    gain = stated["k_p"] * stated["k_a"] * stated["k_t"]
    assert "b" not in stated
    # Eq. (9) and K = k_p k_a k_t N / r
    assert N * J / (gain * r) == pytest.approx(1.1 * servo.b, rel=1e-6)
    assert N * B / (gain * r) == pytest.approx(0.9 * servo.c, rel=1e-6)
    assert gain * N / r == pytest.approx(1.2 * servo.stiffness, rel=1e-6)


def test_uncertainties_and_control_gains_are_added_behind_the_axis_keys():
    original = motor(PLAIN, "[axes.X.control]\nki_over_kp_per_s = 1.0\n")
    machine = machine_of(original)
    axis = machine.axes["X"]
    better = with_axis(
        machine,
        uncertainty=replace(axis.uncertainty, backlash=0.012345678),
        servo=replace(axis.servo, kd_over_kp=0.001),
    )
    text = diagnosed_machine(original, diagnosis(better), log())
    assert "max_jerk_mm_s3 = 5000\nbacklash_uncertainty = 0.01234568\n[axes.X.control]\n" in text
    assert "ki_over_kp_per_s = 1.0\n# fitted to run.csv (sha256 abc123)\nkd_over_kp_s = 0.001\n" in text


def test_the_standard_error_of_friction_is_its_uncertainty():
    axis = machine_of(motor(PLAIN)).axes["X"]
    better = improved_axis(axis, (finding(),))
    # 0.104 N of 20.4 N.
    assert better.uncertainty.friction == 0.00509
    assert replace(better.uncertainty, friction=0.2) == axis.uncertainty


OLD = '\n[[axes.X.effects]]   # first\nname = "coulomb_friction" # dry\nforce_n = 10 # guess\n'


def test_an_effect_that_is_there_gets_the_new_number():
    original = motor(PLAIN, OLD)
    better = with_axis(machine_of(original), effects=(COULOMB,))
    text = diagnosed_machine(original, diagnosis(better, finding()), log())
    assert changed_lines(original, text) == [
        "+ # coulomb_friction, diagnosed from run.csv (sha256 abc123)",
        "+ # residual on held-out data 8.04 -> 3 um",
        "- force_n = 10 # guess",
        "+ force_n = 20.41235 # +- 0.1 N; was 10: guess",
    ]


def test_an_effect_that_is_given_in_another_unit_is_replaced():
    original = motor(PLAIN, OLD.replace("force_n = 10", "following_error_mm = 0.01"))
    better = with_axis(machine_of(original), effects=(COULOMB,))
    text = diagnosed_machine(original, diagnosis(better, finding()), log())
    assert tomllib.loads(text)["axes"]["X"]["effects"] == [{"name": "coulomb_friction", "force_n": 20.41235}]


def test_an_effect_that_goes_is_taken_out_and_another_added():
    offset = EffectSetting(name="load_offset", parameters={"force_n": -3.0})
    original = motor(PLAIN, OLD)
    better = with_axis(machine_of(original), effects=(offset,))
    text = diagnosed_machine(original, diagnosis(better, finding("load_offset", {}, offset)), log())
    assert tomllib.loads(text)["axes"]["X"]["effects"] == [{"name": "load_offset", "force_n": -3.0}]


@pytest.mark.parametrize(
    "text",
    [
        f'{CONTROLLER}[axes]\nX = {{feedback = "motor", b = 1e-4, c = 0.01, lost_motion_mm = 0.03, '
        "servo_stiffness_n_per_mm = 1000, max_velocity_mm_s = 100, max_acceleration_mm_s2 = 500, "
        "max_jerk_mm_s3 = 5000}\n",
        CONTROLLER
        + "[axes]\nX.feedback = 'motor'\n"
        + "".join(f"X.{line}\n" for line in (PLAIN + LIMITS).splitlines()),
        f"{CONTROLLER}[axes.X]\nfeedback = 'motor'\n{PLAIN}{LIMITS}effects = []\n",
        f"{CONTROLLER}[ axes . 'X' ]\nfeedback = 'motor'\n{PLAIN}{LIMITS}".replace("\n", "\r\n"),
        f"{CONTROLLER}[axes.X]\nfeedback = 'motor'\n{PLAIN}{LIMITS}".rstrip(),
        f"[axes.X]\nfeedback = 'motor'\n{PLAIN}{LIMITS}\n{CONTROLLER}",
    ],
    ids=["inline", "dotted", "inline effects", "spaced, other line ends", "no last end", "controller last"],
)
def test_it_reads_back_however_the_file_is_written(text):
    original = source(text)
    machine = machine_of(original)
    axis = machine.axes["X"]
    better = with_axis(
        machine,
        effects=(COULOMB,),
        gap=replace(axis.gap, lost_motion=31e-6),
        uncertainty=replace(axis.uncertainty, gain=0.01),
    )
    written = diagnosed_machine(original, diagnosis(better, finding()), log())
    again = machine_of(source(written)).axes["X"]
    assert again.gap.lost_motion == pytest.approx(31e-6, rel=1e-6)
    assert again.uncertainty.gain == 0.01
    assert again.effects == (EffectSetting(name="coulomb_friction", parameters={"force_n": 20.41235}),)
    assert ("\r\n" in written) == ("\r\n" in text)
    assert written.count("\r\n") in (0, written.count("\n"))


@pytest.mark.parametrize("name", ["mill", "old_mill", "router", "stepper", "paper"])
def test_shipped_machines_take_a_gap_and_an_effect(name):
    original = machine_source(name)
    machine = machine_of(original)
    gap = machine.axes["X"].gap
    factor = 1.25
    angle = None if gap.motor_angle is None else gap.motor_angle * factor
    delay = EffectSetting(name="transport_delay", parameters={"delay_ms": 4.0})
    better = with_axis(
        machine,
        gap=replace(gap, lost_motion=gap.lost_motion * factor, motor_angle=angle),
        effects=(*machine.axes["X"].effects, delay),
    )
    text = diagnosed_machine(original, diagnosis(better, finding("transport_delay", {}, delay)), log())
    gone = [line for line in changed_lines(original, text) if line.startswith("-")]
    assert len(gone) == 1  # the gap


def test_a_machine_that_differs_in_what_no_diagnosis_changes_is_not_written():
    original = motor(PLAIN)
    with pytest.raises(SolveError, match="axis X"):
        diagnosed_machine(original, diagnosis(with_axis(machine_of(original), feedback="none")), log())
