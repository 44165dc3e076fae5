"""Columns of well-known recorders, by the names that they give them.

A recorder has patterns for the names of its columns, which say what a column is and its axis: by letter, or by a
number, the lowest of which is X. Units in brackets behind a name hold; otherwise lengths are millimetres.

Facts: LinuxCNC's HAL pins ``joint.N.motor-pos-cmd``, ``joint.N.motor-pos-fb``, ``pid.N.command`` and
``pid.N.feedback`` [1]_; TwinCAT's axis structure with ``SetPos`` and ``ActPos``, and its text export with a
block of lines for every channel [2]_; measuring systems 1, the motor's, and 2, the table's, of SINUMERIK [3]_;
ODrive's ``pos_setpoint``, ``pos_estimate`` and ``Iq_measured`` in turns and amperes [4]_.

References
----------
.. [1] LinuxCNC: motion(9), pid(9), halsampler(1).
.. [2] Beckhoff Information System: TE13xx, Export in csv; TwinCAT Scope 2, Export to CSV.
.. [3] Siemens: SINUMERIK 840D sl, Commissioning Manual, Trace; machine data 30200, 30240.
.. [4] ODrive documentation: API reference, Axis and Controller.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from typing import Final, NamedTuple

import msgspec

from ph_post.errors import InputError
from ph_post.files.check import one_of, quoted
from ph_post.files.logsheet import Sheet
from ph_post.types import MACHINE_AXES


class Recorder(msgspec.Struct, frozen=True, kw_only=True):
    """A recorder: `time` is the pattern of its time, and that unit; `kinds` are those of the other columns.

    A pattern may have the groups `axis` and `number`. `unit` is that of lengths without one in brackets; `per_turn`
    says that these are turns, which need the travel of one. `reads_loop` says that its `act` is what the loop itself
    reads, at the table or at the motor.
    """

    name: str
    time: str
    time_unit: str
    kinds: tuple[tuple[str, str], ...]
    per_turn: bool = False
    reads_loop: bool = False


_LETTER: Final = r"(?:^|[^a-z])(?P<axis>[xyzuvw])[0-9]?(?=[^a-z]|$)"
_JOINT: Final = r"^(?:joint|pid|axis)\.(?:(?P<axis>[xyzuvw])|(?P<number>[0-9]+))\."
_NC: Final = r"(?:axis|axes|achse)[ _.\[]*(?:(?P<axis>[xyzuvw])(?![a-z])|(?P<number>[0-9]+))"
_DRIVE: Final = r"^(?:odrv[0-9]+\.)?(?:axis(?P<number>[0-9]+)|(?P<axis>[xyzuvw]))[._]"
_SIEMENS: Final = r"(?=.*(?:^|[^a-z0-9])(?P<axis>[xyzuvw])[0-9]?(?:[^a-z0-9]|$))?"
_ACTUAL: Final = r".*(?:position|lage|pos\.?).*(?:actual|istwert|ist)"

RECORDERS: Final = {
    one.name: one
    for one in (
        Recorder(
            name="linuxcnc",
            time=r"t|time",
            time_unit="s",
            reads_loop=True,
            kinds=(
                ("cmd", _JOINT + r"(?:motor-pos-cmd|pos-cmd|command)"),
                ("act", _JOINT + r"(?:motor-pos-fb|pos-fb|feedback)"),
            ),
        ),
        Recorder(
            name="siemens",
            time=r"(?:time|zeit)(?: *\(.*\))?",
            time_unit="s",
            kinds=(
                ("cmd", _SIEMENS + r".*(?:position|lage|pos\.?)[- ]?(?:setpoint|set ?point|sollwert|soll)"),
                ("motor", _SIEMENS + _ACTUAL + r".*(?:(?<![a-z0-9])1(?![0-9])|motor)"),
                ("act", _SIEMENS + _ACTUAL + r".*(?:(?<![a-z0-9])2(?![0-9])|direct|direkt)"),
                ("current", _SIEMENS + r".*(?:actual current|current actual|stromistwert).*"),
            ),
        ),
        Recorder(
            name="twincat",
            time=r"time|t",
            time_unit="ms",
            reads_loop=True,
            kinds=(
                ("cmd", r".*?" + _NC + r".*\bf?(?:set|cmd)_?pos(?:ition)?"),
                ("act", r".*?" + _NC + r".*\bf?act_?pos(?:ition)?"),
                ("cmd", r".*" + _LETTER + r".*\bf?(?:set|cmd)_?pos(?:ition)?"),
                ("act", r".*" + _LETTER + r".*\bf?act_?pos(?:ition)?"),
            ),
        ),
        Recorder(
            name="odrive",
            time=r"t|time",
            time_unit="s",
            per_turn=True,
            kinds=(
                ("cmd", _DRIVE + r"(?:controller\.)?(?:pos_setpoint|input_pos)"),
                ("motor", _DRIVE + r"(?:encoder\.|pos_vel_mapper\.)?(?:pos_estimate|pos_rel)"),
                ("current", _DRIVE + r"(?:motor\.)?(?:foc\.|current_control\.)?iq_measured"),
            ),
        ),
    )
}
"""Recorders by name."""

OPTION: Final = "recorder="
"""What a mapping begins with that names a recorder: ``recorder=odrive*5``, with the travel of a turn."""

_OWN_NAME: Final = re.compile(rf"[{''.join(MACHINE_AXES)}]_(?:cmd|act|motor|force|current)")
_BRACKETS: Final = re.compile(r"\s*[\[(]\s*([^\])]*)\s*[\])]\s*$")
_UNITS: Final = {"mm": "mm", "m": "m", "um": "um", "µm": "um", "inch": "inch", "in": "inch", "s": "s", "ms": "ms"}
_UNITS_OTHER: Final = {"us": "us", "µs": "us", "a": "A", "ma": "mA", "n": "N"}


class Spread(NamedTuple):
    """Mappings with those of a recorder, those given first; `words` say what was taken for what.

    `own` are all mappings of the recorder, `loops` the readings that the axes' own loops take, on a side that it does
    not name.
    """

    mappings: list[str]
    words: tuple[str, ...] = ()
    own: tuple[str, ...] = ()
    loops: tuple[str, ...] = ()


def spread(mappings: Sequence[str], sheet: Sheet, at_motor: Collection[str] = ()) -> Spread:
    """Put the mappings of a recorder in place of its name, or of names that only one recorder uses.

    Parameters
    ----------
    mappings : sequence of str
        As the option ``--column`` takes them; one may be ``recorder=NAME[*FACTOR]``.
    sheet : Sheet
    at_motor : collection of str, optional
        Axes whose loops read the motor: what a recorder has of them is X_motor.

    Returns
    -------
    Spread

    Raises
    ------
    InputError
        Where a recorder is not known, or none of its columns is there.
    """
    given = [one for one in mappings if not one.strip().startswith(OPTION)]
    named = [one.strip()[len(OPTION) :] for one in mappings if one.strip().startswith(OPTION)]
    if len(named) > 1:
        raise InputError(f"--column {quoted(OPTION + named[1])}", "a second recorder", expected="one")
    if not named:
        return _recognized(given, sheet, at_motor)
    name, _, factor = (part.strip() for part in named[0].partition("*"))
    if name not in RECORDERS:
        what = f"--column {quoted(OPTION + named[0])}"
        raise InputError(what, "no recorder", expected=one_of(tuple(RECORDERS), name), got=quoted(name))
    recorder = RECORDERS[name]
    if recorder.per_turn and not factor:
        what = f"--column {quoted(OPTION + named[0])}"
        raise InputError(what, "turns need the travel of one [mm]", expected=f"such as {OPTION}{name}*5")
    own = dict(_own(recorder, sheet, factor))
    if not set(own) - {"t"}:
        kinds = "commands or positions"
        raise InputError(sheet.header, f"no {kinds} of {name} among the columns", got=sheet.listed)
    return _spread(recorder, given, own, at_motor)


def _recognized(given: list[str], sheet: Sheet, at_motor: Collection[str]) -> Spread:
    """Take a recorder whose command and reading are there by name, where nothing else says what is."""
    known = any(name.partition("_")[0] in MACHINE_AXES and "_" in name for name in sheet.names)
    # What messages advise, as X_cmd=X_act, takes names that the recorder gives to columns.
    sources = [_source(one) for one in given]
    others = any(one in sheet.names or not _OWN_NAME.fullmatch(one) for one in sources)
    if others or known or not sheet.named:
        return Spread(given)
    for recorder in RECORDERS.values():
        own = dict(_own(recorder, sheet, ""))
        kinds = {name.partition("_")[2] for name in own}
        if "cmd" in kinds and kinds & {"act", "motor"}:
            if recorder.per_turn:
                raise InputError(
                    sheet.header,
                    f"columns of {recorder.name} in turns: the travel of one is needed",
                    expected=f"--column {OPTION}{recorder.name}*5, say, for 5 mm",
                )
            return _spread(recorder, given, own, at_motor)
    return Spread(given)


def _own(recorder: Recorder, sheet: Sheet, factor: str) -> Iterator[tuple[str, str]]:
    """Yield the columns of a recorder that are there: the name of each, and its mapping."""
    matched: dict[tuple[str, str], str] = {}
    for source in sheet.names:
        plain, unit = without_unit(source)
        if re.fullmatch(recorder.time, plain, re.IGNORECASE):
            yield "t", f"t={source}:{unit or recorder.time_unit}"
            continue
        for kind, pattern in recorder.kinds:
            found = re.match(pattern, plain, re.IGNORECASE)
            if found is None:
                continue
            groups = found.groupdict()
            place = (groups.get("axis") or "").upper() or groups.get("number") or ""
            matched.setdefault((place, kind), source)
            break
    numbers = sorted({place for place, _ in matched if place not in MACHINE_AXES}, key=lambda one: (len(one), one))
    letters = dict(zip(numbers, MACHINE_AXES, strict=False))
    for (place, kind), source in matched.items():
        axis = place if place in MACHINE_AXES else letters.get(place)
        if axis is None:
            continue
        unit = without_unit(source)[1]
        times = f"*{factor}" if factor and kind != "current" else ""
        yield f"{axis}_{kind}", f"{axis}_{kind}={source}{times}:{unit or ('A' if kind == 'current' else 'mm')}"


def without_unit(name: str) -> tuple[str, str]:
    """Return a name without the unit in brackets behind it, and that unit as mappings write it."""
    found = _BRACKETS.search(name)
    unit = found[1].strip().lower() if found else ""
    known = (_UNITS | _UNITS_OTHER).get(unit, "")
    return (name[: found.start()].strip(), known) if found and known else (name.strip(), "")


def _source(mapping: str) -> str:
    """Return the column that a mapping takes, without its factor and unit."""
    return re.split(r"[*:]", mapping.partition("=")[2])[0].strip()


def _spread(recorder: Recorder, given: list[str], own: dict[str, str], at_motor: Collection[str]) -> Spread:
    """Return the mappings given and those of a recorder for other names, and say what was taken for what."""
    sources = {one.partition("=")[0].strip(): _source(one) for one in given}
    named = {}
    for name, mapping in own.items():
        axis, _, kind = name.partition("_")
        # An encoder of its own is mapped beside what the loop reads: that is then of the table.
        beside = f"{axis}_motor" in own or not _OWN_NAME.fullmatch(sources.get(f"{axis}_motor", "X_motor"))
        moved = recorder.reads_loop and kind == "act" and axis in at_motor and not beside
        right = f"{axis}_motor" if moved else name
        named[right] = f"{right}={mapping.partition('=')[2]}"
    further = {name: mapping for name, mapping in named.items() if name not in sources}
    listed = ", ".join(mapping.rpartition(":")[0] for mapping in named.values())
    words = (f"columns as {recorder.name} names them: {listed}",)
    loops = tuple(name for name in further if recorder.reads_loop and name.partition("_")[2] in ("act", "motor"))
    return Spread([*given, *further.values()], words, tuple(named.values()), loops)
