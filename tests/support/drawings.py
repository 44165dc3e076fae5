"""DXF drawings written tag by tag, and points on imported paths."""

import numpy as np

from ph_post.files.path import read_path


def tags(*pairs):
    """Group codes and values as DXF text."""
    return "".join(f"{code}\n{value}\n" for code, value in pairs)


def point(values, first=10):
    return [(first + 10 * k, repr(float(value))) for k, value in enumerate(values)]


def entity(kind, *pairs, layer="0"):
    flat = []
    for pair in pairs:
        flat.extend(pair if isinstance(pair, list) else [pair])
    return [(0, kind), (8, layer), *flat]


def block(name, *entities, base=(0, 0, 0)):
    head = [(0, "BLOCK"), (8, "0"), (2, name), (70, 0), *point(base), (3, name)]
    return [*head, *(pair for one in entities for pair in one), (0, "ENDBLK"), (8, "0")]


def dxf(*entities, units=4, blocks=(), version="AC1015", layers=()):
    """A drawing; `units` is $INSUNITS (None: not given), `layers` are (name, flags, colour)."""
    header = [(0, "SECTION"), (2, "HEADER"), (9, "$ACADVER"), (1, version)]
    header += [] if units is None else [(9, "$INSUNITS"), (70, units)]
    table = [(0, "TABLE"), (2, "LAYER"), (70, len(layers))]
    for name, flags, colour in layers:
        table += [(0, "LAYER"), (2, name), (70, flags), (62, colour), (6, "CONTINUOUS")]
    parts = [*header, (0, "ENDSEC"), (0, "SECTION"), (2, "TABLES"), *table, (0, "ENDTAB"), (0, "ENDSEC")]
    parts += [(0, "SECTION"), (2, "BLOCKS"), *(pair for one in blocks for pair in one), (0, "ENDSEC")]
    parts += [(0, "SECTION"), (2, "ENTITIES"), *(pair for one in entities for pair in one), (0, "ENDSEC")]
    return tags(*parts, (0, "EOF"))


def lwpolyline(vertices, closed=True, layer="0", **more):
    """Vertices are (x, y, bulge)."""
    flat = [pair for x, y, bulge in vertices for pair in [*point((x, y)), (42, repr(float(bulge)))]]
    head = [(100, "AcDbEntity"), (8, layer), (100, "AcDbPolyline"), (90, len(vertices)), (70, int(closed))]
    return [(0, "LWPOLYLINE"), *head, *more.get("extra", []), *flat]


def spline(degree, knots, control=(), weights=(), fit=(), flags=8, layer="0", extra=()):
    head = [(0, "SPLINE"), (100, "AcDbEntity"), (8, layer), (100, "AcDbSpline"), (70, flags), (71, degree)]
    counts = [(72, len(knots)), (73, len(control)), (74, len(fit)), *extra]
    numbers = [(40, repr(float(knot))) for knot in knots]
    for k, row in enumerate(control):
        numbers += point(row)
        numbers += [(41, repr(float(weights[k])))] if len(weights) else []
    for row in fit:
        numbers += point(row, 11)
    return [*head, *counts, *numbers]


def ellipse(center, major, ratio, first, last, layer="0", normal=(0, 0, 1)):
    head = [(0, "ELLIPSE"), (100, "AcDbEntity"), (8, layer), (100, "AcDbEllipse")]
    shape = [*point(center), *point(major, 11), *point(normal, 210), (40, ratio), (41, first), (42, last)]
    return [*head, *shape]


def insert(name, place, sx=1, sy=1, turn=0, layer="0", extra=()):
    return entity("INSERT", (2, name), point(place), (41, sx), (42, sy), (43, 1), (50, turn), *extra, layer=layer)


def sampled(path, count=33):
    """Points in mm along every segment that is no rapid, shape (segments, count, dim)."""
    rows = []
    for segment in path.segments:
        if not segment.rapid:
            low, high = segment.curve.domain
            rows.append(segment.curve.derivatives(np.linspace(low, high, count))[0] * 1e3)
    return np.array(rows)


def imported(main, source, folder, *options):
    """Import a drawing by the command line and return the path it wrote."""
    target = folder / "path.json"
    assert main(["import", str(source), "-o", str(target), *options]) == 0
    return read_path(target)
