"""Compiler options of the kernels.

Nothing is allowed that changes a number: no reordering of sums, so that results do not depend on how a loop was cut
into vectors or threads, and no contraction (see `fpsboost.kernels.fma`).
"""

import os

# A thread that waits for another must not spin: decoder, encoder and other programs want its core, and beside one of
# them spinning made frames take five to ten times as long. Acts when numba starts its threads, if nobody chose before.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

JIT = {"nogil": True, "error_model": "numpy", "fastmath": False}

FINITE_JIT = {"nogil": True, "error_model": "numpy", "fastmath": {"nsz", "nnan", "ninf"}}
"""For inner loops whose values are known to be finite: minimum and maximum become single instructions."""

LANES = 16
"""Rows are processed in whole groups of this many pixels; a scalar rest loop would cost as much as ten vectors."""
