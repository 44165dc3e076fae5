"""Blocks as a controller will read them: on the grid of the dialect's decimals, each with its time."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np

from ph_post.compensate.motion import Motion
from ph_post.gcode.dialect import Dialect
from ph_post.gcode.feedpieces import Course, feed_course
from ph_post.gcode.format import to_grid
from ph_post.gcode.jogs import Carried
from ph_post.gcode.polynomials import polynomial_words
from ph_post.gcode.record import DWELL, JOG, Blocks, Moves
from ph_post.gcode.shape import ARC, POLYNOMIAL, SPLINE, Shape
from ph_post.gcode.splines import cubic_control
from ph_post.types import Array, IntArray, Phase
from ph_post.units import MM

_SAME_FEED = 1e-4
"""A feed that differs from the planned one by no more than this part is written as that: a tenth of what the
time may err."""


def round_blocks(
    blocks: Blocks, shape: Shape, dialect: Dialect, carried: Carried, phases: Sequence[Phase]
) -> Moves:
    """Put blocks on the grid; those that come out with no length give their time to a neighbour.

    All points of one circle share one centre, so that radii at the start and at the end of an arc differ by
    no more than the rounding of the two points. `phases` are the motion's, for dialects whose feed can change
    within a block.
    """
    decimals = dialect.capabilities.decimals
    path = shape.positions(np.append(blocks.s0[:1], blocks.s1))
    points = to_grid(path + carried.offset, decimals)
    moving = (np.diff(points, axis=0) != 0).any(axis=1) | (blocks.kind == DWELL)
    duration = _inherited(blocks.end - blocks.start, moving)
    kept = np.flatnonzero(moving)
    names = Blocks.__struct_fields__
    blocks = msgspec.structs.replace(blocks, **{name: getattr(blocks, name)[kept] for name in names})
    points, offset = points[np.append(0, kept + 1)], carried.offset[kept + 1]
    piece = shape.piece_at(0.5 * (blocks.s0 + blocks.s1))
    center = to_grid(shape.center[piece] + offset[:, :2], decimals)
    way = np.sign(blocks.s1 - blocks.s0).astype(np.int64)
    turn = np.where(blocks.kind == ARC, shape.turn[piece] * way, 0)
    length = _lengths(blocks, points, center, turn, decimals)
    feed = np.where(blocks.kind == JOG, carried.feed[kept], _feeds(blocks, length, duration))
    course = Course(feed=feed, profiles={}, off={})
    if dialect.capabilities.feed_degree:
        course = feed_course(blocks, Motion.from_phases(phases), feed, dialect.feed_digits)
    return Moves(
        kind=blocks.kind,
        points=points,
        plain=to_grid(path[-1], decimals),
        center=center,
        turn=turn,
        inner=_inner_points(blocks, shape, piece, offset, decimals),
        duration=duration,
        length=length,
        feed=course.feed,
        rapid=blocks.rapid,
        s0=blocks.s0,
        s1=blocks.s1,
        polynomials=polynomial_words(blocks, shape, piece, offset, decimals),
        profiles=course.profiles,
        off=course.off,
    )


def _inherited(duration: Array, moving: Array) -> Array:
    """Give the times of the blocks that do not move to those that do.

    A block without length gives its time to the next one that moves, so that a start from rest stays slow;
    at the end to the last one.
    """
    count = int(moving.sum())
    heir = np.minimum(np.cumsum(moving) - moving, max(count - 1, 0))
    return np.asarray(np.bincount(heir, duration, count)[:count], dtype=np.float64)


def _inner_points(blocks: Blocks, shape: Shape, piece: IntArray, offset: Array, decimals: int) -> IntArray:
    inner = np.zeros((piece.size, 2, 2), dtype=np.int64)
    spline = np.flatnonzero(blocks.kind == SPLINE)
    of = piece[spline]
    u0, u1 = shape.local(of, blocks.s0[spline]), shape.local(of, blocks.s1[spline])
    control = cubic_control(shape, of, u0, u1)[:, 1:3]
    inner[spline] = to_grid(control + offset[spline, np.newaxis, :2], decimals)
    return inner


def _lengths(blocks: Blocks, points: IntArray, center: IntArray, turn: IntArray, decimals: int) -> Array:
    """Length [m] of every move as it is written; that of a spline or a polynomial is the path's own."""
    chord = np.diff(points, axis=0).astype(np.float64)
    length = np.sqrt((chord * chord).sum(axis=1))
    arc = blocks.kind == ARC
    start = (points[:-1, :2] - center)[arc].astype(np.float64)
    end = (points[1:, :2] - center)[arc].astype(np.float64)
    cross = start[:, 0] * end[:, 1] - start[:, 1] * end[:, 0]
    angle = np.mod(turn[arc] * np.arctan2(cross, (start * end).sum(axis=1)), 2.0 * np.pi)
    length[arc] = 0.5 * (np.hypot(*start.T) + np.hypot(*end.T)) * angle
    length *= MM * 10.0**-decimals
    own = np.isin(blocks.kind, (SPLINE, POLYNOMIAL))
    length[own] = np.abs(blocks.s1 - blocks.s0)[own]
    return np.asarray(length)


def _feeds(blocks: Blocks, length: Array, duration: Array) -> Array:
    """Length over time; one feed for all moves of a constant-speed stretch, so that it is written once.

    There it is the planned one, unless chords are so much shorter than what they span that it shows.
    """
    works = (blocks.rapid == 0) & (blocks.kind != DWELL)
    feed = np.where(works, length / duration, 0.0)
    held = np.flatnonzero(works & (blocks.timed == 0))
    of = np.unique(blocks.stretch[held], return_inverse=True)[1]
    time = np.bincount(of, duration[held])
    written = np.bincount(of, length[held]) / time
    planned = np.bincount(of, np.abs(blocks.s1 - blocks.s0)[held]) / time
    feed[held] = np.where(np.abs(written - planned) <= _SAME_FEED * planned, planned, written)[of]
    return np.asarray(feed)
