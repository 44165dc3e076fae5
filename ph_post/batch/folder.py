"""The programs of a folder, and where what is made of them goes."""

from __future__ import annotations

import os
import re
import stat
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePath
from typing import Final, NamedTuple

from ph_post.api.inputs import Source, machine_named
from ph_post.dialects.registry import find_dialect
from ph_post.errors import InputError
from ph_post.files.storage import HIDDEN, JOB_ENDINGS, require_folder, require_out
from ph_post.types import Machine

PATH_ENDING: Final = ".json"


class BatchTask(NamedTuple):
    """A file for a machine: its name in the folder, the machine's name, and the file that is to be written."""

    file: str
    label: str
    target: Path


class BatchPlan(NamedTuple):
    """All that a batch has to do.

    Attributes
    ----------
    folder, place : Path
        Where the programs are, and where outputs go.
    machines : dict of str to Machine
        By the names that the report has for them.
    tasks : list of BatchTask
        Largest files first: the last to end are short.
    clashes : dict of Path to str
        Targets that two files have, with what both are.
    """

    folder: Path
    place: Path
    machines: dict[str, Machine]
    tasks: list[BatchTask]
    clashes: dict[Path, str]


def plan_batch(folder: Source, machines: Sequence[Machine | Source], place: Source, dialect: str | None) -> BatchPlan:
    """Find the programs of a folder, and where each goes: ``place/name``, of several machines ``place/machine/name``.

    Raises
    ------
    InputError
        Where the folder, a machine or the place is bad, there is no program, or an output would overwrite an input.
    """
    known = _named_machines(machines, dialect)
    root = require_folder(folder, "programs", file="a folder; ph-post convert takes one program")
    out = require_out(place)
    if os.path.realpath(out) == os.path.realpath(root):
        raise InputError(os.fspath(place), "the outputs would overwrite the inputs", expected="another folder")
    files = sorted(files_below(root, os.path.realpath(out), JOB_ENDINGS))
    if not files:
        raise InputError(os.fspath(folder), "no programs", expected=f"files that end in {' '.join(JOB_ENDINGS)}")
    tasks = [
        BatchTask(
            name, label, _target(out, name, label if len(known) > 1 else "", find_dialect(machine.dialect).ending)
        )
        for _, name in sorted((-size, name) for name, size in files)
        for label, machine in known.items()
    ]
    _refuse_overwriting(root, out, [name for name, _ in files], tasks, machines)
    require_room(out)
    owners: dict[Path, list[str]] = {}
    for task in tasks:
        owners.setdefault(task.target, []).append(task.file)
    clashes = {target: " and ".join(sorted(names)) for target, names in owners.items() if len(names) > 1}
    return BatchPlan(root, out, known, tasks, clashes)


def require_room(out: Path) -> None:
    """Refuse a folder that cannot be made or written, before any work is done for it."""
    there = next(one for one in (out.absolute(), *out.absolute().parents) if os.path.lexists(one))
    if not (there.is_dir() and os.access(there, os.W_OK | os.X_OK)):
        got = "a folder that is write-protected" if there.is_dir() else "a file of that name"
        raise InputError(os.fspath(there), "cannot be written", expected="a folder", got=got)


def _named_machines(machines: Sequence[Machine | Source], dialect: str | None) -> dict[str, Machine]:
    """Read all machines, and name each by its file."""
    if not machines:
        raise InputError("-m", "no machine", expected="at least one machine file")
    found: dict[str, Machine] = {}
    for one in machines:
        machine, _ = machine_named(one, dialect)
        label = _UNFIT.sub("_", machine.name if isinstance(one, Machine) else PurePath(one).stem)
        if label in found:
            raise InputError(f"-m {label}", "two machines have this name", expected="files of different names")
        found[label] = machine
    return found


_UNFIT: Final = re.compile(r"[^\w.+-]|^\.+")
"""What no folder's name should have."""


def files_below(root: Path, out: str, endings: tuple[str, ...]) -> Iterator[tuple[str, int]]:
    """Names and sizes of all files of these endings below a folder, but for hidden ones and what is in `out`.

    Raises
    ------
    InputError
        Where a folder cannot be read.
    """

    def refuse(error: OSError) -> None:
        raise InputError(error.filename or os.fspath(root), "cannot be read", got=error.strerror or str(error))

    for above, folders, names in os.walk(root, onerror=refuse):
        folders[:] = sorted(
            one
            for one in folders
            if not one.startswith(HIDDEN) and os.path.realpath(os.path.join(above, one)) != out  # noqa: PTH118
        )
        for name in names:
            if name.startswith(HIDDEN) or not name.lower().endswith(endings):
                continue
            file = Path(above, name)
            try:
                found = file.stat()
            except OSError:  # a link that leads nowhere: its row says so
                yield file.relative_to(root).as_posix(), 0
                continue
            if stat.S_ISREG(found.st_mode):
                yield file.relative_to(root).as_posix(), found.st_size


def _target(out: Path, name: str, label: str, ending: str) -> Path:
    """Name the output of a program, which keeps its name, or of a path, which gets the dialect's ending."""
    file = out / label / name
    return file.with_suffix(ending) if file.suffix.lower() == PATH_ENDING else file


def _refuse_overwriting(
    root: Path, out: Path, names: Sequence[str], tasks: Sequence[BatchTask], machines: Sequence[Machine | Source]
) -> None:
    """Refuse outputs in the place of a program or a machine file."""
    base, home = os.path.realpath(root), os.path.realpath(out)
    inputs = Counter(os.path.realpath(root / name) for name in names)
    inputs.update(os.path.realpath(one) for one in machines if not isinstance(one, Machine))
    inputs.update(os.path.join(base, name) for name in names)  # noqa: PTH118
    for task in tasks:
        place = os.path.join(home, task.target.relative_to(out))  # noqa: PTH118
        if place in inputs or os.path.realpath(place) in inputs:
            raise InputError(str(task.target), "an output would overwrite an input", expected="another folder after -o")
