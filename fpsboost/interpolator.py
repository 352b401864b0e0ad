"""Interpolation between two frames: combines an estimator, a synthesizer, and the handling of scene cuts."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from types import MappingProxyType
from typing import Annotated, Any, Protocol, Self, runtime_checkable

import numpy as np

from fpsboost.analysis.scene_cuts import CutDetector, CutList, CutPolicy
from fpsboost.analysis.still_parts import find_still_parts
from fpsboost.errors import InputError, OptionError, SceneCutWarning
from fpsboost.finishing import finish, measure_uncertainty, replace_unsure
from fpsboost.frame import ClipInfo
from fpsboost.frame_cache import FrameCache
from fpsboost.image import Image, view
from fpsboost.image_checks import check_guide_size, check_pair, check_values
from fpsboost.layered import FrameImage
from fpsboost.motion import MotionEstimator, TakesPlanes
from fpsboost.motion.rendered import RenderedVectors, UsesVectors
from fpsboost.options import LEAST_CONFIDENCE, AtCuts, Checked, Range, Uncertain, checked
from fpsboost.pair import Pair
from fpsboost.synthesis import FusesHypotheses, InterpolatedImage, Synthesizer
from fpsboost.synthesis.blend import Blend, Nearest
from fpsboost.synthesis.generation import generate
from fpsboost.synthesis.layers import MixesLayers
from fpsboost.synthesis.warp import Extrapolate

CUT_SYNTHESIZERS: Mapping[AtCuts, Synthesizer] = MappingProxyType(
    {"repeat": Nearest(), "blend": Blend(), "extrapolate": Extrapolate()}
)

CUT_WARNINGS: Mapping[AtCuts, str] = MappingProxyType(
    {
        "repeat": "A scene ends between the two images; the nearer one was repeated.",
        "blend": "A scene ends between the two images; they were mixed.",
        "extrapolate": "A scene ends between the two images; each was repeated, as its motion is not known.",
    }
)
"""Warnings on what was done with two images across a cut."""


@runtime_checkable
class FrameMask(Protocol):
    """Contract: areas of the frames of a sequence that stay as they are, such as a HUD; `fpsboost.Mask` is one."""

    @property
    def counts_frames(self) -> bool:
        """Whether each frame of the clip has a mask of its own."""

    @property
    def parts(self) -> tuple[Callable[[FrameCache], FrameCache], ...]:
        """What is behind the areas of a frame, and what they show, to be interpolated apart; none if they are kept."""

    def keep(self, made: InterpolatedImage, nearest: FrameCache) -> InterpolatedImage:
        """Return an interpolated image with these areas of the frame of the source that is nearest in time."""

    def fitted(self, info: ClipInfo, matrix: tuple[int, ...] | None, times: Sequence[Fraction] | None) -> Self:
        """Return the mask for a clip, or raise `InputError` if it is of another size or number of frames.

        Parameters
        ----------
        info : ClipInfo
        matrix : tuple of int or None
            Display matrix that has not been applied to the frames.
        times : sequence of Fraction or None
            Times of all frames, if they are known.
        """

    def composite(self, behind: InterpolatedImage, shown: InterpolatedImage) -> InterpolatedImage:
        """Return an image of what the first of `parts` gives, with one of the second over it, and its confidence."""


@dataclass(frozen=True)
class Interpolator(Checked):
    """Interpolator of the frames between two frames.

    Parameters
    ----------
    estimator : MotionEstimator
        Estimates the motion, once for each pair.
    synthesizer : Synthesizer
        Synthesizes the image at each time.
    cuts : CutPolicy or None
        Decides where scenes end; None takes every pair for one scene.
    at_cuts : {'repeat', 'blend', 'extrapolate'}
        Across a cut or a flash, repeat the nearer frame, blend the two, or extrapolate the motion of each.
    curved : bool
        Follow curved trajectories where the pairs before and after are known, straight ones otherwise.
    compensate_illumination : bool
        If the illumination changes between two frames, estimate motion under equal illumination.
    overlays : bool
        Leave overlays unchanged that are static in front of a moving picture; needs the pair before or after.
    match_grain : bool
        Add noise to interpolated frames in place of what averaging has removed, so that they are as grainy as the two
        frames. For methods that follow motion: texture that is not followed may be taken for grain.
    uncertain : {'keep', 'blend', 'nearest', 'hold'}
        What is shown where the confidence is lower than `below`: the result all the same; with soft edges, the mix of
        both frames or the nearer one; or the nearer one as a whole, if a fifth of the frame is unsure. It is decided
        once for a pair, by the confidence halfway.
    below : float
        Limit of confidence, 0 to 1.
    mask : FrameMask or None
        Areas of the frames of a sequence that stay as in the source frame that is nearest in time, or that are a layer
        of their own.

    Examples
    --------
    >>> import numpy as np
    >>> from fpsboost.motion.field import ZeroMotion
    >>> from fpsboost.synthesis.blend import Blend
    >>> noise = np.random.default_rng(1).integers(0, 256, (48, 64, 3), dtype=np.uint8)
    >>> (middle,) = Interpolator(ZeroMotion(), Blend()).interpolate(noise, noise, [0.5])
    >>> bool((middle == noise).all())
    True
    """

    estimator: MotionEstimator
    synthesizer: Synthesizer
    cuts: CutPolicy | None = CutDetector()
    at_cuts: AtCuts = "repeat"
    curved: bool = True
    compensate_illumination: bool = True
    overlays: bool = True
    match_grain: bool = False
    uncertain: Uncertain = "keep"
    below: Annotated[float, Range(0, 1)] = LEAST_CONFIDENCE
    mask: FrameMask | None = None

    def names_given(self) -> set[str]:
        """Return the names of the options that differ from their defaults; see `fpsboost.conflicts`."""
        given = {
            "at_cuts='extrapolate'": self.at_cuts == "extrapolate",
            "below": self.below != LEAST_CONFIDENCE,
            "cuts": isinstance(self.cuts, CutList),
            "`cuts` by frames": isinstance(self.cuts, CutList) and self.cuts.counts_frames,
            "mask": self.mask is not None,
            "`mask` by frames": self.mask is not None and self.mask.counts_frames,
            "mask_as='layer'": self.mask is not None and len(self.mask.parts) > 0,
            "match_grain": self.match_grain,
            "uncertain": self.uncertain != "keep",
            "vectors": self.uses_vectors,
        }
        return {name for name, is_given in given.items() if is_given}

    @property
    def counts_frames(self) -> bool:
        """Whether cuts or a mask go by the numbers of frames, so that none of the clip may be left unread."""
        return not self.names_given().isdisjoint({"`cuts` by frames", "`mask` by frames"})

    @property
    def _parts(self) -> dict[str, MotionEstimator | Synthesizer]:
        """The two parts of the method, by their names."""
        return {"estimator": self.estimator, "synthesizer": self.synthesizer}

    @property
    def takes_planes(self) -> bool:
        """Whether images may be `YCbCrImage`; results then are, too, except for pairs whose illumination changes."""
        return all(isinstance(part, TakesPlanes) and part.takes_planes for part in self._parts.values())

    @property
    def takes_layers(self) -> bool:
        """Whether images may be `LayeredImage`."""
        mixes_layers = all(isinstance(each, MixesLayers) for each in (self.synthesizer, CUT_SYNTHESIZERS[self.at_cuts]))
        return mixes_layers and not self.match_grain and self.uncertain == "keep"

    @property
    def has_confidence(self) -> bool:
        """Whether the synthesizer computes a confidence for every pixel; otherwise it is computed separately."""
        return isinstance(self.synthesizer, FusesHypotheses)

    @property
    def uses_vectors(self) -> bool:
        """Whether motion comes from a renderer's vectors, so that only times for which there are some can be made."""
        return any(isinstance(part, UsesVectors) and part.vectors is not None for part in self._parts.values())

    @property
    def needs_every_frame(self) -> bool:
        """Whether motion was rendered from each frame to the next one, so that no frame may be skipped."""
        return any(isinstance(part, UsesVectors) and part.needs_every_frame for part in self._parts.values())

    @checked
    def interpolate(
        self,
        image0: Image,
        image1: Image,
        times: Sequence[float | Fraction],
        *,
        cuts: CutPolicy | None = None,
        guides: Sequence[Image] | None = None,
        key_guides: tuple[Image, Image] | None = None,
    ) -> list[Image]:
        """Make one image for every time.

        Two images do not suffice to tell where a scene ends: unless `cuts` is given, motion is followed between any
        two.

        Parameters
        ----------
        image0, image1 : (H, W, C) uint8, uint16 or float32
            Two frames of one size and type; white is 1 in float32, and light may be brighter.
        times : sequence of float or Fraction
            Each in [0, 1]; 0 gives frame 0 and 1 gives frame 1, unchanged.
        cuts : CutPolicy, optional
            Decides whether a scene ends between the two, as a `CutDetector` does, instead of this interpolator's own
            policy, which is for sequences. Across a cut, `at_cuts` applies.
        guides : sequence of (h, w, C) uint8, uint16 or float32, optional
            A cheap picture of each image to be made, which shows where everything is.
        key_guides : tuple of two (h, w, C), optional
            The same of the two frames, by which guides are calibrated.

        Returns
        -------
        list of (H, W, C), dtype of the frames

        Raises
        ------
        InputError
            The two are not images of one size and type, or guides of them are unlike those between.
        OptionError
            A time lies outside of [0, 1], or float images are surely on another scale: from -1 to 1, or whole numbers.

        Warns
        -----
        UserWarning
            Float images have NaN, or are probably 8-bit levels.
        SceneCutWarning
            There is a cut, and a time lies between the two.
        """
        check_pair(image0, image1, "image0", "image1")
        check_values(image0, "image0")
        check_values(image1, "image1")
        if key_guides and guides and any(each.shape != guides[0].shape for each in key_guides):
            raise InputError("Guides of frames must be like those between them; make all of one size and colours.")
        interpolator = replace(self, cuts=cuts)
        pair = interpolator.pair(FrameCache(image0), FrameCache(image1))
        pair.image0.guide, pair.image1.guide = key_guides or (None, None)
        made = interpolator.images(pair, times, guides=guides or ())
        arrays = [view(image).array() for image, _ in made]
        if any(0 < t < 1 for t in times) and pair.is_cut:
            warnings.warn(CUT_WARNINGS[self.at_cuts], SceneCutWarning, stacklevel=3)
        return arrays

    @checked
    def pair(
        self,
        image0: FrameCache,
        image1: FrameCache,
        duration: Annotated[Fraction | float, Range(above=0)] = 1,
        *,
        apart: Fraction | float | None = None,
        is_gap: bool = False,
    ) -> Pair:
        """Return two frames as `images` takes them; `duration` is the time between them, for `apart` see `Pair`.

        In a gap, where the user has named missing frames, no scene cut is detected; one that is listed counts. Each
        frame is to be the same object in both of its pairs, so that what depends on it alone is computed once.
        """
        cuts = None if is_gap and isinstance(self.cuts, CutDetector) else self.cuts
        lit = self.compensate_illumination
        return Pair(
            image0, image1, duration, apart=apart, estimator=self.estimator, cuts=cuts, compensate_illumination=lit
        )

    @checked
    def images(
        self,
        pair: Pair,
        times: Sequence[float | Fraction],
        *,
        with_confidence: bool = False,
        guides: Sequence[FrameImage | None] = (),
    ) -> Iterator[InterpolatedImage]:
        """Interpolate like `interpolate`, but one image at a time, along curved trajectories, and with confidence.

        Whether a scene ends between the two frames is what `Pair.is_cut` says.

        Parameters
        ----------
        pair : Pair
            Trajectories are curved where its neighbours are known; see `Pair.between`.
        times : sequence of float or Fraction
            Each in [0, 1].
        with_confidence : bool
            Compute the confidence of every pixel, too. It is the synthesizer's own if it has one, see
            `fpsboost.synthesis.FusesHypotheses`, or else the agreement of the two frames, see
            `fpsboost.synthesis.agreement`. It is 0 where no motion connects the frames, and 1 for the frames
            themselves.
        guides : sequence of (h, w, C) array, YCbCrImage, LayeredImage or None, optional
            A cheap picture for every time, which the image follows; None where there is none, and none at all without.
            Those of the two frames are their `FrameCache.guide`. `Pair.findings` has what they tell.

        Returns
        -------
        iterator of InterpolatedImage
            One for each time, computed when it is asked for; `confidence` is None unless it was asked for.

        Raises
        ------
        OptionError
            A time lies outside of [0, 1].
        """
        for t in times:
            if not 0 <= t <= 1:
                raise OptionError(f"A time between two frames must lie in [0, 1], not at {t}.")
        return self._images(pair, times, guides, with_confidence=with_confidence)

    def _images(
        self,
        pair: Pair,
        times: Sequence[float | Fraction],
        guides: Sequence[FrameImage | None],
        *,
        with_confidence: bool,
    ) -> Iterator[InterpolatedImage]:
        inner = [float(t) for t in times if 0 < t < 1]
        images = self._synthesize(pair, inner, with_confidence=with_confidence) if inner else iter(())
        for t, guide in zip(times, guides or [None] * len(times), strict=True):
            frame = pair.image1 if t == 1 else pair.image0
            image, confidence = next(images) if 0 < t < 1 else InterpolatedImage(frame.image.copy())
            if with_confidence and confidence is None:  # no motion connects the frames, or it is one of them
                confidence = np.full(image.shape[:2], t in {0, 1}, np.float32)
            made = InterpolatedImage(image, confidence if with_confidence else None)
            yield _guided(pair, made, guide, t) if guide is not None and 0 < t < 1 else made

    def _synthesize(self, pair: Pair, times: list[float], *, with_confidence: bool) -> Iterator[InterpolatedImage]:
        scene = pair.within_scene
        if pair.is_discontinuous:
            frame_pair = scene.extrapolated if self.at_cuts == "extrapolate" else pair.at_rest
            return generate(CUT_SYNTHESIZERS[self.at_cuts], frame_pair, pair.layered, times)
        if self.uncertain == "keep":
            return self._follow(scene, times, with_confidence=with_confidence)
        return self._fall_back(scene, times)

    def _follow(self, pair: Pair, times: list[float], *, with_confidence: bool) -> Iterator[InterpolatedImage]:
        """Interpolate along the motion of a pair, whose neighbours belong to its scene."""
        if self.mask is not None and self.mask.parts:
            return self._in_layers(self.mask, pair, times, with_confidence=with_confidence)
        frame_pair = pair.curved_frame_pair if self.curved else pair.frame_pair
        images = generate(self.synthesizer, frame_pair, pair.layered, times, with_confidence=with_confidence)
        if pair.layered is not None:  # they are mixed as the frames are, so that sums of layers stay sums
            return images
        return finish(images, times, pair, overlays=self.overlays, grain=self.match_grain)

    def _in_layers(
        self, mask: FrameMask, pair: Pair, times: list[float], *, with_confidence: bool
    ) -> Iterator[InterpolatedImage]:
        """Interpolate what is behind a mask, and what it shows, each by itself, and put the one over the other."""
        background = replace(self, mask=None, uncertain="keep", below=LEAST_CONFIDENCE)
        layer = replace(background, match_grain=False)  # flat areas have none to measure
        hidden, layers = pair.parts(*mask.parts)
        behind = background.images(hidden, times, with_confidence=with_confidence)
        shown = layer.images(layers, times, with_confidence=with_confidence)
        if not mask.counts_frames:  # what changes where it stands, such as digits, is not to be mixed
            still = layers.uncertainty_map(lambda: find_still_parts(layers.image0, layers.image1, layers.fields[0]))
            shown = replace_unsure(shown, times, layers, still, mix=False)
        return map(mask.composite, behind, shown)

    def _fall_back(self, pair: Pair, times: list[float]) -> Iterator[InterpolatedImage]:
        """Interpolate along the motion, but not where the image halfway between the two is unsure."""
        made = list(self._follow(pair, times, with_confidence=True)) if times == [0.5] else []

        def measure() -> np.ndarray:
            ((_, confidence),) = made or self._follow(pair, [0.5], with_confidence=True)
            return measure_uncertainty(confidence, self.below, self.uncertain)

        uncertainty = pair.uncertainty_map(measure)
        images = made or self._follow(pair, times, with_confidence=True)
        return replace_unsure(iter(images), times, pair, uncertainty, mix=self.uncertain == "blend")

    def with_vectors(self, change: Callable[[Any], RenderedVectors]) -> Interpolator:
        """Return the interpolator with other vectors of a renderer, if it has any."""
        matched: dict[str, Any] = {}
        for name, part in self._parts.items():
            if isinstance(part, UsesVectors) and part.vectors is not None:
                matched[name] = replace(part, vectors=change(part.vectors))  # type: ignore[type-var]
        return replace(self, **matched)

    def without_vectors(self) -> Interpolator:
        """Return an interpolator that does the same as far as that needs no rendered motion."""
        bare = {name: part.without_vectors() for name, part in self._parts.items() if isinstance(part, UsesVectors)}
        return replace(self, **bare)


def _guided(pair: Pair, made: InterpolatedImage, picture: FrameImage, t: float | Fraction) -> InterpolatedImage:
    """Return an image as its guide shows it, and keep what the guide tells with the pair."""
    check_guide_size("A guide", picture.shape[:2], made.image.shape[:2])
    image, pair.findings[t] = pair.guided.follow(made, picture, float(t))
    return image
