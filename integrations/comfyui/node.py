"""The node: its inputs and outputs as ComfyUI shows them, and a run of it."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any, Literal, get_args

from fpsboost import (
    Entry,
    Frame,
    Interpolator,
    MemoryLimit,
    OutputRange,
    TimelineOptions,
    Timing,
    find_method,
    methods,
    run_conversion,
)
from fpsboost.analysis.duplicates import detector_of
from fpsboost.edits import LOOP_CONTEXT
from fpsboost.io.video.capture import ArraySource
from fpsboost.options import AtCuts, Duplicates
from fpsboost.threads import available_cores

from .batch import BatchSink, Tensor, check_batch, frames_of
from .host import HostObserver, say_summary

MAX_MULTIPLIER = 16
"""The same as that of ComfyUI's own node."""

SceneCuts = AtCuts | Literal["one scene"]
"""Choices for the end of a scene; the last one does not detect it."""

ANY_RATE = Fraction(24)
"""Frames per second of a batch, which has none; images do not depend on it."""


class FrameInterpolation:
    """Node that makes the images between the images of a batch.

    n images become ``(n - 1) * multiplier + 1``, as with other nodes for the purpose: the first and the last image are
    those of the batch, and a single image stays as it is. With `loop` they become ``n * multiplier``.
    """

    CATEGORY = "image/video"
    DESCRIPTION = (
        "Makes the images between the images of a batch, by motion estimated from the images themselves: no model, no "
        "download, no GPU. n images become (n - 1) * multiplier + 1, or n * multiplier with loop."
    )
    FUNCTION = "interpolate"
    RETURN_TYPES = ("IMAGE", "MASK")
    RETURN_NAMES = ("images", "confidence")
    OUTPUT_TOOLTIPS = (
        "The images of the batch and those between them, to be played at multiplier times the rate.",
        "How far every pixel can be trusted, 0 to 1: 1 in the images of the batch, 0 where a scene ends. Invert it for "
        "a mask of what to inpaint.",
    )

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:  # noqa: N802 (ComfyUI prescribes the name)
        """Return the inputs with their types, choices, defaults and tooltips."""
        multiplier = {"default": 2, "min": 2, "max": MAX_MULTIPLIER, "tooltip": "Images out per image in."}
        method = {
            "default": "nlm",
            "tooltip": "nlm: the best. nlm-fast: nearly as good, quicker. blend: a mixture, without motion. "
            "nlm-exhaustive, nlm-brute-force and nlm-passes are slow. The others are for comparison.",
        }
        scene_cuts = {
            "default": "repeat",
            "tooltip": "Where a scene ends: repeat the nearer image, blend the two, or extrapolate the motion of each. "
            "one scene: do not look for cuts.",
        }
        duplicates = {
            "default": "interpolate",
            "tooltip": "Images that show the same as the one before. interpolate: replace them by images made for "
            "their times. keep: leave them.",
        }
        loop = {
            "default": False,
            "tooltip": "The last image leads to the first, and images are made between these two, too. Leave out a "
            "last image that repeats the first.",
        }
        return {
            "required": {
                "images": ("IMAGE", {"tooltip": "Consecutive images of one clip."}),
                "multiplier": ("INT", multiplier),
                "method": (list(methods), method),
                "scene_cuts": ([*get_args(AtCuts), "one scene"], scene_cuts),
                "duplicates": (list(get_args(Duplicates)), duplicates),
            },
            "optional": {"loop": ("BOOLEAN", loop)},  # which saved workflows may lack
        }

    def interpolate(
        self,
        images: Tensor,
        multiplier: int,
        method: str,
        scene_cuts: SceneCuts,
        duplicates: Duplicates,
        loop: bool = False,
    ) -> tuple[Tensor, Tensor]:
        """Make the images between the images of a batch, (N, H, W, C), RGB or RGBA, 0 to 1.

        With `loop`, the last image leads to the first one, as with `fpsboost.interpolate_clip`. Returns images
        (N', H, W, C) and confidence (N', H, W), float32; raises `InputError` if the result does not fit into memory.
        """
        check_batch(images)
        count, height, width, _ = images.shape
        context = LOOP_CONTEXT if loop and count > 1 else 0  # images that are read again before and after all
        total, memory = count * multiplier if context else (count - 1) * multiplier + 1, MemoryLimit()
        sink = BatchSink(images, total, memory)
        if count == 1:
            sink.write(Frame(next(frames_of(images, [0])), Fraction(0)))
            return sink.images, sink.confidence
        numbers, start = range(-context, count + context), context / ANY_RATE
        source = ArraySource(frames_of(images, (number % count for number in numbers)), ANY_RATE, "`images`")
        entry = Entry(-context, start, -context * multiplier)
        outputs = OutputRange(stop=total, entry=entry, end=start + count / ANY_RATE)
        summary = run_conversion(
            source,
            _interpolator(method, scene_cuts),
            sink,
            Timing(factor=multiplier).schedule(source.info, has_clock=False),
            HostObserver(total),
            threads=sink.memory_left.affordable_threads(width, height, available_cores()),
            outputs=outputs,
            options=TimelineOptions(duplicates=detector_of(duplicates)),
        )
        say_summary(summary)
        return sink.images, sink.confidence


def _interpolator(method: str, scene_cuts: SceneCuts) -> Interpolator:
    """Return a method with the node's options."""
    interpolator = find_method(method)
    if scene_cuts == "one scene":
        return replace(interpolator, cuts=None)
    return replace(interpolator, at_cuts=scene_cuts)
