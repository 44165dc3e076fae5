"""DXF entities against ezdxf's own evaluation and closed forms, to 1e-9 mm."""

import io
import math

import ezdxf
import numpy as np
import pytest
import scipy.interpolate
from ezdxf.math import BSpline, ConstructionEllipse, Matrix44, Vec3, bulge_center
from hypothesis import given, settings
from hypothesis import strategies as st
from support.amount import examples
from support.drawings import block, dxf, ellipse, entity, insert, lwpolyline, point, sampled, spline

from ph_post.errors import InputError
from ph_post.files.drawing import shapes
from ph_post.files.drawing.convert import ImportOptions, import_drawing, read_drawing
from ph_post.files.drawing.dxf import read_dxf

WORLD = 1e-9
"""How well an imported curve has to lie where the drawing has it [mm]."""


def path_of(text, **wish):
    drawing = read_dxf(text.encode(), "a.dxf", wish.get("layers", ()))
    return import_drawing(drawing, "a.dxf", "a", ImportOptions(**wish)).path


def shape_of(text, **wish):
    path = path_of(text, **wish)
    return [segment.curve.kind for segment in path.segments if not segment.rapid], sampled(path)


def test_an_arc_runs_counterclockwise_between_its_angles():
    kinds, points = shape_of(dxf(entity("ARC", point((3, 4, 0)), (40, 2.5), (50, 300.0), (51, 80.0))))
    angle = np.radians(300 + np.linspace(0, 140, 33))
    assert kinds == ["arc"]
    assert points[0] == pytest.approx(np.column_stack([3 + 2.5 * np.cos(angle), 4 + 2.5 * np.sin(angle)]), abs=WORLD)


def test_an_arc_seen_from_behind_is_mirrored():
    kinds, points = shape_of(
        dxf(entity("ARC", point((3, 4, 0)), (40, 2.0), (50, 10.0), (51, 100.0), point((0, 0, -1), 210)))
    )
    angle = np.radians(np.linspace(10, 100, 33))
    assert kinds == ["arc"]
    assert points[0] == pytest.approx(np.column_stack([-3 - 2 * np.cos(angle), 4 + 2 * np.sin(angle)]), abs=WORLD)


def test_a_tilted_circle_is_exact_in_space():
    normal = np.array([0.48, 0.6, 0.64])
    kinds, points = shape_of(dxf(entity("CIRCLE", point((3, 4, 5)), (40, 2.0), point(normal, 210))), axes="XYZ")
    assert kinds == ["nurbs"]
    center = np.array(ezdxf.math.OCS(normal).to_wcs((3, 4, 5)).xyz)
    assert np.linalg.norm(points[0] - center, axis=1) == pytest.approx(2.0, abs=WORLD)
    assert (points[0] - center) @ normal == pytest.approx(0.0, abs=WORLD)


@settings(max_examples=examples(25), deadline=None)
@given(
    center=st.tuples(st.floats(-500, 500), st.floats(-500, 500)),
    size=st.floats(0.1, 300),
    turn=st.floats(0, math.tau),
    ratio=st.floats(0.01, 0.99),
    first=st.floats(0, 6),
    sweep=st.floats(0.05, 6.2),
)
def test_an_ellipse_is_one(center, size, turn, ratio, first, sweep):
    major = (size * math.cos(turn), size * math.sin(turn), 0.0)
    text = dxf(ellipse((*center, 0.0), major, ratio, first, first + sweep))
    kinds, points = shape_of(text, join=1e-6)
    assert kinds == ["nurbs"]
    reference = ConstructionEllipse(Vec3(center), Vec3(major), (0, 0, 1), ratio, first, first + sweep)
    # into the unit circle: every point on it, and the parameters run from the first to the last
    u, v = np.array(major[:2]), ratio * np.array([-major[1], major[0]])
    local = np.linalg.solve(np.stack([u, v], axis=1), (points[0] - center).T).T
    assert (np.linalg.norm(local, axis=1) - 1.0) * size == pytest.approx(0.0, abs=WORLD)
    angles = np.unwrap(np.arctan2(local[:, 1], local[:, 0]))
    assert np.all(np.diff(angles) > 0.0)
    assert angles[-1] - angles[0] == pytest.approx(sweep, abs=1e-9)
    for mine, theirs in ((points[0][0], reference.start_point), (points[0][-1], reference.end_point)):
        assert mine == pytest.approx((theirs.x, theirs.y), abs=WORLD)


@settings(max_examples=examples(20), deadline=None)
@given(data=st.data(), degree=st.integers(2, 5), count=st.integers(6, 9), rational=st.booleans())
def test_a_spline_is_the_spline(data, degree, count, rational):
    coordinate = st.floats(-100, 100).map(lambda x: round(x, 3))
    control = np.array(data.draw(st.lists(st.tuples(coordinate, coordinate), min_size=count, max_size=count)))
    control[:, 0] += 40.0 * np.arange(count)  # so that no two points are one
    inner = sorted(
        data.draw(
            st.lists(st.floats(0.05, 0.95), min_size=count - degree - 1, max_size=count - degree - 1, unique=True)
        )
    )
    knots = [0.0] * (degree + 1) + inner + [1.0] * (degree + 1)
    weights = data.draw(st.lists(st.floats(0.2, 5), min_size=count, max_size=count)) if rational else []
    kinds, points = shape_of(dxf(spline(degree, knots, control, weights)))
    assert kinds == ["nurbs"]
    reference = BSpline([(*row, 0) for row in control], degree + 1, knots, weights or None)
    expected = [(p.x, p.y) for p in reference.points(np.linspace(0, 1, 33))]
    assert points[0] == pytest.approx(np.array(expected), abs=WORLD)


def test_the_numbers_of_a_spline_are_not_touched():
    knots, control = [0, 0, 0, 0.1, 1 / 3, 1, 1, 1], [(0, 0.1), (1, 2), (3, 0.7), (5, 1 / 7), (6, 0)]
    (segment,) = path_of(dxf(spline(2, knots, control))).segments
    assert segment.curve.knots.tolist() == knots
    assert (segment.curve.points * 1e3).tolist() == pytest.approx(np.array(control), abs=1e-15)


def test_a_periodic_spline_runs_once_round_and_closes():
    ring = [(10 * math.cos(a), 6 * math.sin(a)) for a in np.arange(8) * math.tau / 8]
    control, knots = [*ring, *ring[:3]], list(range(-3, 12))
    drawing = dxf(spline(3, knots, control, flags=1 + 2))
    path = path_of(drawing)
    assert path.closed
    points = sampled(path)[0]
    reference = scipy.interpolate.BSpline(knots, np.array(control), 3)
    assert points == pytest.approx(reference(np.linspace(0, 8, 33)), abs=WORLD)
    assert points[0] == pytest.approx(points[-1], abs=1e-12)


def test_a_spline_of_fit_points_is_the_cubic_through_them():
    fit = np.array([(0, 0), (10, 4), (22, -3), (30, 5), (31, 9)], dtype=float)
    drawing = read_dxf(dxf(spline(3, [], fit=fit)).encode(), "a.dxf")
    made = import_drawing(drawing, "a.dxf", "a", ImportOptions())
    chords = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(fit, axis=0), axis=1)))
    reference = scipy.interpolate.CubicSpline(chords, fit, bc_type="natural")
    (segment,) = made.path.segments
    low, high = segment.curve.domain
    at = np.linspace(0, 1, 41)
    mine = segment.curve.derivatives(low + at * (high - low))[0] * 1e3
    assert mine == pytest.approx(reference(at * chords[-1]), abs=WORLD)
    assert any("fit points" in note for note in made.notes)


def test_a_closed_spline_of_fit_points_goes_smoothly_round():
    fit = [(10 * math.cos(a), 6 * math.sin(a)) for a in np.arange(6) * math.tau / 6]
    path = path_of(dxf(spline(3, [], fit=fit, flags=1)))
    assert path.closed
    (segment,) = path.segments
    curve, (low, high) = segment.curve, segment.curve.domain
    ends = curve.derivatives([low, high], 2) * 1e3
    for order in range(3):
        assert ends[order][0] == pytest.approx(ends[order][1], abs=1e-9)
    chords = [math.dist(a, b) for a, b in zip(fit, [*fit[1:], fit[0]], strict=True)]
    on = curve.derivatives(low + np.append(0.0, np.cumsum(chords)[:-1]) / sum(chords) * (high - low))[0] * 1e3
    assert on == pytest.approx(np.array(fit), abs=WORLD)


@pytest.mark.parametrize("bulge", [1.0, -1.0, 0.3, -2.5, 1e-3, 2e-5, 9e-6, -1e-7, 1e-12])
def test_a_bulge_is_the_arc_of_its_angle(bulge):
    a, b = (3.0, 1.0), (47.0, 13.0)
    _, points = shape_of(dxf(lwpolyline([(*a, bulge), (*b, 0)], closed=False)))
    chord = np.subtract(b, a)
    length = np.linalg.norm(chord)
    along, aside = chord / length, np.array([-chord[1], chord[0]]) / length
    # points at height h over the chord at distance x: the circle through the ends with sagitta -bulge c/2
    x, h = (points[0] - a) @ along, (points[0] - a) @ aside
    sagitta = 0.5 * length * bulge
    # x (c - x) = h (h - c²/(4 s) + s), the power of the point's foot on the chord
    power = length**2 / (4 * sagitta) - sagitta
    size = abs(power) + length
    assert (x * (length - x) - h * h) / size == pytest.approx(-h * power / size, abs=WORLD)
    if abs(bulge) >= 1e-3:
        center = bulge_center(a, b, bulge)
        radius = math.dist(a, (center.x, center.y))
        assert np.linalg.norm(points[0] - (center.x, center.y), axis=1) == pytest.approx(radius, abs=WORLD)


def test_polylines_of_old_and_in_space():
    old = [
        (0, "POLYLINE"),
        (8, "0"),
        (66, 1),
        (70, 1),
        *point((0, 0, 0)),
        *(
            pair
            for x, y, b in ((0, 0, 0), (10, 0, 1), (10, 8, 0))
            for pair in [(0, "VERTEX"), (8, "0"), *point((x, y, 0)), (42, b)]
        ),
        (0, "SEQEND"),
        (8, "0"),
    ]
    kinds, points = shape_of(dxf(old, version="AC1009"))
    assert kinds == ["line", "arc", "line"]
    assert points[1][16] == pytest.approx((14, 4), abs=WORLD)
    space = [
        (0, "POLYLINE"),
        (8, "0"),
        (66, 1),
        (70, 8),
        *point((0, 0, 0)),
        *(
            pair
            for place in ((0, 0, 0), (10, 0, 1), (10, 8, 3))
            for pair in [(0, "VERTEX"), (8, "0"), *point(place), (70, 32)]
        ),
        (0, "SEQEND"),
        (8, "0"),
    ]
    kinds, points = shape_of(dxf(space, version="AC1009"), axes="XYZ")
    assert points[:, -1].tolist() == pytest.approx(np.array([(10, 0, 1), (10, 8, 3)]), abs=1e-12)
    with pytest.raises(InputError, match="not flat; expected one height, or --axes XYZ"):
        path_of(dxf(space, version="AC1009"))


@settings(max_examples=examples(20), deadline=None)
@given(
    scales=st.tuples(*[st.floats(0.2, 3).flatmap(lambda s: st.sampled_from([s, -s]))] * 2),
    turn=st.floats(0, 360),
    inner=st.floats(0, 360),
    even=st.booleans(),
)
def test_a_block_in_a_block_stands_where_its_maps_put_it(scales, turn, inner, even):
    sx, sy = (scales[0], scales[0]) if even else scales
    leaf = block("LEAF", entity("ARC", point((2, 1, 0)), (40, 1.5), (50, 20.0), (51, 200.0)), base=(1, 1, 0))
    tree = block("TREE", insert("LEAF", (4, 2, 0), 1.5, 1.5, inner))
    text = dxf(insert("TREE", (7, -3, 0), sx, sy, turn), blocks=[leaf, tree])
    kinds, points = shape_of(text)
    assert kinds == (["arc"] if abs(abs(sx) - abs(sy)) < 1e-13 else ["nurbs"])
    # by ezdxf's matrices alone: into the arc's own circle and back
    outer = Matrix44.scale(sx, sy, 1) @ Matrix44.z_rotate(math.radians(turn)) @ Matrix44.translate(7, -3, 0)
    near = Matrix44.translate(-1, -1, 0) @ Matrix44.scale(1.5) @ Matrix44.z_rotate(math.radians(inner))
    whole = near @ Matrix44.translate(4, 2, 0) @ outer
    back = whole.copy()
    back.inverse()
    local = np.array([(p.x, p.y) for p in back.transform_vertices([(*row, 0) for row in points[0]])])
    assert np.linalg.norm(local - (2, 1), axis=1) == pytest.approx(1.5, abs=WORLD)
    angles = np.degrees(np.unwrap(np.arctan2(*(local - (2, 1)).T[::-1])))
    assert sorted((angles[0] % 360, angles[-1] % 360)) == pytest.approx([20, 200], abs=1e-8)


def test_blocks_agree_with_ezdxfs_own_explosion():
    part = block(
        "PART",
        entity("LINE", point((0, 0, 0)), point((5, 1, 0), 11)),
        lwpolyline([(5, 1, 0.5), (9, 4, 0), (2, 7, -0.7)], closed=False),
        ellipse((3, 3, 0), (2, 1, 0), 0.4, 0.3, 4.0),
        spline(2, [0, 0, 0, 1, 1, 1], [(0, 9), (4, 14), (8, 9)]),
    )
    text = dxf(insert("PART", (20, 30, 0), 1.7, -0.6, 35), blocks=[part])
    document = ezdxf.read(io.StringIO(text))
    (reference,) = document.modelspace().query("INSERT")
    expected = [ezdxf.path.make_path(one) for one in reference.virtual_entities()]
    flat = np.array([(p.x, p.y) for path in expected for p in path.flattening(1e-4, segments=32)])
    points = sampled(path_of(text), 2000)
    cloud = points.reshape(-1, 2)
    for place in flat:  # ezdxf flattens; its vertices are on the curves to what its Béziers leave of an arc
        assert np.min(np.linalg.norm(cloud - place, axis=1)) < 0.01
    assert cloud.min(axis=0) == pytest.approx(flat.min(axis=0), abs=1e-3)
    assert cloud.max(axis=0) == pytest.approx(flat.max(axis=0), abs=1e-3)


def test_what_lies_on_layer_0_of_a_block_is_on_the_layer_of_its_insert():
    part = block(
        "PART",
        entity("LINE", point((0, 0)), point((1, 0), 11)),
        entity("LINE", point((0, 1)), point((1, 1), 11), layer="B"),
    )
    drawing = read_dxf(dxf(insert("PART", (0, 0), layer="A"), blocks=[part]).encode(), "a.dxf")
    assert [run.layer for run in drawing.runs] == ["A", "B"]
    rows = (("row", 71, 3), ("column", 70, 2))
    grid = insert("PART", (0, 0), extra=[(code, n) for _, code, n in rows] + [(44, 10), (45, 20)])
    drawing = read_dxf(dxf(grid, blocks=[part]).encode(), "a.dxf")
    starts = sorted(tuple(run.shapes[0].start[:2]) for run in drawing.runs if run.layer == "0")
    assert starts == [(10.0 * column, 20.0 * row) for column in range(2) for row in range(3)]


def test_what_is_hidden_is_left_out_and_named_unless_it_is_asked_for():
    line = [point((0, 0)), point((1, 0), 11)]
    text = dxf(
        entity("LINE", *line),
        entity("LINE", *line, layer="OFF"),
        entity("LINE", *line, layer="Frozen"),
        entity("LINE", *line, (60, 1)),
        layers=[("OFF", 0, -7), ("FROZEN", 1, 7)],
    )
    drawing = read_dxf(text.encode(), "a.dxf")
    assert [run.layer for run in drawing.runs] == ["0"]
    assert drawing.left_out == {"hidden (layer off or frozen, or invisible)": 3}
    assert [run.layer for run in read_dxf(text.encode(), "a.dxf", ["OFF"]).runs] == ["OFF"]


def test_what_is_not_understood_is_named_with_its_count():
    text = dxf(
        entity("LINE", point((0, 0)), point((1, 0), 11), (39, 2.0)),
        entity("TEXT", point((0, 0)), (40, 1), (1, "a")),
        entity("TEXT", point((0, 0)), (40, 1), (1, "b")),
        entity("POINT", point((0, 0))),
        entity("3DFACE", *(point((k, k, 0), 10 + k) for k in range(4))),
        spline(3, [0, 0, 0, 0, 1, 1, 1], [(0, 0), (1, 1), (2, 0), (3, 0)]),
        spline(3, [0, 0, 0, 0, 1, 1, 1, 1], [(0, 0), (1, 1), (2, 0), (3, 0)], [1, -1, 1, 1]),
        spline(1, [0, 0, 1, 1, 2, 2], [(0, 0), (1, 1), (2, 0), (3, 0)]),
        lwpolyline([(0, 0, 0), (0, 0, 0)]),
        entity("CIRCLE", point((0, 0)), (40, -1.0)),
        insert("NONE", (0, 0)),
    )
    drawing = read_dxf(text.encode(), "a.dxf")
    assert drawing.left_out == {
        "thickness of a LINE": 1,
        "TEXT": 2,
        "POINT": 1,
        "3DFACE": 1,
        "SPLINE, which has 7 knots for 4 points of degree 3": 1,
        "SPLINE, whose weights are not one positive number a point": 1,
        "SPLINE, which a repeated knot tears": 1,
        "LWPOLYLINE without length": 1,
        "CIRCLE, whose radius is not positive": 1,
        "INSERT of a block that is not in the file": 1,
    }
    assert len(drawing.runs) == 1
    with pytest.raises(InputError, match="--strict is given; got 1 thickness of a LINE, 2 TEXT"):
        import_drawing(drawing, "a.dxf", "a", ImportOptions(strict=True))


@pytest.mark.parametrize(
    ("code", "unit", "factor"),
    [(1, "inch", 25.4), (2, "mm", 304.8), (4, "mm", 1.0), (5, "mm", 10.0), (6, "m", 1e3)],
)
def test_the_drawings_unit_is_kept(code, unit, factor):
    text = dxf(entity("LINE", point((0, 0)), point((1.1, 0.7), 11)), units=code)
    made = import_drawing(read_dxf(text.encode(), "a.dxf"), "a.dxf", "a", ImportOptions())
    assert made.unit == unit
    assert sampled(made.path, 2)[0][1] == pytest.approx(np.array((1.1, 0.7)) * factor, rel=1e-15)
    assert made.path.feed == pytest.approx(1000e-3 / 60, rel=1e-15)


@pytest.mark.parametrize("code", [None, 0, 20])
def test_a_drawing_without_a_unit_is_refused_until_one_is_named(code):
    text = dxf(entity("LINE", point((0, 0)), point((1, 0), 11)), units=code)
    with pytest.raises(InputError, match=r"^a.dxf: the drawing states no unit; expected --units mm"):
        path_of(text)
    assert sampled(path_of(text, unit="cm"))[0][-1] == pytest.approx((10, 0))


def test_blocks_that_hold_themselves_or_too_much_end(monkeypatch):
    # The limit is what counts, not its size: a hundred thousand take half a minute.
    monkeypatch.setattr(shapes, "MAX_ENTITIES", 2000)
    a, b = block("A", insert("B", (0, 0))), block("B", insert("A", (0, 0)))
    with pytest.raises(InputError, match=r"block [AB] contains itself"):
        read_dxf(dxf(insert("A", (0, 0)), blocks=[a, b]).encode(), "a.dxf")
    levels = [block(f"B{k}", *[insert(f"B{k + 1}", (0, 0))] * 10) for k in range(9)]
    leaf = block("B9", entity("LINE", point((0, 0)), point((1, 0), 11)))
    with pytest.raises(InputError, match="too large; expected at most 2000 entities"):
        read_dxf(dxf(insert("B0", (0, 0)), blocks=[*levels, leaf]).encode(), "a.dxf")
    rows = insert("B9", (0, 0), extra=[(70, 30000), (71, 30000), (44, 1), (45, 1)])
    with pytest.raises(InputError, match="too large"):
        read_dxf(dxf(rows, blocks=[leaf]).encode(), "a.dxf")


def test_a_layers_name_in_an_old_code_page_is_read():
    text = dxf(entity("LINE", point((0, 0)), point((1, 0), 11), layer="Fräsen"), version="AC1015")
    text = text.replace("9\n$INSUNITS", "9\n$DWGCODEPAGE\n3\nANSI_1252\n9\n$INSUNITS", 1)
    assert read_dxf(text.encode("cp1252"), "a.dxf").runs[0].layer == "Fräsen"


def test_damaged_values_are_told_and_nothing_breaks(tmp_path):
    """What ezdxf hands on without a look: missing points, names and layers, endless angles."""
    arc = entity("ARC", point((1, 1, 0)), (40, 2.0), (50, "inf"), (51, 70.0))
    text = dxf(
        entity("LINE", point((0, 0)), point((1, 0), 11)),
        arc,
        entity("INSERT", point((0, 0))),
        [(0, "70"), (8, "0")],
    )
    drawing = read_dxf(text.encode(), "a.dxf")
    assert len(drawing.runs) == 1
    assert sum(drawing.left_out.values()) == 3
    far = dxf(insert("P", (0, 0), 1e300, 1e300), blocks=[block("P", entity("CIRCLE", point((9, 0)), (40, 1e200)))])
    (tmp_path / "far.dxf").write_text(far)
    with pytest.raises(InputError, match="a coordinate is not a number"):
        read_drawing(tmp_path / "far.dxf")
