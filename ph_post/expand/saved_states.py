"""M70 to M73: modes that are kept and restored, in plain words."""

from __future__ import annotations

import math
from typing import Final

from ph_post.expand.blocks import BlockRunner
from ph_post.expand.faults import ExpandError, NotExpandableError
from ph_post.expand.lines import read_line

_ORDER: Final = (
    *("plane", "cutter", "distance", "feed_mode", "system", "length", "retract", "spindle_mode", "centres"),
    "diameter",
)


def _coolant(mist: bool, flood: bool) -> tuple[int, int]:
    """Return the M words by which LinuxCNC keeps mist and flood, -1 for none: flood alone does not end mist."""
    return (7 if mist else -1 if flood else 9, 8 if flood else -1)


class SavedStates:
    """Modes that M70 and M73 keep, by the depth of the calls.

    Parameters
    ----------
    blocks : BlockRunner
    """

    def __init__(self, blocks: BlockRunner) -> None:
        self._blocks = blocks
        self._kept: dict[int, tuple[dict[str, int], tuple[object, ...]]] = {}
        self._restored: set[int] = set()

    def _state(self) -> tuple[dict[str, int], tuple[object, ...]]:
        machine = self._blocks.machine
        other = (machine.feed, machine.speed, machine.spindle, machine.mist, machine.flood, machine.path_words)
        return dict(machine.modes), (*other, self._blocks.offsets.named)

    def order(self, order: int, depth: int) -> None:
        """Obey M70 to M73."""
        if order in (70, 73):
            self._kept[depth] = self._state()
            if order == 73 and depth > 1:
                self._restored.add(depth)
        elif order == 71:
            self._kept.pop(depth, None)
        elif depth not in self._kept:
            raise ExpandError("M72 without M70 or M73 in the same program")
        else:
            self._restore(depth)

    def leave(self, depth: int) -> None:
        """Restore, at the end of a subprogram, what M73 kept."""
        if depth in self._restored and depth in self._kept:
            self._restore(depth)
        self._restored.discard(depth)
        self._kept.pop(depth, None)

    def _restore(self, depth: int) -> None:
        machine = self._blocks.machine
        modes, (feed, speed, spindle, mist, flood, path_words, named) = self._kept[depth]
        lines = []
        if modes["units"] != machine.modes["units"]:
            if modes["units"] == 0:
                raise NotExpandableError("M72 behind the program's first G20 or G21: the units before are not known")
            lines.append(f"G{modes['units'] / 10:g}")
        words = []
        # G94 and G95 end the F in force, and that of G93 is another.
        own = machine.feed if modes["feed_mode"] == machine.modes["feed_mode"] else None
        for letter, kept, now, decimals in (("F", feed, own, 1), ("S", speed, machine.speed, 0)):
            if isinstance(kept, float) and not math.isnan(kept) and kept != now:
                words.append(f"{letter}{kept:.{decimals}f}")
        words += [f"G{modes[group] / 10:g}" for group in _ORDER if modes[group] != machine.modes[group]]
        path = modes["path"]
        if path != machine.modes["path"] or (path == 640 and path_words != machine.path_words):
            if path == 0:
                raise NotExpandableError("M72 behind the program's first G61 or G64: the path mode before is not known")
            words.append(f"G{path / 10:g}" + (f" {path_words}" if path == 640 and path_words else ""))
        if words:
            lines.append(" ".join(words))
        if named != self._blocks.offsets.named:
            if named is None:
                raise NotExpandableError("M72 behind the program's first G92: whether one was in force is not known")
            lines.append("G92.3" if named else "G92.2")
        if spindle != machine.spindle:
            lines.append(f"M{spindle or 5}")
        current = _coolant(machine.mist, machine.flood)
        coolant = _coolant(bool(mist), bool(flood))
        lines += [f"M{code}" for code, had in zip(coolant, current, strict=True) if code > 0 and code != had]
        for text in lines:
            self._blocks.run(read_line(text), keep=True)
