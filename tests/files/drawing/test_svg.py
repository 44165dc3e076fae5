"""SVG shapes against svgelements' points, 50-digit arithmetic and closed forms, to 1e-9 mm."""

import math

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.amount import examples
from support.drawings import sampled
from svgelements import CubicBezier, QuadraticBezier

from ph_post.errors import InputError
from ph_post.files.drawing import shapes
from ph_post.files.drawing.convert import ImportOptions, import_drawing
from ph_post.files.drawing.svg import read_svg

WORLD = 1e-9
"""How well an imported curve has to lie where the drawing has it [mm]."""

INKSCAPE = 'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"'
number = st.floats(-100, 100).map(lambda x: round(x, 4))
place = st.tuples(number, number)


def svg(body, size='width="100mm" height="80mm" viewBox="0 0 100 80"', more=""):
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size} {more}>{body}</svg>'


def read(text, **wish):
    return read_svg(text.encode(), "a.svg", wish.get("layers", ()), wish.get("unit"))


def import_of(text, **wish):
    return import_drawing(read(text, **wish), "a.svg", "a", ImportOptions(**{"join": 1e-6, "nearest": False, **wish}))


def shape_of(text, **wish):
    path = import_of(text, **wish).path
    return [segment.curve.kind for segment in path.segments if not segment.rapid], sampled(path)


def up(points):
    """Page coordinates with y downwards as ours."""
    return np.asarray(points) * (1, -1) + (0, 80)


def test_a_path_of_every_command():
    data = (
        "M10 10 L20 10 l5 5 H30 h5 V20 v5 C36 30 40 30 42 25 s4 -6 6 0 S 52 28 55 25"
        "Q60 20 65 25 t10 0 T 85 30 A 5 5 0 0 1 85 40 a5,5,0,1,0-10,0"
    )
    kinds, points = shape_of(svg(f'<path d="{data}"/>'))
    assert kinds == ["line"] * 6 + ["bezier"] * 6 + ["arc"] * 2
    curves = [
        CubicBezier(35 + 25j, 36 + 30j, 40 + 30j, 42 + 25j),
        CubicBezier(42 + 25j, 44 + 20j, 46 + 19j, 48 + 25j),
        CubicBezier(48 + 25j, 50 + 31j, 52 + 28j, 55 + 25j),
        QuadraticBezier(55 + 25j, 60 + 20j, 65 + 25j),
        QuadraticBezier(65 + 25j, 70 + 30j, 75 + 25j),
        QuadraticBezier(75 + 25j, 80 + 20j, 85 + 30j),
    ]
    for mine, curve in zip(points[6:12], curves, strict=True):
        theirs = [(p.x, p.y) for p in map(curve.point, np.linspace(0, 1, 33))]
        assert mine == pytest.approx(up(theirs), abs=WORLD)
    # half a turn over the right hand side, clockwise on the page and so in our view
    angle = np.linspace(math.pi / 2, -math.pi / 2, 33)
    assert points[12] == pytest.approx(np.column_stack([85 + 5 * np.cos(angle), 45 + 5 * np.sin(angle)]), abs=WORLD)
    assert points[13][16] == pytest.approx(up((80, 35)), abs=WORLD)


def test_an_arc_without_a_radius_is_straight():
    for radii in ("0 0", "0 5", "5 0"):
        kinds, points = shape_of(svg(f'<path d="M0 0A{radii} 0 0 0 4 4"/>'))
        assert kinds == ["line"]
        assert points[0][-1] == pytest.approx(up((4, 4)))


def spec_center(start, end, rx, ry, turn, large, sweep):
    """Centre and radii of an arc by SVG 1.1 F.6.5 and F.6.6, in 50 digits."""
    with mp.workdps(50):
        (x1, y1), (x2, y2), rx, ry = map(mp.mpf, start), map(mp.mpf, end), mp.mpf(rx), mp.mpf(ry)
        c, s = mp.cos(mp.radians(turn)), mp.sin(mp.radians(turn))
        dx, dy = (x1 - x2) / 2, (y1 - y2) / 2
        u, v = c * dx + s * dy, -s * dx + c * dy
        excess = u**2 / rx**2 + v**2 / ry**2
        if excess > 1:
            rx, ry, excess = rx * mp.sqrt(excess), ry * mp.sqrt(excess), mp.mpf(1)
        factor = mp.sqrt(1 / excess - 1) * (1 if large != sweep else -1)
        cu, cv = factor * rx * v / ry, -factor * ry * u / rx
        return (c * cu - s * cv + (x1 + x2) / 2, s * cu + c * cv + (y1 + y2) / 2), (rx, ry)


@settings(max_examples=examples(30), deadline=None)
@given(
    start=place,
    end=place,
    rx=st.floats(0.5, 200),
    ry=st.floats(0.5, 200),
    turn=st.floats(-180, 180),
    large=st.booleans(),
    sweep=st.booleans(),
    circle=st.booleans(),
)
def test_an_arc_is_the_specifications(start, end, rx, ry, turn, large, sweep, circle):
    if math.dist(start, end) < 0.1:
        return
    ry = rx if circle else ry
    data = f"M{start[0]} {start[1]} A{rx} {ry} {turn} {int(large)} {int(sweep)} {end[0]} {end[1]}"
    kinds, points = shape_of(svg(f'<path d="{data}"/>'))
    assert kinds == (["arc"] if rx == ry else ["nurbs"])
    assert points[0][[0, -1]] == pytest.approx(up([start, end]), abs=1e-12)
    (cx, cy), (rx, ry) = spec_center(start, end, rx, ry, turn, large, sweep)
    c, s = mp.cos(mp.radians(turn)), mp.sin(mp.radians(turn))
    angles = []
    for x, y in up(points[0]) * 1.0:
        u, v = c * (x - cx) + s * (y - cy), -s * (x - cx) + c * (y - cy)
        assert abs(float((mp.sqrt((u / rx) ** 2 + (v / ry) ** 2) - 1) * mp.sqrt(rx * ry))) < WORLD
        angles.append(float(mp.atan2(v / ry, u / rx)))
    swept = np.unwrap(angles)[-1] - angles[0]
    assert bool(swept > 0) is sweep
    assert abs(swept) >= math.pi - 1e-6 if large else abs(swept) <= math.pi + 1e-6


@settings(max_examples=examples(25), deadline=None)
@given(
    control=st.lists(place, min_size=4, max_size=4, unique=True),
    shift=place,
    turn=st.floats(-360, 360),
    skew=st.floats(-60, 60),
    scale=st.tuples(st.floats(0.1, 4), st.floats(-4, -0.1)),
)
def test_transforms_of_groups_and_shapes_apply_from_the_inside_out(control, shift, turn, skew, scale):
    outer = f"translate({shift[0]},{shift[1]}) rotate({turn} 3 4)"
    inner = f"skewX({skew}) scale({scale[0]} {scale[1]}) matrix(1 0.5 -0.25 2 3 4)"
    (x0, y0), *rest = control
    data = f"M{x0},{y0}C" + " ".join(f"{x},{y}" for x, y in rest)
    _, points = shape_of(svg(f'<g transform="{outer}"><path transform="{inner}" d="{data}"/></g>'))
    c, s, t = math.cos(math.radians(turn)), math.sin(math.radians(turn)), math.tan(math.radians(skew))
    turned = np.array([[c, -s, 3 - c * 3 + s * 4], [s, c, 4 - s * 3 - c * 4], [0, 0, 1]])
    moved = np.array([[1, 0, shift[0]], [0, 1, shift[1]], [0, 0, 1]])
    matrix = moved @ turned @ [[1, t, 0], [0, 1, 0], [0, 0, 1]] @ np.diag([*scale, 1])
    matrix = matrix @ [[1, -0.25, 3], [0.5, 2, 4], [0, 0, 1]]
    curve = CubicBezier(*control)
    theirs = np.array([(p.x, p.y, 1) for p in map(curve.point, np.linspace(0, 1, 33))]) @ matrix.T
    assert points[0] == pytest.approx(up(theirs[:, :2]), abs=WORLD)


def test_a_rounded_rectangle_a_circle_and_an_ellipse():
    kinds, points = shape_of(svg('<rect x="10" y="20" width="30" height="10" rx="3"/>'))
    assert kinds == ["line", "arc"] * 4
    middle = 3 * (1 - math.sqrt(0.5))
    assert points[1][16] == pytest.approx(up((40 - middle, 20 + middle)), abs=WORLD)
    kinds, points = shape_of(svg('<rect x="10" y="20" width="30" height="10" rx="30" ry="2"/>'))
    assert kinds == ["nurbs", "line", "nurbs", "nurbs", "line", "nurbs"]
    assert points[0][16] == pytest.approx(up((25 + 15 * math.sqrt(0.5), 20 + 2 * (1 - math.sqrt(0.5)))), abs=WORLD)
    kinds, points = shape_of(svg('<circle cx="50%" cy="10mm" r="1pc"/>', 'width="4in" height="3in"'))
    assert kinds == ["arc"]
    assert np.linalg.norm(points[0] - (50.8, 76.2 - 10), axis=1) == pytest.approx(25.4 / 6, abs=WORLD)
    kinds, points = shape_of(svg('<circle r="2" transform="scale(3 1)"/><ellipse rx="6" ry="2"/>'))
    assert kinds == ["nurbs", "nurbs"]
    assert points[0] == pytest.approx(points[1], abs=1e-12)
    assert (points[0] - (0, 80)) ** 2 @ [1 / 36, 1 / 4] == pytest.approx(1.0, abs=1e-12)


def test_polygons_lines_and_subpaths_are_contours():
    made = import_of(
        svg(
            '<polygon points="0,0 10,0 10,10"/><polyline points="20 0 30 0 30 10"/><line x1="1" x2="5" y2="3"/>'
            '<path d="M50 0h5v5z m20 0 h5v5z l-3 -3"/>'
        )
    )
    shown = [(contour.closed, len(contour.shapes)) for contour in made.contours]
    assert shown == [(True, 3), (False, 2), (False, 1), (True, 3), (True, 3), (False, 1)]


@pytest.mark.parametrize(
    ("size", "place"),
    [
        ('width="100mm" height="50mm" viewBox="0 0 200 100"', (5, 45)),
        ('width="10cm" viewBox="-10 -10 200 100"', (10, 40)),
        ('width="2in" height="1in"', (2.645833333333333, 25.4 - 2.645833333333333)),
        ('width="96" height="96" viewBox="0 0 2 2"', (127, 25.4 - 127)),
        ('width="100mm" height="100mm" viewBox="0 0 200 100"', (5, 70)),
        ('width="100mm" height="100mm" viewBox="0 0 200 100" preserveAspectRatio="none"', (5, 90)),
        ('width="100mm" height="100mm" viewBox="0 0 200 100" preserveAspectRatio="xMinYMax slice"', (10, 90)),
    ],
)
def test_the_view_box_and_the_size_place_the_drawing(size, place):
    _, points = shape_of(svg('<path d="M10 10h1"/>', size))
    assert points[0][0] == pytest.approx(place, abs=1e-12)


def test_numbers_of_a_drawing_in_mm_are_kept():
    made = import_of(svg('<path d="M0.1 0.3L7.7 79"/>'))
    assert '"points": [[0.1, 79.7], [7.7, 1]]' in made.text


def test_px_are_said_and_no_size_is_refused():
    made = import_of(svg('<path d="M0 0h96"/>', 'width="800" height="600"'))
    assert sampled(made.path)[0][-1] == pytest.approx((25.4, 158.75))
    assert any("1/96 inch" in note for note in made.notes)
    for size in ('viewBox="0 0 10 10"', 'width="100%" height="100%" viewBox="0 0 10 10"', ""):
        with pytest.raises(InputError, match="states no unit; expected --units mm"):
            import_of(svg('<path d="M0 0h9"/>', size))
    made = import_of(svg('<path d="M0 0h9"/>', 'viewBox="0 0 10 10"'), unit="inch")
    assert (made.unit, sampled(made.path)[0][-1].tolist()) == ("inch", pytest.approx([228.6, 254.0]))


def test_layers_symbols_and_what_is_used():
    body = (
        '<defs><path id="p" d="M0 0h4"/><symbol id="s" viewBox="0 0 2 2"><path d="M0 0h1"/></symbol></defs>'
        '<g inkscape:groupmode="layer" inkscape:label="cut"><use href="#p" x="10" y="20"/>'
        '<use xlink:href="#s" x="30" y="20" width="20" height="10"/></g>'
        '<g inkscape:groupmode="layer" inkscape:label="off" style="display:none"><path d="M0 0h7"/></g>'
        '<switch><foreignObject/><g><path d="M0 0h2"/></g></switch>'
        '<svg x="50" y="40" width="10" height="10" viewBox="0 0 1 1"><path d="M0 0h1"/></svg>'
    )
    text = svg(body, more=f'{INKSCAPE} xmlns:xlink="http://www.w3.org/1999/xlink"')
    made = import_of(text)
    ends = [(contour.layer, *contour.shapes[0].start[:2], *contour.shapes[0].end[:2]) for contour in made.contours]
    assert ends == [
        ("cut", 10, 60, 14, 60),
        ("cut", 35, 60, 40, 60),
        ("0", 0, 80, 2, 80),
        ("0", 50, 40, 60, 40),
    ]
    assert made.drawing.left_out == {"hidden (display or visibility)": 1}
    assert [contour.layer for contour in import_of(text, layers=("off",)).contours] == ["off"]
    plain = import_of(svg('<g id="a"><g id="b"><path d="M0 0h1"/></g></g><path d="M0 5h1"/>'))
    assert [contour.layer for contour in plain.contours] == ["a", "0"]


def test_a_hidden_group_that_holds_nothing_is_nothing_left_out():
    made = import_of(svg('<g display="none"><title>guides</title></g><path d="M0 0h5"/>'), strict=True)
    assert made.drawing.left_out == {}


def test_what_is_not_understood_is_named_with_its_count():
    body = (
        '<path d="M0 0h5" clip-path="url(#c)"/><clipPath id="c"><rect width="2" height="2"/></clipPath>'
        '<text>a</text><text>b</text><image href="x.png"/><circle r="2em"/><rect width="0" height="4"/>'
        '<path d="M0 9h5" visibility="hidden"/><path d="M0 0h1" style="transform: rotate(4deg)"/>'
        '<use href="other.svg#a"/><style>.a { transform: scale(2) }</style><foo/>'
        '<path d="M0 0h3" style="mask:url(#m);stroke:none;fill:red"/><path d=""/>'
    )
    assert read(svg(body)).left_out == {
        "style sheet that moves or hides": 1,
        "clip-path (the shape is taken whole)": 1,
        "text": 2,
        "image": 1,
        "circle with a length in em": 1,
        "rect without length": 1,
        "hidden (display or visibility)": 1,
        "path with a CSS transform": 1,
        "use of an element that is not in the file": 1,
        "foo": 1,
        "mask (the shape is taken whole)": 1,
        "path without length": 1,
    }


@pytest.mark.parametrize(
    ("body", "told"),
    [
        ('<path d="M0 0 L10"/>', "a.svg:1: path data is not understood; expected SVG path commands"),
        ('<path d="M0 0 L1 1 X"/>', 'got "M0 0 L1 1 X"'),
        ('<path d="M0 0 L NaN 3"/>', "path data is not understood"),
        ('<path d="M0 0 L 1e999 3"/>', "a coordinate is not a number"),
        ('<path d="L0 0"/>', "path data is not understood"),
        ('<path d="M0 0A1 1 0 2 0 4 4"/>', "path data is not understood"),
        ('<g transform="rotate(1e999)"><path d="M0 0h1"/></g>', "a coordinate is not a number"),
        ('<polygon points="0,0 1"/>', "points are not understood; expected pairs of numbers"),
        ('<g transform="rotate(4deg)"><path d="M0 0h1"/></g>', "transform is not understood"),
        ('<g transform="scale(1,2,3)"><path d="M0 0h1"/></g>', "transform is not understood"),
        ('<g id="g"><use href="#g"/></g>', "#g uses itself"),
        ("<g>" * 300 + "</g>" * 300, "nested too deeply"),
    ],
)
def test_damage_is_refused_with_its_line(body, told):
    with pytest.raises(InputError) as refusal:
        read(svg(body))
    assert told in str(refusal.value)


def test_use_upon_use_ends(monkeypatch):
    # The limit is what counts, not its size: a hundred thousand take a minute.
    monkeypatch.setattr(shapes, "MAX_ENTITIES", 2000)
    levels = "".join(f'<g id="g{k}">{f"<use href={chr(34)}#g{k + 1}{chr(34)}/>" * 10}</g>' for k in range(8))
    with pytest.raises(InputError, match="too large; expected at most 2000 entities"):
        read(svg(f'<defs>{levels}<path id="g8" d="M0 0h1"/></defs><use href="#g0"/>'))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_entities_are_refused_before_they_grow(encoding):
    bomb = '<!DOCTYPE svg [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]>' + svg("<title>&b;</title>")
    for text in (bomb, '<!DOCTYPE svg [<!ENTITY x SYSTEM "file:///etc/passwd">]>' + svg("<text>&x;</text>")):
        with pytest.raises(InputError, match=r"^a.svg:1: the drawing declares an XML entity"):
            read_svg(text.encode(encoding), "a.svg")
    plain = '<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" "http://www.w3.org/Graphics/SVG/1.1/DTD/svg11.dtd">'
    assert len(read_svg((plain + svg('<path d="M0 0h1"/>')).encode(), "a.svg").runs) == 1
