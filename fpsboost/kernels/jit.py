"""Compiler options of the kernels.

The compiler may not change a finite number: sums are not reassociated, so that results do not depend on how a loop is
vectorised, and nothing is contracted (see `fpsboost.kernels.fma`). Where a sum is taken in parts, or by one
instruction, the kernel says so itself. No entry points for C are compiled, as nothing calls them. Every kernel runs in
one thread and releases Python's global interpreter lock, so that pairs of frames can be processed in parallel (see
`fpsboost.io.prefetch`).
"""

JIT = {"nogil": True, "error_model": "numpy", "fastmath": False, "no_cfunc_wrapper": True}

FINITE_JIT = {**JIT, "fastmath": {"nsz", "nnan", "ninf"}}
"""For inner loops whose values are known to be finite: minimum and maximum become single instructions.

What a NaN or an infinity would become is not defined then, nor is the sign of a zero.
"""

LANES = 16
"""Group size, pixels: rows are processed in whole groups, as a scalar remainder loop would cost as much as ten
vectors."""
