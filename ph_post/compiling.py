"""Compile functions with numba: entry points that Python calls, and inner functions that only compiled code calls.

Compiled code is kept on disk per entry point, and made anew when anything changes that is in it: the text of its
file, numbers and functions that the file takes from others. An installation brings the code that most programs need.
What is compiled later is kept beside the installed files, or else in the user's home; where neither can be written
it is in a folder of the user's own among the temporary files, and where that fails, too, the code is compiled in
every run. Of processes that need the same code at the same time one compiles it.
"""

from __future__ import annotations

import contextlib
import enum
import hashlib
import importlib
import os
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from threading import Timer
from types import ModuleType
from typing import IO, Any, Final, TypeVar, cast

import numpy as np
from numba import config, njit
from numba.core import caching
from numba.core import event as events
from numba.core import types as kinds
from numba.np import linalg
from numpy.typing import NDArray

if sys.platform != "win32":
    import fcntl

settings: Any = config  # which has no types
index_file: Any = caching.IndexDataCacheFile  # nor has this
F = TypeVar("F", bound=Callable[..., Any])
Number = TypeVar("Number", bound=np.generic)


PATIENCE: Final = 0.7
"""Time [s] after which the user is told that the compiler is at work."""

LONGEST_WAIT: Final = 120.0
"""Time [s] for which a process waits while another one compiles the same code; then it compiles by itself."""


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
_locked: Final[set[Path]] = set()
_register: Any = events.register  # which has no types
_notice = _CompileNotice()
_register("numba:compile", _notice)


def read_only(values: NDArray[Number]) -> NDArray[Number]:
    """View an array as a compiled function takes what it only reads, whether or not others may write it.

    It is compiled anew for every combination of arrays that may be written and arrays that may not.
    """
    view = np.ascontiguousarray(values).view()
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
    compile_fast: Any = njit  # numba's type hints leave an option out
    fast: Any = compile_fast(cache=cache, nogil=True, error_model="numpy", _nrt=True)(function)
    if cache:
        _keep(fast)
    return cast("F", fast)


def _keep(fast: Any) -> None:
    """Have an entry point's code kept until what it is made of changes, found in the installation, compiled once."""
    kept, source, held = fast._cache._cache_file, Path(fast.py_func.__code__.co_filename), contextlib.ExitStack()
    installed = index_file(str(source.parent / "__pycache__"), fast._cache._impl.filename_base, None)
    load, compile_here = kept.load, fast.compile

    def find(key: Any) -> Any:
        kept._source_stamp = installed._source_stamp = _stamp(fast.py_func)
        found = load(key)
        if found is None:
            with contextlib.suppress(OSError):
                found = installed.load(key)
        return found

    def find_or_wait(key: Any) -> Any:
        found = find(key)
        if found is None:
            held.enter_context(_alone(source))
            found = find(key)
        return found

    def compile_alone(signature: Any) -> Any:
        with held:
            return compile_here(signature)

    kept.load, fast.compile = find_or_wait, compile_alone


def _stamp(function: Callable[..., Any]) -> str:
    """Return the digest of all that may be in a function's compiled code.

    Those are the text of its file, the numbers which that takes from other files, the texts and numbers of the files
    from which it takes compiled functions, and whether bounds of arrays are checked (NUMBA_BOUNDSCHECK).
    """
    texts = {__name__: Path(__file__).read_bytes()}
    facts = [repr(settings.BOUNDSCHECK)]
    _gather(function.__globals__, texts, facts)
    return hashlib.sha256(repr((sorted(texts.items()), facts)).encode()).hexdigest()


def _gather(scope: Mapping[str, Any], texts: dict[str, bytes], facts: list[str]) -> None:
    """Add a module's text and numbers, and those of the modules whose compiled functions or names it uses."""
    module = scope["__name__"]
    if module in texts:
        return
    texts[module] = Path(scope["__file__"]).read_bytes()
    for name, value in sorted(scope.items()):
        compiled_here = getattr(value, "py_func", None)
        if compiled_here is not None:
            _gather(compiled_here.__globals__, texts, facts)
        elif isinstance(value, ModuleType) and value.__name__.startswith("ph_post."):
            _gather(vars(value), texts, facts)
        elif (fact := _fact(value)) is not None:
            facts.append(f"{module}.{name}={fact}")


def _fact(value: Any) -> str | None:
    """Return what stands for a value that can be in compiled code: a number, a table or a list of named numbers."""
    if isinstance(value, np.ndarray):
        return f"{value.dtype.str}{value.shape}{hashlib.sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, enum.EnumMeta):
        members: Mapping[str, enum.Enum] = value.__members__
        return repr([(name, _fact(one.value)) for name, one in members.items()])
    if isinstance(value, tuple):
        parts = [_fact(one) for one in value]
        return None if None in parts else repr(parts)
    return repr(value) if isinstance(value, int | float | complex | bytes | np.generic | np.dtype) else None


@contextlib.contextmanager
def _alone(source: Path) -> Iterator[None]:
    """Wait until no other process compiles functions of a file, and have others wait meanwhile."""
    if source in _locked:  # by this process: a function of the file calls another one
        yield
        return
    with source.open("rb") as file:
        _notice.on_start(None)
        end = time.monotonic() + LONGEST_WAIT
        while not _lock(file) and time.monotonic() < end:
            time.sleep(0.02)
        _notice.on_end(None)
        _locked.add(source)
        try:
            yield
        finally:
            _locked.discard(source)


def _lock(file: IO[bytes]) -> bool:
    """Lock a file until it is closed, if no other process has; where files cannot be locked, nobody waits."""
    if sys.platform == "win32":
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return True
    return True


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
    return _bare(function, counts=True)


def lean(function: F) -> F:
    """Compile a function as :func:`inner` does that makes no array, and returns none: numba counts no references in it.

    To count those to arrays that it is given takes a short function longer than what it does.
    """
    return _bare(function, counts=False)


def _bare(function: F, *, counts: bool) -> F:
    compile_bare: Any = njit  # numba's type hints leave the options out
    # A function that does not say whether it counts does as the one that calls it.
    bare: Any = compile_bare(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True, _nrt=counts)(function)
    called = bare.get_call_template
    plain: Any = kinds.unliteral

    def call_template(args: Any, named: Any) -> Any:
        """Look up a call: a constant, as a loop begins with, is a number like those that follow."""
        found = called([plain(one) for one in args], {key: plain(one) for key, one in named.items()})
        if not counts:
            for made in bare.overloads.values():
                _require_no_array(function, made)
        return found

    bare.get_call_template = call_template
    return cast("F", bare)


def _require_no_array(function: Callable[..., Any], made: Any) -> None:
    """Refuse a function that counts no references, and has to: nobody would give back an array that it makes."""
    calls = made.type_annotation.calltypes.items() if made.type_annotation is not None else ()
    given = [sign.return_type for call, sign in calls if getattr(call, "op", "") == "call"]
    if any(_has_array(kind) for kind in (made.signature.return_type, *given)):
        raise TypeError(f"{function.__module__}.{function.__name__} makes or returns an array: it cannot be lean")


def _has_array(kind: Any) -> bool:
    parts: Any = kind if isinstance(kind, kinds.BaseTuple) else ()
    return isinstance(kind, kinds.Array) or any(_has_array(part) for part in parts)
