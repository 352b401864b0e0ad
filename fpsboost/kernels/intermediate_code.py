"""Code of kernels between numba and machine code, where it is shared by all kernels that call a function.

numba expects every function that it compiles to be called from Python. So it optimises each one by itself, then with
all that it calls, and makes machine code of it, although most are only linked into kernels and optimised again there.
This costs a quarter of the time that compiling takes. Here, functions are only simplified before they are linked; what
a kernel has become with all that it calls is optimised as a whole and becomes machine code.

Importing this imports numba.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from numba.core.codegen import JITCodeLibrary


class IntermediateCode(JITCodeLibrary):
    """Code of a function and of all that it calls, which is not run in this process."""

    def _optimize_functions(self, module: Any) -> None:
        """Simplify each function of a module at LLVM's first level, without which the linked code is optimised less."""
        module.data_layout = self._codegen._data_layout
        for function in module.functions:
            passes, builder = self._codegen._function_pass_manager(opt=1)
            passes.run(function, builder)

    def _optimize_final_module(self) -> None:
        """Leave the linked code as it is until it is a kernel's."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0, as for a function that is not there."""
        self._ensure_finalized()
        return 0

    def machine_code(self) -> bytes:
        """Optimise a kernel as a whole, and return its object file."""
        self._ensure_finalized()
        passes, builder = self._codegen._module_pass_manager()
        passes.run(self._final_module, builder)
        return bytes(self._codegen._tm.emit_object(self._final_module))


@contextmanager
def intermediate(codegen: Any) -> Iterator[None]:
    """Have numba make `IntermediateCode` of all functions that it compiles meanwhile; its lock must be held."""
    codegen._library_class = IntermediateCode
    codegen.set_env = lambda name, environment: None  # the address of code that is not there
    try:
        yield
    finally:
        del codegen._library_class, codegen.set_env
