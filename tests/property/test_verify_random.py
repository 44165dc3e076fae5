"""Random programs, compensated by the writer: no false alarm, and no number that can be changed unseen."""

import random
import re

import numpy as np
import pytest
from support.editing import compensate
from support.followed import strayed
from support.part_programs import random_program

from ph_post.drive.machinefile import read_machine
from ph_post.errors import InputError
from ph_post.gcode.read import read_program
from ph_post.units import MM
from ph_post.verify.verify import verify

TOLERANCE = 0.005 * MM
MACHINES = ("router", "stepper")
DIALECTS = ("linuxcnc", "grbl")

FELT = 0.02 * MM
"""A coordinate that is changed by more than this is outside every tolerance [m], but along the path."""

SAMPLING = 6e-4
"""Samples of the path are 1 µm apart: a point between two of them seems half as far from it [mm]."""


def compensated(seed):
    rng = random.Random(seed)
    data = random_program(rng, moves=30, tools=False)
    machine = read_machine(MACHINES[seed % 2])
    return data, machine, compensate(data, machine, dialect=DIALECTS[seed // 2 % 2]).text


def starts(count):
    """First of every twenty seeds; those behind the first twenty are for the slow tests."""
    return [0, *(pytest.param(start, marks=pytest.mark.slow) for start in range(20, count, 20))]


def judged(original, text, machine):
    programs = (read_program(original, "original"), read_program(text, "compensated"))
    return verify(*programs, tolerance=TOLERANCE, machine=machine)


@pytest.mark.parametrize("start", starts(100))
@pytest.mark.thinned(6)
def test_what_the_writer_writes_is_accepted(start):
    changed = 0
    for seed in range(start, start + 20):
        original, machine, text = compensated(seed)
        verdict = judged(original, text, machine)
        assert [failure.sentence() for failure in verdict.failures] == [], seed
        changed += text != original
    assert changed > 10


@pytest.mark.slow
@pytest.mark.parametrize("start", starts(40))
@pytest.mark.thinned(4)
def test_no_number_can_be_changed_unseen(start):
    """A digit of a coordinate, by what can be felt, or of G, M, S and T: whichever it is, it is noticed."""
    tried = unseen = 0
    for seed in range(start, start + 20):
        original, machine, text = compensated(seed)
        rng = random.Random(seed)
        for damaged in (damage(rng, text) for _ in range(8)):
            if damaged is None:
                continue
            tried += 1
            try:
                verdict = judged(original, damaged, machine)
            except InputError:
                continue
            # A crossing or a stop a little earlier on the path may be as good: so says a table of the tests' own.
            harmless = verdict.ok and keeps_the_path(original, text, damaged)
            assert not verdict.ok or harmless, (seed, difference(text, damaged))
            unseen += harmless
    assert tried > 40
    assert unseen < 0.05 * tried


def keeps_the_path(original, text, damaged):
    """Whether the table stays within what the head of the compensated program declares, and its chord tolerance."""
    before, after, other = (data.decode("latin-1") for data in (original, text, damaged))
    within = max((float(found) for found in re.findall(r"within ([\d.]+) mm", after)), default=0.0)
    chord = float(re.search(r"chord tolerance ([\d.]+) mm", after)[1])
    sides = {
        axis: (0.0 if sign == "+" else -float(size), 0.0 if sign == "-" else float(size))
        for axis, sign, size in re.findall(r"offset ([XYZ]) ([-+]?)([\d.]+) mm", after)
    }
    return strayed(before, after, other, sides) <= within + chord + SAMPLING


def damage(rng, text):
    """Change one digit of a word outside comments; None where that changes too little."""
    program = read_program(text, "compensated")
    words = program.words
    chosen = np.flatnonzero(np.isin(words.letter, np.frombuffer(b"XYZGMST", dtype=np.uint8)))
    word = int(rng.choice(chosen.tolist()))
    places = [place for place in range(words.start[word] + 1, words.end[word]) if text[place : place + 1].isdigit()]
    place = rng.choice(places)
    digit = rng.choice([digit for digit in "0123456789" if digit != chr(text[place])])
    number = (text[words.start[word] + 1 : place] + digit.encode() + text[place + 1 : words.end[word]]).decode()
    if is_jog(program, int(words.block[word])):
        return None
    change = abs(float(number.replace(" ", "")) - words.value[word])
    units = program.modal_after(int(words.block[word])).units
    if change == 0 or (chr(words.letter[word]) in "XYZ" and change * units < FELT):
        return None
    return text[:place] + digit.encode() + text[place + 1 :]


def is_jog(program, block):
    """Whether a line stands between two dwells: a pulse may well be shorter than the longest one."""
    return all(program.text(line).startswith(b"G4") for line in (block - 1, block + 1) if line < program.blocks)


def difference(one, other):
    return next((a, b) for a, b in zip(one.splitlines(), other.splitlines(), strict=True) if a != b)
