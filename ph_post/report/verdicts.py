"""What ``verify`` found, as text and as JSON."""

from __future__ import annotations

from typing import Any

import msgspec

from ph_post.audit.verdict import Verdict
from ph_post.report.tables import counted

SHOWN = 20
"""So many failures are listed as text."""


def verdict_lines(verdict: Verdict) -> list[str]:
    """Say in lines what is wrong, and what was looked at."""
    looked = ", ".join(f"{number} {name}" for name, number in verdict.checked.items() if number)
    seen = f"checked: {looked or 'the header'}"
    if verdict.ok:
        return ["ok: only what is declared was changed", seen]
    lines = [failure.sentence() for failure in verdict.failures[:SHOWN]]
    if verdict.found > len(lines):
        lines.append(f"and {verdict.found - len(lines)} more")
    return [*lines, f"failed: {counted(verdict.found, 'failure')}", seen]


def verdict_view(verdict: Verdict) -> dict[str, Any]:
    """Return the verdict as a JSON object."""
    return {
        "ok": verdict.ok,
        "failures": [msgspec.to_builtins(failure) for failure in verdict.failures],
        "found": verdict.found,
        "checked": dict(verdict.checked),
    }
