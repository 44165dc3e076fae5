"""Part programs made by hand, as the reader would give them, without a text."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from ph_post.gcode.program import (
    ARC,
    CUBIC,
    LINE,
    NURBS,
    RAPID,
    Break,
    Modal,
    Motions,
    PartProgram,
    WordSource,
    WordTable,
    feed_runs,
)

MM = 1e-3


class Tape:
    """Collects motions, in mm and mm/min; each begins where the one before ends.

    Examples
    --------
    >>> tape = Tape((0, 0, 0))
    >>> tape.line((10, 0, 0)).arc((0, 10, 0), (0, 0), 90.0).motions().kind.tolist()
    [1, 2]
    """

    def __init__(self, start: Sequence[float], feed: float = 1000.0) -> None:
        self.place = np.array(start, dtype=np.float64) * MM
        self.feed = feed
        self.chain = 0
        self.rows: list[dict[str, Any]] = []

    def _add(self, kind: int, end: Any, **what: Any) -> Tape:
        given = np.array([np.nan if x is None else x for x in end], dtype=np.float64) * MM
        given = np.where(np.isnan(given), self.place, given)
        feed = 0.0 if kind == RAPID else what.pop("feed", self.feed) * MM / 60.0
        row = {
            "kind": kind,
            "start": self.place,
            "end": given,
            "plane": 17,
            "center": (0.0, 0.0),
            "angle": 0.0,
            "feed": feed,
            "duration": 0.0,
            "chain": self.chain,
        }
        self.rows.append({**row, **what})
        self.place = given
        return self

    def rapid(self, end: Any) -> Tape:
        return self._add(RAPID, end)

    def line(self, end: Any, **what: Any) -> Tape:
        return self._add(LINE, end, **what)

    def lines(self, points: Any) -> Tape:
        for point in points:
            self.line(point)
        return self

    def arc(self, end: Any, center: Sequence[float], degrees: float, plane: int = 17, **what: Any) -> Tape:
        return self._add(ARC, end, center=tuple(MM * x for x in center), angle=np.radians(degrees), plane=plane, **what)

    def cubic(self, points: Any) -> Tape:
        control = np.array(points, dtype=np.float64) * MM
        return self._add(CUBIC, np.array(points[-1]), control=control)

    def nurbs(self, order: int, points: Any, weights: Sequence[float]) -> Tape:
        control = np.array(points, dtype=np.float64) * MM
        return self._add(NURBS, np.array(points[-1]), nurbs=(order, control, np.array(weights)))

    def new_chain(self) -> Tape:
        self.chain += 1
        return self

    def motions(self) -> Motions:
        rows, count = self.rows, len(self.rows)

        def column(name: str) -> Any:
            return np.array([row[name] for row in rows])

        return Motions(
            block=np.arange(count),
            kind=column("kind"),
            chain=column("chain"),
            start=column("start"),
            end=column("end"),
            plane=column("plane"),
            center=column("center"),
            angle=column("angle"),
            feeds=feed_runs(column("feed")),
            duration=column("duration"),
            exact=np.zeros(count, dtype=np.int64),
            control={k: row["control"] for k, row in enumerate(rows) if "control" in row},
            nurbs={k: row["nurbs"] for k, row in enumerate(rows) if "nurbs" in row},
        )

    def program(self) -> PartProgram:
        count = len(self.rows)
        none = np.zeros(0, dtype=np.int64)
        words = WordTable(
            block=none,
            letter=none.astype(np.uint8),
            start=none,
            end=none,
            value=np.zeros(0),
            decimals=none,
        )
        ends = (Break(block=0, motion=0, kind="beginning"), Break(block=count, motion=count, kind="end"))
        return PartProgram(
            name="tape.ngc",
            data=b"\n" * count,
            digest=hashlib.sha256(b"").hexdigest(),
            lines=np.arange(count + 1),
            source=WordSource(words),
            motions=self.motions(),
            modal=(Modal(),),
            state=np.zeros(count, dtype=np.int64),
            feeds=feed_runs(np.full(count, self.feed)),
            breaks=ends,
            notes=(),
        )
