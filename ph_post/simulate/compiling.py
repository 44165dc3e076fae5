"""How functions are compiled: those that Python calls, and those that only they call.

What is compiled is kept on disk with the function that Python calls, and made anew where the file of that one
changes: so all that such a function calls stands in its file.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compile a function that Python calls, at its first call; others may run beside it."""
    fast: Any = njit(cache=True, nogil=True, error_model="numpy")(function)
    return cast("F", fast)


def inner(function: F) -> F:
    """Compile a function that only compiled ones call.

    It gets no way in from Python: that saves a third of the time that compiling takes.
    """
    compile_bare: Any = njit  # numba's type hints leave the two options out
    return cast(
        "F", compile_bare(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)(function)
    )
