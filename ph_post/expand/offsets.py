"""Work offsets, G92 and tool lengths: what of a place is known behind them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from ph_post.expand.faults import NotExpandableError
from ph_post.expand.machine import AXES, GROUPS, MachineState
from ph_post.expand.values import UNKNOWN, Store

_SYSTEMS: Final = GROUPS["system"]
_LINEAR: Final = "xyzuvw"


class WorkOffsets:
    """Follows offsets in the parameters 5161 to 5390, which hold them in the machine's units.

    Parameters
    ----------
    store : Store
    machine : MachineState
    inches : bool
        Whether the machine's units are inches.
    """

    def __init__(self, store: Store, machine: MachineState, *, inches: bool = False) -> None:
        self._store, self._machine, self._inches = store, machine, inches
        self._tool = dict.fromkeys(AXES, 0.0 if store.number(5221) == 0.0 else UNKNOWN)

    def unit(self, axis: str) -> float:
        """Return the machine's unit in those of the program."""
        code = self._machine.modes["units"]
        if axis not in _LINEAR:
            return 1.0
        if code == 0:
            return UNKNOWN
        return (25.4 if self._inches else 1.0) / (25.4 if code == 200 else 1.0)

    def _stored(self, first: int, axis: str) -> float:
        value = self._store.numbers.get(first + AXES.index(axis))
        if value is None:
            value = self._store.number(first + AXES.index(axis))
        return value * self.unit(axis) if value else value

    def _system(self, code: int | None = None) -> int:
        return 5221 + 20 * _SYSTEMS.index(self._machine.modes["system"] if code is None else code)

    def total(self, axis: str) -> float:
        """Return what the machine's coordinate of an axis has besides that of the program."""
        base = self._system()
        if axis in "xy" and self._store.numbers.get(base + 9, self._store.number(base + 9)) != 0.0:
            return UNKNOWN
        applied = self._store.number(5210)
        shift = self._stored(5211, axis) if applied else applied
        return self._stored(base, axis) + shift + self._tool[axis]

    def _keep(self, before: dict[str, float], axes: Iterable[str] = AXES) -> None:
        """Give the place of axes behind a change of offsets, of the totals from before."""
        for axis in axes:
            now = self.total(axis)
            if before[axis] != now:
                self._machine.place[axis] += before[axis] - now

    def _totals(self) -> dict[str, float]:
        return {axis: self.total(axis) for axis in AXES}

    def select(self, code: int) -> None:
        """Change the work offset."""
        before = self._totals()
        had = self._machine.modes["system"]
        self._machine.modes["system"] = code
        self._store.numbers[5220] = float(_SYSTEMS.index(code) + 1)
        if had != code:
            self._keep(before)

    def set_length(self, code: int, words: dict[str, float]) -> None:
        """Change the tool's length, which is taken to be along Z, and in G18 along X too."""
        before = self._totals()
        axes: Iterable[str] = "xz" if self._machine.modes["plane"] == 180 else "z"
        if code == 431:
            axes = [axis for axis in AXES if axis in words]
        for axis in axes:
            self._tool[axis] = 0.0 if code == 490 else words.get(axis, UNKNOWN) if code == 431 else UNKNOWN
        self._keep(before, axes)

    def tool_changed(self) -> None:
        """Forget what a change of tools may move."""
        self._machine.forget()
        self._store.numbers.update(dict.fromkeys(range(5400, 5414), UNKNOWN))

    def was_set(self, key: int) -> None:
        """Follow a parameter of the machine that the program sets itself."""
        if not 5210 <= key <= 5390:
            return
        raise NotExpandableError(f"the program sets #{key}, which the controller reads when it likes")

    def move_in_machine(self, words: dict[str, float]) -> None:
        """Follow a move of G53."""
        for axis in AXES:
            if axis in words:
                self._machine.place[axis] = words[axis] - self.total(axis)

    def apply(self, code: int, words: dict[str, float]) -> None:
        """Follow a word that sets an offset, or goes home."""
        if code == 100:
            self._set_table(words)
        elif code in (280, 300):
            self._home(5161 if code == 280 else 5181, words)
        elif code in (281, 301):
            for axis in AXES:
                value = (self._machine.place[axis] + self.total(axis)) / self.unit(axis)
                self._store.put((5161 if code == 281 else 5181) + AXES.index(axis), value)
        elif code in (520, 920):
            self._set_names(words, adds=code == 520)
        else:
            before = self._totals()
            if code == 921:
                self._store.numbers.update(dict.fromkeys(range(5210, 5220), 0.0))
            else:
                self._store.numbers[5210] = float(code == 923)
            self._keep(before)

    def _set_table(self, words: dict[str, float]) -> None:
        kind, which = round(words.get("l", -1.0)), round(words.get("p", -1.0))
        if kind not in (2, 20):
            self._store.numbers.update(dict.fromkeys(range(5400, 5414), UNKNOWN))
            return
        code = _SYSTEMS[which - 1] if 1 <= which <= len(_SYSTEMS) else self._machine.modes["system"]
        base, active = self._system(code), code == self._machine.modes["system"]
        before = self._totals()
        changed = [axis for axis in AXES if axis in words]
        if "r" in words:
            self._store.numbers[base + 9] = words["r"]
            changed = sorted({*changed, "x", "y"})
        for axis in AXES:
            if axis not in words:
                continue
            key, unit = base + AXES.index(axis), self.unit(axis)
            if kind == 2:
                self._store.numbers[key] = words[axis] / unit
            else:
                value = self._machine.place[axis] + self._stored(self._system(), axis) - words[axis]
                self._store.numbers[key] = value / unit
        if active:
            self._keep(before, changed)
            if kind == 20:
                self._machine.place.update({axis: words[axis] for axis in AXES if axis in words})

    def _set_names(self, words: dict[str, float], *, adds: bool) -> None:
        before = self._totals()
        self._store.numbers.setdefault(5210, self._store.number(5210))
        for axis in AXES:
            if axis not in words:
                continue
            key = 5211 + AXES.index(axis)
            had = self._store.number(key) if self._store.number(5210) else self._store.number(5210)
            if adds:
                self._store.numbers[key] = words[axis] / self.unit(axis)
            else:
                self._store.numbers[key] = had + (self._machine.place[axis] - words[axis]) / self.unit(axis)
        self._store.numbers[5210] = 1.0
        self._keep(before, [axis for axis in AXES if axis in words])
        if not adds:
            self._machine.place.update({axis: words[axis] for axis in AXES if axis in words})

    def _home(self, first: int, words: dict[str, float]) -> None:
        named = [axis for axis in AXES if axis in words] or list(AXES)
        for axis in named:
            self._machine.place[axis] = self._store.number(first + AXES.index(axis)) * self.unit(axis)
            self._machine.place[axis] -= self.total(axis)
