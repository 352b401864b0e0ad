"""Scene cuts: pairs of frames that no motion connects, detected or read from a list of times or frame numbers.

>>> import numpy as np
>>> from fpsboost import CutDetector, FrameCache
>>> noise = np.random.default_rng(1).integers(0, 256, (2, 60, 80, 3), dtype=np.uint8)
>>> frames = [FrameCache(np.roll(noise[0], 2 * number, axis=1)) for number in range(2)]  # a pan
>>> frames += [FrameCache(np.roll(noise[1], 2 * number, axis=1)) for number in range(2)]  # another scene
>>> detector = CutDetector()
>>> scores = [detector.match_score(*pair) for pair in zip(frames, frames[1:])]
>>> [score > 0.5 for score in scores], detector.is_cut(scores[1], scores[0], scores[2])
([True, False, True], True)
"""

import csv
import math
import os
from bisect import bisect_right
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Annotated, Protocol, runtime_checkable

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.colour import has_alpha
from fpsboost.errors import InputError, explained
from fpsboost.frame_cache import FrameCache, SourcePosition
from fpsboost.image import view
from fpsboost.motion.components import Components, small_components, small_copy
from fpsboost.motion.field import MotionField
from fpsboost.motion.full_search import search_fused
from fpsboost.options import Checked, PathName, Range, checked
from fpsboost.timing.position import TIME_TOLERANCE, Position

CERTAIN_CUT_FRACTION = 0.3
"""Fraction of the threshold below which a pair is a cut regardless of its neighbours, or if it has none."""

ISOLATED_CUT_FACTOR = 1.5
"""Multiple of the threshold below which a pair is a cut if it matches far worse than both its neighbours."""

GRADUAL_CHANGE_FRACTION = 0.55
"""Fraction of a pair's match score below which the match score of frames farther apart shows a gradual change, not a
cut. Chosen on nine constructed sets of 581 cuts and 4,800 other pairs: precision 0.993, recall 0.979."""

MOST_DECAY = 4
"""Maximum exponent of a neighbour's match score where a pair's frames are farther apart in time. In 15 filmed and
rendered clips, scores of frames k intervals apart are hardly below those of neighbours to the power of k; those of
eight and more intervals hardly differ."""

THUMBNAIL_SIDE = 40  # longer side of the thumbnails that are compared, pixels
SEARCH_RANGE = 1 / 3  # search range, as a fraction of the longer side; a faster pan shows another scene anyway

BANDWIDTH = 0.1
"""Bandwidth of the similarity of thumbnails, at which patches that blur or glitter from frame to frame still count."""

MOTION_PENALTY = 0.002
"""Reduction of the similarity per pixel of motion: among equally similar patches, such as those of a wall, the nearest
is found, the same one in both directions."""

CONSISTENCY_TOLERANCE = 1.5
"""Limit of the forward-backward error of a consistent vector, thumbnail pixels: allows one in x and one in y, as zooms
have."""

STRICT_BANDWIDTH = 0.04
"""Bandwidth of the similarity for inconsistent vectors: only patches that look nearly the same, such as those of one
wall or of a black frame, count as the starting point."""

SEEMS_ALIKE = 0.5
"""Match score above which planes that the search has not compared are examined; below it, the frames differ anyway."""
CONTRADICTION = 0.25
"""Loss of similarity of a patch, by planes that the search has not compared, from which the search is repeated with
them. The largest loss is 0.15 in 27 clips without cuts."""

PATCH_RADIUS = 5
"""Patch radius in thumbnail pixels; a patch is a quarter of a thumbnail wide. Smaller patches match in any picture."""


@runtime_checkable
class CutPolicy(Protocol):
    """Contract: decides where scenes end, pair by pair.

    `CutDetector` detects cuts, `fpsboost.analysis.scene_cuts.CutList` has a list of them. The conversion computes the
    match score of each pair once, then decides by the scores of the pairs around it.
    """

    def match_score(self, image0: FrameCache, image1: FrameCache) -> float:
        """Return how well two consecutive frames match as frames of one scene, 0 to 1."""

    def is_cut(self, match_score: float, *neighbours: float) -> bool:
        """Return whether a scene ends within a pair, given its match score and those of the pairs before and after."""

    def is_gradual(self, match_score: float, *across: float) -> bool:
        """Return whether a poorly matching pair is part of a gradual change, given scores of frames farther apart."""

    def is_flash(self, match_score: float, across: float, *neighbours: float) -> bool:
        """Return whether a frame only interrupts a scene, given the match score of the frames around it."""


@dataclass(frozen=True)
class CutDetector(Checked):
    """Detector of scene cuts: pairs in which hardly any motion is consistent forward and backward.

    Both frames are reduced to thumbnails, and every patch of either is searched for in the other with the similarity
    of the method itself. Similar patches are often found by chance; but the backward vector of a patch that has moved
    leads to where it was, and that of a chance match leads elsewhere. The match score is the mean over all pixels of
    the similarity of the match, times the similarity of the patch at which the backward vector ends. It is high under
    any motion and low across a cut. Fast motion, blur and short occlusions lower it in the surrounding pairs, too: a
    cut must stand out.

    Parameters
    ----------
    threshold : float
        Match score below which pairs are cuts if they stand out, 0 (none) to 1 (all).
    drop : float
        Maximum match score of a cut, as a fraction of the better neighbour's: where all pairs match poorly, behind
        turning glass or among trees that rush past, no scene ends.
    times : float
        Ratio of a pair's dissimilarity (1 minus the match score) to that of the worse neighbour from which the pair is
        a cut even if its match score exceeds the threshold, as with slides and rooms in the same colours. A figure that
        strikes another pose in an animation stays below it.
    """

    threshold: Annotated[float, Range(0, 1)] = 0.5
    drop: Annotated[float, Range(above=0, most=1)] = 0.6
    times: Annotated[float, Range(1)] = 8.0

    def is_cut(self, match_score: float, *neighbours: float) -> bool:
        """Return whether a scene ends within a pair, given its match score and those of the pairs before and after.

        Without neighbours, a pair is a cut only if nothing matches: only the surrounding pairs show how well a scene
        can be followed at all, and a needless interpolation does less harm than motion that stops.

        Examples
        --------
        >>> detector = CutDetector()
        >>> detector.is_cut(0.3, 0.9, 0.8), detector.is_cut(0.3, 0.4, 0.3)  # a drop, and motion that is hard to follow
        (True, False)
        """
        if self.threshold == 1 or match_score < CERTAIN_CUT_FRACTION * self.threshold:
            return self.threshold > 0
        if not neighbours:
            return False
        drops = match_score < self.threshold and match_score <= self.drop * max(neighbours)
        # a single neighbour, at the ends of a clip, may be a short rest before motion continues
        far_out = len(neighbours) > 1 and 1 - match_score >= self.times * (1 - min(neighbours))
        return drops or (far_out and match_score < ISOLATED_CUT_FACTOR * self.threshold)

    def is_gradual(self, match_score: float, *across: float) -> bool:
        """Return whether a poorly matching pair is part of a gradual change, such as the end of a fade.

        `across` are the known match scores of each of its frames and the one beyond the other: across a cut, they are
        as low as the pair's; in a gradual change, even lower. A pair without any match is a cut in any case.
        """
        some_alike = CERTAIN_CUT_FRACTION * self.threshold <= match_score and self.threshold < 1
        return some_alike and min(across, default=1.0) < GRADUAL_CHANGE_FRACTION * match_score

    def is_flash(self, match_score: float, across: float, *neighbours: float) -> bool:
        """Return whether a frame that matches the one beside it poorly only interrupts a scene that continues.

        `across` is the match score of the frames on both sides of it, `neighbours` those of the pairs around.
        """
        goes_on = across >= self.threshold and not self.is_cut(across, *neighbours)
        return goes_on and self.is_cut(match_score, across)

    def match_score(self, image0: FrameCache, image1: FrameCache) -> float:
        """Return the share of the frames that can be followed forward and backward, 0 to 1.

        The worse of both directions counts: a frame with little content can be found in nearly any other, but not the
        other in it.
        """
        return min(float(each.mean()) for each in self.match_maps(image0, image1))

    def match_maps(self, image0: FrameCache, image1: FrameCache) -> tuple[np.ndarray, np.ndarray]:
        """Return how well each pixel of both thumbnails can be followed there and back, (h, w) float32, 0 to 1.

        The components of the search do not hold all of chroma. Where matches differ in the planes that these leave out,
        such as orange and azure of equal luma, such a plane takes the place of mean chroma in another search, and the
        lower result counts.
        """
        thumbnails = [image.derived(small_components, THUMBNAIL_SIDE) for image in (image0, image1)]
        fields, matched = self._follow(*thumbnails)
        for planes in zip(*(image.derived(unseen_planes, THUMBNAIL_SIDE) for image in (image0, image1)), strict=True):
            seems_alike = min(each.mean() for each in matched) > SEEMS_ALIKE
            if seems_alike and max(map(_contradiction, matched, fields, planes, planes[::-1])) > CONTRADICTION:
                instead = (np.dstack([each[..., :2], plane]) for each, plane in zip(thumbnails, planes, strict=True))
                _, others = self._follow(*instead)
                matched = np.minimum(matched[0], others[0]), np.minimum(matched[1], others[1])
        return matched

    def _follow(
        self, thumbnail0: Components, thumbnail1: Components
    ) -> tuple[tuple[MotionField, MotionField], tuple[np.ndarray, np.ndarray]]:
        """Return the motion between two thumbnails, and how consistent it is, in both directions."""
        radius = math.ceil(SEARCH_RANGE * THUMBNAIL_SIDE)
        there, back = search_fused(thumbnail0, thumbnail1, radius, PATCH_RADIUS, "box", BANDWIDTH, MOTION_PENALTY)
        matched = _measure_consistency(thumbnail0, there, back), _measure_consistency(thumbnail1, back, there)
        return (there, back), matched


def unseen_planes(image: FrameCache, longer_side: int) -> list[np.ndarray]:
    """Return the planes that the components of an image's thumbnail leave out: hue, and alpha if any, (h, w) float32.

    Hue is half the difference of both colour differences, whose mean is one of the components.
    """
    small = view(image.cached(small_copy, longer_side))
    colours = small.chroma()
    hue = [(colours[0] - colours[1]) * np.float32(0.5 / 255)] if colours else []
    return [*hue, small.array()[..., -1]] if has_alpha(small) else hue


def _contradiction(similarity: np.ndarray, field: MotionField, here: np.ndarray, there: np.ndarray) -> float:
    """Return the largest loss of similarity of any patch by the difference from its match in another plane."""
    ends = np.arange(here.size) + _as_steps(field.flow.reshape(-1, 2), here.shape[1])
    side = 2 * PATCH_RADIUS + 1
    apart = np.square(here - there.take(ends).reshape(here.shape))
    alike = cv2.blur(cv2.exp(apart * np.float32(-0.5 / BANDWIDTH**2)), (side, side))
    return float((similarity * (1 - alike.reshape(here.shape))).max())


def _measure_consistency(thumbnail: Components, there: MotionField, back: MotionField) -> np.ndarray:
    """Return, by pixel, the match's similarity times that of the patch where the backward vector ends, (h, w)."""
    height, width = there.similarity.shape
    starts = np.arange(height * width)
    flow = there.flow.reshape(-1, 2)
    across = flow + back.flow.reshape(-1, 2).take(starts + _as_steps(flow, width), axis=0)
    looks_the_same = np.ones((height, width), np.float32)
    elsewhere = np.flatnonzero(across[:, 0] ** 2 + across[:, 1] ** 2 >= CONSISTENCY_TOLERANCE**2)
    if elsewhere.size:
        ends = elsewhere + _as_steps(across[elsewhere], width)
        patches = _sample_patches(thumbnail)
        apart = np.square(patches.take(ends, axis=0) - patches.take(elsewhere, axis=0)).sum(axis=2)
        looks_the_same.ravel()[elsewhere] = np.exp(-apart / (2 * STRICT_BANDWIDTH**2)).mean(axis=1)
    return there.similarity * looks_the_same


def _as_steps(vectors: np.ndarray, width: int) -> NDArray[np.intp]:
    """Return (N, 2) vectors of whole pixels as distances in an image whose rows are `width` pixels."""
    return np.asarray((vectors[:, 1] * np.float32(width) + vectors[:, 0]).astype(np.intp))


def _sample_patches(thumbnail: Components) -> np.ndarray:
    """Return (h * w, 9, 3) components of all patches: their centres, corners and edges suffice to tell them apart."""
    height, width = thumbnail.shape[:2]
    padded = cv2.copyMakeBorder(thumbnail, *(PATCH_RADIUS,) * 4, cv2.BORDER_REPLICATE)
    starts = range(0, 2 * PATCH_RADIUS + 1, PATCH_RADIUS)
    return np.stack([padded[y : y + height, x : x + width] for y in starts for x in starts], axis=2).reshape(-1, 9, 3)


SECONDS_COLUMN = "Start Time (seconds)"
"""Column of PySceneDetect's scene lists with the start of each scene. Their column of frames counts from 1."""


@dataclass(frozen=True)
class CutList(Checked):
    """Cut policy with the scene cuts of a list and no others; takes the place of a `CutDetector`.

    Parameters
    ----------
    positions : tuple of Position
        First frames of new scenes, counted from the first frame of the clip.

    Examples
    --------
    >>> cuts = CutList((Position(Fraction(5)), Position(Fraction(240), is_frame=True)))
    >>> str(cuts), cuts.counts_frames
    ('CutList of 2 cuts', True)
    """

    positions: tuple[Position, ...]

    def __str__(self) -> str:
        return f"CutList of {len(self.positions)} cuts"

    @property
    def counts_frames(self) -> bool:
        """Whether any position is a frame number."""
        return bool(self._frames)

    def match_score(self, image0: FrameCache, image1: FrameCache) -> float:
        """Return 0 if a listed cut lies between the two frames, else 1; 1 if a source position is unknown."""
        if image0.source_position is None or image1.source_position is None:
            return 1.0
        return float(self._count_cuts_until(image0.source_position) == self._count_cuts_until(image1.source_position))

    def is_cut(self, match_score: float, *neighbours: float) -> bool:
        """Return whether a listed cut lies within the pair, whose match score is 0 then."""
        return match_score == 0

    def is_gradual(self, match_score: float, *across: float) -> bool:
        """Return False: every listed cut is a cut."""
        return False  # every listed cut is a cut

    def is_flash(self, match_score: float, across: float, *neighbours: float) -> bool:
        """Return False: the list is taken as it is."""
        return False

    def _count_cuts_until(self, position: SourcePosition) -> int:
        """Return the number of listed cuts at or before a position in the clip."""
        seconds = position.seconds + TIME_TOLERANCE
        return bisect_right(self._frames, position.number) + bisect_right(self._seconds, seconds)

    @cached_property
    def _frames(self) -> list[Fraction]:
        """Cuts that are listed as frame numbers, increasing."""
        return sorted(place.value for place in self.positions if place.is_frame)

    @cached_property
    def _seconds(self) -> list[Fraction]:
        """Cuts that are listed as times, seconds, increasing."""
        return sorted(place.value for place in self.positions if not place.is_frame)


@checked
def read_cuts(path: PathName) -> CutList:
    """Read a list of cuts from a file.

    It has one position per line, as `Position.parse` reads it, and comments after ``#``, or is the list of scenes that
    PySceneDetect writes as CSV.

    Raises
    ------
    InputError
        The file cannot be read, or is not text.
    OptionError
        A line is not a position.
    """
    name = os.fspath(path)
    with explained(InputError, "read", name, "check `cuts`"):
        try:
            with open(path, encoding="utf-8-sig", newline="") as file:
                return CutList(tuple(_read_positions(file, name)))
        except UnicodeDecodeError:
            raise InputError(
                f"{name} is not a text file; give `cuts` a file with a time or frame on each line."
            ) from None


def _read_positions(lines: Iterable[str], name: str) -> Iterator[Position]:
    """Yield the positions of a list; of PySceneDetect's table, those in the column `SECONDS_COLUMN`."""
    column: int | None = None
    for number, line in enumerate(lines, 1):
        text = line.partition("#")[0].strip()
        fields = next(csv.reader([text]), [])
        if SECONDS_COLUMN in fields:
            column = fields.index(SECONDS_COLUMN)
        elif text and not text.startswith("Timecode List"):
            place = text if column is None else fields[column] if column < len(fields) else ""
            yield Position.parse(place, f"{name}, line {number}:")
