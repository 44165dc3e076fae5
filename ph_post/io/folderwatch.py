"""Which files of a folder are new, and wholly written.

A folder is looked at again and again. That needs nothing of the operating system, and so works on network
drives and memory cards too, whose files change without a word to this machine.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from typing import Final, NamedTuple

from ph_post.errors import InputError

HIDDEN: Final = (".", "~", "#")
"""How names begin that programs use while they write."""


class Look(NamedTuple):
    """What a file looks like from outside; that changes with all that is written to it or put in its place.

    `changed` is the time of the last change of its rights too: it may be readable now.
    """

    inode: int
    size: int
    modified: int
    changed: int


class Folder:
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
    ...     folder = Folder(place, lambda name: name.endswith(".ngc"), settle=2.0)
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
            raise InputError(self.name, "no such folder", expected="a folder to watch")
        self._looks()

    def look(self, name: str) -> Look | None:
        """See what a file looks like; None where there is none."""
        return _look(os.path.join(self.name, name))  # noqa: PTH118 - names as they are, also strange ones

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
            raise InputError(
                self.name, "the watched folder cannot be read", got=error.strerror or str(error)
            ) from None
        wanted = [name for name in names if not name.startswith(HIDDEN) and self._wanted(name)]
        looks = {name: self.look(name) for name in wanted}
        return {name: look for name, look in looks.items() if look is not None}


def _look(file: str) -> Look | None:
    """See what a file looks like; None for what is no file, has gone, or may not be looked at."""
    try:
        found = os.stat(file)  # noqa: PTH116 - twice a second, for every file
    except (OSError, ValueError):
        return None
    if not stat.S_ISREG(found.st_mode):
        return None
    return Look(found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns)
