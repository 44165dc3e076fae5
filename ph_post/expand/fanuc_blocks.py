"""Blocks of Fanuc programs: what they do to modes and place, and cycles and turned coordinates as plain motions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from ph_post.expand.cycles import CycleMemory
from ph_post.expand.fanuc_cycle import MOVING_ONLY, PECKING, FanucCycle
from ph_post.expand.faults import ExpandError, NotExpandableError
from ph_post.expand.frames import Place, TurnedFrame
from ph_post.expand.machine import AXES, MachineState
from ph_post.expand.macro import FanucNumbers, word_text

_CYCLES: Final = (730, 740, 760, 810, 820, 830, 840, 850, 860, 870, 880, 890)
_LINES: Final = (0, 10)
_ARCS: Final = (20, 30)
_FRAMES: Final = (500, 501, 510, 511, 680, 690)
_GROUPS: Final = {
    "plane": (170, 180, 190),
    "units": (200, 210),
    "distance": (900, 910),
    "cutter": (400, 410, 420),
    "retract": (980, 990),
    "motion": (*_LINES, *_ARCS),
}
_GROUP_OF: Final = {code: group for group, codes in _GROUPS.items() for code in codes}
_QUIET: Final = {50, 51, 220, 230, 250, 260}
"""Look-ahead, contour control and limit checks: axis words beside them are their own."""

_STILL: Final = {*_QUIET, 80, 90, 131, 150, 610, 620, 630, 640, 800, 930, 940, 950, 960, 970}
"""G words that move nothing, and change nothing that is followed here."""

_KNOWN: Final = {*_GROUP_OF, *_CYCLES, *_FRAMES, *_STILL, 40}
_NO_MOTION: Final = -2
_OTHER_ARC: Final = {20: 30, 30: 20}
_ENDS: Final = (500, 501, 690)
_LENGTHS: Final = (430, 440, 490)
_OF_AXES: Final = (280, 290, 300, 520, 530)
"""G words behind which the axes that they name are somewhere else."""

_NEVER: Final = 0
_ENDS_OF: Final = {680: 690, 510: 500, 511: _NEVER, 71: _NEVER, 121: 131, 160: 150, 682: 690, 683: 690, 684: 690}
"""G words that give coordinates another sense, and the one that ends that; a mirror may end axis by axis."""

_OF_CYCLES: Final = "xyzrpqk"
_BESIDE: Final = "fsthd"
_IN_FRAMES: Final = (_KNOWN - {200, 210, 170, 180, 190, 131, 150, *_QUIET}) | {*_LENGTHS}
_STILL_ORDERS: Final = {*range(6), 7, 8, 9, 10, 11, 19, 29, 30, *range(41, 45), 48, 49, 88, 89}
_BEFORE: Final = {3, 4, 7, 8, 9}
"""M words that may stand ahead of a cycle's first motion."""


def _moves_nothing_else(code: int) -> bool:
    """Return whether a G word leaves the motion in force as it is."""
    return code in _KNOWN or code in (*_LENGTHS, *_OF_AXES, 100, 110, 310, 650, 920) or 540 <= code <= 599


class MacroWord(NamedTuple):
    """A word: its letters in small, its value in units (NaN where it is not known), and how it is written."""

    letters: str
    value: float
    text: str


class FanucBlocks:
    """Follows blocks, and writes them out to `lines`.

    Parameters
    ----------
    numbers : FanucNumbers
    standing : mapping
        Why the cycle or frame that begins at a place (file and line) stays as it is.

    `at` is the place of the line that runs, `begun` that of the cycle or frame that is being written out.
    """

    def __init__(self, numbers: FanucNumbers, standing: Mapping[tuple[str, int], str]) -> None:
        self.numbers, self._standing = numbers, standing
        self.machine = MachineState()
        self.machine.modes.update(plane=0, distance=0, motion=_NO_MOTION)
        self.lines: list[str] = []
        self.changed = False
        self.at = ("", 0)
        self.begun: tuple[str, int] | None = None
        self.notes: dict[str, None] = {}
        self._memory = CycleMemory()
        self._cycle = 0
        """Cycle that the program has in force, negative where it stays as it is."""
        self._frame: TurnedFrame | None = None
        self._unsettled: set[str] = set()
        self._stands: set[int] = set()
        """Words that will end what gives coordinates another sense, and stays as it is."""
        self._moves_by = _NO_MOTION
        """Motion that the control has in force."""
        self._written: Place = dict.fromkeys(AXES, math.nan)

    @property
    def more(self) -> int:
        """One more decimal in inches, and where nobody says that lengths are in mm."""
        return 0 if self.machine.modes["units"] == 210 else 1

    # ------------------------------------------------------------------ a block

    def run(
        self, text: str, words: Sequence[MacroWord], comments: Sequence[str], *, optional: bool, same: bool
    ) -> None:
        """Run a block of a `text`, which can be kept where it is the `same` as its words."""
        if any(word.letters in "gm" and math.isnan(word.value) for word in words):
            if self.begun is not None:
                raise NotExpandableError("a G or an M without its number")
            self.machine.forget()
            self._keep(text, words, comments, slash="/" * optional, same=same)
            return
        codes = self.codes_of(words)
        orders = [round(word.value) for word in words if word.letters == "m"]
        values = {word.letters: word.value for word in words if word.letters not in "gmno"}
        if optional:
            self._run_optional(codes)
            self._keep(text, words, comments, slash="/", same=same)
            return
        self._follow_modes(codes, orders)
        pointed = all("." in word.text for word in words if word.letters == "r" and word.value)
        changed = self._frame_words(codes, values, pointed=pointed)
        motion = self._motion(codes, values)
        self._check_frame(codes, orders, words)
        if motion in _CYCLES and self._cycle > 0:
            self._write_cycle(motion, words, orders, values, comments)
            return
        start = dict(self.machine.place)
        moves = motion in _LINES + _ARCS
        if moves:
            self._settle(motion, values)
        self._follow(codes, motion, values)
        begins: list[str] = []
        if moves:
            obeyed = _OTHER_ARC[motion] if motion in _ARCS and self._mirrors else motion
            begins = [f"G{obeyed // 10}"] if obeyed != self._moves_by and motion not in codes else []
            self._moves_by = obeyed
        if self._frame is not None and moves and (motion in _ARCS or self._moved & set(values)):
            self._put([*begins, *self._turned(words, motion, start, values), *comments])
        else:
            if changed or begins:
                self._put([*begins, *self._plain(words), *comments])
            else:
                self._keep(text, words, comments, slash="", same=same)
            self._written.update({axis: self.machine.place[axis] for axis in AXES if axis not in self._moved})
        if not self.is_open:
            self.begun = None

    def codes_of(self, words: Sequence[MacroWord]) -> list[int]:
        """Return ten times the G words of a block."""
        return [round(10.0 * word.value) for word in words if word.letters == "g"]

    @property
    def is_open(self) -> bool:
        """Whether something is being written out that a later block may end."""
        return self._frame is not None or bool(self._unsettled) or self._cycle > 0

    def _check_frame(self, codes: list[int], orders: list[int], words: Sequence[MacroWord]) -> None:
        """Refuse what cannot be followed in turned coordinates."""
        if self._frame is None:
            return
        odd = [f"G{code / 10:g}" for code in codes if code not in _IN_FRAMES]
        odd += [f"M{order}" for order in orders if order not in _STILL_ORDERS]
        odd += [word.letters.upper() for word in words if len(word.letters) > 1]
        if odd:
            raise NotExpandableError(f"{odd[0]} in turned, scaled or mirrored coordinates")

    @property
    def _moved(self) -> frozenset[str]:
        return frozenset() if self._frame is None else self._frame.moved

    @property
    def _mirrors(self) -> bool:
        return self._frame is not None and self._frame.mirrors

    def _put(self, texts: Sequence[str]) -> None:
        found = [text for text in texts if text]
        self.lines += [" ".join(found)] if found else []
        self.changed = True

    def _keep(self, text: str, words: Sequence[MacroWord], comments: Sequence[str], *, slash: str, same: bool) -> None:
        if same:
            self.lines.append(text)
        else:
            found = [word.text for word in words if word.text] + list(comments)
            self._put([slash + found[0], *found[1:]] if found else [])

    @staticmethod
    def _plain(words: Sequence[MacroWord]) -> list[str]:
        """Return the words but those that begin or end a frame."""
        frames = {round(10.0 * word.value) for word in words if word.letters == "g"} & set(_FRAMES)
        dropped = [*"xyzijkrp"] if frames - {500, 690} else []
        return [
            word.text
            for word in words
            if word.letters not in dropped and not (word.letters == "g" and round(10.0 * word.value) in _FRAMES)
        ]

    def _run_optional(self, codes: list[int]) -> None:
        """Know nothing of what a line with a slash changes, which runs or not as the control's switch says."""
        if self.begun is not None:
            raise NotExpandableError("a line with a slash in a cycle, or in turned coordinates")
        for code in codes:
            if code in _GROUP_OF:
                self.machine.modes[_GROUP_OF[code]] = _NO_MOTION if _GROUP_OF[code] == "motion" else 0
        self.machine.forget()
        self._moves_by = self.machine.modes["motion"]
        self._stands |= {_NEVER} if set(codes) & {*_FRAMES, *_ENDS_OF} else set()

    def lose(self, why: ExpandError) -> None:
        """Know nothing any longer but the units, which no program may change (B-64484EN, "Inch/metric conversion").

        Raises
        ------
        ExpandError
            The reason `why`, where something is being written out that would be in force there.
        """
        motion = self.machine.modes["motion"]
        other = self.changed and self._moves_by != motion
        if self.begun is not None or (other and motion not in _LINES + _ARCS):
            raise why
        if other:
            self._put([f"G{motion // 10}"])
        self.machine.modes.update(dict.fromkeys(_GROUPS, 0) | {"units": self.machine.modes["units"]})
        self.machine.modes["motion"] = self._moves_by = _NO_MOTION
        self.machine.spindle = 0
        self.machine.forget()

    # ------------------------------------------------------------------ modes and place

    def _follow_modes(self, codes: list[int], orders: list[int]) -> None:
        machine = self.machine
        for code in codes:
            group = _GROUP_OF.get(code)
            if group == "units":
                machine.set_units(code)
            if group is not None:
                machine.modes[group] = code
            if group == "motion" or code == 800:
                self._cycle = 0
            if group is None and not _moves_nothing_else(code):
                machine.modes["motion"], self._cycle = _NO_MOTION, 0
            self._stands.discard(code)
            if code in _ENDS_OF and code not in _FRAMES:
                self._stands.add(_ENDS_OF[code])
        for order in orders:
            if order in (3, 4, 5):
                machine.spindle = order
            elif order not in _STILL_ORDERS:
                machine.forget()
        cycle = next((code for code in codes if code in _CYCLES), None)
        if cycle is not None:
            self._begin_cycle(cycle)

    def _motion(self, codes: list[int], values: dict[str, float]) -> int:
        """Return the motion of a block, -1 for none, `_NO_MOTION` for one that nobody knows."""
        takes = [code for code in codes if code not in _KNOWN - {40, 501, 510, 511, 680} and code not in _LENGTHS]
        if any(not 540 <= code <= 599 for code in takes) or _QUIET & set(codes):
            return -1
        if not any(letter in values for letter in [*AXES, "i", "j", "k", *("r" if self._cycle else "")]):
            return -1
        if self._cycle:
            return abs(self._cycle)
        return self.machine.modes["motion"]

    def _follow(self, codes: list[int], motion: int, values: dict[str, float]) -> None:
        """Follow the place."""
        machine = self.machine
        named = "".join(axis for axis in AXES if axis in values)
        for code in codes:
            if code in _LENGTHS:
                machine.forget("z")
            elif code == 920:
                machine.place.update({axis: values[axis] for axis in named})
            elif code not in _KNOWN:
                machine.forget(named if code in _OF_AXES else AXES)
        if motion == _NO_MOTION or ",c" in values or ",r" in values:
            machine.forget()
        elif motion >= 0 and machine.modes["distance"] == 0:
            machine.forget(named)
        elif motion >= 0:
            machine.place = machine.target(values)
        if motion in _CYCLES:
            machine.forget("z" if machine.absolute else "xyz")

    # ------------------------------------------------------------------ cycles

    def _begin_cycle(self, cycle: int) -> None:
        if not self._cycle:
            self._memory = CycleMemory()
        if self._stands or self._cycle < 0:
            self._cycle = -cycle
            return
        why = self._standing.get(self.at, "")
        if cycle not in (*MOVING_ONLY, *(PECKING if self.numbers.clearance is not None else ())):
            why = f"G{cycle // 10} depends on the control's settings"
        if why:
            self.notes[f"{self.at[0]}:{self.at[1]}: cycle stays as it is: {why}"] = None
            if self._frame is not None or self._cycle > 0:
                raise NotExpandableError(why)
        else:
            self.begun = self.begun or self.at
        self._cycle = -cycle if why else cycle

    def _write_cycle(
        self,
        motion: int,
        words: Sequence[MacroWord],
        orders: list[int],
        values: dict[str, float],
        comments: Sequence[str],
    ) -> None:
        machine = self.machine
        if machine.modes["distance"] == 0 or machine.modes["plane"] != 170:
            raise NotExpandableError("a cycle before G90 or G91, or not in G17")
        if machine.modes["cutter"] != 400:
            raise NotExpandableError("a cycle with cutter compensation on")
        if set(orders) - _BEFORE or set(values) - set(_OF_CYCLES + _BESIDE) or any(map(math.isnan, values.values())):
            raise NotExpandableError("a word in the block of a cycle that does not belong to it")
        self._settle(0, values)
        writer = FanucCycle(machine, self._memory, self.numbers, self.coordinates)
        if writer.is_open(values):
            raise NotExpandableError("a cycle where neither G98 nor G99 was said")
        texts, says = [], False
        for word in words:
            code = round(10.0 * word.value) if word.letters == "g" else -1
            says |= code in _GROUPS["distance"]
            if word.letters not in _OF_CYCLES and code not in (*_CYCLES, *_GROUPS["distance"]):
                texts.append(word.text)
        own = {word.letters: word.value for word in words if word.letters in _OF_CYCLES}
        times = next((word.text[1:] for word in words if word.letters == "k"), "1")
        own["l"] = float(times)
        made = writer.write(motion, own)
        self._put([*texts, *comments])
        self.lines += [*(["G90"] if says or not machine.absolute else []), *made]
        if not machine.absolute:
            self.lines.append("G91")
        self._moves_by = 0

    # ------------------------------------------------------------------ frames

    def _frame_words(self, codes: list[int], values: dict[str, float], *, pointed: bool) -> bool:
        """Follow the begin and the end of a frame; True where its words go."""
        found = next((code for code in codes if code in _FRAMES), None)
        if found is None:
            return False
        frame = self._frame
        if found in _ENDS:
            if frame is None:
                return False
            named = {axis for axis in AXES if axis in values}
            if found != frame.ends or named != (set(frame.factors) if found == 501 else set()):
                raise NotExpandableError("the end of a frame that is not the one in force, or beside a motion")
            # The place is told without the frame from here on; axes that were not moved in it are where they were.
            self.machine.place = frame.apply(self.machine.place)
            self.machine.place.update({axis: self._written[axis] for axis in self._unsettled})
            self._unsettled, self._frame = set(frame.moved), None
            return True
        if frame is not None:
            raise NotExpandableError("a frame within another")
        if self._stands:
            self._stands.add(_ENDS_OF[found])
            return False
        try:
            if self.at in self._standing:
                raise NotExpandableError(self._standing[self.at])
            if self._unsettled or self._cycle or len(codes) > 1:
                raise NotExpandableError("a frame straight behind another, in a cycle, or beside other words")
            frame = self._new_frame(found, values, pointed=pointed)
        except NotExpandableError as error:
            said = f"{self.at[0]}:{self.at[1]}: turned, scaled or mirrored coordinates stay as they are: {error.what}"
            self.notes[said] = None
            self._stands.add(_ENDS_OF[found])
            self.machine.forget()
            return False
        self._frame, self._unsettled, self.begun = frame, set(frame.moved), self.at
        self._written = dict(self.machine.place)
        return True

    def _new_frame(self, code: int, values: dict[str, float], *, pointed: bool) -> TurnedFrame:
        machine = self.machine
        if machine.modes["plane"] == 0 or not machine.absolute:
            raise NotExpandableError("a frame before G17, G18 or G19, or not in G90")
        if machine.modes["cutter"] != 400:
            raise NotExpandableError("a frame with cutter compensation on")
        axes = machine.axes
        assert axes is not None
        center = {axis: values[axis] for axis in "xyz" if axis in values}
        if any(math.isnan(value) for value in values.values()):
            raise NotExpandableError("a number without a decimal point before G20 or G21")
        if code == 680:
            if any(axis not in center for axis in axes[:2]) or "r" not in values or not pointed:
                raise NotExpandableError("G68 without its centre, or without an R with a decimal point")
            return TurnedFrame(ends=690, axes=axes, center=center, turn=math.radians(values["r"]))
        if code == 511:
            return TurnedFrame(ends=501, axes=axes, center=center, factors=dict.fromkeys(center, -1.0))
        if "p" in values or not {"i", "j", "k"} <= set(values) or set(center) != set("xyz"):
            raise NotExpandableError("G51 but with X, Y, Z, I, J and K: which axes P scales, and by what, is set there")
        factors = {axis: values[letter] for axis, letter in zip("xyz", "ijk", strict=True)}
        return TurnedFrame(ends=500, axes=axes, center=center, factors=factors)

    def _settle(self, motion: int, values: dict[str, float]) -> None:
        """Refuse a first move behind the begin or the end of a frame of which the control's settings decide."""
        plane = set(self.machine.axes[:2] if self.machine.axes else ())
        for group in (plane, {*"xyz"} - plane):
            due = self._unsettled & group
            if due & set(values) or (due & plane and motion in _ARCS):
                if not self.machine.absolute or motion in _ARCS or not due <= set(values):
                    raise NotExpandableError("the first move behind a frame's begin or end names not all axes in G90")
                self._unsettled -= due

    # ------------------------------------------------------------------ texts

    def coordinates(self, axes: Sequence[str]) -> str:
        """Write the place of the machine without the frame, of which some axes are named."""
        place, named = self.machine.place, set(axes)
        if self._frame is not None:
            place = self._frame.apply(place)
            plane = set(self._frame.axes[:2])
            named |= plane if self._frame.turn and named & plane else set()
        texts = []
        for axis in sorted(named):
            texts.append(word_text(axis, place[axis], self.numbers.decimals + self.more))
            self._written[axis] = float(texts[-1][1:])
        return " ".join(texts)

    def _turned(self, words: Sequence[MacroWord], motion: int, start: Place, values: dict[str, float]) -> list[str]:
        """Return the words of a motion without the frame."""
        frame, machine, had = self._frame, self.machine, dict(self._written)
        assert frame is not None
        if machine.modes["cutter"] != 400 and frame.factors:
            raise NotExpandableError("cutter compensation in scaled or mirrored coordinates")
        if frame.factors and any(word.letters[0] == "," for word in words):
            raise NotExpandableError("a corner in scaled or mirrored coordinates")
        texts = []
        for word in words:
            if word.letters == "g" and frame.mirrors and round(10.0 * word.value) in _ARCS:
                texts.append(f"G{_OTHER_ARC[motion] // 10}")
            elif word.letters not in "xyzijk" and not (word.letters == "r" and motion in _ARCS):
                texts.append(word.text)
        named = [axis for axis in "xyz" if axis in values]
        begun, places = frame.apply(start), self.numbers.decimals + self.more
        if named:
            absolute = self.coordinates(named)
            for text in absolute.split():
                axis = text[0].lower()
                if math.isnan(self._written[axis]):
                    raise NotExpandableError("a place that is not known in turned, scaled or mirrored coordinates")
                step = self._written[axis] - had[axis]
                texts.append(text if machine.absolute else word_text(axis, step, places))
        if motion in _ARCS:
            texts += self._circle(values, begun, had, places)
        return texts

    def _circle(self, values: dict[str, float], begun: Place, had: Place, places: int) -> list[str]:
        """Return the words of a circle's centre, from the place that was written before."""
        frame = self._frame
        assert frame is not None
        share = frame.radius()
        if not {"i", "j", "k", "r"} & set(values):
            raise NotExpandableError("an arc without centre and radius")
        if "r" in values:
            return [word_text("r", values["r"] * share, places)]
        along = {axis: values.get(letter, 0.0) for axis, letter in zip("xyz", "ijk", strict=True)}
        vector = frame.vector(along)
        texts = []
        for axis, letter in zip("xyz", "ijk", strict=True):
            if axis in frame.axes[:2]:
                start = begun[axis] if math.isnan(had[axis]) else had[axis]
                texts.append(word_text(letter, begun[axis] + vector[axis] - start, places))
        return texts
