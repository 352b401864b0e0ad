"""What makes x264 repeat itself.

With AVX-512, x264 (core 165) decides by what it finds beside its tables, and hardly two runs make the same stream.
"""

from __future__ import annotations

import cv2

CPU_AVX_512F = 13  # OpenCV's number, whose name is not told to Python

repeatable_parameters = ("asm=avx2",) if cv2.checkHardwareSupport(CPU_AVX_512F) else ()
"""Of its ``x264-params``."""
