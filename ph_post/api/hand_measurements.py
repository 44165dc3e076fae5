"""Measure a machine without a log: by a dial indicator, calipers on a test cut, or a ball bar."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec.structs import asdict, replace

from ph_post.api.inputs import Source, source_of
from ph_post.api.measurements import MachineFileResult, measured_machine_of
from ph_post.files.readings import SWING_MM, read_ball_bar, read_readings
from ph_post.files.storage import SourceText
from ph_post.identify.measurement import Measurement, measure_machine, measured_machine
from ph_post.types import Machine
from ph_post.types.readings import Readings
from ph_post.units import MM


class HandMeasurement(Measurement, MachineFileResult, frozen=True, kw_only=True):
    """What readings by hand say, with the machine file that it began with, None where it was made by hand."""

    before: Machine
    source: SourceText | None = None

    def machine_file(self) -> str:
        """Return the machine file with the lost motions and their uncertainties.

        Raises
        ------
        InputError
            Where the machine was not read from a file.
        """
        return measured_machine(source_of(self.machine, self.source, "measured"), self, self.before)


def measure(
    readings: Readings | Source | None, machine: Machine | Source, *, ball_bar: Sequence[Source] = ()
) -> HandMeasurement:
    r"""Work out lost motion, squareness and scale from readings of a dial indicator, calipers or a ball bar.

    Parameters
    ----------
    readings : Readings, str or path, or None
        File that ``ph-post calibrate --without-log`` writes, with its readings; None where there is none.
    machine : Machine, str or path
    ball_bar : sequence of str or path, optional
        Files of ball-bar arcs (CSV: angle [degrees], radius [mm]).

    Returns
    -------
    HandMeasurement
        `axes` by name, each with `lost_motion` and its error [m]; `squareness`, `scale`; and `machine` with them.

    Raises
    ------
    InputError
        Where readings contradict themselves, each other or the machine.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import ph_post as ph
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "readings.toml")
    ...     _ = file.write_text('dial = [{axis = "X", readings = [0.0, 0.5, 0.031, 0.002, 0.029]}]')
    ...     found = ph.measure(file, "stepper")
    >>> round(found.axes["X"].lost_motion.value * 1e3, 3)
    0.029
    """
    drives, source = measured_machine_of(machine)
    hand = _readings(readings)
    if ball_bar:
        traces = [trace for file in ball_bar for trace in read_ball_bar(file)]
        names = " and ".join([*([hand.name] if hand.dial or hand.cut else []), *dict.fromkeys(t.name for t in traces)])
        hand = replace(hand, name=names, ball_bar=[*hand.ball_bar, *traces])
    found = measure_machine(hand, drives)
    return HandMeasurement(**asdict(found), before=drives, source=source)


def _readings(readings: Readings | Source | None) -> Readings:
    if readings is None:
        return Readings(name="no readings", swing=SWING_MM * MM)
    return readings if isinstance(readings, Readings) else read_readings(readings)
