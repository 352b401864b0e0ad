"""Frame-rate conversion by non-local means motion.

Three depths, the upper a few lines over the lower:

- `convert` ``("in.mp4", "out.mp4", factor=2)``: files in, files out;
- `boost` ``(source, interpolator, sink, schedule)``: the same over objects;
- `Interpolator.interpolate` ``(frame0, frame1, times)``, or `interpolate` for one image: arrays in, arrays out.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fpsboost.errors import FpsboostError, InputError, OptionError, OutputError, SceneCutWarning
    from fpsboost.frame import ClipInfo, Frame
    from fpsboost.interpolator import Interpolator
    from fpsboost.media.video.encoding import Encoding
    from fpsboost.media.video.reading import Reading
    from fpsboost.method_table import interpolate, interpolate_with_confidence, methods
    from fpsboost.pipeline import Summary, boost, convert
    from fpsboost.scenes import CutDetector, DuplicateDetector
    from fpsboost.timing import ByFactor, ByRate

from fpsboost.version import __version__

__all__ = [
    "ByFactor",
    "ByRate",
    "ClipInfo",
    "CutDetector",
    "DuplicateDetector",
    "Encoding",
    "FpsboostError",
    "Frame",
    "InputError",
    "Interpolator",
    "OptionError",
    "OutputError",
    "Reading",
    "SceneCutWarning",
    "Summary",
    "__version__",
    "boost",
    "convert",
    "interpolate",
    "interpolate_with_confidence",
    "methods",
]

_homes = {
    "ByFactor": "timing",
    "ByRate": "timing",
    "ClipInfo": "frame",
    "CutDetector": "scenes",
    "DuplicateDetector": "scenes",
    "Encoding": "media.video.encoding",
    "FpsboostError": "errors",
    "Frame": "frame",
    "InputError": "errors",
    "Interpolator": "interpolator",
    "OptionError": "errors",
    "OutputError": "errors",
    "Reading": "media.video.reading",
    "SceneCutWarning": "errors",
    "Summary": "pipeline",
    "boost": "pipeline",
    "convert": "pipeline",
    "interpolate": "method_table",
    "interpolate_with_confidence": "method_table",
    "methods": "method_table",
}


def __getattr__(name: str) -> Any:
    # on first use: `fpsboost --help` should not wait for OpenCV, numba and FFmpeg
    if name not in _homes:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_homes[name]}"), name)
