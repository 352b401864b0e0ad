"""The default synthesis: the mean over the candidate motions of every pixel, weighted by patch similarity at time t.

Steps (`docs/method.md` derives them):

1. The motion at each point of both frames is a vote for the nodes near which it lands at time t
   (`fpsboost.kernels.candidates`). Similar votes are merged into candidates; those with few votes are dropped.
2. Around each node, a window of the in-between frame is sampled in both frames along every candidate, and the
   candidates are weighted by the similarity of the samples, or by features with learnt coefficients
   (`fpsboost.kernels.multi_hypothesis`).
3. Overlapping windows are added, as in overlapped block motion compensation.
4. If a renderer's vectors are given, the image along them is one more hypothesis (`rendered_hypothesis`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Literal, NamedTuple

import numpy as np

from fpsboost.colour import has_alpha, normalised, premultiplied
from fpsboost.errors import OptionError
from fpsboost.frame_cache import FrameCache
from fpsboost.image import Image, Pixels, as_image, colour_unseen, rounding_offset, view
from fpsboost.kernels.candidates import Candidates, Votes, collect_candidates, list_candidates, no_votes
from fpsboost.kernels.constants import CONFIDENCE_POWER, VALUES_PER_MOTION
from fpsboost.kernels.multi_hypothesis import (
    Blended,
    ValueRange,
    Weighting,
    blend_hypotheses,
    find_dominant_motion,
    window_shape,
)
from fpsboost.kernels.pair_context import PairContext
from fpsboost.kernels.window_samples import PlaneGroup
from fpsboost.layered import LayeredImage
from fpsboost.motion.rendered import RenderedVectors
from fpsboost.options import Checked, PositiveFloat, PositiveInt, Range
from fpsboost.synthesis import FramePair, InterpolatedImage
from fpsboost.synthesis.fusion_table import fusion_coefficients
from fpsboost.synthesis.layers import Mixed, Planes, Sources, find_sources, mix_layers
from fpsboost.synthesis.pair_context import context_at, find_context
from fpsboost.synthesis.rendered_hypothesis import SurfaceMotion, find_surface_motion
from fpsboost.synthesis.spline_samples import sharp_and_smooth_samples, spline_samples
from fpsboost.synthesis.votes import collect_votes

Fusion = Literal["learnt", "plain"]
"""Weighting of candidates: by learnt coefficients of many features, or by votes and similarity alone."""

CANDIDATE_CAPACITY = 48
"""Maximum number of distinct motions collected per node."""

ZERO_MOTION_PRIOR = 0.25
"""Votes for zero motion."""

ACCELERATION_TOLERANCE = 20.0
"""Standard deviation of a candidate's accelerations at which their mean is given half its weight, pixels."""

MIN_SHARE = 0.01
"""Added to a candidate's share of the votes, so that one with hardly any votes is not excluded."""


class BlendInput(NamedTuple):
    """Time between the frames of a pair, and what an in-between frame is made of there."""

    pair: FramePair
    t: float
    """Time of the in-between frame, in (0, 1)."""
    full: PlaneGroup
    """Planes of both frames at full resolution."""
    weighting: Weighting
    """Parameters by which candidates are weighed in images of this type."""
    candidates: Candidates
    """Candidate motions of every node."""
    context: PairContext | None
    """Context that the learnt weights read; None for plain weights."""


class _Surfaces(NamedTuple):
    """In-between image along a renderer's motion, and its share in the result."""

    motion: SurfaceMotion
    """Motion of the surfaces to both frames."""
    mixed: np.ndarray
    """Its planes, with 1 for white, (C, H, W) float32."""
    share: np.ndarray
    """Its weight against the mixture of all other candidates, (H, W) float32."""
    confidence: np.ndarray
    """Confidence of the two together, (H, W) float32."""


@dataclass(frozen=True)
class MultiHypothesis(Checked):
    """Weighted mean over the motions of both frames that pass each node at time t.

    Parameters
    ----------
    step : int
        Distance along x and y between the pixels of each frame whose motion is a candidate, pixels.
    node_spacing : int
        Distance between nodes, 16, 20, 24 or 28 pixels: the farther apart, the faster, as the windows of 32 pixels
        around them overlap less.
    support_radius : float
        Maximum distance between a node and the landing position of a motion that votes for it, pixels; the weight
        decreases with distance.
    merge_distance : float
        Motions that differ by less are merged, pixels.
    max_candidates : int
        Maximum number of candidates per node, besides zero motion.
    min_weight : float
        Minimum weight of a candidate relative to that of the best one.
    bandwidth : float
        Bandwidth v of the similarity at time t, for colours in [0, 1]. Learnt coefficients were trained at the default.
    sharpness : float
        Sharpness of the weighting: the weight of a candidate is ``exp(sharpness * similarity)``. Learnt coefficients
        were trained at the default and replace this weight; there, it only decides how firmly neighbours believe in
        the motion that matches best, and when further candidates are skipped.
    sufficient_similarity : float
        Similarity from which on a node needs no further candidates.
    min_vote_share : float
        A candidate is skipped if its votes are below this share of the least accumulated weight of any pixel.
    fusion : {'learnt', 'plain'}
        Weigh candidates by votes and similarity alone, or by features with coefficients trained on synthetic scenes.
    vectors : RenderedVectors or None
        A renderer's motion vectors; if given, the motion of the surfaces is one more hypothesis of every pixel, see
        `fpsboost.synthesis.rendered_hypothesis`.

    Raises
    ------
    OptionError
        An option is out of range, or the support radius is smaller than the distance between nodes.

    References
    ----------
    M. T. Orchard and G. J. Sullivan, Overlapped Block Motion Compensation: An Estimation-Theoretic Approach, IEEE
    Transactions on Image Processing 1994, doi:10.1109/83.334974: windows that overlap.

    M. Unser, A. Aldroubi and M. Eden, B-Spline Signal Processing, IEEE Transactions on Signal Processing 1993,
    doi:10.1109/78.193220, and T. Blu, P. Thevenaz and M. Unser, MOMS: Maximal-Order Interpolation of Minimal Support,
    IEEE Transactions on Image Processing 2001, doi:10.1109/83.931101: the samples between pixels.

    Examples
    --------
    >>> from fpsboost import FrameCache
    >>> from fpsboost.motion.nlm import CoarseToFine
    >>> noise = np.random.default_rng(1).integers(0, 256, (96, 128, 3), dtype=np.uint8)
    >>> image0, image1 = FrameCache(noise), FrameCache(np.roll(noise, 4, axis=1))
    >>> pair = FramePair(image0, image1, *CoarseToFine().estimate(image0, image1))
    >>> (middle,) = MultiHypothesis().synthesize(pair, [0.5])
    >>> int(np.abs(middle[32:64, 32:96].astype(int) - np.roll(noise, 2, axis=1)[32:64, 32:96]).max())
    0
    """

    step: Annotated[int, Range(1, unit=" pixel")] = 8
    node_spacing: Literal[16, 20, 24, 28] = 16
    support_radius: float = 24
    merge_distance: Annotated[float, Range(0, unit=" pixels")] = 1.2
    max_candidates: PositiveInt = 12
    min_weight: Annotated[float, Range(0, below=1)] = 0.04
    bandwidth: PositiveFloat = 0.3
    sharpness: float = 18
    sufficient_similarity: float = 0.98
    min_vote_share: Annotated[float, Range(0, below=1)] = 0.5
    fusion: Fusion = "plain"
    vectors: RenderedVectors | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.support_radius >= self.node_spacing:
            raise OptionError(
                f"support_radius must be at least {self.node_spacing} pixels, or motions are lost, "
                f"not {self.support_radius}."
            )

    @property
    def takes_planes(self) -> bool:
        """Whether frames may be `YCbCrImage`: not with vectors, whose image is made of BGR."""
        return self.vectors is None

    @property
    def needs_every_frame(self) -> bool:
        """Whether no frame may be left out; vectors lead only to the next frame."""
        return self.vectors is not None

    def without_vectors(self) -> MultiHypothesis:
        """Return the same synthesis of the images alone."""
        return replace(self, vectors=None)

    def synthesize(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[Pixels]:
        """Generate one image for every time; see `fpsboost.synthesis.Synthesizer.synthesize`."""
        for inputs in self._blend_inputs(frame_pair, times):
            yield view(self._fused(inputs, with_confidence=False).image).picture

    def fuse(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[InterpolatedImage]:
        """Generate the images of `synthesize` with the confidence of every pixel."""
        for inputs in self._blend_inputs(frame_pair, times):
            yield self._fused(inputs, with_confidence=True)

    def _fused(self, inputs: BlendInput, *, with_confidence: bool) -> InterpolatedImage:
        """Mix the candidates, and with that the image along the renderer's motion, by the agreement of the frames."""
        if self.vectors is None:
            image, confidence = self._mixed(inputs, with_confidence=with_confidence)
            self._limit_highlights(image, inputs, None)
            return InterpolatedImage(image, confidence)
        image, confidence = self._mixed(inputs, with_confidence=True)
        surfaces = self._find_surfaces(confidence, inputs, self.vectors)
        image0 = inputs.pair.image0
        image1 = inputs.pair.image1
        colours = premultiplied(view(image).array())
        along = (surfaces.mixed * view(image0.pixels).white).clip(*_value_range(image0, image1))
        colours += surfaces.share[..., np.newaxis] * (along.transpose(1, 2, 0) - colours)
        self._limit_highlights(colours, inputs, surfaces)
        return InterpolatedImage(as_image(colours, image0.array, image1.array, inputs.t), surfaces.confidence)

    def _find_surfaces(self, confidence: np.ndarray, inputs: BlendInput, vectors: RenderedVectors) -> _Surfaces:
        """Follow the renderer's motion, and weigh it against the mixture of the candidates with its confidence."""
        image0 = inputs.pair.image0
        motion = find_surface_motion(image0, inputs.pair.image1, inputs.t, vectors)
        mixed, squared = motion.mix(inputs.full.frame0.coefficients, inputs.full.frame1.coefficients)
        agreement = motion.similarity(squared, 0.5 / self.bandwidth**2 * view(image0.pixels).gray_weight)
        similarity = confidence ** np.float32(1 / CONFIDENCE_POWER)
        weight = np.where(agreement > 0, np.exp(np.float32(self.sharpness) * (agreement - similarity)), np.float32(0))
        share = weight / (1 + weight)
        similarity += share * (agreement - similarity)
        return _Surfaces(motion, mixed, share, similarity ** np.float32(CONFIDENCE_POWER))

    def synthesize_layers(
        self, frame_pair: FramePair, layered: tuple[LayeredImage, LayeredImage], times: Sequence[float]
    ) -> Iterator[LayeredImage]:
        """Generate images with all layers; see `fpsboost.synthesis.layers.MixesLayers`."""
        for inputs in self._blend_inputs(frame_pair, times):
            surfaces = None
            if self.vectors is not None:
                _, confidence = self._mixed(inputs, with_confidence=True)
                surfaces = self._find_surfaces(confidence, inputs, self.vectors)
            mix = partial(self._mix_planes, inputs, surfaces)
            yield mix_layers(layered, mix, partial(self._find_sources, inputs, surfaces))

    def _mix_planes(self, inputs: BlendInput, surfaces: _Surfaces | None, planes0: Planes, planes1: Planes) -> Mixed:
        """Mix planes of both frames with the weights that the pictures have."""
        samples0, samples1 = map(sharp_and_smooth_samples, (planes0, planes1))
        pixels = view(inputs.pair.image0.pixels).blank()[1]
        output = np.empty((2 * len(planes0), *planes0[0].shape), np.float32)
        blend_hypotheses(
            inputs.full,
            PlaneGroup(samples0, samples1, 1, 1),
            inputs.t,
            inputs.candidates,
            inputs.weighting,
            inputs.context,
            ValueRange(1.0, 0.0, -np.inf, np.inf, False),
            Blended(pixels, output, np.empty((0, 0), np.float32)),
        )
        if surfaces is not None:
            along, _ = surfaces.motion.mix(samples0.coefficients, samples1.coefficients)
            output += surfaces.share * (along - output)
        return Mixed(*np.split(output, 2))

    def _find_sources(self, inputs: BlendInput, surfaces: _Surfaces | None) -> Sources:
        """Find the frame that each pixel is taken from, along the motion with the largest weight."""
        pair = inputs.pair
        size = pair.image0.pixels.shape[:2]
        own_place = np.indices(size, np.float32)[::-1]
        places = np.concatenate([own_place, own_place])
        weights = np.zeros(size, np.float32)
        find_dominant_motion(inputs.full, inputs.t, inputs.candidates, inputs.weighting, weights, places)
        if surfaces is not None:
            follows = surfaces.share > 0.5
            for first, (motion, _) in ((0, surfaces.motion.to_frame0), (2, surfaces.motion.to_frame1)):
                np.copyto(places[first : first + 2], own_place + np.moveaxis(motion, -1, 0), where=follows)
        return find_sources(places, (pair.field01.flow, pair.field10.flow), inputs.t)

    def _blend_inputs(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[BlendInput]:
        """Yield each time with what the kernels read there."""
        image0 = frame_pair.image0
        full = PlaneGroup(image0.cached(spline_samples)[0], frame_pair.image1.cached(spline_samples)[0], 1, 1)
        weighting = Weighting(
            0.5 / self.bandwidth**2 * view(image0.pixels).gray_weight,
            self.sharpness,
            self.sufficient_similarity,
            self.min_vote_share,
            window_shape(self.node_spacing),
            *fusion_coefficients(),
        )
        votes_of_both = collect_votes(frame_pair, self.step)
        context = (
            find_context(frame_pair, self.step, self.bandwidth, self.sharpness) if self.fusion == "learnt" else None
        )
        for t in times:
            candidates = self._candidates(votes_of_both, image0.pixels.shape[:2], t)
            at_time = None if context is None else context_at(context, t, candidates)
            yield BlendInput(frame_pair, t, full, weighting, candidates, at_time)

    def _mixed(self, inputs: BlendInput, *, with_confidence: bool) -> tuple[Pixels, np.ndarray]:
        """Return the mixture of the candidates and its confidence, which is empty if it is not asked for."""
        frame0 = inputs.pair.image0
        frame1 = inputs.pair.image1
        image0 = frame0.pixels
        output, pixels, chroma = view(image0).blank()
        confidence = np.empty(image0.shape[:2] if with_confidence else (0, 0), np.float32)
        straight_alpha = has_alpha(image0) and image0.dtype != np.float32
        blend_hypotheses(
            inputs.full,
            PlaneGroup(frame0.cached(spline_samples)[1], frame1.cached(spline_samples)[1], *view(image0).subsampling),
            inputs.t,
            inputs.candidates,
            inputs.weighting,
            inputs.context,
            ValueRange(view(image0).white, rounding_offset(image0), *_value_range(frame0, frame1), straight_alpha),
            Blended(pixels, chroma, confidence),
        )
        if straight_alpha:
            colour_unseen(view(output).array(), frame0.array, frame1.array, inputs.t)
        return output, confidence

    def _limit_highlights(self, output: Pixels, inputs: BlendInput, surfaces: _Surfaces | None) -> None:
        """Clamp float frames around values above white to the range of their sources, in place.

        A spline rings there, more visibly than elsewhere.
        """
        images = inputs.pair.image0, inputs.pair.image1
        if output.dtype != np.float32 or _value_range(*images)[1] <= 1:
            return
        sources = self._find_sources(inputs, surfaces)
        planes = (np.moveaxis(normalised(image.array), 2, 0) for image in images)
        for values, *both in zip(np.moveaxis(view(output).array(), 2, 0), *planes, strict=True):
            values.clip(*sources.clamp_range(*both), out=values)

    def _candidates(self, votes_of_both: Sequence[Votes], size: tuple[int, int], t: float) -> Candidates:
        """Return the candidates around each node at time t: the merged votes of both frames."""
        height, width = size
        nodes = -(-height // self.node_spacing), -(-width // self.node_spacing)
        collected = no_votes(nodes, CANDIDATE_CAPACITY, self.node_spacing)
        for votes, sign, time in zip(votes_of_both, (1, -1), (t, 1 - t), strict=True):
            collect_candidates(
                votes, sign, time, self.step, self.support_radius, self.merge_distance, height, width, collected
            )
        room = self.max_candidates + 1  # including zero motion
        candidates = Candidates(
            np.empty(nodes, np.int32),
            np.zeros((*nodes, room, VALUES_PER_MOTION), np.float32),
            np.empty((*nodes, room), np.float32),
            self.node_spacing,
        )
        list_candidates(
            collected, ZERO_MOTION_PRIOR, ACCELERATION_TOLERANCE, MIN_SHARE, self.min_weight, *candidates[:3]
        )
        return candidates


def _extremes(image: Image) -> tuple[np.float32, np.float32]:
    """Return the lowest and the highest finite value of a float image."""
    numbers = normalised(image)
    return numbers.min(), numbers.max()


def _value_range(image0: FrameCache, image1: FrameCache) -> tuple[np.float32, np.float32]:
    """Return the range of a generated frame: the spline overshoots, but a float frame stays within that of both."""
    if image0.pixels.dtype != np.float32:
        return view(image0.pixels).value_range
    lowest0, highest0 = image0.cached(_extremes)
    lowest1, highest1 = image1.cached(_extremes)
    return min(lowest0, lowest1), max(highest0, highest1)
