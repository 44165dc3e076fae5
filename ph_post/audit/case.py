"""What all checks of ``verify`` look at, in one record."""

from __future__ import annotations

import msgspec

from ph_post.audit.align import Alignment
from ph_post.audit.declared import Declaration
from ph_post.audit.verdict import Findings
from ph_post.gcode.reader.record import PartProgram


class Case(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A program, what was made of it, and what is known about both.

    `bound` [m] is how far the way may be off, `band` [m] the longest excursion of an axis that need not be
    followed by its offset. Every check adds what it finds to `findings`.
    """

    original: PartProgram
    compensated: PartProgram
    declared: Declaration
    lines: Alignment
    bound: float
    band: float
    findings: Findings
