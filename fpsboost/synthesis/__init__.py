"""In-between frames from two frames and the motion between them.

One contract, `Synthesizer`, and its implementations: `MultiHypothesis` (the default), `Reproject` (the report's),
`SceneAssisted` (with a renderer's vectors), `Splat` (blocks moved, as in video coding), `Warp` (what people usually
write around an optical flow), `Blend` and `Nearest` (which need no motion).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from fpsboost.frame import Pixels
from fpsboost.frame_cache import FrameCache
from fpsboost.motion.field import MotionField
from fpsboost.motion.trajectory import Neighbour


@dataclass(frozen=True)
class FramePair:
    """Two frames and what is known of the way from one to the other.

    Attributes
    ----------
    image0, image1 : FrameCache
        Two frames of one size and type.
    field01, field10 : MotionField
        Motion in both directions.
    before, after : Neighbour, optional
        Motion of the pairs that share its first and its last frame: paths are curved by them, and straight without.
    """

    image0: FrameCache
    image1: FrameCache
    field01: MotionField
    field10: MotionField
    before: Neighbour | None = None
    after: Neighbour | None = None


class Synthesizer(Protocol):
    """Contract: what does the scene look like between two frames?"""

    def synthesize(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[Pixels]:
        """Make one image for every time.

        Parameters
        ----------
        frame_pair : FramePair
        times : sequence of float
            Each in (0, 1).

        Yields
        ------
        (H, W, C), dtype of the frames, or YCbCrImage where they are
            New arrays; made one at a time, so that any number of them needs the memory of one.
        """
        ...
