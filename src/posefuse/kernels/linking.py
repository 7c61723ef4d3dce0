"""A Numba compiler that gives each kernel private copies of its subroutines, so that every run executes the same code.

Numba links a copy of each function that a kernel calls into the kernel, and optimizes it there, as a *weak* symbol. If
the process already holds another definition of that symbol (the subroutine compiled separately, or the copy of another
kernel), the linker uses that one. It is the same function with different rounding, so results would depend on whether
the process compiled the kernels or loaded them, and in which order. Copies that are internal to their kernel leave the
linker no choice and give the optimizer more freedom.

The copies are also renamed. The linker keeps internal functions in the same table as the others, and would otherwise
hand a copy whose arguments the optimizer has changed to a caller of the original function.
"""

from typing import Any

from llvmlite import binding
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.typed_passes import AnnotateTypes


class PrivateCopiesCompiler(CompilerBase):
    """Numba's compiler, with all linked subroutines kept internal to their kernel."""

    def define_pipelines(self) -> list[Any]:
        """Return Numba's default passes with the library pass added before the last one."""
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(_UsePrivateLibrary, AnnotateTypes)
        passes.finalize()
        return [passes]


class _PrivateLibrary(JITCodeLibrary):
    """Machine code of a kernel that exports only the kernel itself."""

    def _optimize_final_module(self) -> None:
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == binding.Linkage.linkonce_odr:
                function.linkage = binding.Linkage.internal
                function.name = f"{self.name}.{function.name}"
        super()._optimize_final_module()


@register_pass(mutates_CFG=False, analysis_only=False)
class _UsePrivateLibrary(LoweringPass):
    """Create the private library; runs as the last pass before lowering, which uses an existing library."""

    _name = "use_private_library"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> Any:
        state.library = _PrivateLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return False
