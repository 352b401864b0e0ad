"""Guided synthesis: a cheap picture of the in-between frame itself, its guide, shows where everything is.

1. Guides of both frames show how a guide is made (`guide_calibration`): offset, scaling, tone and noise.
2. The report's search leads from the guide to both frames, as a guide would show them; and once more, at half the size
   of the frames, from the frame that this gives.
3. The frames along this motion, the frame that is made without a guide, and that displaced to fit the guide are the
   candidates. Each pixel is their mean, weighted by how much their surroundings look like those in the guide, as
   non-local means are (Buades, Coll and Morel 2005, doi:10.1109/CVPR.2005.38).
4. What the guide shows beyond its usual differences is added (`guide_residual`).

Li, Li and Fu (2017) have the idea, as modified non-local means for the super-resolution of hybrid videos.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import cv2
import numpy as np

from fpsboost.frame_cache import FrameCache
from fpsboost.image import Image, view
from fpsboost.layered import FrameImage, LayeredImage
from fpsboost.motion.nlm import CoarseToFine
from fpsboost.synthesis import InterpolatedImage
from fpsboost.synthesis.agreement import sample
from fpsboost.synthesis.guide_calibration import Calibration, Rendition, calibrate, resized
from fpsboost.synthesis.guide_colours import WHITE, Colours
from fpsboost.synthesis.guide_layers import Candidate, Fused, mixed_layers
from fpsboost.synthesis.guide_residual import EXACT, exact_difference, excess_difference

SHARPNESS = 3
"""Power of the ratio of two errors by which their weights differ."""

FLOOR = 1.5
"""Difference that means nothing, levels."""

PATCH, NOISY_PATCH = 3, 5
"""Sides of the patches that are compared, pixels of the guide: of guides with little noise, and with more."""

OWN_WEIGHT = 2.0
"""Weight of the frame that is made without a guide, and of that displaced, as a multiple of that of the others."""

DOUBT = 40.0
"""Usual difference of guides and frames at which that weight is doubled, square levels."""

UNSURE = 12.0
"""Difference from the guide at which confidence is 0.6, levels."""

SMALL_SEARCHES = ((2.0, CoarseToFine(step=2)), (1.0, CoarseToFine(step=2)))
LARGE_SEARCHES = ((1.0, CoarseToFine(step=4)), (0.5, CoarseToFine(step=4)))
"""Searches from a small guide and from one of full size, each with its size as a multiple of the guide's."""

SECOND_SEARCH = CoarseToFine(finest_level=1)
"""Search from the frame that is made at first."""

LEAST_SIDE = 16
"""Smallest side of a picture that is searched, pixels."""


class Guide(NamedTuple):
    """Cheap picture of a frame to be made, and of the two frames between which it lies."""

    picture: FrameImage
    """(h, w, C) uint8, uint16 or float32, BGR(A): of the shape of the frames, and at most of their size."""
    picture0: FrameImage | None = None
    """The same of the first frame, if there is one."""
    picture1: FrameImage | None = None
    """The same of the second frame, if there is one."""
    is_damaged: bool = False
    """Whether it is damaged, so that nothing is taken from it but where everything is."""


class GuideFindings(NamedTuple):
    """Figures on a pair of frames and its guides, of which the means tell of a whole run."""

    calibrated: float
    """1 if the guides of both frames were there, else 0."""
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
    images = image0.image, image1.image
    colours = Colours.of(*images)
    values = [colours.values(each) for each in (*images, made.image)]
    levels = [_levels_of(colours, each) for each in (guide.picture, guide.picture0, guide.picture1) if each is not None]
    white = view(images[0]).white
    height, width = values[0].shape[:2]
    rendition = Rendition(colours, white, (width, height), levels[0].shape[1::-1], in_light=colours.is_scene_linear)
    key_guides = levels[1:] if len(levels) == 3 else []
    work = _Guided(values, levels[0], key_guides, calibrate(rendition, levels[0], key_guides, values[:2], values[2]))
    fused = work.fused(adds_detail=not guide.is_damaged)
    agreement = np.exp(fused.error * np.float32(-0.5 / UNSURE**2))
    calibration = work.calibration
    x, y = calibration.rendition.offset
    is_calibrated = float(len(key_guides) > 0)
    is_other = float(calibration.is_other)
    findings = GuideFindings(is_calibrated, calibration.noise, -x, -y, is_other, float(agreement.mean()))
    confidence = None if made.confidence is None else work.rendition.raised(agreement)
    picture = colours.image(fused.values, *images, t)
    if not isinstance(made.image, LayeredImage):
        return GuidedImage(picture, confidence, findings)
    layers = mixed_layers(fused, [each for each in (*images, made.image) if isinstance(each, LayeredImage)])
    return GuidedImage(LayeredImage(picture, layers), confidence, findings)


def _levels_of(colours: Colours, image: FrameImage) -> np.ndarray:
    """Return the levels of a guide, (h, w, 3) float32."""
    return colours.levels(colours.values(image), view(image).white)


class _Guided:
    """Frame that is made with a guide."""

    def __init__(
        self,
        values: Sequence[np.ndarray],
        guide: np.ndarray,
        key_guides: Sequence[np.ndarray],
        calibration: Calibration,
    ) -> None:
        self.keys = values[:2]
        self.made = values[2]
        self.guide = guide
        self.key_guides = key_guides
        self.calibration = calibration
        self.rendition = calibration.rendition
        self.searches = SMALL_SEARCHES if self.rendition.is_small else LARGE_SEARCHES
        self.side = NOISY_PATCH if calibration.is_noisy else PATCH
        # two guides with noise are compared if light or shading is another one
        self.variance = calibration.noise**2 * (2 if calibration.is_other else 1)
        self.usual = 0.0
        if calibration.usual is not None and not calibration.is_other:
            # differences beyond noise, such as a codec's, decide nothing either
            self.usual = float(_patch_error(calibration.usual[0], self.side, calibration.noise**2).mean())

    def fused(self, *, adds_detail: bool) -> Fused:
        """Return the mean of all candidates, with what the guide alone shows."""
        candidates = [*self._along(self._motions()), *self._own()]
        first = self._with_difference(self._mean(candidates), adds_detail=adds_detail)
        image = FrameCache(_as_bytes(self._levels(first.values)))
        motions = [
            (i, _smooth_flow(SECOND_SEARCH, image, FrameCache(_as_bytes(self._levels(key)))))
            for i, key in enumerate(self.keys)
        ]
        return self._with_difference(self._mean([*candidates, *self._along(motions)]), adds_detail=adds_detail)

    def _levels(self, values: np.ndarray) -> np.ndarray:
        return self.rendition.colours.levels(values, self.rendition.white)

    @property
    def _like(self) -> list[np.ndarray]:
        """The two frames as guides show them."""
        if self.calibration.is_other:
            return list(self.key_guides)
        return [self.rendition.shown(key) for key in self.keys]

    def _motions(self) -> list[tuple[int, np.ndarray]]:
        """Return the motion from the guide to each frame, (H, W, 2), by each search, with the number of the frame."""
        like = self._like
        return [(i, self._search(picture, *each)) for each in self.searches for i, picture in enumerate(like)]

    def _search(self, picture: np.ndarray, scale: float, search: CoarseToFine) -> np.ndarray:
        """Return the motion from the guide to a picture that looks like it, for every pixel of the frame."""
        width, height = self.rendition.size
        size = max(LEAST_SIDE, round(scale * width)), max(LEAST_SIDE, round(scale * height))
        way = cv2.INTER_CUBIC if scale > 1 else cv2.INTER_AREA
        guide, other = (FrameCache(_as_bytes(resized(each, size, way))) for each in (self.guide, picture))
        return self.rendition.motion(_smooth_flow(search, guide, other))

    def _along(self, motions: Sequence[tuple[int, np.ndarray]]) -> list[Candidate]:
        """Return the frames along motions as candidates."""
        return [self._candidate(sample(self.keys[i], flow, cv2.INTER_CUBIC), 1.0, i, flow) for i, flow in motions]

    def _candidate(self, values: np.ndarray, weight: float, source: int, flow: np.ndarray | None) -> Candidate:
        """Return a candidate with its difference from the guide."""
        if not self.calibration.is_other or flow is None:
            return Candidate(values, self._error(self.rendition.shown(values)), weight, source, flow)
        preview = sample(self.key_guides[source], self._guide_motion(flow), cv2.INTER_CUBIC)
        return Candidate(values, self._error(preview), weight, source, flow, preview)

    def _guide_motion(self, flow: np.ndarray) -> np.ndarray:
        """Return motion of the frame's pixels as that of the guide's."""
        scale = np.float32(1 / self.rendition.factor)
        return resized(flow, self.rendition.size, cv2.INTER_LINEAR) * scale

    def _error(self, shown: np.ndarray) -> np.ndarray:
        return _patch_error(shown - self.guide, self.side, self.variance)

    def _own(self) -> list[Candidate]:
        """Return the frame that is made without a guide as a candidate, and that displaced to fit the guide."""
        if self.calibration.is_other:
            return []
        weight = OWN_WEIGHT * (1 + self.usual / DOUBT)
        own = self._candidate(self.made, weight, 2, None)
        flow = self._search(self.rendition.shown(self.made), *self.searches[0])
        return [own, self._candidate(sample(self.made, flow, cv2.INTER_CUBIC), weight, 2, flow)]

    def _mean(self, candidates: list[Candidate]) -> Fused:
        """Return the mean of candidates, weighted by how well each agrees with the guide."""
        unsure = np.float32(FLOOR**2 + self.variance / self.side + self.usual)
        errors = [each.error for each in candidates]
        best = np.minimum.reduce(errors)
        total = np.zeros(self.made.shape, np.float32)
        sum_of_weights = np.zeros(self.made.shape[:2], np.float32)
        weights = []
        for each in candidates:
            share = np.float32(each.weight) * ((best + unsure) / (each.error + unsure)) ** SHARPNESS
            weights.append(self.rendition.raised(share))
            total += weights[-1][..., np.newaxis] * each.values
            sum_of_weights += weights[-1]
        return Fused(total / sum_of_weights[..., np.newaxis], best, candidates, weights)

    def _with_difference(self, fused: Fused, *, adds_detail: bool) -> Fused:
        """Add what the guide shows beyond its usual differences."""
        if not adds_detail:
            return fused
        difference = self._difference(fused)
        colours = self.rendition.colours
        return fused._replace(values=colours.shifted(fused.values, difference, self.rendition.white))

    def _difference(self, fused: Fused) -> np.ndarray:
        """Return what the guide shows beyond what the frames do, levels at full size."""
        rendition = self.rendition
        if self.calibration.is_other:
            return self._difference_of_previews(fused)
        shown = rendition.shown(fused.values)
        difference = self.guide - shown
        usual = self.calibration.usual
        off = np.abs(difference if usual is None else usual[0]).mean(axis=2)
        # without guides of the frames, only the better part can be judged
        least = np.quantile(cv2.blur(off, (3, 3)), 0.25) if usual is None else off.mean()
        is_plain = rendition.is_small and not (rendition.in_light or rendition.blur or rendition.offset != (0, 0))
        if is_plain and least < EXACT:
            error = np.maximum(fused.error - np.float32(FLOOR**2), 0)
            return exact_difference(self._levels(fused.values), self.guide, error, rendition)
        return rendition.raised(excess_difference(difference, shown, self.calibration), cv2.INTER_CUBIC)

    def _difference_of_previews(self, fused: Fused) -> np.ndarray:
        """Return the difference of the guide from those of the frames, by the local gain from their tone."""
        total = np.zeros_like(self.guide)
        sum_of_shares = np.zeros(self.guide.shape[:2], np.float32)
        for each, weight in zip(fused.candidates, fused.weights, strict=True):
            if each.preview is not None:
                share = resized(weight, self.rendition.size, cv2.INTER_AREA)
                total += share[..., np.newaxis] * each.preview
                sum_of_shares += share
        preview = total / sum_of_shares[..., np.newaxis]
        shown = replace(self.rendition, tone=None).shown(fused.values)
        blurred = partial(cv2.blur, ksize=(11, 11))
        mean, mean_shown = blurred(preview), blurred(shown)
        spread = blurred(preview * preview) - mean**2
        gain = (blurred(preview * shown) - mean * mean_shown) / (spread + np.float32(9))
        calibration = replace(self.calibration, usual=None)
        difference = gain.clip(0, 2) * excess_difference(self.guide - preview, preview, calibration)
        return self.rendition.raised(difference, cv2.INTER_CUBIC)


def _smooth_flow(search: CoarseToFine, image: FrameCache, other: FrameCache) -> np.ndarray:
    """Return the motion from an image to another one, interpolated between the vectors, (H, W, 2) float32."""
    field, _ = search.estimate(image, other)
    height, width = field.shape
    rows, columns = field.vectors.shape[:2]
    flow = cv2.resize(field.vectors, (columns * field.spacing, rows * field.spacing), interpolation=cv2.INTER_LINEAR)
    return np.ascontiguousarray(flow[:height, :width])


def _as_bytes(levels: np.ndarray) -> Image:
    return np.asarray(np.rint(levels.clip(0, WHITE)).astype(np.uint8))


def _patch_error(difference: np.ndarray, side: int, variance: float) -> np.ndarray:
    """Return the squared difference around each pixel beyond that of noise, mean of the colours, square levels."""
    squared = cv2.blur(np.mean(difference * difference, axis=2, dtype=np.float32), (side, side))
    return np.asarray(np.maximum(squared - np.float32(variance), 0))


def describe_findings(means: Mapping[str, float]) -> str:
    """Return what was found, in words, of the means of `GuideFindings` over all frames made with a guide."""
    parts = [f"{100 * means['from_frames']:.0f} % of the pixels agree with the frames around"]
    if not means["calibrated"]:
        parts.append("no guides of the frames around")
    elif means["calibrated"] < 1:
        parts.append(f"guides of the frames around {100 * means['calibrated']:.0f} % of them")
    if means["noise"] >= 3:
        parts.append(f"noise of {means['noise']:.0f} levels")
    if max(abs(means["offset_x"]), abs(means["offset_y"])) >= 0.1:
        parts.append(f"offset ({means['offset_x']:.1f}, {means['offset_y']:.1f}) pixels")
    if means["other_shading"] >= 0.5:
        parts.append("other light or shading")
    return ", ".join(parts)
