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

from collections.abc import Mapping, Sequence
from functools import cached_property, partial
from typing import NamedTuple

import cv2
import numpy as np

from fpsboost.frame_cache import FrameCache
from fpsboost.layered import FrameImage, LayeredImage
from fpsboost.motion.nlm import CoarseToFine
from fpsboost.synthesis import InterpolatedImage
from fpsboost.synthesis.agreement import sample
from fpsboost.synthesis.guide_calibration import Calibration, Rendition, as_bytes, calibrate, resized, squared
from fpsboost.synthesis.guide_colours import Colours
from fpsboost.synthesis.guide_layers import Candidate, Fused, mixed_layers
from fpsboost.synthesis.guide_residual import EXACT, exact_difference, excess_difference

SHARPNESS = 3
"""Power of the ratio of two errors by which their weights differ."""

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

SMALL_SEARCHES = ((2.0, CoarseToFine(step=2)), (1.0, CoarseToFine(step=2)))
LARGE_SEARCHES = ((1.0, CoarseToFine(step=4)), (0.5, CoarseToFine(step=4)))
"""Searches from a small guide and from one of full size, each with its size as a multiple of the guide's."""

SECOND_SEARCH = CoarseToFine(finest_level=1)
"""Search from the frame that is made at first, and between the two frames."""


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
        self.bytes = [_searched(self.colours.levels(key)) for key in self.keys]
        self.guides: list[np.ndarray] = []
        """Levels of the guides of both frames, or none."""
        self.calibration: Calibration | None = None
        self.are_exposed = False
        """Whether each guide has an exposure of its own."""
        self.is_other = False
        """Whether their light or shading is another one, so that only guides are comparable with guides."""
        self.is_damaged = image0.guide is image0.image
        """Whether frames guide their own repair, so that nothing is taken from them but where everything is."""
        self.usual = self.motion_error = np.float32(0)
        """Usual squared error of guides, (h, w) or a number, and that of motion from them, square levels."""
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
        flows = _smooth_flows(SECOND_SEARCH, *self.bytes)
        frames = [GuidedFrame(self, guide, calibration) for guide in self.guides]
        warped_guides = [
            frame.warped_guide(1 - i, flow) for i, (frame, flow) in enumerate(zip(frames, flows, strict=True))
        ]
        self.is_other = _are_other(calibration, np.vstack(self.guides), np.vstack(warped_guides))
        errors, excess, shares = [], [], []
        for i, frame in enumerate(frames):
            (flow,) = frame.search([frame.shown_keys[1 - i]], *frame.searches[0])
            found = frame.along(1 - i, flow)
            usual = (
                np.median(found.error)
                if self.is_other
                else cv2.blur(frame.error(rendition.shown(self.keys[i])), (AROUND, AROUND))
            )
            errors.append(usual)
            # where the guide shows that motion is wrong, it is not followed
            unsure = FLOOR**2 + np.mean(usual)
            shares.append(unsure / (found.error + unsure))
            ordinary = sample(self.keys[1 - i], flows[i], cv2.INTER_LINEAR)
            wrong, least = (frame.error_at_full_size(each, self.keys[i]) for each in (found.values, ordinary))
            excess.append(np.maximum(wrong - least, 0))
        self.usual = np.float32((errors[0] + errors[1]) / 2)
        self.motion_error = np.float32(MOTION_ERROR_FACTOR * np.average(excess, weights=shares))
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
        image = LayeredImage(colours, mixed_layers(fused, layered)) if layered else colours
        confidence = None if made.confidence is None else known.rendition.raised(agreement)
        return InterpolatedImage(image, confidence), findings


def _are_other(calibration: Calibration, known: np.ndarray, warped_guides: np.ndarray) -> bool:
    """Return whether guides have other light or shading than frames, so that only other guides explain them."""
    smooth = partial(cv2.blur, ksize=(5, 5))
    apart = np.mean(smooth(calibration.usual[0]) ** 2)
    contrast = np.mean((smooth(known) - cv2.blur(known, (31, 31))) ** 2)
    error, error_of_frames = (
        np.median(smooth(squared(each))) for each in (warped_guides - known, calibration.usual[0])
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
        self.searches = SMALL_SEARCHES if self.rendition.is_small else LARGE_SEARCHES
        self.variance = calibration.noise**2
        self.side = SMALL_PATCH if self.rendition.is_small else PATCH

    @cached_property
    def shown_keys(self) -> list[np.ndarray]:
        """The two frames as guides show them."""
        return self.pair.guides if self.pair.is_other else [self.rendition.shown(key) for key in self.pair.keys]

    def fused(self, made: np.ndarray) -> Fused:
        """Return the mean of all candidates."""
        flows = [pair for each in self.searches for pair in enumerate(self.search(self.shown_keys, *each))]
        candidates = [self.along(*each) for each in flows] + self._own(made)
        first = _searched(self.pair.colours.levels(self._mean(candidates).values))
        flows = [(i, _smooth_flows(SECOND_SEARCH, first, key)[0]) for i, key in enumerate(self.pair.bytes)]
        return self._mean([*candidates, *(self.along(*each) for each in flows)])

    def search(self, pictures: Sequence[np.ndarray], scale: float, search: CoarseToFine) -> list[np.ndarray]:
        """Return the motion from the guide to pictures that look like it, for every pixel of the frame."""
        width, height = self.rendition.size
        size = round(scale * width), round(scale * height)
        way = cv2.INTER_CUBIC if scale > 1 else cv2.INTER_AREA
        guide, *others = (_searched(resized(each, size, way)) for each in (self.guide, *pictures))
        to_frame = np.divide(self.rendition.full, size, dtype=np.float32)
        return [self.rendition.raised(_smooth_flows(search, guide, each)[0] * to_frame) for each in others]

    def along(self, source: int, flow: np.ndarray) -> Candidate:
        """Return a frame along a motion."""
        warped_guide = self.warped_guide(source, flow) if self.pair.is_other else None
        return self._candidate(sample(self.pair.keys[source], flow, cv2.INTER_CUBIC), source, flow, warped_guide)

    def warped_guide(self, source: int, flow: np.ndarray) -> np.ndarray:
        """Return the guide of a frame along a motion of the frame's pixels."""
        motion = resized(flow, self.rendition.size, cv2.INTER_LINEAR) / self.rendition.factor
        return sample(self.pair.guides[source], motion, cv2.INTER_CUBIC)

    def _own(self, made: np.ndarray) -> list[Candidate]:
        """Return the frame that is made without a guide, and that displaced to fit the guide, as candidates."""
        if self.pair.is_other:
            image = _searched(self.pair.colours.levels(made))
            flows = [_smooth_flows(SECOND_SEARCH, image, key)[0] for key in self.pair.bytes]
            return [self._candidate(made, 2, None, self.warped_guide(i, flow)) for i, flow in enumerate(flows)]
        (flow,) = self.search([self.rendition.shown(made)], *self.searches[0])
        moved = sample(made, flow, cv2.INTER_CUBIC)
        return [self._candidate(made, 2, None), self._candidate(moved, 2, flow)]

    def _candidate(
        self, values: np.ndarray, source: int, flow: np.ndarray | None, warped_guide: np.ndarray | None = None
    ) -> Candidate:
        """Return a candidate with its difference from the guide."""
        error = self.error(self.rendition.shown(values) if warped_guide is None else warped_guide)
        return Candidate(values, error, source, flow, warped_guide)

    def error(self, shown: np.ndarray) -> np.ndarray:
        """Return the squared difference from the guide around each pixel beyond that of noise, square levels."""
        error = cv2.blur(squared(shown - self.guide), (self.side, self.side))
        return np.asarray(np.maximum(error - self.variance, 0))

    def error_at_full_size(self, values: np.ndarray, truth: np.ndarray) -> np.ndarray:
        """Return the squared error of a picture around each pixel of the guide, square levels."""
        colours = self.pair.colours
        error = squared(colours.levels(values) - colours.levels(truth))
        return np.asarray(cv2.blur(resized(error, self.rendition.size, cv2.INTER_AREA), (5, 5)))

    def _mean(self, candidates: list[Candidate]) -> Fused:
        """Return the mean of candidates, weighted by the errors that are expected of them."""
        usual = self.pair.usual
        unsure = FLOOR**2 + self.variance / self.side + UNSURE_SHARE * usual
        best = np.minimum.reduce([each.error for each in candidates])
        trust = np.ones_like(best)
        if self.pair.is_damaged:  # what no frame explains is damage, and so is what lies around
            trust = np.exp(cv2.dilate(best, NEARBY) * (-0.5 / UNSURE**2))
        expected = [self._expected(each) * (trust if each.flow is None else 1) + unsure for each in candidates]
        least = np.minimum.reduce(expected)
        own_weight = OWN_WEIGHT * (1 + usual / DOUBLING_ERROR)
        total = np.zeros(candidates[0].values.shape, np.float32)
        weights = []
        for each, error in zip(candidates, expected, strict=True):
            share = (least / error) ** SHARPNESS * (own_weight if each.flow is None else 1)
            weights.append(self.rendition.raised(share))
            total += weights[-1][..., np.newaxis] * each.values
        return Fused(total / np.sum(weights, axis=0)[..., np.newaxis], best, candidates, weights)

    def _expected(self, candidate: Candidate) -> np.ndarray:
        """Return the error that is expected of a candidate beyond the usual one of guides, square levels."""
        usual = self.pair.usual
        error = candidate.error
        if candidate.flow is not None:
            return np.maximum(error - usual, 0) + self.pair.motion_error
        if np.mean(usual) > EXACT_ERROR:
            error = cv2.blur(error, (OWN_PATCH, OWN_PATCH))
        return np.maximum(error - usual, 0)

    def difference(self, fused: Fused) -> np.ndarray:
        """Return what the guide shows beyond what the frames do, and beyond its usual differences, levels."""
        rendition = self.rendition
        usual = self.calibration.usual if self.pair.guides else None
        if self.pair.is_other:
            shares = [resized(weight, rendition.size, cv2.INTER_AREA) for weight in fused.weights]
            warped_guides = np.array([each.warped_guide for each in fused.candidates])
            shown = np.einsum("kyxc,kyx->yxc", warped_guides, shares) / np.sum(shares, axis=0)[..., np.newaxis]
            usual = None
        else:
            shown = rendition.shown(fused.values)
        difference = self.guide - shown
        # without usual differences, only the better part of these can be judged
        off = np.quantile(np.abs(difference), 0.5) if usual is None else np.abs(usual[0]).mean()
        if rendition.is_small and off < EXACT and not (self.pair.is_other or self.pair.are_exposed):
            return exact_difference(fused.values, self.guide, np.maximum(fused.error - FLOOR**2, 0), rendition)
        return rendition.raised(excess_difference(difference, shown, usual), cv2.INTER_CUBIC)


def _smooth_flows(search: CoarseToFine, image: FrameCache, other: FrameCache) -> list[np.ndarray]:
    """Return the motion in both directions, interpolated between the vectors, each (H, W, 2) float32."""
    flows = []
    for field in search.estimate(image, other):
        height, width = field.shape
        rows, columns = field.vectors.shape[:2]
        size = columns * field.spacing, rows * field.spacing
        flow = cv2.resize(field.vectors, size, interpolation=cv2.INTER_LINEAR)
        flows.append(np.ascontiguousarray(flow[:height, :width]))
    return flows


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
