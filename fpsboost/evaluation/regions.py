"""Areas where errors are expected: moving, occluded in one of the shown frames, or uncertain.

Uncertain pixels are found in neither of the shown frames. No method that is compared determines the areas, since each
would be measured where it fails. They come from the hidden frame itself, which no method sees: its motion to both shown
frames is half as long as the motion that a method has to find, and visibility is verified by the pixels. If a
renderer's vectors are given, these determine motion and occlusion.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import cv2
import numpy as np

from fpsboost.analysis.duplicates import DuplicateDetector, compared_planes
from fpsboost.evaluation.hidden_frames import Interval
from fpsboost.frame_cache import FrameCache
from fpsboost.motion.field import ends_inside
from fpsboost.motion.opencv import Dis
from fpsboost.motion.rendered import frame_number
from fpsboost.render.folder import VectorFolder
from fpsboost.synthesis.agreement import sample

MOVES = 1.0
"""Shortest motion from one shown frame to the next that counts as moving, pixels."""

CONSISTENT = 1.5
"""Largest distance between a pixel and the end of the motion there and back, pixels; beyond it, the pixel is
occluded."""

BLOCK = 7
"""Side of the blocks that are compared, pixels: large enough to average noise, and small compared with moving
objects."""

MAX_DIFFERENCE = DuplicateDetector().noise
"""Largest mean difference of a block from the same one in another frame, levels of 8 bits: as in a repeated frame."""

NOISE_FACTOR = 3.0
"""Multiple of the median difference over the frame that replaces it in noisy clips, where most pixels are visible."""

AREAS = {"moving": "still", "occluded": "visible", "uncertain": "certain"}
"""Names of the areas, each with that of its complement."""


class Regions(NamedTuple):
    """Areas of one hidden frame, each (H, W) bool."""

    moving: np.ndarray  # pixels that move by more than `MOVES` from one shown frame to the other
    occluded: np.ndarray  # pixels that only one of the shown frames has
    uncertain: np.ndarray  # pixels that neither has as they are: blur, glare, reflections, other light


def find_regions(interval: Interval, vectors: VectorFolder | None = None) -> Iterator[Regions]:
    """Yield the areas of every hidden frame of an interval, the same for every method.

    Without a renderer's vectors, motion is that of DIS between the hidden frame and each of the shown ones; methods
    that use DIS have no access to it. It is used as far as the pixels confirm it: a block is found where it is the same
    at the other end of its motion, or in its own place, and visible where its motion leads back as well. Where DIS is
    wrong, more counts as occluded or not found, for all methods alike. On two frames of `samples/scenes/texture`, whose
    occlusions are known, more than 90 % of them were marked within three pixels, and half of the marked pixels were
    occluded.

    Parameters
    ----------
    interval : Interval
        Two shown frames and the hidden ones between them.
    vectors : VectorFolder, optional
        A renderer's motion vectors.
    """
    others = interval.prepared()
    for truth in interval.prepared_truths():
        motions = [_motion(truth, other, vectors) for other in others]
        flows = [flow for flow, _ in motions]
        matches = _find(truth, others, flows)
        found = matches if vectors is None else (np.True_, np.True_)
        visible = [_leads_back(*each) & is_found for each, is_found in zip(motions, found, strict=True)]
        moving = np.linalg.norm(flows[1] - flows[0], axis=-1) > MOVES
        yield Regions(moving, visible[0] != visible[1], ~(matches[0] | matches[1]))


def _motion(here: FrameCache, there: FrameCache, vectors: VectorFolder | None) -> tuple[np.ndarray, np.ndarray]:
    """Return the motion from one frame to another and back, (H, W, 2) float32 each."""
    if vectors is None:
        field, back = Dis().estimate(here, there)
        return field.flow, back.flow
    return _rendered_motion(here, there, vectors), _rendered_motion(there, here, vectors)


def _find(truth: FrameCache, others: Sequence[FrameCache], flows: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return where the blocks of the true frame are found in each of the shown ones, (H, W) bool each."""
    here = _levels(truth)
    differences = []
    for other, flow in zip(others, flows, strict=True):
        there = _levels(other)
        moved = np.where(ends_inside(flow), _apart(here, sample(there, flow, cv2.INTER_CUBIC)), np.float32(np.inf))
        differences.append(np.minimum(moved, _apart(here, there)))
    first, second = differences
    limit = max(MAX_DIFFERENCE, NOISE_FACTOR * float(np.median(np.minimum(first, second))))
    return [first <= limit, second <= limit]


def _levels(frame: FrameCache) -> np.ndarray:
    """Return the planes of an image that are compared, (H, W, 1 to 4) float32, in levels of 8 bits."""
    return np.dstack([np.asarray(plane, np.float32) * np.float32(unit) for plane, unit in compared_planes(frame)])


def _apart(here: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Return the mean difference of the block around each pixel, (H, W), in levels of 8 bits.

    It is that of the plane where it is largest.
    """
    return np.asarray(cv2.blur(cv2.absdiff(here, there), (BLOCK, BLOCK)).reshape(here.shape).max(axis=2))


def _rendered_motion(here: FrameCache, there: FrameCache, vectors: VectorFolder) -> np.ndarray:
    """Return the motion from one frame to another along the vectors of the first, (H, W, 2) float32."""
    number = frame_number(here.output_position)
    frames = frame_number(there.output_position) - number
    rendered = vectors.for_image(number, here.array)
    return (rendered.forward if frames > 0 else rendered.backward) * np.float32(abs(frames))


def _leads_back(flow: np.ndarray, back: np.ndarray) -> np.ndarray:
    """Return where motion leads into another frame, and from there back to where it began, (H, W) bool."""
    round_trip = flow + sample(back, flow, cv2.INTER_NEAREST)
    return np.asarray((np.linalg.norm(round_trip, axis=-1) <= CONSISTENT) & ends_inside(flow))
