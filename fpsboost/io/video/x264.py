"""Parameters that make x264's output reproducible.

With AVX-512, decisions of x264 (core 165) depend on memory next to its tables, so two runs rarely make the same stream.
"""

from __future__ import annotations

import cv2

CPU_AVX_512F = 13  # OpenCV's number of the CPU feature, which has no name in Python

repeatable_parameters = ("asm=avx2",) if cv2.checkHardwareSupport(CPU_AVX_512F) else ()
"""Entries of ``x264-params`` that make the output reproducible; empty where none is needed."""
