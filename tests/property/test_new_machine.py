"""Whatever is answered in bounds, in whatever unit, stands in the machine file and reads back."""

from __future__ import annotations

import math
import tomllib
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.amount import examples

from ph_post.cli.interview import GivenAnswer, conduct, machine_answers
from ph_post.drive.machinefile import machine_of
from ph_post.files.storage import SourceText
from ph_post.identify.newmachine import new_machine

# Exact sizes of the units, independent of those in the package.
LENGTH = {"mm": Fraction(1), "": Fraction(1), "in": Fraction(254, 10), "thou": Fraction(254, 10000)}
SPEED = {"mm/s": Fraction(1), "mm/min": Fraction(1, 60), "m/min": Fraction(100, 6), "ipm": Fraction(254, 600)}
ACCELERATION = {"": Fraction(1), "mm/s2": Fraction(1), "m/s²": Fraction(1000), "in/s^2": Fraction(254, 10)}


def numbers(low, high, units):
    """Texts of numbers with units, beside their values."""

    @st.composite
    def draw_number(draw):
        unit = draw(st.sampled_from(sorted(units)))
        value = draw(st.floats(low * 1.001, high * 0.999))
        text = f"{value / float(units[unit]):.6g}"
        blank = draw(st.sampled_from(["", " "])) if unit else ""
        return f"{text}{blank}{unit}", float(Fraction(text) * units[unit])

    return draw_number()


def of_teeth(teeth):
    return f"{teeth[0]}:{teeth[1]}", teeth[0] / teeth[1]


def of_gain(gain):
    return f"{gain:.8g}/s", 1 / float(f"{gain:.8g}")


QUANTITIES = {
    "lost_motion": ("lost_motion_mm", numbers(1e-5, 10.0, LENGTH)),
    "lead": ("screw_lead_mm", numbers(0.1, 1000.0, LENGTH)),
    "speed": ("max_velocity_mm_s", numbers(0.01, 10_000.0, SPEED)),
    "acceleration": ("max_acceleration_mm_s2", numbers(0.1, 100_000.0, ACCELERATION)),
    "gear": ("gear_ratio", st.tuples(st.integers(1, 99), st.integers(1, 99)).map(of_teeth)),
    "following_error": ("c", st.floats(1.01, 9e3).map(of_gain)),
}


@st.composite
def interviews(draw):
    """Answers by question, and what has to stand in the file by axis and key."""
    axes = draw(st.sampled_from(["X", "Y", "Z", "XY", "XZ", "YZ", "XYZ"]))
    loops = {axis: draw(st.sampled_from(["load", "motor", "none"])) for axis in axes}
    texts = {"axes": axes, "loop": " ".join(f"{axis}={loop}" for axis, loop in loops.items())}
    wanted = {axis: {"feedback": loop} for axis, loop in loops.items()}
    needs = {"lead": {"load"}, "gear": {"load"}, "following_error": {"load", "motor"}}
    for question, (key, values) in QUANTITIES.items():
        asked = [axis for axis in axes if loops[axis] in needs.get(question, {"load", "motor", "none"})]
        if not asked:
            continue
        drawn = [draw(values) for _ in asked]
        way = draw(st.sampled_from(["named", "listed", "one"]))
        drawn = [drawn[0]] * len(asked) if way == "one" else drawn
        if way == "one":
            texts[question] = drawn[0][0]
        elif way == "listed":
            texts[question] = draw(st.sampled_from([" ", "; ", ", "])).join(text for text, _ in drawn)
        else:
            texts[question] = " ".join(f"{axis}={text}" for axis, (text, _) in zip(asked, drawn, strict=True))
        for axis, (_, value) in zip(asked, drawn, strict=True):
            wanted[axis][key] = value
    texts["dialect"] = draw(st.sampled_from(["linuxcnc", "grbl", "grblhal"]))
    texts["name"] = draw(st.text(st.characters(categories=["L", "N", "P", "S"]), min_size=1, max_size=40))
    return texts, wanted


@settings(max_examples=examples(150))
@given(interview=interviews())
def test_any_valid_answers_read_back(interview):
    texts, wanted = interview
    outcome = conduct({key: GivenAnswer(text, key) for key, text in texts.items()}, defaults=True)
    made = new_machine(machine_answers(outcome))
    file = tomllib.loads(made.text)
    assert file["name"] == texts["name"]
    assert file["controller"]["dialect"] == texts["dialect"]
    assert file["axes"].keys() == wanted.keys()
    for axis, keys in wanted.items():
        for key, value in keys.items():
            expected = value if isinstance(value, str) else pytest.approx(value, rel=1e-6)
            assert file["axes"][axis][key] == expected, (axis, key)
        if keys["feedback"] == "none":
            assert (file["axes"][axis]["b"], file["axes"][axis]["c"]) == (0.0, 0.0)
    # and the project's reader takes it, in SI
    machine = machine_of(SourceText(name="made.toml", stem="made", text=made.text, digest=""))
    for axis, keys in wanted.items():
        read = machine.axes[axis]
        assert read.gap.lost_motion == pytest.approx(keys["lost_motion_mm"] / 1000, rel=1e-6)
        assert read.limits.velocity == pytest.approx(keys["max_velocity_mm_s"] / 1000, rel=1e-6)
        if "screw_lead_mm" in keys:
            lead = read.gap.travel_per_rad * 2 * math.pi
            assert lead == pytest.approx(keys["screw_lead_mm"] / 1000, rel=1e-6)
