"""Distances from polylines, against exact fractions."""

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest

from ph_post.geometry.numeric import polyline_distances


def exactly(point, line):
    """Return the least squared distance of a point from the chords of a polyline."""
    found = []
    for start, end in itertools.pairwise(line):
        way = [b - a for a, b in zip(start, end, strict=True)]
        off = [b - a for a, b in zip(start, point, strict=True)]
        square = sum(one * one for one in way)
        share = min(max(sum(a * b for a, b in zip(off, way, strict=True)) / square, 0), 1) if square else Fraction(0)
        found.append(sum((a - share * b) ** 2 for a, b in zip(off, way, strict=True)))
    return min(found)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("seed", range(8))
def test_distances_from_a_polyline_are_those_of_its_nearest_chord(dimension, seed):
    rng = np.random.default_rng(seed)
    line, points = (rng.integers(-40, 40, (count, dimension)) for count in (12, 30))
    line[5] = line[4]  # a chord without a length
    points[0], points[1] = line[7], line[0] - 100
    whole = [[Fraction(int(x)) for x in one] for one in line]
    expected = [math.sqrt(exactly([Fraction(int(x)) for x in point], whole)) for point in points]
    found = polyline_distances(points.astype(float), line.astype(float))
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-9)


def test_it_makes_no_difference_how_the_arrays_lie_in_memory():
    rng = np.random.default_rng(3)
    line, points = rng.normal(size=(9, 3)), rng.normal(size=(17, 3))
    found = polyline_distances(points, line)
    assert np.array_equal(found, polyline_distances(np.asfortranarray(points), np.asfortranarray(line)))
    assert np.array_equal(found[::-1], polyline_distances(points[::-1], line))
