"""Real programs: those that LinuxCNC installs, by name, and those that FreeCAD's operations made."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from msgspec.structs import replace

from ph_post.api.compensated_program import ProgramRequest
from ph_post.api.programs import compensate_program
from ph_post.compensate.options import PlanOptions
from ph_post.dialects.base import Dialect
from ph_post.dialects.registry import find_dialect
from ph_post.drive.machinefile import read_machine
from ph_post.edit.edits import EditOptions
from ph_post.gcode.program import PartProgram
from ph_post.types import Machine

HERE = Path(__file__).resolve().parents[1] / "corpus"
NCFILES = Path("/usr/share/linuxcnc/ncfiles")
SAMPLES = Path("/usr/share/doc/linuxcnc/examples/sample-configs/sim")
AXIS = Path("/usr/share/axis/images")

LINUXCNC = (
    (NCFILES, "3D_Chips"),
    (NCFILES, "3dtest"),
    (NCFILES, "arcspiral"),
    (NCFILES, "b-index"),
    (NCFILES, "cds"),
    (NCFILES, "comp-g1"),
    (NCFILES, "comp"),
    (NCFILES, "comp311"),
    (NCFILES, "comp311_2"),
    (NCFILES, "daisy"),
    (NCFILES, "flowsnake"),
    (NCFILES, "gmoccapy_2_tools_with_cutter_radius_compensation"),
    (NCFILES, "hole-circle"),
    (NCFILES, "lathe-g76"),
    (NCFILES, "lathe_pawn"),
    (NCFILES, "lathecomp"),
    (NCFILES, "mmount"),
    (NCFILES, "plasmatest"),
    (NCFILES, "polar"),
    (NCFILES, "skeleton"),
    (NCFILES, "spiral"),
    (NCFILES, "systems"),
    (NCFILES, "threading"),
    (NCFILES, "tool-length-probe"),
    (NCFILES, "toplevel"),
    (NCFILES, "tort"),
    (NCFILES, "useful-subroutines"),
    (NCFILES, "x-trim"),
    (SAMPLES, "axis/remap/extend-builtins/nc_files/examples"),
    (SAMPLES, "axis/vismach/5axis/table-dual-rotary/demos/xyzab-tdr-demo"),
    (SAMPLES, "axis/vismach/melfa-sim/example"),
    (SAMPLES, "axis/vismach/millturn/example"),
    (SAMPLES, "axis/vismach/puma/puma_seam_weld"),
    (SAMPLES, "craftsman/screens/craftsmancnc"),
    (SAMPLES, "gmoccapy/non_trivial_kinematics/table-rotary-tilting/examples/boat-xyzac"),
    (SAMPLES, "gmoccapy/non_trivial_kinematics/table-rotary-tilting/examples/boat-xyzbc"),
    (AXIS, "axis"),
)
"""Programs that LinuxCNC 2.9 installs.

Left out of those it installs are: files with nothing but subroutines, which other programs call (most of
ncgcui_lib, macros, probe, remap subroutines); those of plasmac, which read the settings of their own screen
and are no G-code without it; 5axisgui, which is written with exponents; examples of remapped words; and
programs that hold nothing but parameters and loops, of which daisy, flowsnake and useful-subroutines stand
for the others.
"""


@dataclass(frozen=True)
class Entry:
    """A program of the corpus and the controller it is for."""

    name: str
    file: Path
    dialect: str = "linuxcnc"


def entries() -> list[Entry]:
    """All programs, by name; those of LinuxCNC stand at the same place on every machine."""
    own = [
        Entry(f"freecad/{file.stem}", file, "grbl" if file.stem.endswith("grbl") else "linuxcnc")
        for file in sorted(HERE.glob("freecad/*.ngc"))
    ]
    return own + [Entry(name, folder / f"{name}.ngc") for folder, name in LINUXCNC]


def stepper() -> Machine:
    """A stepper machine with 0.05 mm of lost motion on X, Y and Z."""
    machine = read_machine("stepper")
    some = next(iter(machine.axes.values()))
    gap = replace(some.gap, lost_motion=5e-5)
    axes = {name: replace(machine.axes.get(name, some), name=name, gap=gap) for name in "XYZ"}
    return replace(machine, axes=axes)


def mill() -> Machine:
    """Name the mill with scales on its table, with the dialect of LinuxCNC."""
    machine = read_machine("mill")
    some = machine.axes["X"]
    return replace(machine, axes={name: replace(machine.axes.get(name, some), name=name) for name in "XYZ"})


def compensated(program: PartProgram, machine: Machine, dialect: Dialect, strategy: str | None = None) -> bytes:
    """Write a program with the lasting offsets of a machine, or with the windows of a strategy."""
    how = PlanOptions(strategy=strategy or "takeup", carrier="program", inverse_dynamics=False, effort=0.01)
    asked = ProgramRequest(plan=how, edit=EditOptions())
    return compensate_program(program, replace(machine, dialect=dialect.name), asked).after.data


def dialect_of(entry: Entry) -> Dialect:
    """Find the dialect of an entry."""
    return find_dialect(entry.dialect)
