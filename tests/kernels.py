"""Steps of kernels, made callable from tests: alone they can be called from other kernels only."""

from collections.abc import Callable
from typing import Any

import numba


def from_python(step: Callable[..., Any]) -> Callable[..., Any]:
    """A step with an entry from Python."""

    @numba.njit(error_model="numpy")
    def entry(*arguments):
        return step(*arguments)

    return entry
