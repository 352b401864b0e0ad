"""Guided synthesis: a cheap picture of the in-between frame itself, its guide, shows where everything is.

1. Guides of both frames show how guides are made (`guide_calibration`), how far they usually are from that, and how
   wrong motion is that is searched from them (`GuidedPair`).
2. The report's search leads from the guide to both frames, as a guide would show them; and once more, at half the size
   of the frames, from the frame that this gives.
3. The frames along this motion, the frame that is made without a guide, and that displaced to fit the guide are the
   candidates. Each pixel is their mean, weighted by how much their surroundings look like those in the guide, as
   non-local means are (Buades, Coll and Morel 2005, doi:10.1109/CVPR.2005.38), and by the errors that are expected of
   them.
4. What the guide shows beyond its usual differences is added (`guide_residual`).

Li, Li and Fu (2017) have the idea, as modified non-local means for the super-resolution of hybrid videos.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import cv2
import numpy as np

from fpsboost.frame_cache import FrameCache
from fpsboost.kernels.guided import measure_error, weigh
from fpsboost.kernels.smooth_motion import SmoothMotion, add_along
from fpsboost.layered import FrameImage, LayeredImage
from fpsboost.motion.field import MotionField
from fpsboost.motion.nlm import CoarseToFine
from fpsboost.synthesis import InterpolatedImage
from fpsboost.synthesis.guide_calibration import Calibration, Rendition, as_bytes, calibrate, resized, squared
from fpsboost.synthesis.guide_colours import Colours
from fpsboost.synthesis.guide_layers import Candidate, Fused, mixed_layers, sampled
from fpsboost.synthesis.guide_residual import EXACT, exact_difference, excess_difference, usual_power

FLOOR = 1.5
"""Difference that means nothing, levels."""

SMALL_PATCH, PATCH = 3, 5
"""Sides of the patches that are compared, pixels of the guide: of small guides, and of larger ones."""

OWN_PATCH = 7
"""The same for the frame that is made without a guide, which was not chosen to fit the guide's errors."""

AROUND = 9
"""Side of the surroundings of which the usual error is the mean, pixels of the guide."""

UNSURE_SHARE = 0.15
"""Share of the usual error by which an error may be more or less than it seems."""

NEARBY = np.ones((21, 21), np.uint8)
"""Area around damage in which the repair that is made without a guide is trusted, and in which light of the frames
limits that of the guide, pixels."""

OWN_WEIGHT = 2.0
"""Weight of the frame that is made without a guide as a multiple of that of the others, if guides have no error."""

DOUBLING_ERROR = 40.0
"""Usual error of guides at which that weight is doubled, square levels."""

MOTION_ERROR_FACTOR = 2.0
"""Error of motion from guides as a multiple of what is measured between the frames, of which no other one is near."""

EXACT_ERROR, INEXACT_ERROR = 1.0, 10.0
"""The error of motion counts by the share (q + EXACT_ERROR) / (q + INEXACT_ERROR) for the usual error q of guides,
square levels: exact guides show by themselves where motion is wrong."""

OTHER_SHADING = 0.06
"""Smallest share of the coarse contrast of guides that the frames leave unexplained where light or shading is another
one."""

OTHER_EXPOSURE = 1.0
"""Difference of the guides of both frames, beyond that of the frames, from which on each has its own exposure, levels;
it must be clear beside its deviation over the parts of the picture."""

OTHER_ERROR = 0.5
"""Largest error of the other frame's guide along the motion there, as a share of the error of the frame."""

UNSURE = 12.0
"""Difference from the guide at which confidence is 0.6, levels."""

SECOND_SEARCH = CoarseToFine(coarsest_side=30)
"""Search from the frame that is made at first, and between the two frames, all at half their size."""

LARGE_SEARCH = 1, replace(SECOND_SEARCH, step=4)
SMALL_SEARCH = 2, CoarseToFine(step=2)
"""Searches from a guide of full size and from a small one, each with its size as a multiple of the guide's."""


class GuideFindings(NamedTuple):
    """Figures on a pair of frames and its guides, of which the means tell of a whole run."""

    noise: float
    """Standard deviation of their noise, levels of 255."""
    offset_x: float
    """Offset of the guides to the right, pixels of the frames."""
    offset_y: float
    """Offset downwards."""
    other_shading: float
    """1 if light or shading is another one, else 0."""
    from_frames: float
    """Share of the pixels that agree with the guide, which come from the frames around."""


class GuidedPair:
    """Two frames, and what their guides tell of all guides between them.

    Parameters
    ----------
    image0, image1 : FrameCache
        The two frames, with their guides if there are some.
    """

    def __init__(self, image0: FrameCache, image1: FrameCache) -> None:
        self.images = image0.image, image1.image
        self.colours = Colours.of(*self.images)
        self.keys = [self.colours.values(each) for each in self.images]
        self.halves = [np.atleast_3d(cv2.pyrDown(key)) for key in self.keys]
        self.bytes = [_searched(self.colours.levels(half)) for half in self.halves]
        self.guides: list[np.ndarray] = []
        """Levels of the guides of both frames, or none."""
        self.calibration: Calibration | None = None
        self.are_exposed = False
        """Whether each guide has an exposure of its own."""
        self.is_other = False
        """Whether their light or shading is another one, so that only guides are comparable with guides."""
        self.is_damaged = image0.guide is image0.image
        """Whether frames guide their own repair, so that nothing is taken from them but where everything is."""
        self.usual = self.motion_error = np.asarray(0, np.float32)
        """Usual squared error of guides, (h, w) or a number, and that of motion from them, square levels."""
        self.usual_power: np.ndarray | None = None
        """The same band by band, beside as much detail, if it is known."""
        if image0.guide is not None and image1.guide is not None:
            self.guides = [self.colours.levels_of(each) for each in (image0.guide, image1.guide)]
            rendition = self.rendition(self.guides[0])
            self.calibration = calibrate(rendition, self.keys, self.guides, are_frames=True)
            first, second = np.split(self.calibration.usual[0], 2)
            mean, deviation = cv2.meanStdDev(cv2.resize(first - second, (8, 8), interpolation=cv2.INTER_AREA))
            self.are_exposed = bool((abs(mean) > np.maximum(OTHER_EXPOSURE, deviation / 2)).any())
            if self.are_exposed:
                self.guides = list(map(rendition.equalised, self.guides, self.keys))
                self.calibration = calibrate(rendition, self.keys, self.guides, are_frames=True, with_tone=False)
            self._measure(self.calibration)

    def rendition(self, guide: np.ndarray) -> Rendition:
        """Return how a guide shows frames, as far as only its size is known."""
        full = self.keys[0].shape[1::-1]
        return Rendition(self.colours, full, guide.shape[1::-1], in_light=self.colours.exposure is not None)

    def _measure(self, calibration: Calibration) -> None:
        """Measure how far the guides of the frames are from these, and how wrong motion from them is."""
        rendition = calibration.rendition
        motions = [_smooth(each) for each in SECOND_SEARCH.estimate(*self.bytes)]
        frames = [GuidedFrame(self, guide, calibration) for guide in self.guides]
        warped_guides = [sampled(self.guides[1 - i], motion) for i, motion in enumerate(motions)]
        self.is_other = _are_other(calibration, np.vstack(self.guides), np.vstack(warped_guides))
        if not self.is_other:
            self.usual_power = usual_power(*calibration.usual, use_median=False)
        shown = self.guides if self.is_other else [rendition.shown(key) for key in self.keys]
        errors, excess, shares = [], [], []
        for i, frame in enumerate(frames):
            ((*_, motion),) = frame.search([shown[1 - i]])
            found_error = frame.candidate(1 - i, motion, self.keys).error
            usual = np.median(found_error) if self.is_other else cv2.blur(frame.error(shown[i]), (AROUND, AROUND))
            errors.append(usual)
            # where the guide shows that motion is wrong, it is not followed
            unsure = FLOOR**2 + np.mean(usual)
            shares.append(unsure / (found_error + unsure))
            wrong, least = (frame.error_at_full_size(i, each) for each in (motion, motions[i]))
            excess.append(np.maximum(wrong - least, 0))
        self.usual = np.asarray(np.mean(errors, axis=0), np.float32)
        self.motion_error = np.asarray(MOTION_ERROR_FACTOR * np.average(excess, weights=shares), np.float32)
        if not (self.is_other and rendition.is_small):  # whose pixels do not show what is between them
            self.motion_error = self.motion_error * (self.usual + EXACT_ERROR) / (self.usual + INEXACT_ERROR)

    def follow(self, made: InterpolatedImage, picture: FrameImage, t: float) -> tuple[InterpolatedImage, GuideFindings]:
        """Return an in-between frame as its guide shows it, and what the guide tells.

        Parameters
        ----------
        made : InterpolatedImage
            The frame as it is made without a guide.
        picture : (h, w, C) uint8, uint16 or float32
            Its guide, BGR(A): of the shape of the frames, and at most of their size.
        t : float
            Its time between the two frames, in (0, 1).
        """
        guide = self.colours.levels_of(picture)
        values = self.colours.values(made.image)
        rendition = self.rendition(guide)
        if self.are_exposed:
            guide = rendition.equalised(guide, values)
        known = self.calibration or calibrate(rendition, [values], [guide], are_frames=False)
        frame = GuidedFrame(self, guide, known)
        fused = frame.fused(values)
        agreement = np.exp(fused.error * (-0.5 / UNSURE**2))
        x, y = known.rendition.offset
        findings = GuideFindings(known.noise, -x, -y, self.is_other, float(agreement.mean()))
        values = fused.values if self.is_damaged else self.colours.shifted(fused.values, frame.difference(fused))
        if self.colours.exposure is not None:  # fireflies of path tracers
            values = np.minimum(values, cv2.dilate(np.maximum.reduce([fused.values, *self.keys]), NEARBY))
        colours = self.colours.image(values, *self.images, t)
        layered = [each for each in (*self.images, made.image) if isinstance(each, LayeredImage)]
        image = LayeredImage(colours, mixed_layers(fused, known.rendition, layered)) if layered else colours
        confidence = None if made.confidence is None else known.rendition.raised(agreement)
        return InterpolatedImage(image, confidence), findings


def _are_other(calibration: Calibration, known: np.ndarray, warped_guides: np.ndarray) -> bool:
    """Return whether guides have other light or shading than frames, so that only other guides explain them."""
    smooth = partial(cv2.blur, ksize=(5, 5))
    apart = np.mean(smooth(calibration.usual[0]) ** 2)
    contrast = np.mean((smooth(known) - cv2.blur(known, (31, 31))) ** 2)
    error, error_of_frames = (
        np.median(smooth(squared(each))[::2, ::2]) for each in (warped_guides - known, calibration.usual[0])
    )
    return bool(apart > OTHER_SHADING * max(contrast, 1) and error < OTHER_ERROR * error_of_frames)


class GuidedFrame:
    """Frame that has a guide.

    Parameters
    ----------
    pair : GuidedPair
    guide : (h, w, 3) float32
        Its levels.
    calibration : Calibration
    """

    def __init__(self, pair: GuidedPair, guide: np.ndarray, calibration: Calibration) -> None:
        self.pair = pair
        self.guide = guide
        self.calibration = calibration
        self.rendition = calibration.rendition
        offset = np.divide(self.rendition.offset, self.rendition.full)
        self.layout = np.array([np.divide(1, self.rendition.size), offset], np.float32)
        """Where its pixels lie in pictures of the frame; see `fpsboost.kernels.smooth_motion`."""
        self.variance = calibration.noise**2
        self.side = SMALL_PATCH if self.rendition.is_small else PATCH

    def fused(self, made: np.ndarray) -> Fused:
        """Return the mean of all candidates."""
        pair = self.pair
        half = np.atleast_3d(cv2.pyrDown(made))
        pictures, halves = [*pair.keys, made], [*pair.halves, half]
        if pair.is_other:
            shown = pair.guides
            warped_guides = [sampled(pair.guides[i], motion) for i, motion in self._second(half)]
            candidates = [Candidate(2, None, self.error(each), each) for each in warped_guides]
        else:
            shown = [self.rendition.shown(each) for each in pictures]
            candidates = [Candidate(2, None, self.error(shown[2]), None)]
        for source, motions in enumerate(self.search(shown)):
            # the last but one has other errors, as its patches are larger
            candidates += [self.candidate(source, each, pictures) for each in motions[-1 if source == 2 else -2 :]]
        second = self._second(self._mean(candidates, halves).values)
        return self._mean(candidates + [self.candidate(*each, pictures) for each in second], pictures)

    def _second(self, half: np.ndarray) -> Iterator[tuple[int, SmoothMotion]]:
        """Yield each frame and the motion to it from a picture of half its size."""
        image = _searched(self.pair.colours.levels(half))
        for i, key in enumerate(self.pair.bytes):
            yield i, _smooth(SECOND_SEARCH.estimate_onward(image, key)[-1])

    def search(self, pictures: Sequence[np.ndarray]) -> list[list[SmoothMotion]]:
        """Return the motion from the guide to pictures that look like it, on every level from the coarsest on."""
        scale, search = SMALL_SEARCH if self.rendition.is_small else LARGE_SEARCH
        width, height = self.rendition.size
        size = scale * width, scale * height
        guide, *others = (_searched(resized(each, size, cv2.INTER_CUBIC)) for each in (self.guide, *pictures))
        return [[_smooth(field, self.layout[1]) for field in search.estimate_onward(guide, each)] for each in others]

    def candidate(self, source: int, motion: SmoothMotion, pictures: Sequence[np.ndarray]) -> Candidate:
        """Return a picture along a motion, with its difference from the guide."""
        if self.pair.is_other:
            warped_guide = sampled(self.pair.guides[source], motion)
            return Candidate(source, motion, self.error(warped_guide), warped_guide)
        return Candidate(source, motion, self.error(self.rendition.shown(sampled(pictures[source], motion))), None)

    def error(self, shown: np.ndarray) -> np.ndarray:
        """Return the squared difference from the guide around each pixel beyond that of noise, square levels."""
        error = np.empty(self.guide.shape[:2], np.float32)
        measure_error(self.guide, shown, self.side, self.variance, error)
        return error

    def error_at_full_size(self, key: int, motion: SmoothMotion) -> np.ndarray:
        """Return the squared error of the other frame along a motion around each pixel of the guide, square levels."""
        truth, picture = (
            self.pair.colours.levels(each) for each in (self.pair.keys[key], sampled(self.pair.keys[1 - key], motion))
        )
        return cv2.blur(resized(squared(picture - truth), self.rendition.size, cv2.INTER_AREA), (5, 5))

    def _mean(self, candidates: list[Candidate], pictures: Sequence[np.ndarray]) -> Fused:
        """Return the mean of candidates, weighted by the errors that are expected of them.

        The pictures that they are made of have the frames' size or another one.
        """
        pair = self.pair
        errors = np.array([each.error for each in candidates])
        shares = np.empty_like(errors)
        least = errors.min(axis=0)
        flat = np.zeros_like(least)
        trust = flat + 1
        if pair.is_damaged:  # what no frame explains is damage, and so is what lies around
            trust = np.exp(cv2.dilate(least, NEARBY) * (-0.5 / UNSURE**2))
        own_side = OWN_PATCH if np.mean(pair.usual) > EXACT_ERROR else 1
        unsure = FLOOR**2 + self.variance / self.side
        is_own = np.array([each.motion is None for each in candidates])
        around = flat + pair.usual, flat + pair.motion_error, trust
        weigh(errors, is_own, *around, own_side, unsure, UNSURE_SHARE, OWN_WEIGHT, DOUBLING_ERROR, shares)
        mix = partial(self._mixed, candidates, shares)
        return Fused(mix(pictures), least, candidates, shares, mix)

    def _mixed(self, candidates: list[Candidate], shares: np.ndarray, pictures: Sequence[np.ndarray]) -> np.ndarray:
        """Return the mean of candidates, of pictures of the frames' size or another one."""
        total = np.zeros_like(pictures[0])
        sums = np.zeros_like(total[..., :1])
        for each, share in zip(candidates, shares, strict=True):
            add_along(pictures[each.source], each.motion, share, self.layout, total, sums)
        return np.asarray(total / sums)

    def difference(self, fused: Fused) -> np.ndarray:
        """Return what the guide shows beyond what the frames do, and beyond its usual differences, levels."""
        rendition = self.rendition
        pair = self.pair
        if pair.is_other:
            warped_guides = np.array([each.warped_guide for each in fused.candidates])
            shares = fused.shares
            if (
                rendition.is_small
            ):  # whose pixels show means of weights interpolated between them: 1/8, 3/4, 1/8, nearly
                shares = np.array([cv2.GaussianBlur(each, (3, 3), 0.5) for each in shares])
            total = np.einsum("kyxc,kyx->yxc", warped_guides, shares)
            shown = total / shares.sum(axis=0)[..., np.newaxis]
        else:
            shown = rendition.shown(fused.values)
        difference = self.guide - shown
        if rendition.is_small and not (pair.is_other or pair.are_exposed):
            # without usual differences, only the better part of these can be judged
            off = np.abs(self.calibration.usual[0]).mean() if pair.guides else np.median(np.abs(difference))
            if off < EXACT:
                return exact_difference(fused.values, self.guide, np.maximum(fused.error - FLOOR**2, 0), rendition)
        usual = pair.usual_power
        if usual is None:
            usual = usual_power(difference, shown, use_median=True)
        return rendition.raised(excess_difference(difference, shown, usual), cv2.INTER_CUBIC)


def _smooth(field: MotionField, corner: Sequence[float] = (0, 0)) -> SmoothMotion:
    """Return motion that was searched in pictures of any size, which lie at an offset from the frames."""
    scale = np.divide(1, field.shape[::-1], dtype=np.float32)
    return SmoothMotion(field.vectors * scale, np.array([scale * field.spacing, corner], np.float32))


def _searched(levels: np.ndarray) -> FrameCache:
    return FrameCache(as_bytes(levels))


def describe_findings(means: Mapping[str, float]) -> str:
    """Return what was found, in words, of the means of `GuideFindings` over all frames made with a guide."""
    parts = [f"{100 * means['from_frames']:.0f} % of the pixels agree with the frames around"]
    if means["noise"] >= 3:
        parts.append(f"noise of {means['noise']:.0f} levels")
    if np.hypot(means["offset_x"], means["offset_y"]) >= 0.1:
        parts.append(f"offset ({means['offset_x']:.1f}, {means['offset_y']:.1f}) pixels")
    if means["other_shading"] >= 0.5:
        parts.append("other light or shading")
    return ", ".join(parts)
