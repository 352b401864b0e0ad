"""Frame-rate conversion by non-local means motion.

Four depths, the upper a few lines over the lower:

- `convert` ``("in.mp4", "out.mp4", factor=2)``: files in, files out;
- `stream` ``(source, factor=2)``: from a path, a ``cv2.VideoCapture`` or arrays, to arrays as they are made;
- `run_conversion` ``(source, interpolator, sink, schedule)``: the same over objects;
- `Interpolator.interpolate` ``(frame0, frame1, times)``, or `interpolate` for one image: arrays in, arrays out.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fpsboost.analysis.duplicates import DuplicateDetector
    from fpsboost.analysis.scene_cuts import CutDetector
    from fpsboost.array_stream import stream
    from fpsboost.conversion import convert
    from fpsboost.errors import FpsboostError, InputError, OptionError, OutputError, SceneCutWarning
    from fpsboost.frame import ClipInfo, Frame
    from fpsboost.interpolator import Interpolator
    from fpsboost.io.video.decode_options import DecodeOptions
    from fpsboost.io.video.encoding import Encoding
    from fpsboost.method_table import interpolate, interpolate_with_confidence, methods
    from fpsboost.streaming import Summary, run_conversion
    from fpsboost.timing.schedule import ByFactor, ByRate

from fpsboost.version import __version__

__all__ = [
    "ByFactor",
    "ByRate",
    "ClipInfo",
    "CutDetector",
    "DecodeOptions",
    "DuplicateDetector",
    "Encoding",
    "FpsboostError",
    "Frame",
    "InputError",
    "Interpolator",
    "OptionError",
    "OutputError",
    "SceneCutWarning",
    "Summary",
    "__version__",
    "convert",
    "interpolate",
    "interpolate_with_confidence",
    "methods",
    "run_conversion",
    "stream",
]

_homes = {
    "ByFactor": "timing.schedule",
    "ByRate": "timing.schedule",
    "ClipInfo": "frame",
    "CutDetector": "analysis.scene_cuts",
    "DuplicateDetector": "analysis.duplicates",
    "Encoding": "io.video.encoding",
    "FpsboostError": "errors",
    "Frame": "frame",
    "InputError": "errors",
    "Interpolator": "interpolator",
    "OptionError": "errors",
    "OutputError": "errors",
    "DecodeOptions": "io.video.decode_options",
    "SceneCutWarning": "errors",
    "Summary": "streaming",
    "run_conversion": "streaming",
    "stream": "array_stream",
    "convert": "conversion",
    "interpolate": "method_table",
    "interpolate_with_confidence": "method_table",
    "methods": "method_table",
}


def __getattr__(name: str) -> Any:
    # on first use: `fpsboost --help` should not wait for OpenCV, numba and FFmpeg
    if name not in _homes:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_homes[name]}"), name)
