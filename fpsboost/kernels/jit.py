"""Compiler options of the kernels.

A compiler may not change a finite number: sums are not reassociated, so that results do not depend on how it cut a
loop into vectors, and nothing is contracted (see `fpsboost.kernels.fma`). Where a sum is taken in parts, or by one
instruction, a kernel says so itself. Every kernel runs in one thread and lets go of Python's lock, so that pairs of
frames can be worked on side by side (see `fpsboost.io.prefetch`).
"""

JIT = {"nogil": True, "error_model": "numpy", "fastmath": False}

FINITE_JIT = {"nogil": True, "error_model": "numpy", "fastmath": {"nsz", "nnan", "ninf"}}
"""For inner loops whose values are known to be finite: minimum and maximum become single instructions.

What a NaN or an infinity would become is not defined then, nor is the sign of a zero.
"""

LANES = 16
"""Rows are processed in whole groups of this many pixels; a scalar rest loop would cost as much as ten vectors."""
