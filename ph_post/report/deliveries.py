"""What is said about a compensated part program, on the terminal and as JSON."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

from ph_post.audit.deliver import Delivery
from ph_post.audit.outcome import Outcome, Performance
from ph_post.gcode.reader.record import PartProgram
from ph_post.report.assessments import error_view
from ph_post.report.programwindows import window_views
from ph_post.report.tables import counted
from ph_post.types import Machine
from ph_post.units import MM


def delivery_lines(delivery: Delivery, outcome: Outcome | None, products: Iterable[str]) -> Iterator[str]:
    """Say what was changed, what was left alone, and what was written where, a line each."""
    yield summary(delivery, outcome)
    for warning in warnings_of(delivery):
        yield f"warning: {warning}"
    yield from written_lines(products)


def summary(delivery: Delivery, outcome: Outcome | None) -> str:
    """Say in one line what was changed."""
    name = delivery.before.name
    if delivery.done:
        return f"{name}: compensated already for this machine, with these options: kept as it is"
    return f"{name}: {_changes(delivery)}{_times(delivery, outcome)}"


def written_lines(products: Iterable[str]) -> Iterator[str]:
    """Name the files that were written."""
    return (f"wrote {product}" for product in products if product != "-")


def warnings_of(delivery: Delivery) -> tuple[str, ...]:
    """All that was left alone or has to be known, stretches that are passed through first."""
    edits = () if delivery.edits is None else delivery.edits.warnings
    return (*(note_words(delivery.before)), *edits)


def note_words(program: PartProgram) -> Iterator[str]:
    """Name the stretches of a program that are passed through as they are."""
    for note in program.notes:
        lines = f"{note.first + 1}" if note.first == note.last else f"{note.first + 1} to {note.last + 1}"
        yield f"{program.name}:{lines}: {note.what}: passed through as it is"


def _changes(delivery: Delivery) -> str:
    edits = delivery.edits
    if edits is None or delivery.verdict is None:
        return "nothing to change"
    told = delivery.declaration
    facts = [counted(told.stops, "stop")] if told is not None and told.stops else []
    facts += [counted(told.dips, "feed dip")] if told is not None and told.dips else []
    facts += [f"{axis} carries {size / MM:.4g} mm" for axis, size in sorted(edits.amplitude.items())]
    facts += [
        f"{axis} goes out and back by up to {size / MM:.4g} mm" for axis, size in sorted(edits.pulse.items())
    ]
    return ", ".join(facts)


def _times(delivery: Delivery, outcome: Outcome | None) -> str:
    if outcome is None:
        return ""
    apart = ", not counting what is passed through" if delivery.before.notes else ""
    return f"; cycle time {outcome.before.time:.3f} s before, {outcome.after.time:.3f} s after{apart}"


def delivery_view(
    delivery: Delivery, machine: Machine, tolerance: float, outcome: Outcome | None
) -> dict[str, Any]:
    """Return what ``convert --json`` prints of a part program; what was not simulated is null."""
    edits, told = delivery.edits, delivery.declaration
    sides: dict[str, Performance | None] = {"before": None, "after": None}
    if outcome is not None:
        sides = {"before": outcome.before, "after": outcome.after}
    return {
        "windows": window_views(delivery, machine, tolerance),
        "cycle_time": {side: None if one is None else one.time for side, one in sides.items()},
        "error": {side: None if one is None else error_view(one.error) for side, one in sides.items()},
        "carrier": "program",
        "stops": 0 if told is None else told.stops,
        "dips": 0 if told is None else told.dips,
        "offsets": {} if edits is None else {axis: size / MM for axis, size in edits.amplitude.items()},
        "pulses": {} if edits is None else {axis: size / MM for axis, size in edits.pulse.items()},
        "verified": delivery.verdict is not None and delivery.verdict.ok,
        "unchanged": delivery.after.data == delivery.before.data,
        "warnings": list(warnings_of(delivery)),
    }


def undone_view() -> dict[str, Any]:
    """Return what ``convert --undo --json`` prints: as :func:`delivery_view`, nothing added or simulated.

    What is given back is the original byte for byte, which the hash in the program's head has shown.
    """
    return {
        "windows": [],
        "cycle_time": {"before": None, "after": None},
        "error": {"before": None, "after": None},
        "carrier": "program",
        "stops": 0,
        "dips": 0,
        "offsets": {},
        "pulses": {},
        "verified": True,
        "unchanged": False,
        "warnings": [],
    }
