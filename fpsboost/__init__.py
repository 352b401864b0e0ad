"""Frame-rate conversion by non-local means motion.

Four levels of interface, each built on the one below:

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
    from fpsboost.analysis.scene_cuts import CutDetector, CutPolicy
    from fpsboost.colour import Coding
    from fpsboost.contracts import (
        Entry,
        FrameSink,
        FrameSource,
        FrameWatcher,
        LowestMatch,
        Observer,
        OutputRange,
        SourceMoment,
        Summary,
    )
    from fpsboost.conversion import convert, convert_job, stream
    from fpsboost.errors import FpsboostError, InputError, OptionError, OutputError, SceneCutWarning
    from fpsboost.frame import ClipInfo, Frame, PairMotion
    from fpsboost.frame_cache import FrameCache, SourcePosition
    from fpsboost.image import YCbCrImage
    from fpsboost.interpolator import Interpolator, with_neighbours
    from fpsboost.io.opening import Target, open_sink
    from fpsboost.io.side.options import SideOutputs
    from fpsboost.io.video.decode_options import DecodeOptions
    from fpsboost.io.video.encode_options import Encoding
    from fpsboost.kernels.compiling import told_of_compiling
    from fpsboost.layered import Layer, LayeredImage
    from fpsboost.memory import MemoryLimit
    from fpsboost.method_table import find_method, interpolate, interpolate_with_confidence, methods
    from fpsboost.motion import MotionEstimator
    from fpsboost.motion.rendered import RenderedVectors
    from fpsboost.pair import Pair
    from fpsboost.parts.join import join
    from fpsboost.preparation import ConversionJob
    from fpsboost.render.folder import VectorFolder
    from fpsboost.rerender.frame_choice import FrameChoice, choose_frames
    from fpsboost.rerender.merging import MergeSummary, merge_regions
    from fpsboost.rerender.options import MergeOptions, PlanOptions, RenderBudget
    from fpsboost.rerender.planning import PlannedFrame, RerenderPlan, plan_rerender
    from fpsboost.rerender.regions import Rectangle
    from fpsboost.run_options import Part, RunOptions
    from fpsboost.streaming import run_conversion
    from fpsboost.synthesis import InterpolatedImage, Synthesizer
    from fpsboost.timing.position import Position, Trim, format_time
    from fpsboost.timing.rate import FrameIntervals, OutputRate
    from fpsboost.timing.schedule import ByFactor, ByRate, Schedule

from fpsboost.version import __version__

__all__ = ["__version__"]
__all__ += ["ByFactor", "ByRate", "FrameIntervals", "OutputRate", "Position", "Schedule", "Trim", "format_time"]
__all__ += ["ClipInfo", "Coding", "Frame", "FrameCache", "Layer", "LayeredImage", "PairMotion", "SourcePosition"]
__all__ += ["ConversionJob", "MemoryLimit", "Part", "RunOptions", "convert", "convert_job", "join", "run_conversion"]
__all__ += ["CutDetector", "CutPolicy", "DuplicateDetector", "InterpolatedImage", "Interpolator", "MotionEstimator"]
__all__ += ["DecodeOptions", "Encoding", "SideOutputs", "Target", "VectorFolder", "YCbCrImage", "open_sink", "stream"]
__all__ += ["Entry", "FrameSink", "FrameSource", "FrameWatcher", "LowestMatch", "Observer", "OutputRange"]
__all__ += ["FpsboostError", "InputError", "OptionError", "OutputError", "SceneCutWarning", "SourceMoment", "Summary"]
__all__ += ["FrameChoice", "MergeOptions", "MergeSummary", "PlanOptions", "PlannedFrame", "Rectangle", "RenderBudget"]
__all__ += ["Pair", "RenderedVectors", "Synthesizer", "find_method", "interpolate", "interpolate_with_confidence"]
__all__ += ["RerenderPlan", "choose_frames", "merge_regions", "plan_rerender"]
__all__ += ["methods", "told_of_compiling", "with_neighbours"]

_modules = {
    "analysis.duplicates": "DuplicateDetector",
    "analysis.scene_cuts": "CutDetector CutPolicy",
    "colour": "Coding",
    "contracts": "Entry FrameSink FrameSource FrameWatcher LowestMatch Observer OutputRange SourceMoment Summary",
    "conversion": "convert convert_job stream",
    "errors": "FpsboostError InputError OptionError OutputError SceneCutWarning",
    "frame": "ClipInfo Frame PairMotion",
    "frame_cache": "FrameCache SourcePosition",
    "image": "YCbCrImage",
    "interpolator": "Interpolator with_neighbours",
    "memory": "MemoryLimit",
    "io.side.options": "SideOutputs",
    "io.opening": "Target open_sink",
    "render.folder": "VectorFolder",
    "io.video.decode_options": "DecodeOptions",
    "io.video.encode_options": "Encoding",
    "kernels.compiling": "told_of_compiling",
    "layered": "Layer LayeredImage",
    "method_table": "find_method interpolate interpolate_with_confidence methods",
    "motion": "MotionEstimator",
    "motion.rendered": "RenderedVectors",
    "pair": "Pair",
    "parts.join": "join",
    "preparation": "ConversionJob",
    "rerender.frame_choice": "FrameChoice choose_frames",
    "rerender.merging": "MergeSummary merge_regions",
    "rerender.options": "MergeOptions PlanOptions RenderBudget",
    "rerender.planning": "PlannedFrame RerenderPlan plan_rerender",
    "rerender.regions": "Rectangle",
    "run_options": "Part RunOptions",
    "streaming": "run_conversion",
    "synthesis": "InterpolatedImage Synthesizer",
    "timing.position": "Position Trim format_time",
    "timing.rate": "FrameIntervals OutputRate",
    "timing.schedule": "ByFactor ByRate Schedule",
}

_homes = {name: module for module, names in _modules.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    # on first use: `fpsboost --help` should not wait for OpenCV, numba and FFmpeg
    if name not in _homes:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_homes[name]}"), name)
