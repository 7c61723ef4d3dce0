"""The one way kernels are compiled."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])

_OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy", "fastmath": {"contract"}}


def kernel(function: F) -> F:
    """Compile a kernel: cached on disk, outside the GIL, division by zero gives inf, fused multiply-add allowed."""
    return cast("F", numba.njit(**_OPTIONS)(function))


def inline(function: F) -> F:
    """Compile a step of a kernel that is always inlined into its callers.

    It must not allocate: reference counting is off, because counting the arrays it is passed, atomically, would cost
    more than its arithmetic (measured: a factor of four on the rows of an observation).
    """
    return cast("F", cast("Any", numba.njit)(**_OPTIONS, forceinline=True, _nrt=False)(function))
