"""Path files: every kind of segment, units, and numbers kept as they are written.

The refusals are in tests/bad/paths; here is what must be accepted and what it becomes.
"""

import hashlib
import io
import json
import math
import sys
from fractions import Fraction

import numpy as np
import pytest

from ph_post.errors import InputError
from ph_post.files.path import read_path

UNITS = {"mm": Fraction(1, 1000), "m": Fraction(1), "inch": Fraction(254, 10000)}


def text(segments, **keys):
    head = {"format": "ph-post-path", "version": 1, "units": "mm", "axes": ["X", "Y"], "feed": 600, **keys}
    return json.dumps({**head, "segments": segments})


@pytest.fixture
def read(tmp_path):
    def read_text(content, name="part.json"):
        file = tmp_path / name
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
        return read_path(file)

    return read_text


def curve_of(path):
    (segment,) = path.segments
    return segment.curve


def at(curve, xi):
    return curve.derivatives(np.array([xi]))[0, 0]


LINE = {"type": "line", "points": [[0, 0], [10, 5]]}


def test_the_head_of_a_file(read):
    content = text([LINE], name="plate", source="a drawing", feed=1200)
    path = read(content)
    assert (path.name, path.source, path.axes, path.closed) == ("plate", "a drawing", ("X", "Y"), False)
    assert path.feed == 0.02
    assert path.digest == hashlib.sha256(content.encode()).hexdigest()


def test_a_path_without_a_name_has_its_files(read):
    path = read(text([LINE]), "bracket.json")
    assert (path.name, path.source) == ("bracket", "")


def test_axes_may_stand_in_any_order(read):
    assert read(text([LINE], axes=["Z", "X"])).axes == ("Z", "X")


def test_feed_and_rapid_of_segments(read):
    on = {"type": "line", "points": [[10, 5], [20, 5]]}
    back = {"type": "line", "points": [[20, 5], [0, 5]]}
    path = read(text([LINE, {**on, "feed": 60, "rapid": False}, {**back, "rapid": True, "feed": None}]))
    assert [segment.feed for segment in path.segments] == [None, 0.001, None]
    assert [segment.rapid for segment in path.segments] == [False, False, True]


@pytest.mark.parametrize("units", UNITS)
def test_every_number_is_rounded_once(read, units):
    written = ["0.1", "-123.456789012345678", "25.4e-3", "1E2", "7", "0.30000000000000004"]
    points = ", ".join(f"[{x}, {y}]" for x, y in zip(written, reversed(written), strict=True))
    content = text([{"type": "bezier", "points": "HERE"}], units=units).replace('"HERE"', f"[{points}]")
    curve = curve_of(read(content))
    for row, (x, y) in enumerate(zip(written, reversed(written), strict=True)):
        assert curve.pieces[0].control[row].tolist() == [
            float(Fraction(x) * UNITS[units]),
            float(Fraction(y) * UNITS[units]),
        ]
    assert [point[0] for point in curve.exact_pieces()[0].control] == [Fraction(x) for x in written]


def test_the_feed_is_rounded_once(read):
    assert read(text([LINE], feed=0.1, units="inch")).feed == float(Fraction(1, 10) * Fraction(254, 10000) / 60)


def test_rational_strings(read):
    curve = curve_of(read(text([{"type": "bezier", "points": [["1/3", "-9/8"], ["+2", " 4/6 "]]}])))
    assert curve.exact_pieces()[0].control == (
        (Fraction(1, 3), Fraction(-9, 8)),
        (Fraction(2), Fraction(2, 3)),
    )
    assert curve.pieces[0].control[0].tolist() == [float(Fraction(1, 3000)), float(Fraction(-9, 8000))]


def test_numbers_may_be_long_or_small(read):
    many = "0." + "3" * 400
    curve = curve_of(read(text([LINE]).replace("[10, 5]", f"[{many}, 0e-999999999]")))
    assert curve.exact_pieces()[0].control[1] == (Fraction(int("3" * 400), 10**400), 0)


def test_arcs(read):
    arc = {"type": "arc", "start": [10, 0], "end": [0, 10], "center": [0, 0]}
    quarter = curve_of(read(text([{**arc, "turn": "ccw"}])))
    assert quarter.length == pytest.approx(0.01 * math.pi / 2, rel=1e-15)
    assert curve_of(read(text([{**arc, "turn": "cw"}]))).length == pytest.approx(0.03 * math.pi / 2, rel=1e-15)
    full = curve_of(read(text([{**arc, "end": [10, 0], "turn": "cw"}], closed=True)))
    assert full.length == pytest.approx(0.01 * math.tau, rel=1e-15)
    assert full.exact == ((10, 0), (10, 0), (0, 0))


def test_an_arc_in_space_lies_in_the_first_two_axes(read):
    arc = {"type": "arc", "start": [10, 0, 3], "end": [0, 10, 3], "center": [0, 0, 3], "turn": "ccw"}
    curve = curve_of(read(text([arc], axes=["X", "Y", "Z"])))
    assert at(curve, 0.5) == pytest.approx([0.01 / math.sqrt(2), 0.01 / math.sqrt(2), 0.003], rel=1e-15)


def test_polynomials(read):
    segment = {"type": "polynomial", "coefficients": {"X": [0, "9/8", -3], "Y": [0, 1]}}
    curve = curve_of(read(text([segment])))
    assert curve.domain == (0.0, 1.0)
    # x = 9/8 xi - 3 xi^2 has the Bernstein coefficients 0, 9/16, -15/8
    assert [point[0] for point in curve.exact_pieces()[0].control] == [0, Fraction(9, 16), Fraction(-15, 8)]
    wide = curve_of(read(text([{**segment, "domain": [-1, "3/2"]}])))
    assert wide.domain == (-1.0, 1.5)
    # -9/8 - 3 mm, and a unit in the last place for the rounding of the sum
    assert at(wide, -1.0)[0] == pytest.approx(-4.125e-3, rel=2.0**-52)


def test_ph_curves_take_their_preimage_in_the_root_of_the_unit(read):
    segment = {"type": "ph", "start": [1, 2], "preimage": [[1, 0], [2, "1/2"], [1, 1]]}
    curve = curve_of(read(text([segment])))
    # the exact control points, in mm: start + integral of (u² - v², 2 u v) of the preimage
    exact = curve.exact_pieces()[0].control
    assert exact[0] == (1, 2)
    assert exact[5] == integral_of_square([1, 2 + 0.5j, 1 + 1j], 1 + 2j)
    # the preimage in SI goes through one square root and one product more
    found = curve.pieces[0].control * 1000
    assert np.allclose(found, np.array(exact, dtype=float), rtol=0, atol=16 * np.spacing(4.0))


def integral_of_square(preimage, start):
    """End of the PH curve in exact numbers, by the power basis in place of Bernstein forms."""
    w0, w1, w2 = ((Fraction(w.real), Fraction(w.imag)) for w in map(complex, preimage))
    first = tuple(2 * (b - a) for a, b in zip(w0, w1, strict=True))
    second = tuple(a - 2 * b + c for a, b, c in zip(w0, w1, w2, strict=True))
    power = [w0, first, second]
    end = [Fraction(start.real), Fraction(start.imag)]
    for i, (a, b) in enumerate(power):
        for j, (c, d) in enumerate(power):
            end[0] += (a * c - b * d) / (i + j + 1)
            end[1] += (a * d + b * c) / (i + j + 1)
    return tuple(end)


def test_spatial_ph_curves(read):
    segment = {"type": "ph", "start": [0, 0, 0], "preimage": [[1, 2, 3, 4]]}
    curve = curve_of(read(text([segment], axes=["X", "Y", "Z"])))
    # x' = 1 + 4 - 9 - 16, y' = 2 (1*4 + 2*3), z' = 2 (2*4 - 1*3)
    assert curve.exact_pieces()[0].control[-1] == (-20, 20, 10)


def test_ph_hermite(read):
    segment = {"type": "ph-hermite", "points": [[0, 0], [10, 5]], "derivatives": [[15, 0], [0, 15]]}
    curve = curve_of(read(text([segment])))
    values = curve.derivatives(np.array([0.0, 1.0]), 1)
    assert np.allclose(values[0], [[0, 0], [0.01, 0.005]], rtol=0, atol=1e-16)
    assert np.allclose(values[1], [[0.015, 0], [0, 0.015]], rtol=0, atol=1e-15)


def test_nurbs(read):
    root = math.sqrt(0.5)
    segment = {
        "type": "nurbs",
        "degree": 2,
        "knots": [0, 0, 0, 2, 2, 2],
        "points": [[10, 0], [10, 10], [0, 10]],
    }
    parabola = curve_of(read(text([segment])))
    assert parabola.domain == (0.0, 2.0)
    assert at(parabola, 1.0).tolist() == [0.0075, 0.0075]
    circle = curve_of(read(text([{**segment, "weights": [1, root, 1]}])))
    assert np.linalg.norm(at(circle, 0.3)) == pytest.approx(0.01, rel=1e-15)


def test_joints_may_differ_by_less_than_the_tolerance(read):
    on = {"type": "line", "points": [[10.0000007, 5.0000007], [20, 5]]}
    assert len(read(text([LINE, on])).segments) == 2
    with pytest.raises(InputError, match=r"segments\[1\]\.points\[0\]: gap of 1\.1e-06 mm after segments\[0\]"):
        read(text([LINE, {"type": "line", "points": [[10.0000011, 5], [20, 5]]}]))


def test_joints_of_files_in_other_units_have_the_same_tolerance(read):
    on = {"type": "line", "points": [[10.0000011, 5], [20, 5]]}
    with pytest.raises(InputError, match=r"gap of 1\.1e-06 inch"):
        read(text([LINE, on], units="inch"))


def test_a_closed_path_ends_where_it_starts(read):
    back = {"type": "line", "points": [[10, 5], [0, 0]]}
    assert read(text([LINE, back], closed=True)).closed


def test_standard_input_and_a_byte_order_mark(read, monkeypatch):
    data = b"\xef\xbb\xbf" + text([LINE]).encode()
    assert read(data).digest == hashlib.sha256(data).hexdigest()
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(data)))
    assert read_path("-").name == "stdin"


@pytest.mark.parametrize("name", ["a\0b", "x" * 5000])
def test_impossible_file_names(name):
    with pytest.raises(InputError):
        read_path(name)
