"""What kernels are compiled for, and where the compiled ones are kept."""

from __future__ import annotations

from pathlib import Path

from llvmlite import binding

from fpsboost.kernels.machine_code import KeptKernel, folder

FEATURES = ("fma", "avx2", "avx512f", "neon")
"""Instructions that make kernels fast: fused multiply-add, and vectors of 8, 16 and 4 numbers."""


def processor() -> tuple[str, list[str]]:
    """Return LLVM's name of the processor, and which of `FEATURES` it has."""
    present = binding.get_host_cpu_features()
    return binding.get_host_cpu_name(), [name for name in FEATURES if present.get(name)]


def cache_folder() -> Path:
    """Return the folder of the compiled kernels."""
    from fpsboost.kernels.block import match_blocks  # noqa: PLC0415 (raises where nothing can be kept)

    kept_in = folder()
    return kept_in if isinstance(match_blocks, KeptKernel) and kept_in else Path(match_blocks.stats.cache_path)
