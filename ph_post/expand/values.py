"""Parameters of a program while it is written out; what only the machine knows is NaN."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Final

from ph_post.expand.faults import ExpandError, NotExpandableError

LOCAL: Final = 30
"""Parameters 1 to 30 belong to the subprogram."""

USER: Final = 5000
"""Parameters up to this one hold what programs put there."""

LAST: Final = 5602

UNKNOWN: Final = math.nan

_TOLD: Final = (
    (5061, 5070, "the place of a probing"),
    (5161, 5200, "a home position"),
    (5210, 5219, "an offset of G92"),
    (5220, 5220, "the work offset in force"),
    (5221, 5390, "a work offset"),
    (5399, 5399, "an input of the machine"),
    (5400, 5413, "the tool"),
    (5420, 5428, "the position"),
)
"""Parameters that the machine fills."""

READ_ONLY: Final = (5400, 5428)


class ParameterFrame:
    """Parameters of the main program or of one call: `numbers` 1 to 30, and `named` ones."""

    def __init__(self, arguments: Mapping[int, float] | None = None) -> None:
        self.numbers: dict[int, float] = dict(arguments or {})
        self.named: dict[str, float] = {}


class Store:
    """All parameters.

    `told` looks up a named parameter that the interpreter fills, and returns None where it has no such name;
    `place` does so for the parameters 5420 to 5428. With `stored`, the controller's own file of parameters, all are
    known; without it those that the machine fills are not. `assumed` are the ones that were read as 0 before anything
    was put there; `version` counts changes; `doubt` says what was not known last.
    """

    def __init__(
        self,
        told: Callable[[str], float | None],
        place: Callable[[int], float],
        stored: Mapping[int, float] | None = None,
    ) -> None:
        self._told, self._place, self._stored = told, place, stored is not None
        self.numbers: dict[int, float] = dict(stored or {})
        self.shared: dict[str, float] = {}
        self.frames = [ParameterFrame()]
        self.assumed: set[int] = set()
        self.version = 0
        self.doubt = ""
        self._lost = False

    @property
    def frame(self) -> ParameterFrame:
        """Parameters of the subprogram that runs."""
        return self.frames[-1]

    def number(self, index: float) -> float:
        """Return a numbered parameter."""
        key = self.index_of(index)
        if key <= LOCAL:
            found = self.frame.numbers.get(key)
        elif 5420 <= key <= 5428:
            found = self._place(key - 5420)
        else:
            found = self.numbers.get(key)
        if found is None:
            found = self._unset(key)
        if math.isnan(found):
            what = next((words for low, high, words in _TOLD if low <= key <= high), "")
            self.doubt = f"#{key}, {what}" if what else self.doubt
        return found

    def forget(self) -> None:
        """Know no parameter any longer but those of the subprogram itself: words of a machine's own may set them."""
        self.numbers, self._lost = {}, True
        self.shared = dict.fromkeys(self.shared, UNKNOWN)
        self.version += 1

    def _unset(self, key: int) -> float:
        if self._lost and key > LOCAL:
            self.doubt = f"#{key}"
            return UNKNOWN
        if key <= USER:
            if not (key <= LOCAL and len(self.frames) > 1):
                self.assumed.add(key)
            return 0.0
        told = any(low <= key <= high for low, high, _ in _TOLD)
        always = key <= 5070 or key == 5399 or 5400 <= key <= 5413
        return UNKNOWN if told and (always or not self._stored) else 0.0

    def index_of(self, value: float) -> int:
        """Return the number of a parameter.

        Raises
        ------
        ExpandError
            Where it is no whole number, or there is no such parameter.
        """
        if math.isnan(value):
            raise NotExpandableError(f"a parameter whose number is not known: {self.doubt}")
        key = round(value)
        if abs(value - key) > 1e-4 or not 1 <= key < LAST:
            raise ExpandError("there is no such parameter", expected=f"#1 to #{LAST - 1}", got=f"#{value:g}")
        return key

    def exists(self, name: str) -> bool:
        """Return whether there is a parameter of that name."""
        return name in self._space(name) or self._told(name) is not None

    def named(self, name: str) -> float:
        """Return a named parameter.

        Raises
        ------
        ExpandError
            Where there is none.
        """
        found = self._space(name).get(name)
        if found is None:
            found = self._told(name)
        if found is None and not (self._lost and name.startswith("_")):
            raise ExpandError("the parameter has no value yet", got=f"#<{name}>")
        found = UNKNOWN if found is None else found
        if math.isnan(found):
            self.doubt = f"#<{name}>"
        return found

    def _space(self, name: str) -> dict[str, float]:
        return self.shared if name.startswith("_") else self.frame.named

    def put(self, key: int | str, value: float) -> None:
        """Give a parameter a value.

        Raises
        ------
        ExpandError
            Where only the interpreter may.
        """
        if isinstance(key, str):
            if self._told(key) is not None:
                raise ExpandError("the parameter can only be read", got=f"#<{key}>")
            had, self._space(key)[key] = self._space(key).get(key), value
        else:
            if READ_ONLY[0] <= key <= READ_ONLY[1]:
                raise ExpandError("the parameter can only be read", got=f"#{key}")
            space = self.frame.numbers if key <= LOCAL else self.numbers
            had, space[key] = space.get(key), value
        if had != value:
            self.version += 1

    def require(self, value: float, what: str) -> float:
        """Return a value that has to be known: `NotExpandableError` where only the machine knows it."""
        if math.isnan(value):
            raise NotExpandableError(f"{what} depends on what only the machine knows: {self.doubt or 'a place'}")
        return value

    def holds(self, value: float) -> bool:
        """Return whether a condition holds; its value has to be known."""
        return self.require(value, "a condition") != 0.0


class NumberStore(Store):
    """Parameters that have numbers alone, and are the same in all subprograms; what the program did not set is NaN."""

    def __init__(self) -> None:
        super().__init__(lambda _: None, lambda _: UNKNOWN)

    def put(self, key: int | str, value: float) -> None:
        """Give a parameter a value."""
        assert isinstance(key, int)
        had, self.numbers[key] = self.numbers.get(key), value
        self.version += had != value
