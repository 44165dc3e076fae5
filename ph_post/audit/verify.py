"""``verify``: proves that a compensated program is the original but for what its header declares.

A judge that is independent of the writer: it reads both programs, and of the writer nothing but the header's
public format. In this order it demands

1. of the text: outside hunks every byte, but for numbers that differ by exactly the declared offset;
2. of the state: the same modes, F, commands and breaks after every block, and after every hunk;
3. of the motion: less the declared shifts the same way within the tolerance, each part once and in order;
   shifts only of declared axes and amounts, changed between dwells or by rapids, and taken back in time;
4. of the feed: in hunks never above the original's, and jogs inside the machine's limits.
"""

from __future__ import annotations

from ph_post.audit.align import align
from ph_post.audit.case import Case
from ph_post.audit.course import check_course
from ph_post.audit.declared import Declaration, read_declared
from ph_post.audit.direction import check_direction
from ph_post.audit.feeds import check_feeds, check_jogs
from ph_post.audit.orders import check_dwells, check_orders
from ph_post.audit.pairing import pair_motions
from ph_post.audit.shifts import check_amounts, check_known, check_pairs, check_returns, check_stops
from ph_post.audit.states import check_breaks, check_states
from ph_post.audit.verdict import Findings, Verdict, shown
from ph_post.audit.wording import check_wording
from ph_post.gcode.reader.record import PartProgram
from ph_post.types import Machine
from ph_post.units import MM

ROUNDED = 4.0
"""A point may be off by so many units of its last decimal: rounding of ends and of an arc's centre."""


def verify(
    original: PartProgram, compensated: PartProgram, *, tolerance: float, machine: Machine | None = None
) -> Verdict:
    """Judge whether only what is declared was changed, and the tool still goes the same way.

    Parameters
    ----------
    original, compensated : PartProgram
        The program, and what was made of it.
    tolerance : float
        How far the way may be off in changed stretches, and the longest excursion of an axis that need not
        be followed by its offset [m]. Where the header declares a finer chord tolerance, the way is held to
        that.
    machine : Machine, optional
        The machine the program is for: jogs are held to its limits, and the declaration to its lost motion.

    Returns
    -------
    Verdict
        With every failure, its place in both programs, and counts of what was looked at.
    """
    findings = Findings()
    declared = read_declared(original, compensated)
    if declared is None:
        _check_undeclared(original, compensated, findings)
        return findings.verdict()
    for line, fault in declared.faults:
        findings.add("header", fault, compensated=line)
    if declared.original != original.digest:
        findings.add(
            "original", "the header tells of another original", compensated=declared.first,
            expected=original.digest, got=declared.original,
        )  # fmt: skip
        return findings.verdict()
    if machine is not None:
        _check_machine(declared, machine, findings)
    lines = align(original, compensated, declared, findings)
    if lines is not None:
        case = Case(
            original=original, compensated=compensated, declared=declared, lines=lines,
            bound=_bound(declared, tolerance), band=tolerance, findings=findings,
        )  # fmt: skip
        _compare(case, machine)
    return findings.verdict()


def _check_undeclared(original: PartProgram, compensated: PartProgram, findings: Findings) -> None:
    """Without a header nothing may differ."""
    findings.count("lines", compensated.blocks)
    if original.data == compensated.data:
        return
    shared = min(original.blocks, compensated.blocks)
    place = next((k for k in range(shared) if original.text(k) != compensated.text(k)), shared)
    findings.add(
        "undeclared", "the programs differ, and no header declares why",
        original=place if place < original.blocks else None,
        compensated=place if place < compensated.blocks else None,
        expected=shown(original.text(place)) if place < original.blocks else "nothing more",
        got=shown(compensated.text(place)) if place < compensated.blocks else "nothing more",
    )  # fmt: skip


def _check_machine(declared: Declaration, machine: Machine, findings: Findings) -> None:
    """Demand that the declaration names this machine, and half the lost motion of axes behind their loop."""
    digest = declared.machine_digest
    if digest and machine.digest and not machine.digest.startswith(digest):
        findings.add(
            "machine", "the program was made for another machine", compensated=declared.first,
            expected=f"{machine.name}, {machine.digest[: len(digest)]}", got=f"{declared.machine}, {digest}",
        )  # fmt: skip
    for axis, amount in declared.offsets.items():
        if axis not in machine.axes or machine.axes[axis].feedback == "load":
            findings.add(
                "machine", f"{axis} carries a lasting offset", compensated=declared.first,
                expected="an axis with its gap behind the loop",
            )  # fmt: skip
            continue
        half = 0.5 * machine.axes[axis].gap.lost_motion
        step = amount.unit * 10.0 ** -(declared.decimals or 0)
        if abs(amount.metres - half) > step:
            findings.add(
                "machine", f"the offset of {axis} is not half its lost motion", compensated=declared.first,
                expected=f"{half / MM:.6g} mm", got=f"{amount.metres / MM:.6g} mm",
            )  # fmt: skip


def _compare(case: Case, machine: Machine | None) -> None:
    """Compare text, state, motion and feed, line by line of the alignment."""
    check_wording(case)
    check_states(case)
    check_breaks(case)
    check_orders(case)
    dwells = check_dwells(case)
    pairing = pair_motions(case, dwells)
    if pairing is None:
        return
    check_pairs(case, pairing)
    check_known(case, pairing)
    check_amounts(case, pairing)
    check_returns(case, pairing)
    check_stops(case, pairing, dwells)
    found = check_course(case, pairing, dwells)
    check_feeds(case, found)
    check_direction(case, pairing)
    if machine is not None:
        check_jogs(case, pairing, machine)


def _bound(declared: Declaration, tolerance: float) -> float:
    """How far the way may be off [m]: the tolerance, or what the header promises where that is less."""
    if declared.chord is None or declared.decimals is None:
        return tolerance
    return min(tolerance, declared.chord + ROUNDED * MM * 10.0**-declared.decimals)
