"""Numba compilers for kernels and their subroutines, which take half the time of Numba's own.

Numba optimizes each subroutine and translates it into machine code, and then optimizes copies of it again in its
callers and in theirs. Here a subroutine remains simplified LLVM code; a kernel links one copy of each subroutine that
it reaches, and only the whole is optimized and translated.

Numba links such copies as *weak* symbols. If the process already holds another definition of a symbol (the copy of
another kernel), the linker uses that one. It is the same function with different rounding, so results would depend on
whether the process compiled the kernels or loaded them, and in which order. Copies that are internal to their kernel
leave the linker no choice and give the optimizer more freedom. They are also renamed: the linker keeps internal
functions in the same table as the others, and would otherwise hand a copy whose arguments the optimizer has changed to
a caller of the original function.

The passes of Numba that are left out rewrite closures, ``with`` blocks and array expressions, which kernels do not
contain.
"""

import copy
import gc
from collections.abc import Iterable
from typing import Any

from llvmlite import binding
from numba import _dynfunc  # pyright: ignore[reportAttributeAccessIssue]
from numba.core import types
from numba.core.codegen import CPUCodeLibrary, JITCodeLibrary
from numba.core.compiler import CompilerBase, Flags, _LowerResult
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.typed_passes import (
    IRLegalization,
    NativeLowering,
    NoPythonBackend,
    NopythonTypeInference,
    PreLowerStripPhis,
)
from numba.core.typing.context import Context
from numba.core.untyped_passes import FixupArgs, IRProcessing, ReconstructSSA, TranslateByteCode


class _Compiler(CompilerBase):
    """Compiler with few passes."""

    library_class: type[JITCodeLibrary]
    lowering: type[NativeLowering]

    def __init__(self, typingctx: Any, *arguments: Any) -> None:
        super().__init__(typingctx, *arguments)
        self.state.flags = _ComparedFlags(self.state.flags)
        self.state.typingctx = _RememberingContext.of(typingctx, self.state.flags)

    def define_pipelines(self) -> list[Any]:
        """Create the library of machine code, and return the passes."""
        state = self.state
        state.type_annotation = ""
        state.library = self.library_class(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        passes = _Passes("kernel")
        for one in (TranslateByteCode, FixupArgs, IRProcessing, ReconstructSSA):
            passes.add_pass(one, "untyped")
        for one in (NopythonTypeInference, PreLowerStripPhis, IRLegalization, self.lowering, NoPythonBackend):
            passes.add_pass(one, "typed")
        passes.finalize()
        return [passes]

    def _compile_core(self) -> Any:
        # Compilation makes millions of objects that live until it ends; searching them for cycles takes a tenth of it.
        collects = gc.isenabled()
        gc.disable()
        try:
            return super()._compile_core()
        finally:
            if collects:
                gc.enable()


class _ComparedFlags(Flags):
    """Compiler flags that are compared fast.

    They are part of the keys of Numba's tables. Numba's own comparison reads all options, set or not, through
    properties, which takes a tenth of the compilation.
    """

    __slots__ = ()

    def __hash__(self) -> int:
        # Flags change while they are keys.
        return 0

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Flags) and self._values == other._values


class _Passes(PassManager):
    """Passes without Numba's check of its own passes after each of them."""

    _ENFORCING = False


class _RememberingContext(Context):
    """A view of Numba's typing context that remembers the signatures of operators and of Numba's functions.

    Numba tries dozens of overloads for each ``+``.
    """

    original: Any
    remembered: dict[Any, Any]
    _signatures: dict[str, dict[Any, Any]] = {}  # noqa: RUF012

    @classmethod
    def of(cls, context: Any, flags: Any) -> "_RememberingContext":
        """Return a view that shares all tables with a context; its signatures are those of the same compiler flags."""
        view = copy.copy(context)
        view.__class__ = cls
        view.original = context
        view.remembered = cls._signatures.setdefault(flags.summary(), {})
        return view

    def resolve_function_type(self, func: Any, args: Any, kws: Any) -> Any:
        """Return the signature of a call."""
        if kws or not isinstance(func, types.Function):
            return self.original.resolve_function_type(func, args, kws)
        key = func, tuple(args)
        if key not in self.remembered:
            signature = self.original.resolve_function_type(func, args, kws)
            if signature is None:
                return None
            self.remembered[key] = signature
        return self.remembered[key]


class _SimplifiedLibrary(JITCodeLibrary):
    """LLVM code that is simplified function by function."""

    def add_llvm_module(self, ll_module: Any) -> None:
        """Simplify the functions that a module defines, and add them."""
        ll_module.data_layout = self._codegen._data_layout
        manager, builder = self._codegen._function_pass_manager()
        for function in ll_module.functions:
            if not function.is_declaration:
                manager.run(function, builder)
        self._final_module.link_in(ll_module)


class _SubroutineLibrary(_SimplifiedLibrary):
    """LLVM code of a subroutine without its callees, which is never executed by itself."""

    def finalize(self) -> None:
        """Set the linkage that allows several copies."""
        self._raise_if_finalized()
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == binding.Linkage.external:
                function.linkage = binding.Linkage.linkonce_odr
        self._finalized = True

    def _get_module_for_linking(self) -> Any:
        """Return the code with that of all callees, for functions that are not kernels."""
        if self._shared_module is None:
            module = self._final_module.clone()
            for library in _callers_first(self._linking_libraries):
                module.link_in(_own_module(library), preserve=True)
            self._shared_module = module
        return self._shared_module


class _KernelLibrary(_SimplifiedLibrary):
    """Machine code of a kernel that exports only the kernel itself."""

    def finalize(self) -> None:
        """Link the subroutines, optimize, and translate into machine code."""
        for library in _callers_first(self._linking_libraries):
            self._final_module.link_in(_own_module(library), preserve=True)
        self._linking_libraries = []
        super().finalize()

    def _optimize_final_module(self) -> None:
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == binding.Linkage.linkonce_odr:
                function.linkage = binding.Linkage.internal
                function.name = f"{self.name}.{function.name}"
        super()._optimize_final_module()


def _own_module(library: CPUCodeLibrary) -> Any:
    """Return the code of a library, for subroutines without that of their callees."""
    return library._final_module if isinstance(library, _SubroutineLibrary) else library._get_module_for_linking()


def _callers_first(libraries: Iterable[CPUCodeLibrary]) -> list[CPUCodeLibrary]:
    """Return libraries and those that their subroutines call, each once, callers before callees.

    The linker drops a function that nothing calls so far.
    """
    finished: dict[CPUCodeLibrary, None] = {}

    def visit(library: CPUCodeLibrary) -> None:
        if library not in finished:
            if isinstance(library, _SubroutineLibrary):
                for callee in reversed(library._linking_libraries):
                    visit(callee)
            finished[library] = None

    for library in reversed(list(libraries)):
        visit(library)
    return list(reversed(finished))


@register_pass(mutates_CFG=True, analysis_only=False)
class _LowerSubroutine(NativeLowering):
    """Lower a subroutine without machine code."""

    _name = "lower_subroutine"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> Any:
        """Create the LLVM code, and announce the subroutine to its callers."""
        state.flags.no_compile = True
        super().run_pass(state)
        state.flags.no_compile = False
        lowered = state["cr"]
        name = lowered.fndesc.qualname.split(".")[-1]
        # The null pointer is that of the entry from Python, which a subroutine lacks.
        entry = _dynfunc.make_function(lowered.fndesc.lookup_module(), name, "", 0, lowered.env, (state.library,))
        state.targetctx.insert_user_function(entry, lowered.fndesc, [state.library])
        state["cr"] = _LowerResult(lowered.fndesc, lowered.call_helper, cfunc=entry, env=lowered.env)
        return True


class KernelCompiler(_Compiler):
    """Compiler of kernels."""

    library_class = _KernelLibrary
    lowering = NativeLowering


class SubroutineCompiler(_Compiler):
    """Compiler of subroutines."""

    library_class = _SubroutineLibrary
    lowering = _LowerSubroutine


class DisjointSubroutineCompiler(SubroutineCompiler):
    """Compiler of subroutines whose array arguments do not overlap."""

    def __init__(self, typingctx: Any, *arguments: Any) -> None:
        super().__init__(typingctx, *arguments)
        self.state.flags.noalias = True
