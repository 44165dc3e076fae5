"""Random programs from bytes to bytes: each is compensated, passes its judge, and comes back by undo."""

import random

import pytest
from msgspec.structs import replace
from support.amount import examples
from support.corpus import stepper
from support.part_programs import random_program

from ph_post.api.compensated_program import ProgramRequest
from ph_post.api.programs import compensate_program
from ph_post.compensate.options import PlanOptions
from ph_post.drive.machinefile import read_machine
from ph_post.edit.edits import EditOptions
from ph_post.edit.undo import undo
from ph_post.gcode.read import read_program
from ph_post.types import Machine
from ph_post.units import MM

DIALECTS = ("linuxcnc", "grbl", "grblhal")
LOST_MOTIONS = (0.05 * MM, 0.5 * MM, 0.012 * MM)


def machine_of(rng: random.Random) -> Machine:
    """The stepper with some lost motion on every axis, or the router, whose axes differ."""
    if rng.random() < 0.4:
        return replace(read_machine("router"), dialect=rng.choice(DIALECTS))
    machine, lost = stepper(), rng.choice(LOST_MOTIONS)
    axes = {name: replace(axis, gap=replace(axis.gap, lost_motion=lost)) for name, axis in machine.axes.items()}
    return replace(machine, axes=axes, dialect=rng.choice(DIALECTS))


def asked(rng: random.Random) -> ProgramRequest:
    slowdown = rng.choice((0.1, 10.0, 1000.0))
    strategy = rng.choice(("auto", "takeup"))
    plan = PlanOptions(strategy=strategy, carrier="program", max_slowdown=slowdown)
    return ProgramRequest(plan=plan, edit=EditOptions(max_slowdown=slowdown))


@pytest.mark.parametrize("start", [0, *(pytest.param(one, marks=pytest.mark.slow) for one in (30, 60, 90))])
def test_what_is_delivered_passes_and_comes_back(start):
    changed, tried = 0, examples(30)
    for seed in range(start, start + tried):
        rng = random.Random(seed)
        data = random_program(rng, moves=rng.choice((14, 30)), tools=rng.random() < 0.5)
        found = compensate_program(read_program(data, f"seed {seed}"), machine_of(rng), asked(rng))
        assert undo(found.after.data, "part.ngc") == data if found.verdict else found.after.data == data
        changed += found.after.data != data
    assert changed > tried // 2


@pytest.mark.parametrize(("seed", "tools"), [(12498, False), (1566, True), (1062, True), (2856, True)])
def test_programs_that_were_once_refused_are_delivered(seed, tools):
    """Their stops come to one seat, or stand where two chains meet; all reversals are followed."""
    data = random_program(random.Random(seed), moves=14, tools=tools)
    machine = replace(read_machine("router"), dialect=("linuxcnc", "grbl")[seed // 2 % 2])
    plan = PlanOptions(strategy="takeup", carrier="program", max_slowdown=1000.0)
    found = compensate_program(
        read_program(data, "part.ngc"),
        machine,
        ProgramRequest(plan=plan, edit=EditOptions(max_slowdown=1000.0)),
    )
    assert undo(found.after.data, "part.ngc") == data
    assert found.after.data != data
