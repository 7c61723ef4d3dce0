"""Cache of compiled kernels that loads them in a fifth of the time of Numba's own.

Before Numba loads the first function, it imports its implementations of all operations, which takes 0.15 s; only
compilation needs them, and it imports them itself. With each function, Numba parses the LLVM code, of which only a
caller that is compiled later needs a copy.
"""

import pickle
from contextlib import suppress
from functools import cache
from typing import Any

from llvmlite import binding
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.runtime.nrt import rtsys

from posefuse.kernels import prebuilt
from posefuse.kernels.stores import LOCATORS, check_store, is_read_only


def store_machine_code(dispatcher: Any) -> None:
    """Store the machine code of a kernel on disk; if the compiler is switched off, do nothing."""
    if hasattr(dispatcher, "_cache"):
        with suppress(RuntimeError):  # The kernel is not in a file.
            dispatcher._cache = KernelCache(dispatcher.py_func)


class _LoadedLibrary(JITCodeLibrary):
    """Machine code of a loaded kernel."""

    llvm_code: bytes

    def _get_module_for_linking(self) -> Any:
        """Return the LLVM code, for a caller that is compiled."""
        if self._shared_module is None:
            self._shared_module = binding.parse_bitcode(self.llvm_code)
        return self._shared_module


@cache
def _no_code() -> bytes:
    """Return the stored form of LLVM code without functions."""
    return binding.parse_assembly("").as_bitcode()


class _StoredResults(CompileResultCacheImpl):
    """Conversion between results of compilation and what the cache stores."""

    _locator_classes = LOCATORS

    def reduce(self, cres: Any) -> tuple[Any, ...]:
        """Return what is stored of a result of compilation, without the environments of functions that read none.

        To load an environment imports the module of its function; Numba's own modules take longer than all kernels.
        """
        *others, environments = super().reduce(cres)
        return *others, tuple(each for each in environments if each.consts)

    def rebuild(self, target_context: Any, payload: tuple[Any, ...]) -> Any:
        """Return the result of compilation, whose LLVM code remains unparsed."""
        (name, kind, (machine_code, llvm_code)), function, *others = payload
        # Numba looks up addresses of symbols only if it has seen them in LLVM code.
        exported = function.llvm_func_name, function.llvm_cpython_wrapper_name
        target_context.codegen()._engine._defined_symbols.update(exported)
        loaded = super().rebuild(target_context, ((name, kind, (machine_code, _no_code())), function, *others))
        library = loaded.library
        library.__class__ = _LoadedLibrary
        library._shared_module = None
        library.llvm_code = llvm_code
        return loaded


class KernelCache(FunctionCache):
    """Cache of a kernel's machine code."""

    _impl_class = _StoredResults

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load the machine code for the types of arguments, or return None if it is not stored or truncated."""
        # Kernels that allocate arrays call the runtime.
        rtsys.initialize(target_context)
        try:
            with self._guard_against_spurious_io_errors():
                return self._load_prebuilt(sig, target_context) or self._load_overload(sig, target_context)
        except (pickle.UnpicklingError, EOFError):
            # An empty index lets the kernel be compiled and stored again.
            if not is_read_only(self._impl.locator):
                self.flush()
            return None

    def _load_prebuilt(self, sig: Any, target_context: Any) -> Any:
        """Load the machine code that the package contains, or return None if there is none."""
        stored = prebuilt.load(self._py_func, self._index_key(sig, target_context.codegen()))
        return None if stored is None else self._impl.rebuild(target_context, stored)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store a result of compilation, unless the folder cannot be written to."""
        if check_store(self._impl.locator):
            super().save_overload(sig, data)
