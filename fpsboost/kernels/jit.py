"""Compiler options of the kernels.

Nothing is allowed that changes a number: no reordering of sums, so that results do not depend on how a loop was cut
into vectors, and no contraction (see `fpsboost.kernels.fma`). Every kernel runs in one thread and lets go of Python's
lock, so that pairs of frames can be worked on side by side (see `fpsboost.io.prefetch`).
"""

JIT = {"nogil": True, "error_model": "numpy", "fastmath": False}

FINITE_JIT = {"nogil": True, "error_model": "numpy", "fastmath": {"nsz", "nnan", "ninf"}}
"""For inner loops whose values are known to be finite: minimum and maximum become single instructions."""

LANES = 16
"""Rows are processed in whole groups of this many pixels; a scalar rest loop would cost as much as ten vectors."""
