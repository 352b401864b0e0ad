"""Guided synthesis: a cheap picture of the in-between frame itself, its guide, shows where everything is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import cv2
import numpy as np

from fpsboost.frame_cache import FrameCache
from fpsboost.image import Image, view
from fpsboost.layered import FrameImage
from fpsboost.synthesis import InterpolatedImage


class Guide(NamedTuple):
    """Cheap picture of a frame to be made, and of the two frames between which it lies."""

    picture: Image
    """(h, w, C) uint8, uint16 or float32, BGR(A): of the shape of the frames, and at most of their size."""
    picture0: Image | None = None
    """The same of the first frame, if there is one."""
    picture1: Image | None = None
    """The same of the second frame, if there is one."""

    @classmethod
    def of(cls, picture: FrameImage, picture0: FrameImage | None, picture1: FrameImage | None) -> Guide:
        """Return the guide of images as their sources give them, on the scale on which frames are compared."""
        first, second = (None if each is None else _compared(each) for each in (picture0, picture1))
        return cls(_compared(picture), first, second)


def _compared(image: FrameImage) -> Image:
    """Return the BGR(A) values of an image as frames are compared."""
    return view(view(image).compared).to_bgr()


class GuideFindings(NamedTuple):
    """Figures on a pair of frames and its guides, of which the means tell of a whole run."""

    calibrated: float
    """1 if the guides of both frames were there, else 0."""


class GuidedImage(NamedTuple):
    """In-between frame made with its guide."""

    image: FrameImage
    """As an `InterpolatedImage` has it."""
    confidence: np.ndarray | None
    """Confidence of every pixel, (H, W) float32 in [0, 1]; None if the frame came without."""
    findings: GuideFindings


def follow_guide(
    image0: FrameCache, image1: FrameCache, made: InterpolatedImage, guide: Guide, t: float
) -> GuidedImage:
    """Return an in-between frame as its guide shows it.

    Parameters
    ----------
    image0, image1 : FrameCache
        The two frames around it.
    made : InterpolatedImage
        The frame as it is made without a guide.
    guide : Guide
    t : float
        Its time between the two frames, in (0, 1).
    """
    findings = GuideFindings(float(guide.picture0 is not None and guide.picture1 is not None))
    shown = made.image
    if not isinstance(shown, np.ndarray):
        return GuidedImage(shown, made.confidence, findings)
    height, width, _ = shown.shape
    picture = cv2.resize(guide.picture, (width, height)).reshape(height, width, -1)
    if picture.shape != shown.shape or picture.dtype != shown.dtype:
        return GuidedImage(shown, made.confidence, findings)
    mixed = cv2.addWeighted(shown, 0.5, picture, 0.5, 0).reshape(shown.shape)
    return GuidedImage(mixed, made.confidence, findings)


def describe_findings(means: Mapping[str, float]) -> str:
    """Return what was found, in words, of the means of `GuideFindings` over all frames made with a guide."""
    return f"guides of the frames around {100 * means['calibrated']:.0f} % of them"
