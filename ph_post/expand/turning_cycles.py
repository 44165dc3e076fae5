"""A turning cycle of LinuxCNC's from the words of its line and the blocks of its subprogram, as lines of plain motions.

Of the subprogram LinuxCNC takes the motions alone: it reads each block for where it leads, and runs nothing.
"""

from __future__ import annotations

import math
from typing import Final

import msgspec

from ph_post.expand.faults import NotExpandableError
from ph_post.expand.machine import MachineState
from ph_post.expand.profiles import Piece
from ph_post.expand.roughing import TURNING, TurningMove, TurningWords, turning_moves
from ph_post.expand.writing import number_text

_FINISHING: Final = set("xzqdepfs")
_ROUGHING: Final = set("xzqdirfs")
"""Words of a cycle's line; by U and W LinuxCNC moves axes besides."""

_PROFILE: Final = set("xzikrfsac")
"""Words of a block of the profile: A and C round and break corners. By U and W LinuxCNC goes in increments."""

_MOTIONS: Final = (0, 10, 20, 30)
_UNLIKE: Final = {210: 1e-3, 200: 4e-5, 0: 4e-5}
"""By how much radii of an arc at its two ends may differ, by units; LinuxCNC refuses a little more."""


class ProfileBlock(msgspec.Struct, frozen=True):
    """A block of a profile: G words (ten times their numbers), M words and the others."""

    codes: list[int]
    orders: list[int]
    words: dict[str, float]


class TurningCycle(msgspec.Struct, frozen=True):
    """A cycle that is written out: its lines, where it ends (z + i·x), and the motion in force behind it."""

    lines: list[str]
    end: complex
    motion: int


def belongs_to_cycle(letter: str, value: float) -> bool:
    """Return whether a word is part of a turning cycle."""
    return letter in "xzqdeirp" or (letter == "g" and round(10.0 * value) in TURNING)


def turning_cycle(
    machine: MachineState,
    line: ProfileBlock,
    profile: list[ProfileBlock],
    decimals: int,
) -> TurningCycle:
    """Write a cycle out.

    Raises
    ------
    NotExpandableError
        Where it has to stay as it is.
    """
    words = line.words
    odd = [f"G{code / 10:g}" for code in line.codes if code not in TURNING]
    known = _FINISHING if line.codes == [700] else _ROUGHING
    odd += [f"M{order}" for order in line.orders] + [letter.upper() for letter in words if letter not in known]
    if odd or len(line.codes) != 1:
        raise NotExpandableError(f"{(odd or ['another motion'])[0]} on the line of a turning cycle")
    modes = machine.modes
    if not machine.absolute or modes["plane"] != 180 or modes["cutter"] != 400 or modes["feed_mode"] == 930:
        raise NotExpandableError("a turning cycle under G91, G93 or cutter compensation, or in another plane than G18")
    to = machine.target(words)
    begin = complex(to["z"], to["x"])
    if math.isnan(abs(begin)):
        raise NotExpandableError("the place where the turning cycle begins is not known")
    passes = words.get("p", 1.0)
    if passes != round(passes):
        raise NotExpandableError("a turning cycle with a P that is not whole")
    read = TurningWords(
        begin=begin,
        allowance=words.get("d", 0.0),
        last=words.get("e", 0.0),
        step=words.get("i", 1.0),
        lift=words.get("r", 0.5),
        passes=round(passes),
    )
    pieces = read_profile(machine, profile, begin)
    moves = [TurningMove(0, begin), *turning_moves(line.codes[0], pieces, read, machine.version)]
    lines = [_text(machine, had, move, decimals) for had, move in zip([moves[0], *moves], moves, strict=False)]
    return TurningCycle(lines, moves[-1].end, 10 * moves[-1].motion)


def read_profile(machine: MachineState, blocks: list[ProfileBlock], begin: complex) -> list[Piece]:
    """Return the pieces of a profile from where the cycle begins.

    Raises
    ------
    NotExpandableError
        Where a block does more than to move.
    """
    pieces: list[Piece] = []
    at, motion = begin, 0
    for block in blocks:
        words = block.words
        odd = [f"G{code / 10:g}" for code in block.codes if code not in _MOTIONS]
        odd += [f"M{order}" for order in block.orders] + [letter.upper() for letter in words if letter not in _PROFILE]
        if odd:
            raise NotExpandableError(f"{odd[0]} in the profile of a turning cycle")
        motion = next(iter(block.codes), motion)
        to = complex(words.get("z", at.real), words["x"] / machine.factor("x") if "x" in words else at.imag)
        if to == at:
            continue
        turn = {20: -1, 30: 1}.get(motion, 0)
        pieces.append(Piece(at, to, _center(machine, at, to, turn, words) if turn else 0j, turn))
        at = to
        if "a" in words or "c" in words:
            pieces.append(_corner(at, words))
    return pieces


def _corner(at: complex, words: dict[str, float]) -> Piece:
    """Return a corner that is to be rounded by A, or broken by C."""
    finish = words.get("a", words.get("c", 0.0))
    if ("a" in words and "c" in words) or not finish > 0.0:
        raise NotExpandableError("A and C together, or not above 0, in the profile of a turning cycle")
    return Piece(at, at, finish=finish, rounds="a" in words)


def _center(machine: MachineState, start: complex, end: complex, turn: int, words: dict[str, float]) -> complex:
    """Return the centre of an arc of the profile."""
    if "r" in words:
        square = abs(end - start) ** 2
        height = words["r"] ** 2 - square / 4.0
        if height < 0.0 or "i" in words or "k" in words:
            raise NotExpandableError("an arc of the profile whose radius does not reach its end")
        return (start + end) / 2.0 + turn * 1j * math.sqrt(height / square) * (end - start)
    absolute = machine.modes["centres"] == 901
    if len({"i", "k"} & set(words)) < (2 if absolute else 1):
        raise NotExpandableError("an arc of the profile without a centre")
    center = complex(words.get("k", 0.0), words.get("i", 0.0)) + (0.0 if absolute else start)
    if abs(abs(end - center) - abs(start - center)) > _UNLIKE[machine.modes["units"]]:
        raise NotExpandableError("an arc of the profile whose ends are not as far from its centre")
    return center


def _text(machine: MachineState, had: TurningMove, move: TurningMove, decimals: int) -> str:
    end, center = move.end, move.center
    if machine.modes["centres"] != 901:
        center -= had.end
    words = [("X", end.imag * machine.factor("x")), ("Z", end.real)]
    if move.motion > 1:
        words += [("I", center.imag), ("K", center.real)]
    return " ".join([f"G{move.motion}", *(f"{letter}{number_text(value, decimals)}" for letter, value in words)])
