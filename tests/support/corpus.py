"""Real programs: those that LinuxCNC installs, by name, and those that FreeCAD's operations made.

Beside these, the whole corpus has slicers' programs, programs after the examples of manuals, parts written in the
manners of CAM systems, generated families, and small programs with one defect each.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from msgspec.structs import replace

from ph_post.api.compensated_program import ProgramRequest
from ph_post.api.inputs import read_machine
from ph_post.api.programs import compensate_program
from ph_post.compensate.options import PlanOptions
from ph_post.dialects.base import Dialect
from ph_post.dialects.registry import find_dialect
from ph_post.edit.edits import EditOptions
from ph_post.gcode.program import PartProgram
from ph_post.types import Machine
from support import cam_posts, random_cuts

HERE = Path(__file__).resolve().parents[1] / "corpus"
TOOLS = HERE / "tools.tbl"
"""Table of the tools whose radius programs with cutter compensation need."""

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
    """A program of the corpus and the controller it is for; `text` where it is in no file of its own."""

    name: str
    file: Path
    dialect: str = "linuxcnc"
    text: str = ""

    @property
    def origin(self) -> str:
        """Where it is from: the first part of its name."""
        return self.name.partition("/")[0]

    @property
    def title(self) -> str:
        """Name of a file with it."""
        own = {"siemens": ".mpf", "heidenhain": ".h", "heidenhain-iso": ".i", "marlin": ".gcode", "klipper": ".gcode"}
        return self.name + (own.get(self.dialect, ".nc") if self.text else self.file.suffix)

    @cached_property
    def data(self) -> bytes:
        """Bytes of the program."""
        return self.text.encode() if self.text else self.file.read_bytes()


def entries() -> list[Entry]:
    """All programs, by name; those of LinuxCNC stand at the same place on every machine."""
    own = [
        Entry(f"freecad/{file.stem}", file, "grbl" if file.stem.endswith("grbl") else "linuxcnc")
        for file in sorted(HERE.glob("freecad/*.ngc"))
    ]
    return own + [Entry(name, folder / f"{name}.ngc") for folder, name in LINUXCNC]


WRITTEN = {"defects": "linuxcnc", "fanuc": "fanuc", "siemens": "siemens", "heidenhain": "heidenhain"}
"""Files of small programs, and the controllers that those are for that name none."""

FAMILIES = 60
"""Random programs of the corpus, in turn of each kind of work."""

BIG = 20_000
"""Programs that LinuxCNC installs and that are larger [bytes] are left out: they take minutes."""


def installed() -> list[Entry]:
    """All programs that LinuxCNC installs, by their place below its folders."""
    folders = {"nc_files": NCFILES, "configs": SAMPLES, "axis": AXIS}
    files = ((label, folder, file) for label, folder in folders.items() for file in sorted(folder.rglob("*.ngc")))
    return [
        Entry(f"linuxcnc/{label}/{file.relative_to(folder).with_suffix('')}", file)
        for label, folder, file in files
        if file.is_file() and not file.is_symlink() and file.stat().st_size <= BIG
    ]


def whole() -> list[Entry]:
    """Every program of the corpus, by name; those of LinuxCNC where it is installed."""
    sliced = sorted(HERE.parent.glob("slicers/*.gcode"))
    found = [entry for entry in entries() if entry.origin == "freecad"]
    found += [Entry(f"slicers/{file.stem}", file, "marlin") for file in sliced]
    found += [*_written(), *_posted(), *_families()]
    return sorted([*found, *installed()], key=lambda entry: entry.name)


def _written() -> Iterator[Entry]:
    for origin, dialect in WRITTEN.items():
        file = HERE / f"{origin}.toml"
        for name, one in tomllib.loads(file.read_text(encoding="utf-8")).items():
            yield Entry(f"{origin}/{name}", file, one.get("dialect", dialect), one["text"].lstrip("\n"))


def _posted() -> Iterator[Entry]:
    file = Path(cam_posts.__file__)
    for name, part in cam_posts.PARTS.items():
        for system, (write, dialect) in cam_posts.CAM.items():
            yield Entry(f"{system}/{name}", file, dialect, write(part))
    for name in cam_posts.SLICED:
        for manner in (cam_posts.prusa, cam_posts.cura):
            for dialect in ("marlin", "klipper"):
                yield Entry(
                    f"printers/{name}_{manner.__name__}_{dialect}", file, dialect, manner(cam_posts.PARTS[name])
                )


def _families() -> Iterator[Entry]:
    file = Path(random_cuts.__file__)
    for number in range(FAMILIES):
        cut = random_cuts.random_cut(number)
        yield Entry(f"families/{cut.kind}_{number}", file, cut.machine.dialect, cut.text)


def stepper(dialect: str | None = None) -> Machine:
    """A stepper machine with 0.05 mm of lost motion on X, Y and Z.

    It has the shipped one's controller, or another, which rounds corners by 0.01 mm at most if it rounds any.
    """
    machine = read_machine("stepper", dialect=dialect)
    if dialect is not None:
        machine = replace(machine, planner=replace(machine.planner, path_tolerance=1e-5))
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
