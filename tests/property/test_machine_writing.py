"""Whatever changes of a machine, its file reads back as the new machine and keeps its person's comments."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from support.amount import examples

from ph_post.drive.machinefile import machine_of, machine_source
from ph_post.files.machine_text import edit_axes
from ph_post.files.storage import SourceText, shipped_names
from ph_post.identify.machinefile import axis_change
from ph_post.types import EffectSetting

factor = st.one_of(st.just(1.0), st.floats(0.8, 1.25))
delay = st.floats(0.5, 9.0).map(lambda ms: EffectSetting(name="transport_delay", parameters={"delay_ms": ms}))
friction = st.floats(1e-3, 0.02).map(
    lambda mm: EffectSetting(name="coulomb_friction", parameters={"following_error_mm": mm})
)
effects = st.tuples(st.lists(delay, max_size=1), st.lists(friction, max_size=1), st.booleans())


@st.composite
def changed(draw, axis):
    gap, servo = axis.gap, axis.servo
    beta = None if gap.beta is None else gap.beta * draw(factor)
    stiffness = None if servo.stiffness is None else servo.stiffness * draw(factor)
    late, dry, turned = draw(effects)
    return replace(
        axis,
        gap=replace(gap, lost_motion=gap.lost_motion * draw(factor), beta=beta),
        # no less damping than before: that of the load may not become negative
        servo=replace(servo, b=servo.b * draw(factor), c=servo.c * 1.6 * draw(factor), stiffness=stiffness),
        uncertainty=replace(axis.uncertainty, gain=draw(st.sampled_from([axis.uncertainty.gain, 0.0123456789]))),
        effects=tuple(dry + late if turned else late + dry),
    )


@settings(max_examples=examples(100))
@given(data=st.data(), name=st.sampled_from(shipped_names("machines")))
def test_a_changed_machine_reads_back(data, name):
    source = machine_source(name)
    for again in range(2):
        before = machine_of(source).axes["X"]
        after = data.draw(changed(before))
        change = axis_change(before, after, source, parameters={}, above=["fitted"], effects={})
        text = source.text if change is None else edit_axes(source.text, [change])
        if not again:
            comments = [line for line in source.text.splitlines() if line.lstrip().startswith("#")]
            assert [line for line in text.splitlines() if line in comments] == comments
        source = SourceText(name="mine.toml", stem="mine", text=text, digest="")
        read = machine_of(source).axes["X"]
        assert read.gap.lost_motion == pytest.approx(after.gap.lost_motion, rel=1e-6)
        assert read.gap.beta == (None if after.gap.beta is None else pytest.approx(after.gap.beta, rel=1e-6))
        assert (read.servo.b, read.servo.c) == pytest.approx((after.servo.b, after.servo.c), rel=1e-6)
        assert read.uncertainty.gain == pytest.approx(after.uncertainty.gain, rel=1e-6)
        assert [effect.name for effect in read.effects] == [effect.name for effect in after.effects]
        for one, other in zip(read.effects, after.effects, strict=True):
            assert dict(one.parameters) == pytest.approx(dict(other.parameters), rel=1e-6)
