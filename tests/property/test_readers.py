"""Whatever stands in a file, a reader takes it or refuses it in one line; nothing else ever comes out."""

import json
import math
import tomllib
from fractions import Fraction

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.amount import examples

from ph_post.drive.machinefile import read_machine
from ph_post.errors import InputError
from ph_post.files.path import read_path
from ph_post.files.storage import shipped, shipped_names

PATHS = [shipped("paths", name).read_text(encoding="utf-8") for name in shipped_names("paths")]
MACHINES = [shipped("machines", name).read_text(encoding="utf-8") for name in shipped_names("machines")]

relaxed = settings(
    max_examples=examples(150),
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
odd = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=8),
    st.sampled_from([0, -1, 1e-7, 1e308, -1e308, 5e-324, 1e15, 10**30, "1/3", "0/1", "1/0", "X", "line", "mm", [], {}]),
    st.lists(st.integers(-2, 2), max_size=4),
    st.lists(st.lists(st.floats(-1e200, 1e200), min_size=2, max_size=2), min_size=1, max_size=4),
    st.dictionaries(st.sampled_from(["X", "Y", "type", "feed"]), st.integers(), max_size=2),
)


def takes_or_refuses(read, file, data):
    file.write_bytes(data)
    line = str(file)
    try:
        read(file)
    except InputError as refusal:
        line = str(refusal)
    assert line.splitlines() == [line]
    assert line.startswith(str(file))


@st.composite
def mangled(draw, texts):
    """Bytes of a good file with a few of them deleted, doubled or replaced."""
    data = bytearray(draw(st.sampled_from(texts)).encode())
    for _ in range(draw(st.integers(1, 3))):
        place = draw(st.integers(0, len(data)))
        length = draw(st.integers(0, 30))
        data[place : place + length] = draw(
            st.one_of(st.binary(max_size=4), st.just(bytes(data[place : place + length]) * 2), st.just(b""))
        )
    return bytes(data)


@st.composite
def altered(draw, values):
    """A good file's value with a few of its parts replaced, removed or added."""
    value = json.loads(json.dumps(draw(st.sampled_from(values))))
    for _ in range(draw(st.integers(1, 3))):
        place = value
        # mostly down the longest branch, where the geometry or the drives are
        while True:
            keys = sorted(place, key=lambda key: len(str(place[key]))) if isinstance(place, dict) else range(len(place))
            if not keys:
                break
            key = keys[-1] if draw(st.booleans()) else draw(st.sampled_from(keys))
            if not isinstance(place[key], dict | list) or not place[key] or draw(st.integers(0, 9)) == 0:
                alter(draw, place, key)
                break
            place = place[key]
    return value


def alter(draw, place, key):
    match draw(st.integers(0, 3)):
        case 0 if isinstance(place, dict):
            del place[key]
        case 1 if isinstance(place, list):
            place.insert(key, draw(odd))
        case 2 if isinstance(place, list):
            place.append(place[key])
        case _:
            place[key] = draw(odd)


def toml_of(value, prefix=()):
    """Write a table as TOML; values that TOML has no word for become text."""
    plain = {key: item for key, item in value.items() if not isinstance(item, dict)}
    lines = [f"[{'.'.join(prefix)}]"] if prefix else []
    lines += [f"{key} = {word(item)}" for key, item in plain.items()]
    for key, item in value.items():
        if isinstance(item, dict):
            lines.append(toml_of(item, (*prefix, key)))
    return "\n".join(lines)


def word(item):
    if isinstance(item, float) and math.isnan(item):
        return "nan"
    if isinstance(item, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {word(part)}" for key, part in item.items()) + "}"
    if isinstance(item, list):
        return "[" + ", ".join(map(word, item)) + "]"
    text = json.dumps("null" if item is None else item)
    return {"Infinity": "inf", "-Infinity": "-inf"}.get(text, text)


number = st.one_of(
    st.sampled_from([0, 0, 1, 1, -1, 2, 10, "1/3", 0.1, 1e-7, 1e-9, 1e-30, 1e-300, 1e9, 1e12, -1e12, 1e150, 1e300]),
    st.integers(-20, 20),
    st.floats(-100, 100),
)


@st.composite
def rows(draw, least, most, width):
    return [[draw(number) for _ in range(width)] for _ in range(draw(st.integers(least, most)))]


@st.composite
def made_segment(draw, width):
    """A segment of the right form with numbers that are not."""
    kind = draw(st.sampled_from(["line", "arc", "bezier", "polynomial", "ph", "ph-hermite", "nurbs"]))
    match kind:
        case "line":
            rest = {"points": draw(rows(2, 2, width))}
        case "arc":
            start, center = draw(rows(2, 2, width))
            end = draw(st.sampled_from([start, start[::-1], *draw(rows(1, 1, width))]))
            rest = {
                "start": start,
                "end": end,
                "center": center,
                "turn": draw(st.sampled_from(["cw", "ccw"])),
            }
        case "bezier":
            rest = {"points": draw(rows(2, 8, width))}
        case "polynomial":
            rest = {"coefficients": {axis: draw(st.lists(number, min_size=1, max_size=6)) for axis in "XYZ"[:width]}}
            rest |= {"domain": [draw(number), draw(number)]} if draw(st.booleans()) else {}
        case "ph":
            rest = {"start": draw(rows(1, 1, width))[0], "preimage": draw(rows(1, 5, 2 if width == 2 else 4))}
        case "ph-hermite":
            rest = {"points": draw(rows(2, 2, width)), "derivatives": draw(rows(2, 2, width))}
        case _:
            degree, points = draw(st.integers(1, 4)), draw(rows(2, 8, width))
            knots = draw(st.lists(number, min_size=len(points) + degree + 1, max_size=len(points) + degree + 1))
            rest = {"degree": degree, "points": points, "knots": sorted(knots, key=Fraction)}
            rest |= {"weights": [draw(number) for _ in points]} if draw(st.booleans()) else {}
    return {"type": kind, **rest}


@st.composite
def made_path(draw):
    width = draw(st.sampled_from([2, 2, 3]))
    head = {"format": "ph-post-path", "version": 1, "units": draw(st.sampled_from(["mm", "m", "inch"]))}
    return {**head, "axes": list("XYZ"[:width]), "feed": 1, "segments": [draw(made_segment(width))]}


@pytest.mark.parametrize(("read", "texts"), [(read_path, PATHS), (read_machine, MACHINES)])
@relaxed
@given(st.data())
def test_mangled_files(tmp_path, read, texts, data):
    takes_or_refuses(read, tmp_path / "file", data.draw(mangled(texts)))


@relaxed
@given(st.binary(max_size=60))
def test_any_bytes(tmp_path, data):
    takes_or_refuses(read_path, tmp_path / "file", data)
    takes_or_refuses(read_machine, tmp_path / "file", data)


@settings(relaxed, max_examples=examples(200))
@given(altered([json.loads(text) for text in PATHS]))
def test_altered_paths(tmp_path, value):
    takes_or_refuses(read_path, tmp_path / "file", json.dumps(value).encode())


@settings(relaxed, max_examples=examples(300))
@given(made_path())
def test_made_paths(tmp_path, value):
    takes_or_refuses(read_path, tmp_path / "file", json.dumps(value).encode())


@relaxed
@given(altered([tomllib.loads(text) for text in MACHINES]))
def test_altered_machines(tmp_path, value):
    takes_or_refuses(read_machine, tmp_path / "file", toml_of(value).encode("utf-8", "surrogatepass"))
