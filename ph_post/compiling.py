"""Compile functions with numba: entry points that Python calls, and inner functions that only compiled code calls.

Compiled code is cached on disk per entry point, and rebuilt when the entry point's own file changes. So every
inner function stands in the file of the entry points that call it. The cache is beside the installed files, or
else in the user's home; where neither can be written it is in a folder of the user's own among the temporary
files, and where that fails, too, the code is compiled in every run.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import stat
import sys
import tempfile
from collections.abc import Callable
from threading import Timer
from typing import Any, Final, TypeVar, cast

import numpy as np
from numba import config, njit
from numba.core import event as events
from numba.core import types as kinds
from numba.np import linalg

from ph_post.types import Array

settings: Any = config  # which has no types
F = TypeVar("F", bound=Callable[..., Any])


PATIENCE: Final = 0.7
"""Time [s] after which the user is told that the compiler is at work."""


def _load_without_blas() -> None:
    """Have numba load its functions of arrays without scipy's matrices, which it does to see whether they are there.

    They are, as scipy is required; what multiplies matrices loads them by itself. That is a sixth of a start.
    """
    matrices: Any = linalg
    ensure = getattr(matrices, "ensure_blas", None)
    if ensure is None:  # another numba, which does not look
        return
    matrices.ensure_blas = lambda: None
    try:
        importlib.import_module("numba.np.arraymath")
    finally:
        matrices.ensure_blas = ensure


_load_without_blas()


class _CompileNotice(events.Listener):
    """Prints once in a process, on standard error, that code is being compiled."""

    def __init__(self) -> None:
        self._depth, self._printed = 0, False
        self._timer: Timer | None = None

    def on_start(self, event: Any) -> None:  # noqa: ARG002
        """Wait for the compiler: functions that a function calls are compiled within it."""
        self._depth += 1
        if self._depth == 1 and not self._printed:
            self._timer = Timer(PATIENCE, self._print)
            self._timer.daemon = True
            self._timer.start()

    def on_end(self, event: Any) -> None:  # noqa: ARG002
        """Compiling is done."""
        self._depth -= 1
        if self._depth == 0 and self._timer is not None:
            self._timer.cancel()

    def _print(self) -> None:
        if not self._printed:
            self._printed = True
            print(f"ph-post: compiling ({_kept.words}) ...", file=sys.stderr, flush=True)  # noqa: T201


class _CachePlace:
    """Where compiled code is kept: where numba finds a place, or else in `folder`, or nowhere."""

    def __init__(self) -> None:
        self.words = "kept for the next time"
        self.folder: str | None = None
        self.sought = False

    def seek(self) -> None:
        """Take a folder among the temporary files, as neither the installation nor a home can be written."""
        if self.sought:
            return
        self.sought = True
        self.folder = _private_folder()
        self.words = "in every run: no folder can be written that would keep the result"
        if self.folder is not None:
            self.words = f"kept in {self.folder}: neither the installation nor a home can be written"


def _private_folder() -> str | None:
    """Return a folder among the temporary files that nobody else can write to, as numba runs what it finds."""
    user = os.getuid() if hasattr(os, "getuid") else 0
    try:
        folder = os.path.join(tempfile.gettempdir(), f"ph-post-{user}")  # noqa: PTH118 - a name for numba
        with contextlib.suppress(FileExistsError):
            os.mkdir(folder, 0o700)  # noqa: PTH102
        found = os.lstat(folder)
        mine = stat.S_ISDIR(found.st_mode) and found.st_uid == user and not found.st_mode & 0o022
        return folder if mine else tempfile.mkdtemp(prefix="ph-post-")
    except OSError:
        return None


_kept = _CachePlace()
_register: Any = events.register  # which has no types
_register("numba:compile", _CompileNotice())


def read_only(values: Array) -> Array:
    """View floats as a compiled function takes what it only reads, whether or not others may write them.

    It is compiled anew for every combination of arrays that may be written and arrays that may not.
    """
    view = np.ascontiguousarray(values, dtype=np.float64).view()
    view.setflags(write=False)
    return view


def compiled(function: F) -> F:
    """Compile a function that Python calls, at its first call; others may run beside it."""
    if not _kept.sought:
        try:
            return _entry(function, cache=True)
        except RuntimeError:  # numba finds no place for the cache
            _kept.seek()
    return _in_folder(function, _kept.folder)


def _entry(function: F, *, cache: bool) -> F:
    fast: Any = njit(cache=cache, nogil=True, error_model="numpy")(function)
    return cast("F", fast)


def _in_folder(function: F, folder: str | None) -> F:
    """Cache compiled code in a folder, or not at all where there is none."""
    if folder is None:
        return _entry(function, cache=False)
    before, settings.CACHE_DIR = settings.CACHE_DIR, folder
    try:
        return _entry(function, cache=True)
    except RuntimeError:  # it was taken away, or is full
        return _entry(function, cache=False)
    finally:
        settings.CACHE_DIR = before


def inner(function: F) -> F:
    """Compile a function that only compiled ones call.

    It gets no way in from Python: that saves a third of the time that compiling takes.
    """
    compile_bare: Any = njit  # numba's type hints leave the two options out
    bare: Any = compile_bare(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)(function)
    called = bare.get_call_template
    plain: Any = kinds.unliteral

    def call_template(args: Any, named: Any) -> Any:
        """Look up a call: a constant, as a loop begins with, is a number like those that follow."""
        return called([plain(one) for one in args], {key: plain(one) for key, one in named.items()})

    bare.get_call_template = call_template
    return cast("F", bare)
