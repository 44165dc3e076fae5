"""Real programs: what is read is what LinuxCNC reads, and compensation changes only what it declares."""

from __future__ import annotations

import re
from decimal import Decimal
from functools import cache

import pytest
from support.canon import RS274, assert_agrees, run_rs274
from support.corpus import Entry, compensated, dialect_of, entries, mill, stepper

from ph_post.edit.undo import undo
from ph_post.errors import InputError
from ph_post.gcode.read import read_program
from ph_post.verify.verify import verify

ROUNDING = Decimal("0.00011")
"""rs274 writes four decimals, each half a unit off."""

TOLERANCE = 5e-6
HUNK = re.compile(rb"\(ph-post: \+(\d+) -(\d+)\b.*\)\s*")
OURS = re.compile(rb"\((ph-post[ :]|  ).*\)\s*")
OFFSET = re.compile(rb"\(ph-post: offset ([XYZ]) ([-+]?)([0-9.]+) (?:mm|inch)\)")
WORD = re.compile(rb"([A-Za-z])[ \t]*([+-]?(?:\d+\.?\d*|\.\d+))")
OWN_NUMBER = re.compile(rb"^([ \t]*/?[ \t]*)N\d+(?:\.\d+)?[ \t]*", re.IGNORECASE | re.MULTILINE)
MOTIONS = ("STRAIGHT_TRAVERSE", "STRAIGHT_FEED", "ARC_FEED")
COMMENT = re.compile(rb"\([^)]*\)|;.*")
CENTRES = {b"I": b"X", b"J": b"Y", b"K": b"Z"}

ALL = {entry.name: entry for entry in entries()}
each = pytest.mark.parametrize("name", ALL)

LONG = ("adaptive_linuxcnc", "helix_linuxcnc", "arcspiral", "plasmatest")
"""Programs whose windows take many seconds to plan; their lasting offsets do not."""

SECONDS = (
    "tort",
    "craftsmancnc",
    "pocket_linuxcnc",
    "example",
    "lathe_pawn",
    "cds",
    "pocket_zigzag_linuxcnc",
    "dogbone_linuxcnc",
)
"""Programs whose windows take seconds: they are for the slow tests, the short ones for all."""

LARGE = ("boat-xyzac", "boat-xyzbc")
"""Programs that take seconds on every machine."""

MACHINES = {"stepper": stepper(), "mill": mill()}
JOBS = [(name, "stepper", None) for name in ALL]
JOBS += [
    (name, "mill", "suppress")
    for name, entry in ALL.items()
    if entry.dialect == "linuxcnc" and name.split("/")[-1] not in LONG
]
JOBS += [("comp-g1", "mill", "auto")]


def job(name, machine, strategy):
    last = name.split("/")[-1]
    slow = strategy == "auto" or last in LARGE or (machine == "mill" and last in SECONDS)
    return pytest.param(name, machine, strategy, marks=pytest.mark.slow if slow else ())


jobs = pytest.mark.parametrize(("name", "machine", "strategy"), [job(*one) for one in JOBS])
"""Lasting offsets of a machine without feedback; dips, and full stops with pulses, of one with scales."""


def data_of(entry: Entry) -> bytes:
    if not entry.file.exists():
        pytest.skip(f"{entry.file} is not installed: it comes with Debian's linuxcnc-uspace")
    return entry.file.read_bytes()


@cache
def programs(name, machine, strategy):
    """Read a program, and what was made of it for a machine."""
    entry = ALL[name]
    program = read_program(data_of(entry), name)
    output = compensated(program, MACHINES[machine], dialect_of(entry), strategy)
    return program, read_program(output, name)


def test_there_are_enough_programs():
    assert len(ALL) >= 50
    assert len([name for name in ALL if name.startswith("freecad/")]) >= 15


@each
def test_every_byte_is_kept(name):
    data = data_of(ALL[name])
    program = read_program(data, name)
    assert program.data == data
    assert b"".join(program.text(block) for block in range(program.blocks)) == data


@each
@pytest.mark.thinned(12)
def test_what_is_read_is_what_linuxcnc_reads(name):
    if RS274 is None:
        pytest.skip("LinuxCNC's rs274 is not installed")
    data = data_of(ALL[name])
    text = numbered(data, {k: k for k in range(len(data.splitlines()))})
    program, canon = read_program(text.encode("latin-1"), name), run_rs274(text)
    if canon.refusal:
        pytest.skip(f"rs274 refuses the program itself: {canon.refusal.splitlines()[0]}")
    if program.notes and any("O-word" in note.what for note in program.notes):
        pytest.skip("the program loops: lines that are passed through run more than once")
    assert_agrees(program, canon)


@jobs
@pytest.mark.thinned(12)
def test_the_compensated_program_is_judged_right(name, machine, strategy):
    program, output = programs(name, machine, strategy)
    verdict = verify(program, output, tolerance=TOLERANCE, machine=MACHINES[machine])
    assert verdict.failures == ()


@jobs
@pytest.mark.thinned(12)
def test_outside_hunks_only_declared_numbers_change(name, machine, strategy):
    program, output = programs(name, machine, strategy)
    before, after = (one.data.splitlines(keepends=True) for one in (program, output))
    for old, new in kept_lines(program.data, output.data):
        if before[old] != after[new]:
            require_offsets(before[old], after[new], declared_by(output.data))


def declared_by(data: bytes) -> dict[bytes, tuple[Decimal, ...]]:
    """Offsets by axis that a head declares: to either side, or with a sign none or one to that side."""
    return {
        axis: (Decimal(0), Decimal((sign + size).decode()))
        if sign
        else (Decimal(size.decode()), -Decimal(size.decode()))
        for axis, sign, size in OFFSET.findall(data)
    }


def kept_lines(old: bytes, new: bytes) -> list[tuple[int, int]]:
    """Lines that stand for each other, by number; new ones only where a hunk or the header says so."""
    before, after = old.splitlines(keepends=True), new.splitlines(keepends=True)
    if old == new:
        return [(k, k) for k in range(len(before))]
    i, j, pairs = 0, 0, []
    while j < len(after):
        if hunk := HUNK.fullmatch(after[j]):
            i, j = i + int(hunk[2]), j + 1 + int(hunk[1])
        elif OURS.fullmatch(after[j]) and after[j] not in before[i : i + 1]:
            j += 1
        else:
            pairs.append((i, j))
            i, j = i + 1, j + 1
    assert i == len(before)
    return pairs


def require_offsets(old: bytes, new: bytes, declared: dict[bytes, tuple[Decimal, ...]]):
    """Demand the same line but for numbers that differ by declared offsets: one, or from one to the other."""
    parts, values = WORD.split(COMMENT.sub(b"", old)), WORD.split(COMMENT.sub(b"", new))
    assert COMMENT.findall(old) == COMMENT.findall(new)
    assert len(parts) == len(values)
    for k, (one, other) in enumerate(zip(parts, values, strict=True)):
        if one == other:
            continue
        assert k % 3 == 2, (old, new)
        letter = parts[k - 1].upper()
        sides = declared[CENTRES.get(letter, letter)]
        steps = {abs(a - b) for a in (*sides, Decimal(0)) for b in sides} - {Decimal(0)}
        change = Decimal(other.decode()) - Decimal(one.decode())
        assert abs(change) in steps, (old, new)


@jobs
@pytest.mark.thinned(12)
def test_undoing_gives_every_byte_back(name, machine, strategy):
    program, output = programs(name, machine, strategy)
    if program.data == output.data:
        with pytest.raises(InputError, match="nothing to undo"):
            undo(output.data, name)
    else:
        assert undo(output.data, name) == program.data


@jobs
@pytest.mark.thinned(12)
def test_a_second_run_changes_nothing(name, machine, strategy):
    _, output = programs(name, machine, strategy)
    again = compensated(output, MACHINES[machine], dialect_of(ALL[name]), strategy)
    assert again == output.data


@jobs
@pytest.mark.thinned(12)
def test_linuxcnc_accepts_the_output_and_makes_the_same_of_what_is_not_declared(name, machine, strategy):
    if RS274 is None:
        pytest.skip("LinuxCNC's rs274 is not installed")
    program, output = programs(name, machine, strategy)
    if program.data == output.data:
        return
    if refusal := refusal_of(name):
        pytest.skip(f"rs274 refuses the program itself: {refusal.splitlines()[0]}")
    assert run_rs274(output.data.decode("latin-1")).refusal == ""
    pairs = kept_lines(program.data, output.data)
    before = run_rs274(numbered(program.data, {old: old for old, _ in pairs}))
    after = run_rs274(numbered(output.data, {new: old for old, new in pairs}))
    assert before.refusal == after.refusal == ""
    compare_calls(by_line(before.calls), by_line(after.calls), declared_by(output.data))


@cache
def refusal_of(name: str) -> str:
    return run_rs274(data_of(ALL[name]).decode("latin-1")).refusal


def numbered(data: bytes, numbers: dict[int, int]) -> str:
    """Give lines their numbers as N words in place of their own; the others get none."""
    lines = OWN_NUMBER.sub(rb"\1", data).decode("latin-1").splitlines()
    return "\n".join(
        f"N{numbers[k]} {line}" if k in numbers and line and line[0] not in "%/;oO" else line
        for k, line in enumerate(lines)
    )


def by_line(calls: list[tuple[int, str, str]]) -> dict[int, list[tuple[str, str]]]:
    """Calls that come from numbered lines, with positions where they are told."""
    found: dict[int, list[tuple[str, str]]] = {}
    for line, name, text in calls:
        if line >= 0:
            found.setdefault(line, []).append((name, text))
    return found


def compare_calls(before, after, declared):
    """Demand the same calls of every line that was kept, but for declared offsets of positions."""
    assert before.keys() == after.keys()
    steps = {Decimal(0)} | {abs(a - b) for both in declared.values() for a in (*both, Decimal(0)) for b in both}
    for line, calls in before.items():
        assert [name for name, _ in calls] == [name for name, _ in after[line]], line
        for (name, old), (_, new) in zip(calls, after[line], strict=True):
            if old == new:
                continue
            assert name in MOTIONS, (line, name, old, new)
            numbers = [[Decimal(number) for number in text.split(",")] for text in (old, new)]
            for one, other in zip(*numbers, strict=True):
                assert min(abs(abs(other - one) - step) for step in steps) <= ROUNDING, (line, old, new)
