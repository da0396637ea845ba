"""How numba compiles a function for its compiled callers: as code to be linked into them, with none of its own."""

from __future__ import annotations

from typing import Any

from llvmlite.binding import parse_assembly
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler

_CONSTANTS = "_ZN08NumbaEnv"  # how names of such pointers begin


class LinkedLibrary(JITCodeLibrary):
    """Code that is optimised and turned into machine code as a part of its callers only.

    numba does both for every function by itself as well, although nothing runs the outcome: a caller links the code,
    not the machine code, and optimises all of it anew.
    """

    def _optimize_final_module(self) -> None:
        """Leaves the optimisation to the callers."""

    def _finalize_final_module(self) -> None:
        """Ends linking. Of machine code there is only the pointer to the function's constants, which numba sets."""
        self._finalize_dynamic_globals()
        engine = self._codegen._engine
        pointers = [
            f'@"{variable.name}" = common global i64 0'
            for variable in self._final_module.global_variables
            if variable.name.startswith(_CONSTANTS) and not engine.is_symbol_defined(variable.name)
        ]
        header = str(self._codegen._create_empty_module(f"constants of {self.name}"))
        engine.add_module(parse_assembly("\n".join([header, *pointers])))
        engine.finalize_object()
        self._finalized = True


class LinkedCompiler(Compiler):
    """numba's compiler with a `LinkedLibrary`."""

    def define_pipelines(self) -> list[Any]:
        """Returns numba's own steps."""
        self.state.library = LinkedLibrary(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        return list(super().define_pipelines())
