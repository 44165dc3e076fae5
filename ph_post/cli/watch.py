"""``ph-post convert --watch``: converts files as they arrive in a folder, for senders that call nothing."""

from __future__ import annotations

import contextlib
import os
import pathlib
import signal
import stat
import time
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

import click

from ph_post.api.inputs import read_machine
from ph_post.api.program_compensation import ProgramCompensation
from ph_post.cli import options
from ph_post.cli.conversion import conversion_lines, converted, silenced
from ph_post.cli.outputs import refuse_bad_suffix
from ph_post.dialects.declaration import is_written_here
from ph_post.dialects.registry import find_dialect
from ph_post.errors import InputError, PhPostError, is_interrupt, printable
from ph_post.files.storage import HIDDEN, JOB_ENDINGS, SourceBytes, make_folder, read_raw, write_atomically
from ph_post.progress import no_progress


class Look(NamedTuple):
    """What a file looks like from outside; that changes with all that is written to it or put in its place.

    `changed` is the time of the last change of its rights too: it may be readable now.
    """

    inode: int
    size: int
    modified: int
    changed: int


class WatchedFolder:
    """The files of a folder, and which of them have been taken.

    A file is wholly written when it has looked the same for a while. One that changes after it was taken, or
    that another was put in the place of, is taken again; one under a new name is a new file.

    Parameters
    ----------
    name : str
        The folder.
    wanted : callable
        ``wanted(name)``: whether a file of that name is looked at.
    settle : float
        How long a file has to stay as it is [s].

    Examples
    --------
    >>> import tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as place:
    ...     _ = pathlib.Path(place, "part.ngc").write_text("M2")
    ...     folder = WatchedFolder(place, lambda name: name.endswith(".ngc"), settle=2.0)
    ...     [folder.ready(now) for now in (0.0, 1.0, 2.0)]
    [[], [], ['part.ngc']]
    """

    def __init__(self, name: str, wanted: Callable[[str], bool], settle: float) -> None:
        self.name = name
        self._wanted, self._settle = wanted, settle
        self._seen: dict[str, tuple[Look, float]] = {}
        self._taken: dict[str, Look] = {}

    def ready(self, now: float) -> list[str]:
        """Look at the folder; names of files that are wholly written and not taken, oldest first.

        `now` [s] is any clock that never goes back.

        Raises
        ------
        InputError
            Where the folder is not there any more, or cannot be read.
        """
        looks = self._looks()
        self._seen = {
            name: (look, self._since(name, look, now)) for name, look in looks.items()
        }  # what has gone is forgotten, and is new when it comes back
        self._taken = {name: look for name, look in self._taken.items() if name in looks}
        found = [
            name
            for name, (look, since) in self._seen.items()
            if self._taken.get(name) != look and now - since >= self._settle
        ]
        return sorted(found, key=lambda name: (looks[name].modified, name))

    @property
    def names(self) -> list[str]:
        """Names of the files that were there at the last look, wholly written or not."""
        return sorted(self._seen)

    def require(self) -> None:
        """See that the folder is there; raises as :meth:`ready`, and takes no note of its files."""
        if not os.path.exists(self.name):  # noqa: PTH110 - as it was named
            raise InputError(self.name or "''", "no such folder", expected="a folder to watch")
        self._looks()

    def look(self, name: str) -> Look | None:
        """See what a file looks like; None where there is none."""
        return _stamp_of(os.path.join(self.name, name))  # noqa: PTH118 - names as they are, also strange ones

    def take(self, name: str, look: Look) -> None:
        """Count a file as taken, as it looked when it was read."""
        self._taken[name] = look

    def _since(self, name: str, look: Look, now: float) -> float:
        before, since = self._seen.get(name, (None, now))
        return since if before == look else now

    def _looks(self) -> dict[str, Look]:
        try:
            names = os.listdir(self.name)  # noqa: PTH208 - names alone are wanted
        except FileNotFoundError:
            raise InputError(self.name, "the watched folder is not there any more") from None
        except NotADirectoryError:
            raise InputError(self.name, "is no folder", expected="a folder to watch") from None
        except OSError as error:
            raise InputError(self.name, "the watched folder cannot be read", got=error.strerror or str(error)) from None
        wanted = [name for name in names if not name.startswith(HIDDEN) and self._wanted(name)]
        looks = {name: self.look(name) for name in wanted}
        return {name: look for name, look in looks.items() if look is not None}


def _stamp_of(file: str) -> Look | None:
    """See what a file looks like; None for what is no file, has gone, or may not be looked at."""
    try:
        found = os.stat(file)  # noqa: PTH116 - twice a second, for every file
    except (OSError, ValueError):
        return None
    if not stat.S_ISREG(found.st_mode):
        return None
    return Look(found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns)


POLL: Final = 0.5
"""Time between two looks at the folder [s]."""

_PATH: Final = ".json"

_UNFIT: Final = {
    "table": "--table",
    "in_place": "--in-place",
    "backup": "--backup",
    "undo": "--undo",
}


def watch_folder(folder: str, how: Mapping[str, Any]) -> int:
    """Convert what comes into a folder until the user, or the system, says stop.

    Parameters
    ----------
    folder : str
    how : mapping
        The options of ``convert`` by name, with `machine` and `output` or `suffix`.

    Returns
    -------
    int
        0: it was stopped by Ctrl-C or SIGTERM.

    Raises
    ------
    InputError
        Where the folder, that of the outputs or the machine file are bad, or one of the folders vanishes.
    """
    _refuse_unfit(how)
    watcher = Watcher(folder, how)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    mine = f", but not *{how['suffix']}.*" if how["suffix"] else ""
    _say(f"watching {folder} for {' '.join(JOB_ENDINGS)}{mine}; Ctrl-C stops")
    with contextlib.suppress(KeyboardInterrupt):
        while True:
            watcher.step(time.monotonic())
            time.sleep(POLL)
    _say(f"stopped; {watcher.converted} converted, {watcher.refused} refused")
    return 0


def _refuse_unfit(how: Mapping[str, Any]) -> None:
    given = [option for name, option in _UNFIT.items() if how[name]]
    if given:
        raise click.UsageError(f"{given[0]} does not go with --watch")
    options.require_machine(how["machine"])
    if (how["output"] is None) == (how["suffix"] is None):
        raise click.UsageError("--watch needs a place for the programs: -o FOLDER or --suffix END")
    if how["output"] in ("", "-"):
        raise click.UsageError(f"-o needs the name of a folder with --watch; got {how['output']!r}")
    if how["suffix"] is not None:
        refuse_bad_suffix(how["suffix"])


class Watcher:
    """Converts the files of one folder, each as often as it changes.

    Parameters
    ----------
    folder : str
    how : mapping
        As for :func:`watch_folder`.
    """

    def __init__(self, folder: str, how: Mapping[str, Any]) -> None:
        self._how = how
        self._ending = find_dialect(read_machine(how["machine"], dialect=how["dialect"]).dialect).ending
        self._suffix: str | None = how["suffix"]
        self._folder = WatchedFolder(folder, self._wanted, how["settle"])
        self._folder.require()
        self._place = pathlib.Path(folder)
        if self._suffix is None:
            self._place = make_folder(how["output"])
            if self._place.resolve() == pathlib.Path(folder).resolve():
                raise InputError(how["output"], "the watched folder itself", expected="another folder, or --suffix END")
        self._written: dict[pathlib.Path, str] = {}
        self.converted, self.refused = 0, 0

    def step(self, now: float) -> None:
        """Look at the folder once, and convert what is ready."""
        for name in self._folder.ready(now):
            self._require_place()
            look = self._folder.look(name)
            if look is not None:
                self._attempt(name, look)

    def _wanted(self, name: str) -> bool:
        """Tell inputs by their names from all else, and from what was made of them."""
        stem, ending = os.path.splitext(name)  # noqa: PTH122
        mine = self._suffix is not None and stem.endswith(self._suffix)
        return not mine and ending.lower() in JOB_ENDINGS

    def _require_place(self) -> None:
        if not self._place.is_dir():
            raise InputError(str(self._place), "the folder for the programs is not there any more")

    def _attempt(self, name: str, look: Look) -> None:
        """Convert one file, and tell how it went; whatever is wrong with it, the next has its turn."""
        try:
            self._convert(name, look)
        except click.ClickException as error:
            words = f"ph-post: {name}: {error.format_message()}"
        except PhPostError as error:
            words = f"ph-post: {error}"
        except Exception as error:
            if is_interrupt(error):
                raise KeyboardInterrupt from None
            words = f"ph-post: {name}: internal error: {type(error).__name__}: {error}"
        else:
            return
        if self._folder.look(name) != look:
            return  # it has gone, or is written to: nobody wants to know what was wrong with it meanwhile
        self._folder.take(name, look)
        self.refused += 1
        _say(" ".join(words.split()))

    def _convert(self, name: str, look: Look) -> None:
        """Convert one file, unless it changes meanwhile: then it has its turn later."""
        raw = read_raw(os.path.join(self._folder.name, name))  # noqa: PTH118
        target = self._target(name)
        if self._is_there(target, raw):
            program, lines = None, [f"{raw.name}: {target} is there already"]
        else:
            self._require_own(target, name)
            with silenced():
                result = converted(raw, self._how, no_progress)
                program, (said, *warnings) = result.program(), conversion_lines(result)
            self._require_free(target, raw, program)
            said = said if said.startswith(raw.name) else f"{raw.name}: {said}"
            lines = [f"{said}; wrote {target}", *warnings]
        if self._folder.look(name) != look:
            return
        if program is not None:
            write_atomically({str(target): program})
            self.converted += 1
        self._written[target] = name
        self._folder.take(name, look)
        for line in lines:
            _say(line)

    def _target(self, name: str) -> pathlib.Path:
        """Name the program that is made of a file."""
        stem, ending = os.path.splitext(name)  # noqa: PTH122
        ending = self._ending if ending.lower() == _PATH else ending
        return self._place / f"{stem}{self._suffix or ''}{ending}"

    def _is_there(self, target: pathlib.Path, raw: SourceBytes) -> bool:
        """Return whether the program is there from an earlier run, made of these bytes for this machine."""
        known = raw.name.endswith(_PATH) or target in self._written
        there = b"" if known or self._how["force"] else _bytes(target)
        if not is_written_here(there):
            return False
        with contextlib.suppress(PhPostError), silenced():
            result = converted(SourceBytes(name=target.name, stem="", data=there), self._how, no_progress)
            if isinstance(result, ProgramCompensation):
                return result.already_compensated and result.original.data == raw.data
        return False

    def _require_own(self, target: pathlib.Path, name: str) -> None:
        """See that no other file has its program in the same place.

        Which of them was there first nobody knows who has just begun to watch: then neither is converted.

        Raises
        ------
        InputError
            Where another has.
        """
        where, other = os.path.join(self._folder.name, name), self._written.get(target)  # noqa: PTH118
        if other not in (None, name) and self._folder.look(str(other)):
            raise InputError(where, f"its program would overwrite that of {other}", got=str(target))
        rivals = (one for one in self._folder.names if one != name and self._target(one) == target)
        if other is None and (rival := next(rivals, None)):
            raise InputError(
                where,
                f"its program and that of {rival} would be one file",
                expected="one of them under another name",
                got=str(target),
            )

    def _require_free(self, target: pathlib.Path, raw: SourceBytes, program: bytes) -> None:
        """See that nothing is lost that was not made here.

        Raises
        ------
        InputError
            Where something is in its place that somebody else wrote.
        """
        there = _bytes(target)
        known = target in self._written or there in (b"", raw.data, program) or is_written_here(there)
        if not (known or self._how["force"]):
            raise InputError(
                str(target),
                "is there already, and not written by ph-post",
                expected="that file moved away, or --force",
            )


def _bytes(place: pathlib.Path) -> bytes:
    return place.read_bytes() if place.is_file() else b""


def _say(words: str) -> None:
    click.echo(printable(" ".join(words.split("\n"))), err=True)
