"""Write the offsets of axes beside X, Y and Z, and of holes in drilling cycles, into a program, and what undoes that.

It comes before all else that is done for X, Y and Z, which then finds the words of these as they are to stay.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np

from ph_post.dialects.base import Dialect
from ph_post.edit.block_words import line_end
from ph_post.edit.changes import Change
from ph_post.edit.further_edits import AddedMoves, FurtherAxisPlan
from ph_post.edit.hole_edits import HolePlan
from ph_post.edit.word_shifts import ShiftedWords, assemble
from ph_post.edit.write import HASH_DIGITS, check_lines, head_line, join_lines, shifted_numbers
from ph_post.expand.writing import SHIFTED, Written
from ph_post.gcode.numbers import comment_lines, decimal_text
from ph_post.gcode.program import PartProgram
from ph_post.types import ROTARY_AXES, Machine, sealed
from ph_post.units import MINUTE, MM
from ph_post.version import package_version

_PART_OF_SPEED: Final = 0.25
"""Part of the axis' speed at which a move of its own is timed under G93."""

_LEAST_TIME: Final = 0.02
"""Least time of such a move [s]."""


class FurtherRequest(msgspec.Struct, frozen=True, kw_only=True):
    """What the head of a program says of a compensation: machine and options by their hashes."""

    machine: str
    machine_digest: str
    options_digest: str

    @classmethod
    def of(cls, machine: Machine, options_digest: str) -> FurtherRequest:
        """Shorten the hashes as they are written."""
        return cls(
            machine=machine.name,
            machine_digest=machine.digest[:HASH_DIGITS],
            options_digest=options_digest[:HASH_DIGITS],
        )


def write_further(
    program: PartProgram,
    plans: Sequence[FurtherAxisPlan],
    dialect: Dialect,
    request: FurtherRequest,
    holes: HolePlan | None = None,
) -> bytes:
    """Write plans of axes beside X, Y and Z, and of holes, into a program; its own bytes where nothing changes.

    Raises
    ------
    InputError
        Where a number has too many digits.
    LongLinesError
        Where lines come out too long for the dialect.
    """
    holes = HolePlan() if holes is None else holes
    across = holes.axes if holes.changed else ()
    changed = [*(plan for plan in plans if plan.shifts or plan.added), *across]
    if not changed:
        return program.data
    decimals, least = max(plan.decimals for plan in changed), int(dialect.numbers.point)
    steps = {word: count * 10 ** (decimals - plan.decimals) for plan in changed for word, count in plan.shifts.items()}
    word = np.array(sorted(steps), dtype=np.int32)
    delta = np.array([steps[one] for one in word.tolist()], dtype=np.int32)
    numbers = shifted_numbers(program, ShiftedWords(word=word, delta=delta), decimals, least)
    changes = [_change(program, plan, one, dialect) for plan in changed for one in plan.added]
    changes += holes.changes
    changes.sort(key=lambda change: change.block)
    style, end, first = dialect.syntax.comments, line_end(program), head_line(program)
    most = dialect.syntax.max_line
    facts = [SHIFTED.mark + fact for fact in _facts(program, changed, holes, request)]
    texts = [join_lines([line for fact in facts for line in comment_lines(fact, most, style)], end)]
    for change in changes:
        mark = f"{SHIFTED.mark}+{len(change.lines)} -0 {', '.join(change.label)}"
        texts.append(join_lines([*comment_lines(mark, most, style), *change.lines], end))
    data = program.data if program.data.endswith((b"\n", b"\r")) else program.data + end.encode()
    places = np.array([first, *(change.block for change in changes)], dtype=np.int64)
    at = np.append(program.lines[:-1], len(data))[places]
    sizes = np.append(0, np.cumsum([len(text) for text in texts]))
    words = program.words
    made = assemble(
        np.frombuffer(data, np.uint8),
        words.start[word] + 1,
        words.end[word],
        sealed(numbers.pool),
        numbers.bounds,
        np.column_stack([at, at, sizes[:-1], sizes[1:]]).astype(np.int64),
        np.frombuffer(b"".join(texts), np.uint8),
    )
    check_lines(program, made, dialect)
    text = made.tobytes()
    kept = Written(original=program.data, digest=hashlib.sha256(text).hexdigest())
    return SHIFTED.add(text, kept, end.encode(), style)


def _facts(
    program: PartProgram, plans: Sequence[FurtherAxisPlan], holes: HolePlan, request: FurtherRequest
) -> list[str]:
    whats = ["axes beside X, Y and Z"] if any(plan not in holes.axes for plan in plans) else []
    whats += ["X and Y of holes"] if holes.changed else []
    return [
        f"{package_version()} compensated {' and '.join(whats)}",
        f"original sha256 {program.digest}",
        f"machine {request.machine}, sha256 {request.machine_digest}",
        f"options sha256 {request.options_digest}",
        *(f"offset {plan.axis.name} {offset_words(plan)}" for plan in plans),
        *(f"take-up {plan.axis.name} {_way_text(plan, plan.beyond)}" for plan in plans if plan.beyond),
        f"{sum(plan.added_moves for plan in plans) + sum(len(one.lines) for one in holes.changes)} short moves",
    ]


def offset_words(plan: FurtherAxisPlan) -> str:
    """Write the offset of an axis to either side, or with a sign to that side alone, as ``0.025 deg``."""
    minus, plus = plan.sides
    sign = "+" if minus == 0 else "-" if plus == 0 else ""
    return sign + _way_text(plan, max(abs(minus), abs(plus)))


def _way_text(plan: FurtherAxisPlan, steps: int) -> str:
    unit = "deg" if plan.axis.name in ROTARY_AXES else "mm" if plan.step * 10**plan.decimals == MM else "inch"
    return f"{decimal_text(steps, plan.decimals)} {unit}"


def _change(program: PartProgram, plan: FurtherAxisPlan, moves: AddedMoves, dialect: Dialect) -> Change:
    """Write moves of an axis alone."""
    words, fine = program.words, plan.decimals
    own = words.decimals[(words.letter == ord(moves.letter)) & (words.decimals >= 0)]
    fine = max(fine, int(own.max(initial=0)))
    scale = 10 ** (fine - plan.decimals)
    lines, at = [], moves.at
    for step in moves.steps:
        count = round(moves.place / plan.step * scale) + step * scale if moves.absolute else (step - at) * scale
        text = [moves.motion, moves.letter + dialect.numbers.length(count, fine)]
        if moves.inverse:
            way = abs(step - at) * plan.step
            time = max(way / (_PART_OF_SPEED * plan.axis.limits.velocity), _LEAST_TIME)
            text.append("F" + dialect.numbers.inverse_time(MINUTE / time))
        lines.append(("" if dialect.syntax.terse else " ").join(text))
        at = step
    return Change(block=moves.block, removed=0, lines=lines, label=[moves.label])
