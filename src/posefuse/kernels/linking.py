"""Kernels that call their own copies of their steps, so that every run calls the same machine code.

Numba links a copy of each function a kernel calls into the kernel, optimised with it, as a *weak* symbol. Where the
process holds another definition of that symbol already (the step compiled by itself, or another kernel's copy of it),
the linker takes that one. It is the same function with other roundings: what came out depended on whether this
process had compiled the kernels or loaded them, and in which order. Copies that are internal to their kernel leave
the linker no choice, and the optimiser more.

They get names of their own as well: the linker keeps internal functions in the same table as others, and would hand
one whose arguments the optimiser has changed to whoever asks for the function it is a copy of.
"""

from typing import Any

from llvmlite import binding
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.typed_passes import AnnotateTypes


class OwnCopies(CompilerBase):
    """Numba's compiler, with kernels that keep what is linked into them to themselves."""

    def define_pipelines(self) -> list[Any]:
        """The usual passes, and ours before the last."""
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(_TakeClosedLibrary, AnnotateTypes)
        passes.finalize()
        return [passes]


class _ClosedLibrary(JITCodeLibrary):
    """Machine code of a kernel of which only the kernel itself is seen from outside."""

    def _optimize_final_module(self) -> None:
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == binding.Linkage.linkonce_odr:
                function.linkage = binding.Linkage.internal
                function.name = f"{self.name}.{function.name}"
        super()._optimize_final_module()


@register_pass(mutates_CFG=False, analysis_only=False)
class _TakeClosedLibrary(LoweringPass):
    """The last pass before lowering, which creates a library where it finds none."""

    _name = "take_closed_library"

    def __init__(self) -> None:
        super().__init__()

    def run_pass(self, state: Any) -> Any:
        state.library = _ClosedLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return False
