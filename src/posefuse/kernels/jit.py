"""Decorators that compile kernels and their subroutines with Numba.

All compiled code of the package goes through this module, so that every kernel uses the same compiler options.
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

from posefuse.kernels.compiled_sources import require_all_sources
from posefuse.kernels.linking import DisjointSubroutineCompiler, KernelCompiler, SubroutineCompiler
from posefuse.kernels.loading import store_machine_code

F = TypeVar("F", bound=Callable[..., Any])

# Numba's rewrites replace array expressions and exceptions. Kernels contain neither, and the search for them takes a
# tenth of the compilation time. No C code calls kernels.
_OPTIONS: dict[str, Any] = {
    "nogil": True,
    "error_model": "numpy",
    "fastmath": {"contract"},
    "no_rewrites": True,
    "no_cfunc_wrapper": True,
}


def kernel(function: F) -> F:
    """Compile a kernel: cached on disk, releases the GIL, division by zero gives inf, fused multiply-add allowed."""
    compiled = numba.njit(**_OPTIONS, pipeline_class=KernelCompiler)(function)
    store_machine_code(compiled)
    require_all_sources(compiled)
    return cast("F", compiled)


def subroutine(function: F) -> F:
    """Compile a subroutine that only kernels and other subroutines can call.

    A subroutine must not allocate, because reference counting is off: atomic counts of the array arguments would cost
    more than the arithmetic (measured: a factor of four on the rows of an observation). It has no entry point from
    Python, no machine code and no cache of its own: its callers need none of them.
    """
    return _compile_subroutine(function, forceinline=False)


def vectorized(function: F) -> F:
    """Compile a subroutine whose sums may be reordered, so that the compiler can use vector instructions."""
    return _compile_subroutine(function, forceinline=False, fastmath={"contract", "reassoc"})


def disjoint(function: F) -> F:
    """Compile a subroutine whose array arguments never overlap, so that short loops over lanes become vectors.

    Before a loop over few lanes, checks for overlap would cost more than vector instructions save.
    """
    return _compile_subroutine(function, forceinline=False, pipeline_class=DisjointSubroutineCompiler)


def inline(function: F) -> F:
    """Compile a subroutine that is always inlined into its callers."""
    return _compile_subroutine(function, forceinline=True)


def _compile_subroutine(function: F, **options: Any) -> F:
    compile_function = cast("Any", numba.njit)
    minimal = {"_nrt": False, "no_cpython_wrapper": True, "pipeline_class": SubroutineCompiler}
    return cast("F", compile_function(**{**_OPTIONS, **minimal, **options})(function))
