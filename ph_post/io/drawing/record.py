"""What a drawing is to this program: runs of shapes by layer, its unit, and what was left out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from fractions import Fraction
from typing import Final, Literal

import msgspec

from ph_post.errors import InputError
from ph_post.io.drawing.shapes import Shape, is_finite, transformed
from ph_post.types import Array

MAX_BYTES: Final = 64 * 2**20
"""Largest drawing that is read; one takes some thirty times as much memory."""

MAX_ENTITIES: Final = 100_000
"""Most entities, blocks taken apart: what refers to itself tenfold in ten steps must end somewhere."""

MAX_DEPTH: Final = 64
"""Deepest nesting of blocks or groups."""

UNITS: Final = {
    "mm": Fraction(1), "cm": Fraction(10), "m": Fraction(1000), "um": Fraction(1, 1000),
    "inch": Fraction(127, 5), "ft": Fraction(1524, 5), "mil": Fraction(127, 5000),
    "px": Fraction(127, 480), "pt": Fraction(127, 360),
}  # fmt: skip
"""Length units by the names of --units [mm]; px and pt as CSS has them, 96 and 72 to the inch."""


class Run(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Shapes that the drawing itself joins end to start: one entity, or one subpath.

    `name` tells it in messages: ``LINE 2F``, ``path at line 12``.
    """

    shapes: tuple[Shape, ...]
    layer: str
    name: str


class Drawing(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A drawing as read, y upwards.

    `unit` is the length unit's name, None where the drawing does not tell; `found` counts entities by layer
    and kind, `left_out` what is not in the runs, by its name; `notes` are for the user.
    """

    kind: Literal["DXF", "SVG"]
    runs: tuple[Run, ...]
    unit: str | None
    found: dict[str, dict[str, int]]
    left_out: dict[str, int]
    notes: tuple[str, ...]


class Collector:
    """Gathers what a reader finds, and keeps count.

    Parameters
    ----------
    file : str
        The drawing's name for messages.
    layers : sequence of str
        Layers that are wanted; all where there are none.
    """

    def __init__(self, file: str, layers: Sequence[str] = ()) -> None:
        self.file = file
        self.layers = frozenset(layers)
        self.runs: list[Run] = []
        self.found: dict[str, Counter[str]] = {}
        self.left_out: Counter[str] = Counter()
        self.notes: dict[str, None] = {}
        self._count = 0

    def wants(self, layer: str) -> bool:
        """Whether a layer was asked for."""
        return not self.layers or layer in self.layers

    def count(self, layer: str, kind: str) -> None:
        """Count one entity, whether it is understood or not.

        Raises
        ------
        InputError
            Where there are too many.
        """
        self.found.setdefault(layer, Counter())[kind] += 1
        self.spend(1)

    def spend(self, number: int) -> None:
        """Count towards the limit.

        Raises
        ------
        InputError
            Where it is passed.
        """
        self._count += number
        if self._count > MAX_ENTITIES:
            raise InputError(
                self.file, "the drawing is too large",
                expected=f"at most {MAX_ENTITIES} entities, blocks taken apart", got="more",
            )  # fmt: skip

    def leave_out(self, what: str, times: int = 1) -> None:
        """Name something that does not become part of the path; of nothing there is nothing to say."""
        if times:
            self.left_out[what] += times

    def note(self, text: str) -> None:
        """Say something once."""
        self.notes[text] = None

    def add(self, shapes: Sequence[Shape], matrix: Array, layer: str, name: str) -> None:
        """Add a run, mapped.

        Raises
        ------
        InputError
            Where a coordinate is not a number.
        """
        mapped = tuple(transformed(shape, matrix) for shape in shapes if is_finite(shape))
        if len(mapped) < len(shapes) or not all(map(is_finite, mapped)):
            raise InputError(
                f"{self.file}: {name}", "a coordinate is not a number", expected="finite numbers"
            )
        if mapped:
            self.runs.append(Run(shapes=mapped, layer=layer, name=name))
        else:
            self.leave_out(f"{name.split(maxsplit=1)[0]} without length")

    def drawing(self, kind: Literal["DXF", "SVG"], unit: str | None) -> Drawing:
        """Return what was gathered."""
        return Drawing(
            kind=kind,
            runs=tuple(self.runs),
            unit=unit,
            found={layer: dict(counts) for layer, counts in self.found.items()},
            left_out=dict(self.left_out),
            notes=tuple(self.notes),
        )
