"""The one way kernels are compiled."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

from posefuse.kernels.linking import OwnCopies

F = TypeVar("F", bound=Callable[..., Any])

# Rewrites turn array expressions and exceptions into other code; kernels hold neither, and looking for them is a
# tenth of the time to compile.
_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}, "no_rewrites": True}


def kernel(function: F) -> F:
    """Compile a kernel: cached on disk, outside the GIL, division by zero gives inf, fused multiply-add allowed."""
    return cast("F", numba.njit(**_OPTIONS, cache=True, pipeline_class=OwnCopies)(function))


def step(function: F) -> F:
    """Compile a step of kernels, which can be called from kernels alone.

    It must not allocate: reference counting is off, because counting the arrays it is passed, atomically, would cost
    more than its arithmetic (measured: a factor of four on the rows of an observation). It gets no entry from Python
    and no cache of its own, which its callers do not need either: a fifth of the time to compile.
    """
    return _step(function, forceinline=False)


def dense(function: F) -> F:
    """Compile a step whose sums may be taken in any order, so that they use vector instructions."""
    return _step(function, forceinline=False, fastmath={"contract", "reassoc"})


def inline(function: F) -> F:
    """Compile a step that is always inlined into its callers."""
    return _step(function, forceinline=True)


def choice(function: F) -> F:
    """Compile an inlined step in which ``if argument is not None`` is decided, and left out, before it is compiled."""
    return _step(function, forceinline=True, no_rewrites=False)


def _step(function: F, **options: Any) -> F:
    compile_step = cast("Any", numba.njit)
    bare = {"_nrt": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    return cast("F", compile_step(**{**_OPTIONS, **bare, **options})(function))
