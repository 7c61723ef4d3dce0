"""A kernel calls private copies of its subroutines, whatever else the process has compiled."""

import numba
import numpy as np
import pytest

from posefuse.kernels.jit import kernel, subroutine


@subroutine
def _divide(value):
    return value / 3.0


@subroutine
def _third(values, k):
    return _divide(values[k]) + values[k - 1]


@kernel
def _total(values):
    total = 0.0
    for k in range(1, len(values)):
        total += _third(values, k)
    return total


@kernel
def _total_of_a_copy(values):
    return _total(values.copy())


@pytest.mark.parametrize("compiled", [_total, _total_of_a_copy])
def test_kernel_exports_only_itself(compiled):
    assert compiled(np.arange(5.0)) == pytest.approx(10.0 / 3.0 + 6.0)
    (overload,) = compiled.overloads.values()
    functions = overload.library._get_module_for_linking().functions
    seen = {
        function.name for function in functions if not function.is_declaration and function.linkage.name != "internal"
    }
    assert seen == {overload.fndesc.llvm_func_name, overload.fndesc.llvm_cpython_wrapper_name}


def test_plain_function_uses_the_original_subroutine():
    """It does not use the copy of a kernel, whose arguments the optimizer may have changed."""

    @numba.njit
    def plain(values):
        return _third(values, 2) + _third(values, 3)

    values = np.arange(5.0)
    assert _total(values) > 0.0
    assert plain(values) == pytest.approx(2.0 / 3.0 + 1.0 + 1.0 + 2.0)
