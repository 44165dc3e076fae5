"""Check that a compensated program is its original but for what its header declares."""

from __future__ import annotations

import re
from typing import Final

import numpy as np

from ph_post.bounds import give_memory_back
from ph_post.drive.axes import side_offsets
from ph_post.errors import InputError
from ph_post.gcode.program import PartProgram
from ph_post.gcode.read import with_contours
from ph_post.types import Machine
from ph_post.units import MM
from ph_post.verify.crossing_words import check_crossing_words, words_of_changes
from ph_post.verify.crossings import check_crossings
from ph_post.verify.declared import DeclaredChanges, read_declared
from ph_post.verify.further import check_further
from ph_post.verify.leads import check_leads
from ph_post.verify.line_pairs import VerifyCase, pair_lines
from ph_post.verify.offsets import (
    check_amounts,
    check_approaches,
    check_feeds,
    check_jogs,
    check_known,
    check_pairs,
    check_returns,
    check_standstills,
    check_stops,
)
from ph_post.verify.pairing import pair_motions
from ph_post.verify.path import check_direction, check_path
from ph_post.verify.states import check_breaks, check_commands, check_dwells, check_states
from ph_post.verify.stretches import find_stretches
from ph_post.verify.text import check_text
from ph_post.verify.threads import check_threads
from ph_post.verify.verdict import Findings, Verdict, quoted

_MODE: Final = re.compile(rb"G0*[0-3](?![\d.])[ \t]*", re.IGNORECASE)

_CORRECTED: Final = (b"cutter compensation holds for", b"threads keep their turn of the spindle")
"""What the head says where contours with cutter compensation, or threads, are shifted."""

ROUNDED = 4.0
"""A point may be off by so many units of its last decimal: rounding of ends and of an arc's centre."""


def verify(
    original: PartProgram, compensated: PartProgram, *, tolerance: float, machine: Machine | None = None
) -> Verdict:
    """Check that only what is declared was changed, and that the tool still follows the same path.

    Parameters
    ----------
    original, compensated : PartProgram
        The program, and the compensated program.
    tolerance : float
        Bound of the path's deviation in changed stretches, and the longest move of an axis that need not be
        compensated [m]. A finer chord tolerance in the header bounds the path instead.
    machine : Machine, optional
        The machine the program is for: jogs are held to its limits, and the declaration to its lost motion.

    Returns
    -------
    Verdict
        Every failure with its place in both programs, and counts of what was checked.

    Raises
    ------
    InputError
        Where a controller would refuse a line of the compensated program that it does not refuse in the original.
    """
    findings = Findings()
    _refuse_new_faults(original, compensated)
    declared = read_declared(original, compensated)
    if declared is None:
        _check_undeclared(original, compensated, findings)
        return findings.verdict()
    head = compensated.data[compensated.lines[declared.first] : compensated.lines[declared.last + 1]]
    if any(said in head.lower() for said in _CORRECTED):
        original, compensated = with_contours(original), with_contours(compensated)
    for line, fault in declared.faults:
        findings.add("header", fault, compensated=line)
    if declared.original != original.digest:
        findings.add(
            "original",
            "the header names another original",
            compensated=declared.first,
            expected=original.digest,
            got=declared.original,
        )
        return findings.verdict()
    if machine is not None:
        _check_machine(declared, machine, findings)
    # Their words are looked at a part of the lines at a time.
    original.source.let_go()
    compensated.source.let_go()
    lines = pair_lines(original, compensated, declared, findings)
    if lines is not None:
        bound = tolerance
        if declared.chord is not None and declared.decimals is not None:
            bound = min(tolerance, declared.chord + ROUNDED * MM * 10.0**-declared.decimals)
        case = VerifyCase(
            original=original,
            compensated=compensated,
            declared=declared,
            lines=lines,
            bound=bound,
            band=tolerance,
            findings=findings,
        )
        _compare(case, machine)
    return findings.verdict()


def _refuse_new_faults(original: PartProgram, compensated: PartProgram) -> None:
    """Refuse a line with a fault that the original does not have."""
    passed, whats = set(), set()
    for note in original.notes:
        if note.refusal is not None:
            passed |= {_without_mode(original.text(block)) for block in range(note.first, note.last + 1)}
            whats.add(note.refusal[0])
    for note in compensated.notes:
        if note.refusal is None:
            continue
        what, expected, got = note.refusal
        # That the program breaks off is a fault of no line.
        of_line = note.why != 0 and note.first < compensated.breaks[-1].block
        within = of_line and _breaks_at(compensated, note.first)
        for block in range(note.first, note.last + 1):
            if what not in whats or (within and _without_mode(compensated.text(block)) not in passed):
                where = f"{compensated.name}:{block + 1}:{note.column if block == note.first else 1}"
                raise InputError(where, what, expected=expected, got=got)


def _without_mode(text: bytes) -> bytes:
    """Return a line without its motion mode, which is named again behind new lines that change it."""
    return _MODE.sub(b"", text, count=1).strip()


def _breaks_at(program: PartProgram, block: int) -> bool:
    """Return True if a line is passed through, and not only named."""
    return not np.any(program.motions.block == block)


def _check_undeclared(original: PartProgram, compensated: PartProgram, findings: Findings) -> None:
    """Without a header nothing may differ."""
    findings.count("lines", compensated.blocks)
    if original.data == compensated.data:
        return
    if read_declared(compensated, original) is not None:
        what = "the first program has the header of a compensated one, and the second has none: name the original first"
        findings.add("undeclared", what, original=0)
        return
    shared = min(original.blocks, compensated.blocks)
    place = next((k for k in range(shared) if original.text(k) != compensated.text(k)), shared)
    findings.add(
        "undeclared",
        "the programs differ, and no header declares why",
        original=place if place < original.blocks else None,
        compensated=place if place < compensated.blocks else None,
        expected=quoted(original.text(place)) if place < original.blocks else "nothing more",
        got=quoted(compensated.text(place)) if place < compensated.blocks else "nothing more",
    )


def _check_machine(declared: DeclaredChanges, machine: Machine, findings: Findings) -> None:
    """Demand that the declaration names this machine, and the offsets of its axes."""
    digest = declared.machine_digest
    if digest and machine.digest and not machine.digest.startswith(digest):
        findings.add(
            "machine",
            "the program was made for another machine",
            compensated=declared.first,
            expected=f"{machine.name}, {machine.digest[: len(digest)]}",
            got=f"{declared.machine}, {digest}",
        )
    for axis, amount in declared.offsets.items():
        minus, plus = side_offsets(machine.axes[axis]) if axis in machine.axes else (0.0, 0.0)
        if minus == plus:
            findings.add(
                "machine",
                f"{axis} is given an offset",
                compensated=declared.first,
                expected="an axis with its backlash outside the loop",
            )
            continue
        step = amount.unit * 10.0 ** -(declared.decimals or 0)
        # An offset without a sign is carried to either side, whichever side the zero was taken from.
        most = max(-minus, plus) if amount.side else 0.5 * (plus - minus)
        wrong_side = amount.side and (plus if amount.side > 0 else -minus) < most
        if wrong_side or abs(amount.metres - most) > step:
            sign = "+" if plus > -minus else "-"
            findings.add(
                "machine",
                f"the offset of {axis} is not {'its' if amount.side else 'half its'} lost motion",
                compensated=declared.first,
                expected=f"{sign if amount.side else ''}{most / MM:.6g} mm",
                got=f"{'+' if amount.side > 0 else '-' if amount.side else ''}{amount.metres / MM:.6g} mm",
            )


def _compare(case: VerifyCase, machine: Machine | None) -> None:
    """Compare text, state, motion and feed, line by line of the alignment."""
    words = check_text(case)
    check_states(case)
    check_breaks(case)
    check_commands(case, words)
    check_further(case, words)
    check_threads(case)
    dwells = check_dwells(case, words)
    changed = words_of_changes(case, words)
    give_memory_back(case.compensated.blocks)
    pairing = pair_motions(case, dwells)
    if pairing is None:
        return
    give_memory_back(case.compensated.blocks)
    check_pairs(case, pairing)
    check_known(case, pairing)
    check_amounts(case, pairing)
    check_returns(case, pairing)
    check_approaches(case, pairing)
    check_stops(case, pairing, dwells)
    give_memory_back(case.compensated.blocks)
    found = find_stretches(case.original.motions, case.compensated.motions, pairing)
    case.findings.count("stretches", found.change.size)
    crossed = case.lines.changes.crossed[found.change]
    led = case.lines.changes.led[found.change]
    plain = found.take(~crossed & ~led)
    check_path(case, pairing, plain, dwells)
    check_feeds(case, plain)
    give_memory_back(case.compensated.blocks)
    crossings = check_crossings(case, pairing, found.take(crossed))
    check_crossing_words(case, crossings, changed)
    give_memory_back(case.compensated.blocks)
    check_direction(case, pairing)
    check_leads(case, found.take(led), machine)
    if machine is not None:
        check_jogs(case, pairing.jog | crossings.at_corner, machine)
        check_standstills(case, dwells, machine)
