"""Two consecutive frames, and what is computed from them once: match score, illumination, motion, noise."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from copy import copy
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import chain
from typing import Any, TypeVar

import numpy as np

from fpsboost.analysis.grain import PairGrain, measure_grain
from fpsboost.analysis.illumination import IlluminationModel, compensate_either, estimate_illumination
from fpsboost.analysis.scene_cuts import MOST_DECAY, CutDetector, CutPolicy
from fpsboost.colour import normalised
from fpsboost.errors import OptionError
from fpsboost.frame_cache import FrameCache, Results
from fpsboost.image import view
from fpsboost.image_checks import check_pair
from fpsboost.layered import LayeredImage
from fpsboost.motion import MotionEstimator
from fpsboost.motion.components import gray, half_chroma
from fpsboost.motion.field import COMPARABLE, MotionField, ZeroMotion
from fpsboost.synthesis import FramePair
from fpsboost.synthesis.guided import GuidedPair, GuideFindings

MAX_LENGTH = 1e6
"""No vector is as long, pixels."""

Item = TypeVar("Item")
Result = TypeVar("Result")

Layered = tuple[LayeredImage, LayeredImage]
"""Two frames with their further layers."""


def once(compute: Callable[[Pair], Result]) -> Callable[[Pair], Result]:
    """Let a pair compute a result once, when it is first asked for; it is kept under the name of the function."""

    def result(pair: Pair) -> Result:
        return pair._results.cached(compute.__name__, partial(compute, pair))

    return result


class Pair:
    """Two consecutive frames, and the results of an interpolator for them, computed once when first asked for.

    `Interpolator.pair` makes one, of which no neighbours are known. `between` and `with_neighbours` tell them.

    Parameters
    ----------
    image0, image1 : FrameCache
    duration : Fraction or float
        Time between them, in any unit that neighbouring pairs share.
    apart : Fraction or float, optional
        Time to the second frame from the last one that shows the same as the first; `duration` by default.
    estimator : MotionEstimator
    cuts : CutPolicy or None
    compensate_illumination : bool
        As the interpolator has them.

    Attributes
    ----------
    before, after : Pair or None
        The pairs that share its first and its last frame, if they are known. Those farther away have no influence.
    findings : dict of Fraction or float to GuideFindings
        What guides have told of the frames made between the two, by the times of these.

    Raises
    ------
    InputError
        The two differ in size or type.
    """

    def __init__(
        self,
        image0: FrameCache,
        image1: FrameCache,
        duration: Fraction | float,
        *,
        apart: Fraction | float | None = None,
        estimator: MotionEstimator,
        cuts: CutPolicy | None,
        compensate_illumination: bool,
    ) -> None:
        check_pair(image0.pixels, image1.pixels)
        self.image0 = image0
        self.image1 = image1
        self.duration = duration
        self.apart = apart or duration
        self._estimator = estimator
        self._cuts = cuts
        self._compensate_illumination = compensate_illumination
        self._pair = partial(Pair, estimator=estimator, cuts=cuts, compensate_illumination=compensate_illumination)
        self.before: Pair | None = None
        self.after: Pair | None = None
        self.findings: dict[Fraction | float, GuideFindings] = {}
        self._results = Results()
        self._decisions = Results()  # those that depend on the pairs before and after

    def between(self, before: Pair | None, after: Pair | None) -> Pair:
        """Return the same pair, of which these neighbours are known; both have the same results."""
        known = copy(self)
        known.before = before
        known.after = after
        known._decisions = Results()
        return known

    @property
    def within_scene(self) -> Pair:
        """The same pair with the neighbours that motion connects; of these, the pairs beyond are not known."""
        before = self.before
        after = self.after
        return self.between(
            None if before is None or before.between(None, self).is_discontinuous else before,
            None if after is None or after.between(self, None).is_discontinuous else after,
        )

    @property
    def layered(self) -> Layered | None:
        """The two frames with their further layers; None if they have none."""
        image0 = self.image0.image
        image1 = self.image1.image
        # only some methods take these
        return (image0, image1) if isinstance(image0, LayeredImage) and isinstance(image1, LayeredImage) else None

    @property
    def illumination(self) -> IlluminationModel | None:
        """Illumination change from the first frame to the second; None if there is none, or it is not compensated."""
        return self._measured_illumination if self._compensate_illumination else None

    @property
    @once
    def _measured_illumination(self) -> IlluminationModel | None:
        return estimate_illumination(self.image0, self.image1)

    @property
    @once
    def compensated(self) -> tuple[FrameCache, FrameCache]:
        """The two frames, both under the illumination of the first."""
        if self.illumination is None:
            return self.image0, self.image1
        first = normalised(view(self.image0.pixels).to_bgr())
        second = view(self.image1.pixels).to_bgr()
        return self.image0.with_image(first), self.image1.with_image(self.illumination.undo(second))

    @property
    def match_score(self) -> float:
        """Match score of the two frames, 0 to 1; 1 if scene cuts are not looked for.

        If the illumination changes, the lower of the scores under that of either frame: dark frames look alike, but
        not under the brighter illumination.
        """
        return 1.0 if self._cuts is None else self._measured_match_score(self._cuts)

    @property
    def detected_match_score(self) -> float:
        """Match score of the two frames by a `CutDetector`, also if scene cuts are not looked for or are listed."""
        return self._measured_match_score(self._cuts if isinstance(self._cuts, CutDetector) else CutDetector())

    def _measured_match_score(self, cuts: CutPolicy) -> float:
        def measure() -> float:
            if not self._compensate_illumination:
                score = cuts.match_score(self.image0, self.image1)
                if not cuts.is_cut(score, 1.0, 1.0):  # whatever its neighbours
                    return score
            if self._measured_illumination is None:
                return cuts.match_score(self.image0, self.image1)
            either = compensate_either(self.image0, self.image1, self._measured_illumination)
            return min(cuts.match_score(*thumbnails) for thumbnails in either)

        return self._results.cached(("match_score", cuts), measure)

    @property
    def is_discontinuous(self) -> bool:
        """Whether no motion connects the frames."""
        return self._decisions.cached("is_discontinuous", self._find_discontinuity)

    def _find_discontinuity(self) -> bool:
        cuts = self._cuts
        if cuts is None or not cuts.is_cut(self.match_score, *self._expected_scores()):
            return False
        return not cuts.is_gradual(self.match_score, *(each.match_score for each in self._spanning_pairs))

    @property
    def is_cut(self) -> bool:
        """Whether a scene ends between the frames: no motion connects them, and it is no flash of one frame."""
        return self.is_discontinuous and not self._is_flash()

    def _is_flash(self) -> bool:
        """Return whether the frames on both sides of the pair's first or last frame show one scene."""
        cuts = self._cuts
        usual = max(self._expected_scores(), default=1.0)
        scores = [each.match_score for each in self._spanning_pairs]
        return cuts is not None and any(cuts.is_flash(self.match_score, score, usual) for score in scores)

    def _expected_scores(self) -> list[float]:
        """Return the match scores of the pairs before and after, if known, as of frames that are as far apart in time.

        In one scene, scores fall with the distance; see `MOST_DECAY`.
        """
        known = [each for each in (self.before, self.after) if each is not None and each._cuts is not None]
        decays = [float(min(max(self.apart / each.apart, 1), MOST_DECAY)) for each in known]
        # a score may be a little below 0
        return [
            each.match_score * abs(each.match_score) ** (decay - 1) for each, decay in zip(known, decays, strict=True)
        ]

    @property
    def _spanning_pairs(self) -> list[Pair]:
        """The known pairs of each frame of the two and the frame beyond the other."""
        return self._decisions.cached("spanning_pairs", self._span)

    def _span(self) -> list[Pair]:
        pairs = [] if self.before is None else [self._pair(self.before.image0, self.image1, 1)]
        return pairs if self.after is None else [*pairs, self._pair(self.image0, self.after.image1, 1)]

    @property
    @once
    def fields(self) -> tuple[MotionField, MotionField]:
        """Motion fields in both directions."""
        fields = self._estimator.estimate(*self.compensated)
        check_fields(self._estimator, fields, self.image0.pixels.shape[:2])
        if self.illumination is not None:  # no other pair uses these: saves memory
            for image in self.compensated:
                image.clear()
        return fields

    @property
    def frame_pair(self) -> FramePair:
        """What a synthesizer takes of two frames that motion connects."""
        return FramePair(*self.compensated, *self.fields)

    @property
    def curved_frame_pair(self) -> FramePair:
        """The same with that of the pairs before and after."""
        # the next pair's motion first: the thread that makes its frames waits for it
        after = self._beside(self.after)
        return replace(self.frame_pair, before=self._beside(self.before), after=after)

    def _beside(self, neighbour: Pair | None) -> FramePair | None:
        """Return what a synthesizer takes of the pair before or after, whose frames are in their own light."""
        if neighbour is None:
            return None
        other_light = neighbour.illumination is not None or self.illumination is not None
        ratio = float(neighbour.duration / self.duration)
        images = (neighbour.image0, neighbour.image1)
        return FramePair(*images, *neighbour.fields, duration=ratio, other_light=other_light)

    @property
    def at_rest(self) -> FramePair:
        """What a synthesizer takes of two frames that no motion connects."""
        return FramePair(self.image0, self.image1, *ZeroMotion().estimate(self.image0, self.image1))

    @property
    def extrapolated(self) -> FramePair:
        """The same in BGR, with the motion of each frame as it goes on from the pair before or after, if known."""
        rest = self.at_rest
        return FramePair(
            as_bgr(self.image0),
            as_bgr(self.image1),
            rest.field01 if self.before is None else self._extend(self.before.fields[1], self.before),
            rest.field10 if self.after is None else self._extend(self.after.fields[0], self.after),
        )

    def _extend(self, away: MotionField, neighbour: Pair) -> MotionField:
        # a pair that is much shorter says little of how long its motion goes on
        ratio = min(float(self.duration / neighbour.duration), COMPARABLE)
        return replace(away, vectors=away.vectors * np.float32(-ratio))

    @property
    @once
    def guided(self) -> GuidedPair:
        """The two frames with what their guides tell."""
        return GuidedPair(self.image0, self.image1)

    @property
    @once
    def grain(self) -> PairGrain:
        """Noise of the two frames, as they are."""
        image0, image1 = (
            image if self.illumination is None else as_bgr(image)  # results under other light are arrays
            for image in (self.image0, self.image1)
        )
        return measure_grain(image0.pixels, image1.pixels, *self.fields)

    def parts(self, *functions: Callable[[FrameCache], FrameCache]) -> list[Pair]:
        """Return a pair for each function, of the parts of the two frames that it gives, without scene cuts.

        They are between those of the pairs before and after. The functions must be the same at every call.
        """

        def divide() -> list[Pair]:
            return [
                self._pair(self.image0.derived(part), self.image1.derived(part), self.duration, cuts=None)
                for part in functions
            ]

        parts = self._results.cached("parts", divide)
        before = [None] * len(parts) if self.before is None else self.before.parts(*functions)
        after = [None] * len(parts) if self.after is None else self.after.parts(*functions)
        return [part.between(*around) for part, *around in zip(parts, before, after, strict=True)]

    def uncertainty_map(self, measure: Callable[[], np.ndarray]) -> np.ndarray:
        """Return the uncertainty of the image halfway, (H, W) float32, 0 to 1, which is measured once for the pair."""
        return self._results.cached("uncertainty", measure)

    @property
    def unsure_share(self) -> float:
        """Share of the pixels in which motion is unsure; 0 if that was not measured."""
        uncertainty = self._results.get("uncertainty")
        return 0.0 if uncertainty is None else float(uncertainty.mean())

    @property
    def search_radius(self) -> int | None:
        """Search radius in pixels; None if the estimator has no such limit or has not run."""
        fields = (self._results.get("parts") or [self])[0]._results.get("fields")  # of the background, if divided
        return None if fields is None else fields[0].search_radius

    def release_caches(self) -> None:
        """Discard all results that the next pair does not need, to save memory, once this pair's frames are made."""
        for part in self._results.get("parts") or ():
            part.release_caches()
        self.image0.clear(gray, half_chroma)  # overlays are static in the frame before a pair, too
        self._results.discard({"compensated", "grain", "guided"}.__contains__)


def with_neighbours(pairs: Iterable[Pair]) -> Iterator[Pair]:
    """Yield each pair `Pair.between` the previous and the next one; lags one pair behind."""
    return (pair.between(before, after) for before, pair, after in triplewise(pairs))


def items_with_neighbours(items: Iterable[tuple[Item, Pair]]) -> Iterator[tuple[Item, Pair]]:
    """Yield each item with its pair, between those of the items before and after."""
    for before, (item, pair), after in triplewise(items):
        yield item, pair.between(before and before[1], after and after[1])


def triplewise(items: Iterable[Item]) -> Iterator[tuple[Item | None, Item, Item | None]]:
    """Yield each item between the previous and the next one, None at the ends; lags one item behind.

    Examples
    --------
    >>> list(triplewise("ab"))
    [(None, 'a', 'b'), ('a', 'b', None)]
    """
    padded = chain([None], items, [None])
    before = next(padded)
    item = next(padded)
    for after in padded:
        assert item is not None, "only the first and the last are"
        yield before, item, after
        before = item
        item = after


def check_fields(estimator: MotionEstimator, fields: Any, size: tuple[int, ...]) -> None:
    """Raise `OptionError` unless an estimator, which may be a user's, returned two motion fields of such frames."""
    told = f"The estimator {type(estimator).__name__} must return two `fpsboost.MotionField`"
    if not isinstance(fields, tuple | list) or [type(each) for each in fields] != [MotionField, MotionField]:
        raise OptionError(f"{told}, as in `return MotionField(flow01), MotionField(flow10)`.")
    for each in fields:
        if each.shape != size:
            raise OptionError(f"{told} for frames of (height, width) {size}, not {each.shape}.")
        vectors = each.vectors
        similarities = each.similarities
        in_range = vectors.min() > -MAX_LENGTH and vectors.max() < MAX_LENGTH  # NaN is not
        if not (in_range and similarities.min() > -0.01 and similarities.max() < 1.01):  # sums are rounded
            raise OptionError(f"{told} of finite vectors, in pixels, with `similarities` from 0 to 1.")


def as_bgr(image: FrameCache) -> FrameCache:
    """Return an image with its pixels as an array, converted to BGR from YCbCr."""
    return image if view(image.pixels).coding is None else image.with_image(view(image.pixels).to_bgr())
