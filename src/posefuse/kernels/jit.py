"""The one way kernels are compiled."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])

# Rewrites turn array expressions and exceptions into other code; kernels hold neither, and looking for them is a
# tenth of the time to compile.
_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract"}, "no_rewrites": True}


def kernel(function: F) -> F:
    """Compile a kernel: cached on disk, outside the GIL, division by zero gives inf, fused multiply-add allowed."""
    return cast("F", numba.njit(**_OPTIONS, cache=True)(function))


def inline(function: F) -> F:
    """Compile a step of a kernel that is always inlined into its callers, and can be called from kernels alone.

    It must not allocate: reference counting is off, because counting the arrays it is passed, atomically, would cost
    more than its arithmetic (measured: a factor of four on the rows of an observation). It gets no entry from Python
    and no cache of its own, which its callers do not need either: a tenth of the time to compile.
    """
    compile_step = cast("Any", numba.njit)
    return cast(
        "F",
        compile_step(**_OPTIONS, forceinline=True, _nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True)(
            function
        ),
    )
