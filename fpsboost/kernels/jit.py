"""Compiler of the kernels, and its options.

The compiler may not change a finite number: sums are not reassociated, so that results do not depend on how a loop is
vectorised, and nothing is contracted (see `fpsboost.kernels.fma`). Where a sum is taken in parts, or by one
instruction, the kernel says so itself. No entry points for C are compiled, as nothing calls them. Every kernel runs in
one thread and releases Python's global interpreter lock, so that pairs of frames can be processed in parallel (see
`fpsboost.threads`).

What kernels use of numba they import from here, and get it from `fpsboost.kernels.deferred` and
`fpsboost.kernels.machine_code`, so that numba is only imported when something is to be compiled.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

if TYPE_CHECKING or os.environ.get("NUMBA_DISABLE_JIT", "0") != "0":
    from numba import njit, types
    from numba.core import cgutils
    from numba.extending import intrinsic, overload
else:
    from fpsboost.kernels.deferred import cgutils, intrinsic, overload, types
    from fpsboost.kernels.machine_code import njit

__all__ = ["BORROWING", "FINITE_JIT", "JIT", "LANES", "cgutils", "intrinsic", "njit", "overload", "types"]

JIT = {"nogil": True, "error_model": "numpy", "fastmath": False, "no_cfunc_wrapper": True}

FINITE_JIT = {**JIT, "fastmath": {"nsz", "nnan", "ninf"}}
"""For inner loops whose values are known to be finite: minimum and maximum become single instructions.

What a NaN or an infinity would become is not defined then, nor is the sign of a zero.
"""

BORROWING = {"_nrt": False}
"""For kernels that make no arrays, nor does what they call: references to the arrays of their callers are not counted.

Counting is most of the code of a kernel that passes many arrays on, before it is found to be superfluous.
"""

LANES = 16
"""Group size, pixels: rows are processed in whole groups, as a scalar remainder loop would cost as much as ten
vectors."""
