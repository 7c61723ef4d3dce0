"""Subroutines of kernels made callable from Python for tests."""

from collections.abc import Callable
from typing import Any

import numba


def from_python(subroutine: Callable[..., Any]) -> Callable[..., Any]:
    """Return a subroutine with an entry point from Python."""

    @numba.njit(error_model="numpy")
    def entry(*arguments):
        return subroutine(*arguments)

    return entry
