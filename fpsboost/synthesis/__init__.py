"""Synthesis of in-between frames from two frames and the motion between them.

`Synthesizer` is the protocol. Its implementations are `MultiHypothesis` (the default), `Reproject` (the report's),
`SceneAssisted` (with a renderer's vectors), `Splat` (forward splatting, as in video coding), `Warp` (the usual backward
warp along an optical flow), `Blend` and `Nearest` (which need no motion). Each is a frozen dataclass whose fields are
its options; values out of range raise `OptionError`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from fpsboost.frame_cache import FrameCache
from fpsboost.image import Pixels
from fpsboost.layered import FrameImage
from fpsboost.motion.field import MotionField


@dataclass(frozen=True)
class FramePair:
    """Two frames and the motion between them.

    Attributes
    ----------
    image0, image1 : FrameCache
        Two frames of one size and type.
    field01, field10 : MotionField
        Motion in both directions.
    before, after : FramePair, optional
        The pairs that share its first and its last frame, without pairs of their own around them; without these,
        trajectories are linear.
    duration : float
        Of a pair before or after: the time between its frames divided by that of the pair in between.
    other_light : bool
        Of a pair before or after: whether the light changes in it or in the pair in between, so that its frames are
        not compared with those of that pair.
    """

    image0: FrameCache
    image1: FrameCache
    field01: MotionField
    field10: MotionField
    before: FramePair | None = None
    after: FramePair | None = None
    duration: float = 1
    other_light: bool = False


class InterpolatedImage(NamedTuple):
    """In-between frame, and its confidence if that was asked for."""

    image: FrameImage
    """Colours, (H, W, C), as the frames have them."""
    confidence: np.ndarray | Any = None
    """Confidence of every pixel, (H, W) float32 in [0, 1]; None if it was not asked for."""


@runtime_checkable
class Synthesizer(Protocol):
    """Protocol of synthesizers of the frames between two frames."""

    def synthesize(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[Pixels]:
        """Generate one image for every time.

        Parameters
        ----------
        frame_pair : FramePair
        times : sequence of float
            Each in (0, 1).

        Yields
        ------
        (H, W, C), dtype of the frames, or YCbCrImage where they are
            New arrays, generated one at a time, so that any number of them needs the memory of one.
        """


@runtime_checkable
class FusesHypotheses(Protocol):
    """Contract: synthesizer that knows how far each pixel can be trusted."""

    def fuse(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[InterpolatedImage]:
        """Generate one image with its confidence for every time; see `Synthesizer.synthesize`."""
