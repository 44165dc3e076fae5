"""Work offsets, G92 and tool lengths: what of a place is known behind them."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable
from typing import Final, NamedTuple

from ph_post.expand.faults import NotExpandableError
from ph_post.expand.machine import AXES, GROUPS, LINEAR, MachineState
from ph_post.expand.values import UNKNOWN, Store

_SYSTEMS: Final = GROUPS["system"]


class OffsetState(NamedTuple):
    """What a machine's coordinate has besides that of the program: sums by axis, and in X and Y how they are turned.

    Of a place p of X and Y the machine's is (p + `shift`) · exp(i · `turn`) + `base`, as complex numbers.
    """

    totals: dict[str, float]
    base: complex
    shift: complex
    turn: float


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
        if axis not in LINEAR:
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

    @property
    def named(self) -> bool | None:
        """Whether an offset of G92 or G52 is in force, which M72 restores; None where that is not known."""
        applied = self._store.number(5210)
        return None if math.isnan(applied) else applied != 0.0

    def total(self, axis: str) -> float:
        """Return what the machine's coordinate of an axis has besides that of the program."""
        return UNKNOWN if axis in "xy" and self._turn() != 0.0 else self._base(axis) + self._shift(axis)

    def _base(self, axis: str) -> float:
        return self._stored(self._system(), axis) + self._tool[axis]

    def _shift(self, axis: str) -> float:
        applied = self._store.number(5210)
        return self._stored(5211, axis) if applied else applied

    def _turn(self) -> float:
        """Return by how much [rad] the work offset in force is turned."""
        return math.radians(self._store.number(self._system() + 9))

    def _state(self) -> OffsetState:
        base, shift = (complex(of("x"), of("y")) for of in (self._base, self._shift))
        totals = {axis: self._base(axis) + self._shift(axis) for axis in AXES}
        return OffsetState(totals=totals, base=base, shift=shift, turn=self._turn())

    def _keep(self, before: OffsetState, axes: Iterable[str] = AXES, *, table: bool = False) -> None:
        """Give the place of axes behind a change of offsets, of the state from before; `table` by G10.

        Where a work offset is turned by G10, LinuxCNC takes the place as if G92 and G52 had moved nothing.
        """
        now, place, axes = self._state(), self._machine.place, set(axes)
        if table:
            before, now = before._replace(shift=0j), now._replace(shift=0j)
        if (before.turn != 0.0 or now.turn != 0.0) and axes & {"x", "y"}:
            self._put(self._in_machine(before), now)
            axes -= {"x", "y"}
        for axis in axes:
            if before.totals[axis] != now.totals[axis]:
                place[axis] += before.totals[axis] - now.totals[axis]

    def _in_machine(self, state: OffsetState) -> complex:
        """Return the machine's X and Y."""
        place = self._machine.place
        return (complex(place["x"], place["y"]) + state.shift) * cmath.rect(1.0, state.turn) + state.base

    def _put(self, machine: complex, state: OffsetState) -> None:
        """Take the program's X and Y from those of the machine."""
        found = (machine - state.base) * cmath.rect(1.0, -state.turn) - state.shift
        self._machine.place.update(x=found.real, y=found.imag)

    def _go(self, to: dict[str, float]) -> None:
        """Take the places of axes from their coordinates in the machine."""
        state = self._state()
        if state.turn != 0.0 and {"x", "y"} & set(to):
            had = self._in_machine(state)
            self._put(complex(to.get("x", had.real), to.get("y", had.imag)), state)
            to = {axis: value for axis, value in to.items() if axis not in "xy"}
        for axis, value in to.items():
            self._machine.place[axis] = value - state.totals[axis]

    def select(self, code: int) -> None:
        """Change the work offset."""
        before = self._state()
        had = self._machine.modes["system"]
        self._machine.modes["system"] = code
        self._store.numbers[5220] = float(_SYSTEMS.index(code) + 1)
        if had != code:
            self._keep(before)

    def set_length(self, code: int, words: dict[str, float]) -> None:
        """Change the tool's length, which is taken to be along Z, and in G18 along X too."""
        before = self._state()
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
        self._go({axis: words[axis] for axis in AXES if axis in words})

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
            before = self._state()
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
        before = self._state()
        changed = [axis for axis in AXES if axis in words]
        if "r" in words:
            self._store.numbers[base + 9] = words["r"]
        if "r" in words or before.turn != 0.0:
            changed = sorted({*changed, "x", "y"})
        found = {axis: words[axis] for axis in AXES if axis in words}
        if kind == 20:
            steps = {axis: self._machine.place[axis] - value for axis, value in found.items()}
            steps = self._turned(steps, self._turn() if active else 0.0 if before.turn == 0.0 else UNKNOWN)
            found = {axis: self._stored(self._system(), axis) + step for axis, step in steps.items()}
        for axis, value in found.items():
            self._store.numbers[base + AXES.index(axis)] = value / self.unit(axis)
        if active:
            self._keep(before, changed, table=True)
            if kind == 20:
                self._machine.place.update({axis: words[axis] for axis in AXES if axis in words})

    @staticmethod
    def _turned(steps: dict[str, float], turn: float) -> dict[str, float]:
        """Return differences of the program's coordinates as those of the machine."""
        if turn == 0.0 or not {"x", "y"} & set(steps):
            return steps
        turned = complex(steps.get("x", 0.0), steps.get("y", 0.0)) * cmath.rect(1.0, turn)
        return {**steps, "x": turned.real, "y": turned.imag}

    def _set_names(self, words: dict[str, float], *, adds: bool) -> None:
        before = self._state()
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
        self._go({axis: self._store.number(first + AXES.index(axis)) * self.unit(axis) for axis in named})
