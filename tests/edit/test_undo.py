"""The head of compensated programs, and the way back to the original."""

from __future__ import annotations

import re
from decimal import Decimal

import numpy as np
import pytest
from msgspec.structs import replace
from support.editing import compensate

from ph_post.dialects.declaration import Declaration, declaration_lines, read_declaration
from ph_post.drive.machinefile import read_machine
from ph_post.edit import write
from ph_post.edit.edits import DipEdit, Edits, OffsetShift, StopEdit, merge_edits, runs_of
from ph_post.edit.undo import Payload, payload_lines, read_payload, undo
from ph_post.edit.word_shifts import LONGEST, assemble, shift_numbers, unshift_numbers
from ph_post.errors import InputError
from ph_post.types import sealed

MM = 1e-3
INCH = 25.4e-3
STEPPER = read_machine("stepper")
PROGRAM = b"%\nO12 (slot)\nG21 G90 G17 F600\nG0 X0 Y0\nG1 X10\nY3\nX0\nG0 X9\nM2\n%\n"

FULL = Declaration(
    version="0.1.0",
    digest="0123456789abcdef" * 4,
    machine="old mill, no. 2",
    machine_digest="ab" * 8,
    options_digest="cd" * 8,
    units=INCH,
    offset={"X": 0.001181 * INCH, "Y": 0.0005 * INCH, "Z": 0.002 * INCH},
    one_sided={"X": 1, "Z": -1},
    pulse={"Z": 0.0012 * INCH},
    stops=12,
    dips=3,
    crossings=8,
    crossing_length=0.62 * MM,
    crossing_error=0.0012 * MM,
    dwell=0.01,
    decimals=5,
    chord_tolerance=0.001 * MM,
    block_time=5e-3,
    path_mode="G64 P0.00004 Q0",
    notes=("rapids are left alone",),
)


@pytest.mark.parametrize("width", [70, 255])
@pytest.mark.parametrize("before", ["", "%\n", "%\r\nO5\r\n"])
def test_a_head_is_read_as_it_was_written(width: int, before: str) -> None:
    lines = declaration_lines(FULL, width)
    assert max(map(len, lines)) <= width
    found = read_declaration((before + "\n".join(lines) + "\n(ph-post: +1 -0 X up)\nG0 X0\n").encode())
    assert found is not None
    assert found.offset == pytest.approx(FULL.offset, rel=1e-12)
    assert found.pulse == pytest.approx(FULL.pulse, rel=1e-12)
    exact = {"offset": {}, "pulse": {}, "chord_tolerance": 0.0, "block_time": 0.0}
    exact |= {"crossing_length": 0.0, "crossing_error": 0.0}
    assert replace(found, **exact) == replace(FULL, **exact)
    assert (found.chord_tolerance, found.block_time) == pytest.approx((1e-6, 5e-3))
    assert (found.crossing_length, found.crossing_error) == pytest.approx((0.62 * MM, 0.0012 * MM))


def test_bounds_of_crossings_are_rounded_up_and_signs_of_offsets_kept() -> None:
    text = "\n".join(declaration_lines(replace(FULL, crossing_length=0.61234 * MM, crossing_error=1.0000001e-7), 255))
    assert "(ph-post: 8 crossings, up to 0.6124 mm long, within 0.0001 mm)" in text
    assert "(ph-post: offset X +0.001181 inch)" in text
    assert "(ph-post: offset Y 0.0005 inch)" in text
    assert "(ph-post: offset Z -0.002 inch)" in text
    signed = "take-up Z -0.0012"
    assert read_declaration(text.replace("take-up Z 0.0012", signed).encode()).pulse == {}
    assert "crossings" not in "\n".join(declaration_lines(replace(FULL, crossings=0), 255))


def test_the_head_stands_behind_percent_and_number() -> None:
    text = compensate(PROGRAM, STEPPER).text.decode().splitlines()
    assert text[:2] == ["%", "O12 (slot)"]
    assert re.fullmatch(r"\(ph-post .* compensated this program\)", text[2])


def test_other_programs_declare_nothing() -> None:
    assert read_declaration(PROGRAM) is None
    assert read_declaration(b"(ph-post 0.1.0, strategy auto)\nG0 X0\n") is None


def test_a_damaged_head_is_refused() -> None:
    text = compensate(PROGRAM, STEPPER).text.replace(b"original sha256", b"original sha")
    with pytest.raises(InputError, match="head of the compensated program is damaged"):
        read_declaration(text)


def test_a_second_compensation_is_refused() -> None:
    once = compensate(PROGRAM, STEPPER).text
    with pytest.raises(InputError, match="marks of an earlier compensation"):
        compensate(once, STEPPER)


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
@pytest.mark.parametrize("last", [True, False])
def test_undo_gives_every_byte_back(end: bytes, last: bool) -> None:
    data = PROGRAM.replace(b"\n", end) if last else PROGRAM.replace(b"\n", end)[: -len(end)]
    found = compensate(data, STEPPER).text
    assert found.count(end) > data.count(end)
    assert undo(found, "slot.ngc") == data


def test_a_program_that_was_not_compensated_cannot_be_undone() -> None:
    with pytest.raises(InputError, match=r"^slot.ngc: there is nothing to undo"):
        undo(PROGRAM, "slot.ngc")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"X10.03", b"X10.04"),
        (b"X-0.03", b"X-0.03 Z1"),
        (b"G0 X9", b"G0 X9\nG0 X9"),
        (b"X-0.03\n", b""),
        (b"+4 -1", b"+3 -1"),
        (b"+4 -1", b"+4 -0"),
        (b"(ph-post: undo 1/", b"(ph-post: undo 2/"),
        (b"undo 1/1 eJ", b"undo 1/1 AA"),
        (b"M2", b"M30"),
    ],
)
def test_a_program_changed_by_hand_is_not_undone(old: bytes, new: bytes) -> None:
    text = compensate(PROGRAM, STEPPER).text
    damaged = text.replace(old, new)
    assert damaged != text
    with pytest.raises(InputError, match="undo"):
        undo(damaged, "slot.ngc")


def test_where_the_inverse_fails_the_whole_original_is_packed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(write, "restores", lambda text, name, original: False)
    found = compensate(PROGRAM, STEPPER).text
    assert read_payload(found, "slot.ngc")[0].whole == PROGRAM
    assert undo(found, "slot.ngc") == PROGRAM


@pytest.mark.parametrize("width", [60, 70, 255])
@pytest.mark.parametrize("size", [0, 10, 3000, 200_000])
def test_payloads_of_any_size(width: int, size: int) -> None:
    payload = Payload(removed=np.random.default_rng(1).bytes(size), delta=((-25, 3),), odd={3: b"1 0"})
    lines = payload_lines(payload, width)
    assert max(map(len, lines)) <= width
    assert read_payload("\n".join(["M2", *lines]).encode(), "a")[0] == payload


def word_of(end: int, digits: int, decimals: int) -> tuple[np.ndarray, ...]:
    """Columns of one word as the writer takes them: for others the compiler would run again."""
    kinds = (np.int32, np.int32, np.int64, np.int16)
    return tuple(np.array([one], kind) for one, kind in zip((0, end, digits, decimals), kinds, strict=True))


def shifted(data: np.ndarray, columns: tuple[np.ndarray, ...], shift: list[int]) -> tuple[str, np.ndarray, bool]:
    """Text, style and oddness of the number of a word to which a shift was added."""
    pool, bounds = np.empty(LONGEST, np.uint8), np.zeros(2, np.int64)
    style, odd = np.empty(1, np.uint16), np.zeros(1, np.uint8)
    shift_numbers(data, columns, FIRST, np.array([shift]), (pool, bounds), (style, odd))
    return pool[: bounds[1]].tobytes().decode(), style, bool(odd[0])


FIRST = np.zeros(1, dtype=np.uint8)


@pytest.mark.parametrize(
    ("text", "digits", "decimals", "odd"),
    [
        ("X10", 10, 0, False),
        ("X10.", 10, 0, False),
        ("X-0.50", -50, 2, False),
        ("X+.5", 5, 1, False),
        ("X007.25", 725, 2, False),
        ("X0", 0, 0, False),
        ("X.0", 0, 1, False),
        ("X-0", 0, 0, True),
        ("X 1 0", 10, 0, True),
        ("X1 .5", 15, 1, True),
        ("X-123456789.123456", -123456789123456, 6, False),
    ],
)
def test_styles_of_numbers(text: str, digits: int, decimals: int, odd: bool) -> None:
    data, columns = np.frombuffer(text.encode(), np.uint8), word_of(len(text), digits, decimals)
    number, style, found = shifted(data, columns, [0, 0])
    assert found == odd
    if not odd:
        assert number == text[1:]
        back, _, wrong = unshift_numbers(*map(sealed, columns[2:]), FIRST, np.array([[0, 0]]), sealed(style))
        assert (back.tobytes().decode(), wrong) == (text[1:], 0)


@pytest.mark.parametrize("shift", [(25, 3), (-7, 6), (1, 0), (-123456789, 7)])
@pytest.mark.parametrize("number", ["0", "-0.025", "99.99", ".5", "+7.", "-12345.678901", "0012.30"])
def test_sums_are_exact(number: str, shift: tuple[int, int]) -> None:
    decimals = len(number.partition(".")[2])
    digits = int(number.replace(".", ""))
    data = np.frombuffer(f"X{number}".encode(), np.uint8)
    text, _, _ = shifted(data, word_of(data.size, digits, decimals), list(shift))
    assert Decimal(text) == Decimal(number) + Decimal(shift[0]).scaleb(-shift[1])
    assert len(text.partition(".")[2]) == max(decimals, shift[1])


def test_spans_are_put_in_place_of_others() -> None:
    data, pool, text = (np.frombuffer(one, np.uint8) for one in (b"abcdefgh", b"123", b"LINE"))
    lines = np.array([[0, 0, 0, 1], [4, 6, 1, 4], [8, 8, 4, 4]])
    start, end, bounds = np.array([1, 4, 6]), np.array([2, 6, 8]), np.array([0, 1, 1, 3])
    assert assemble(data, start, end, pool, bounds, lines, text).tobytes() == b"La1cdINE23"
    with pytest.raises(ValueError, match="not in order"):
        assemble(data, start, end, pool, bounds, lines[[0, 2, 1]], text)


def _stop(axis: str, motion: int, share: float, pause: float = 0.01) -> StopEdit:
    return StopEdit(
        motion=motion,
        share=share,
        pause=pause,
        shifts=(OffsetShift(axis=axis, travel=1e-5, velocity=0.01, pause=0.01),),
    )


def test_changes_of_different_axes_are_merged() -> None:
    offset = np.zeros((3, 3))
    x, y = offset.copy(), offset.copy()
    x[:, 0], y[:, 1] = 1e-5, 2e-5
    a = Edits(runs=runs_of(x), stops=(_stop("X", 1, 0.5), _stop("X", 2, 1.0)), amplitude={"X": 1e-5}, warnings=("w",))
    b = Edits(
        runs=runs_of(y), stops=(_stop("Y", 0, 1.0), _stop("Y", 2, 1.0, 0.03)), pulse={"Y": 1e-5}, warnings=("w", "v")
    )
    both = merge_edits(a, b)
    assert [(stop.motion, stop.share) for stop in both.stops] == [(0, 1.0), (1, 0.5), (2, 1.0)]
    assert [shift.axis for shift in both.stops[2].shifts] == ["X", "Y"]
    assert both.stops[2].pause == 0.03
    assert both.offset.tolist() == (x + y).tolist()
    assert (both.amplitude, both.pulse, both.warnings) == ({"X": 1e-5}, {"Y": 1e-5}, ("w", "v"))


def test_one_axis_or_one_stretch_twice_is_refused() -> None:
    offset = np.zeros((3, 3))
    a = Edits(runs=runs_of(offset), amplitude={"X": 1e-5})
    with pytest.raises(ValueError, match="offset axis X"):
        merge_edits(a, a)
    one = Edits(runs=runs_of(offset), dips=(_dip(0.2, 0.5),))
    assert len(merge_edits(one, Edits(runs=runs_of(offset), dips=(_dip(0.5, 0.7),))).dips) == 2
    with pytest.raises(ValueError, match="overlap"):
        merge_edits(one, Edits(runs=runs_of(offset), dips=(_dip(0.4, 0.7),)))


def _dip(low: float, high: float) -> DipEdit:
    return DipEdit(motion=np.array([1, 1]), share=np.array([low, high]), duration=np.array([1.0]))
