"""Arguments as users write them: what is taken, which mypy checks here too, and one sentence for what is not."""

from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

import fpsboost
from fpsboost import (
    ByFactor,
    ByRate,
    CutDetector,
    DecodeOptions,
    DuplicateDetector,
    Encoding,
    FrameCache,
    MergeOptions,
    PlanOptions,
    Position,
    RunOptions,
    SideOutputs,
    Target,
    Timing,
    Trim,
    convert,
    interpolate,
    interpolate_with_confidence,
    methods,
    stream,
)
from fpsboost.analysis.scene_cuts import CutList
from fpsboost.motion.block import BlockMatching
from fpsboost.motion.nlm import CoarseToFine
from fpsboost.motion.opencv import Dis, Farneback, TvL1
from fpsboost.synthesis.multi_hypothesis import MultiHypothesis
from fpsboost.synthesis.scene_assisted import SceneAssisted
from fpsboost.synthesis.warp import Splat

NOISE = np.random.default_rng(1).integers(0, 256, (48, 64, 3), dtype=np.uint8)

TAKEN: list[Callable[[], object]] = [
    lambda: convert(Path("in"), method="blend"),
    lambda: convert("in", Path("out.mkv"), input_fps=23.976, fps=59.94, overwrite=True, method="blend"),
    lambda: convert("in", "out", factor="5/2", start="0f", end="3f", limit="8G", threads=1, method=methods["blend"]),
    lambda: convert("in", "o.mp4", input_fps="24", crf=30, preset="ultrafast", method="blend"),
    lambda: convert("in", "o", timing=Timing(factor=2.5), encoding=Encoding(), run=RunOptions(), method="blend"),
    lambda: convert("in", "o", timing=Timing("3"), side=SideOutputs(Path("confidence/")), method="blend"),
    lambda: list(stream(Path("in"), factor=2, method="blend")),
    lambda: list(stream([NOISE] * 3, fps=59.94, input_fps=Fraction(30000, 1001), method="blend")),
    lambda: list(stream(np.stack([NOISE] * 3), fps="60", input_fps=24, method="blend")),
    lambda: interpolate(NOISE, np.asfortranarray(NOISE), Fraction(1, 3), method="nlm"),
    lambda: interpolate(NOISE[:, ::2], NOISE[:, ::2], 0.25, method="blend"),
    lambda: interpolate(NOISE[..., 0], NOISE[..., 0], method="blend"),
    lambda: methods["blend"].interpolate(NOISE, NOISE, (0, 0.5, Fraction(1))),
    lambda: untyped.methods["blend"].interpolate(NOISE, NOISE, np.linspace(0, 1, 3)),
    lambda: interpolate(TENSOR, TENSOR, method="dis"),
    lambda: convert("in", "o", fps=Decimal("59.94"), input_fps=24, start=0.1 / 3, end=Fraction(1, 7), method="blend"),
    lambda: convert("in", "o", trim=Trim(Position(Fraction(1), is_frame=True)), end="3f", method="blend"),
    lambda: untyped.ByFactor(2.5),
    lambda: untyped.Position(90.1),
    lambda: [untyped.Encoding(streams=streams) for streams in ([1, 2], range(2), {1, 2}, np.arange(2))],
    lambda: Target.parse(Path("o.mp4")),
]
"""Calls that work, with names, rates, numbers and arrays of every kind; images lie in the folder ``in``."""

TENSOR: Any = type("Tensor", (), {"__array__": lambda self, *_, **__: NOISE, "shape": NOISE.shape})()
"""Image of another library."""

UNTYPED_CUTS: Any = CutList
VECTORS: Any = SimpleNamespace(step=1, remarks=[], has=len, for_image=len)

untyped: Any = fpsboost
"""The library, for calls that mypy refuses."""

REFUSED: dict[str, Callable[[], object]] = {
    "`input` must be text or a path, not None": lambda: untyped.convert(None),
    "`output` must be text or a path, not 5": lambda: untyped.convert("in", 5),
    "`fps` must be a number or text, not (60,)": lambda: convert("in", fps=[60]),
    "`fps` must be above 0 and at most 100000, not 0": lambda: convert("in", fps=0),
    "`fps` 'fast' is not a number": lambda: convert("in", fps="fast"),
    "`fps` is given twice": lambda: convert("in", fps=60, timing=Timing(fps=50)),
    "convert takes no fbs; did you mean 'fps'?": lambda: convert("in", fbs=60),
    "convert takes no magic_lamp; choose one of method, mask, timing, decoding, encoding, run, factor, fps, ": (
        lambda: convert("in", magic_lamp=1)
    ),
    ", overwrite, in_place, resume, limit, threads, chunk, observer, progress, cancel, watcher, side, ": (
        lambda: convert("in", magic_lamp=1)
    ),
    "convert takes no progres; did you mean 'progress'?": lambda: convert("in", progres=print),
    "`observer` must be an Observer with ready and wrote, not namespace(": (
        lambda: convert("in", observer=SimpleNamespace(opened=print))
    ),
    "`watcher` must be a FrameWatcher with watch, not namespace(": lambda: convert("in", watcher=SimpleNamespace()),
    "`cancel` must be a function, not True": lambda: convert("in", cancel=True),
    "`overwrite` must be True or False, not 'yes'": lambda: convert("in", overwrite="yes"),
    "`crf` must be a whole number, not 18.5": lambda: convert("in", crf=18.5),
    "`start` 'soon' is not a position in a clip": lambda: convert("in", start="soon"),
    "`timing` must be a Timing, not 60": lambda: untyped.convert("in", timing=60),
    "`method` must be text or an Interpolator, not None": lambda: untyped.convert("in", method=None),
    "magic'; choose one of nlm, nlm-fast, ": lambda: interpolate(NOISE, NOISE, method="magic"),
    "`at_cuts` must be one of repeat, blend, extrapolate": lambda: untyped.Interpolator(Dis(), Splat(), at_cuts="fade"),
    "`source` must be text or a path or a VideoCapture or a sequence, not 5": lambda: untyped.stream(5),
    "must have the shape": lambda: list(untyped.stream([5, NOISE])),
    "`threads` must be at least 1": lambda: stream("in", threads=0),
    "`frame0` must be an array, not [1, 2]": lambda: untyped.interpolate([1, 2], NOISE),
    "`t` must be a number, not 'half'": lambda: untyped.interpolate(NOISE, NOISE, "half"),
    "frame1 must have the shape": lambda: interpolate(NOISE, NOISE[:, :0]),
    "frame0 must be uint8, uint16 or float32, not float64": lambda: interpolate(NOISE / 1, NOISE / 1),
    "must be alike": lambda: interpolate(NOISE, NOISE[:20]),
    "frame0 must have the shape (height, width, 1 to 4), not (48, 64)": lambda: interpolate(NOISE[..., 0], NOISE),
    "image0 must be uint8, uint16 or float32, not float64": lambda: methods["dis"].interpolate(NOISE / 1, NOISE, []),
    "above 0 and below 1, not at 0": lambda: interpolate_with_confidence(NOISE, NOISE, 0),
    "above 0 and below 1, not at 1": lambda: interpolate_with_confidence(NOISE, NOISE, 1),
    "above 0 and below 1, not at -0.5": lambda: interpolate_with_confidence(NOISE, NOISE, -0.5),
    "above 0 and below 1, not at nan": lambda: interpolate_with_confidence(NOISE, NOISE, float("nan")),
    "the other 64x40, 3 channels, 8-bit": lambda: interpolate_with_confidence(NOISE, NOISE[:40]),
    "`cuts` must be a CutPolicy": lambda: untyped.interpolate(NOISE, NOISE, cuts=0.5),
    "`times` must be a sequence, each item a number, not 0.5": lambda: untyped.methods["blend"].interpolate(
        NOISE, NOISE, 0.5
    ),
    "`times` must be a sequence, each item a number, not ['half']": lambda: untyped.methods["blend"].interpolate(
        NOISE, NOISE, ["half"]
    ),
    "`source` must be a FrameSource": lambda: untyped.run_conversion("in", methods["blend"], None, None),
    "`parts` must be text or a path or a sequence": lambda: untyped.join("out.mp4", None),
    "`info` must be a ClipInfo": lambda: untyped.open_sink("out.mp4", None),
    "`job` must be a ConversionJob": lambda: untyped.convert_job("in"),
    "`streams` must be a sequence, each item a whole number, not ('a',)": lambda: untyped.Encoding(streams=["a"]),
    "`value` must be a fraction, not '1:30'": lambda: untyped.Position("1:30"),
    "`duration` must be above 0": lambda: methods["blend"].pair(FrameCache(NOISE), FrameCache(NOISE), 0),
    "`image` must be an array or": lambda: untyped.FrameCache([NOISE]),
    "`vectors` must be a RenderedVectors": lambda: untyped.find_method("nlm", vectors="folder"),
    "`positions` must be a sequence, each item a Position, not (5,)": lambda: UNTYPED_CUTS([5]),
    "`path` must be text or a path, not None": lambda: untyped.Target.parse(None),
    "`ranges` must be a sequence": lambda: untyped.Replacement(5),
    "`text` must be text or a path, not 5": lambda: untyped.Replacement.parse(5),
    "`seconds` must be a number": lambda: untyped.format_time("1:30"),
    "`options` must be a MergeOptions": lambda: untyped.merge_regions("a", "b", "c", None),
}
"""Calls that end in a sentence of the library, which names the argument."""


@pytest.mark.parametrize("call", TAKEN)
def test_what_is_taken(call: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It works, and gives something."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in").mkdir()
    for number in range(4):
        cv2.imwrite(f"in/{number}.png", np.roll(NOISE, number, axis=1))
    assert call() is not None


@pytest.mark.parametrize("sentence", REFUSED)
def test_what_is_refused(sentence: str) -> None:
    """At the door, in one sentence that names the argument."""
    with pytest.raises(fpsboost.FpsboostError) as error:
        REFUSED[sentence]()
    assert sentence in str(error.value)


@pytest.mark.parametrize(
    ("kind", "option", "values"),
    [
        (ByFactor, "factor", [0, -1, Fraction(-1, 2), 1001, 2000.5, "2"]),
        (lambda **rate: ByRate(*rate.values()), "fps", [0, -1, Fraction(-1, 2), 100_001, 59.94]),
        (Timing, "factor", [0, -1, "-1/2", 1001]),
        (Timing, "fps", [0, -1, "-1/2", 100_001]),
        (Timing, "slow_motion_sound", ["loud"]),
        (DecodeOptions, "input_fps", [0, -24, Fraction(1, 10**12)]),
        (DecodeOptions, "stream", [-1, "1"]),
        (DecodeOptions, "size_change", ["crop"]),
        (Encoding, "bitrate", [10, 3_000_000_000]),
        (PlanOptions, "tile", [0]),
        (PlanOptions, "factor", [1]),
        (PlanOptions, "budget", [0.0, 1.2]),
        (MergeOptions, "feather", [-1]),
        (CutDetector, "threshold", [-0.1, 1.1, float("nan"), "high"]),
        *((DuplicateDetector, name, [-1]) for name in ("noise", "block", "most", "longest")),
        (DuplicateDetector, "share", [1]),
        (DuplicateDetector, "smallest_step", [0]),
        (MultiHypothesis, "step", [0]),
        (MultiHypothesis, "node_spacing", [0, 12, 18, 22, 32]),
        (MultiHypothesis, "merge_distance", [-0.1]),
        (MultiHypothesis, "max_candidates", [0]),
        (MultiHypothesis, "min_weight", [1]),
        (MultiHypothesis, "bandwidth", [0, float("nan")]),
        (Splat, "least_similarity", [-0.1, 1.1, float("nan")]),
        (partial(SceneAssisted, VECTORS), "depth_tolerance", [-0.1, 1]),
        (CoarseToFine, "step", [3, "8"]),
        (CoarseToFine, "max_motion_share", [0.0, 1.5]),
        (CoarseToFine, "patch_radius", [0, 11, 2.5, "5"]),
        (CoarseToFine, "v", [-1.0]),
        (CoarseToFine, "labels", [0]),
        (CoarseToFine, "smoothness", [-0.1]),
        (CoarseToFine, "coarsest_side", [0]),
        (CoarseToFine, "finest_level", [-1]),
        (CoarseToFine, "steepness", [0.0]),
        (Dis, "preset", ["slow"]),
        *((Farneback, name, [0]) for name in ("levels", "window_size", "iterations")),
        *((TvL1, name, [0]) for name in ("levels", "warps", "inner_iterations", "outer_iterations", "epsilon")),
        (TvL1, "scale_step", [1.0]),
        (BlockMatching, "block_size", [1, 129]),
        (BlockMatching, "search_range", [0, 1001]),
        (BlockMatching, "pattern", ["spiral"]),
    ],
)
def test_options_out_of_range_are_refused(kind: Any, option: str, values: list[Any]) -> None:
    """When the object is made, by the option's name."""
    for value in values:
        with pytest.raises(fpsboost.OptionError, match=f"^`{option}` must be"):
            kind(**{option: value})
