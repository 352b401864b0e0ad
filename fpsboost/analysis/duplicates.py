"""Detection of duplicate frames: animation on twos and threes, pulldown, frames that a capture missed.

Frames that repeat a picture form a group, between whose pictures motion is then interpolated evenly. The thresholds of
`DuplicateDetector` were measured on clips as people share them.
"""

import math
from collections import deque
from collections.abc import Generator, Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice, pairwise
from typing import Annotated, NamedTuple

import cv2
import numpy as np

from fpsboost.colour import has_alpha, normalised
from fpsboost.frame import Frame
from fpsboost.frame_cache import FrameCache, SourcePosition
from fpsboost.image import view
from fpsboost.motion.components import CHROMA_WEIGHT, Components, chroma, gray
from fpsboost.options import AnyDuplicates, Checked, PositiveInt, Range

ROUNDING = 0.01  # maximum error of differences by the rounding of sums, 8-bit levels
BAND_BLOCKS = 8  # height of the bands that are compared one after the other, blocks


@dataclass(frozen=True)
class DuplicateDetector(Checked):
    """Detector of duplicate frames: frames that show the same as an earlier one, up to the noise of an encoder.

    The difference of two frames is that of their most different block, so that a mouth that moves in a still picture
    counts. Encoder noise in a duplicate reaches a few levels there and cannot be told from a slow fade by itself; but
    where a picture is held between moves, the differences of the moves are several times as large.

    Parameters
    ----------
    noise : float
        Maximum difference of a duplicate, in 8-bit levels. In two clips as people share them, the noisiest duplicates
        differed by 5 levels, and pairs in motion by 10 and more.
    share : float
        Maximum difference of a duplicate, as a fraction of those before and after it; below 0.1 in these clips.
    smallest_step : float
        Minimum difference of two different pictures, in 8-bit levels; a smaller difference is invisible.
    block : int
        Side of the blocks in pixels.
    longest : Fraction
        Maximum duration of a held picture in seconds; a longer one is a still. Animation on fours lasts 1/6.
    most : int
        Maximum number of frames of a held picture; this many are kept in memory.

    Examples
    --------
    >>> detector = DuplicateDetector()
    >>> gradient = np.tile(np.arange(0, 192, 4, dtype=np.uint8), (32, 1))[..., np.newaxis].repeat(3, axis=2)
    >>> detector.difference(FrameCache(gradient), FrameCache(gradient + np.uint8(1)))  # noise of one level
    1.0
    >>> detector.is_held(1.0, before=16.0, after=16.0), detector.is_held(1.0, before=2.0, after=2.0)
    (True, False)
    """

    noise: Annotated[float, Range(0, 255, unit=" levels")] = 6.0
    share: Annotated[float, Range(0, below=1)] = 0.25
    smallest_step: Annotated[float, Range(above=0, most=255, unit=" levels")] = 3.0
    block: Annotated[int, Range(1, unit=" pixel")] = 16
    longest: Annotated[Fraction, Range(0, unit=" s")] = Fraction(1, 4)
    most: PositiveInt = 8

    @property
    def difference_limit(self) -> float:
        """Difference, in 8-bit levels, beyond which no decision depends on its exact value.

        That holds with noise of up to `noise` levels added to or taken from it.
        """
        largest_share = self.noise / self.share if self.share else math.inf
        return self.noise + max(largest_share, self.smallest_step) + ROUNDING

    def difference(self, image0: FrameCache, image1: FrameCache) -> float:
        """Return the mean difference in the block and the plane where it is largest, in 8-bit levels.

        The planes are luma, both colour differences, and alpha. The comparison ends once a block differs by more than
        `difference_limit`, so that chroma is read only where luma has hardly changed.
        """
        largest = 0.0
        for (plane0, unit), (plane1, _) in zip(compared_planes(image0), compared_planes(image1), strict=True):
            rows, columns = (
                max(1, round(self.block * length / whole))
                for length, whole in zip(plane0.shape, image0.pixels.shape[:2], strict=True)
            )
            for first, last in _bands(plane0.shape[0], BAND_BLOCKS * rows):
                around = slice(max(0, first - rows // 2), last + rows // 2)
                difference = cv2.absdiff(plane0[around], plane1[around])
                whole = cv2.CV_16U if rows * columns * 255 < 2**16 else cv2.CV_32S
                depth = whole if difference.dtype == np.uint8 else cv2.CV_32F
                sums = cv2.boxFilter(difference, depth, (columns, rows), normalize=False)
                most = sums[first - around.start :][: last - first].max()
                largest = max(largest, float(most / (rows * columns) * unit))
                if largest > self.difference_limit:
                    return largest
        return largest

    def is_held(self, noise: float, before: float, after: float) -> bool:
        """Return whether frames show one held picture.

        `noise` is the largest `difference` of any of them from the first; `before` and `after` are the differences from
        the previous picture and to the next one, all in 8-bit levels.
        """
        return noise <= self.noise and noise <= self.share * min(before, after) and self.smallest_step <= after

    def repeats_still(self, noise: float, before: float) -> bool:
        """Return whether frames that differ little repeat one picture; frames in slow motion differ as little.

        `noise` and `before` as in `is_held`; `before` is infinite if the clip begins with this picture.
        """
        return noise <= (self.smallest_step if math.isinf(before) else min(self.noise, self.share * before))


def detector_of(duplicates: AnyDuplicates) -> DuplicateDetector | None:
    """Return the detector of duplicates that are interpolated across; None if they are kept or left out."""
    return DuplicateDetector() if duplicates == "interpolate" else None


def _bands(rows: int, height: int) -> list[tuple[int, int]]:
    """Return the first row of each band and the row after its last, the band in the middle first.

    Most motion is there, and the comparison ends at the first large difference.
    """
    bands = [(first, min(first + height, rows)) for first in range(0, rows, height)]
    return sorted(bands, key=lambda band: abs(band[0] + band[1] - rows))


def compared_planes(frame: FrameCache) -> Iterator[tuple[Components, float]]:
    """Yield the planes in which a frame is compared, luma first, with the 8-bit levels per unit of each.

    Planes are up to a constant. Those of video are not copied; the others are computed when they are asked for.
    """
    image = view(frame.pixels)
    if image.coding is None:
        yield frame.derived(brightness), 1.0
        yield from ((plane, CHROMA_WEIGHT) for plane in frame.cached(chroma))
        if has_alpha(image):
            yield normalised(frame.array[..., -1]), 255.0
    else:
        _, luma_span, _, chroma_span = image.coding.levels
        units = 255 / luma_span, *(CHROMA_WEIGHT * 255 / chroma_span,) * 2
        yield from zip(image.channels(), units, strict=True)


def brightness(frame: FrameCache) -> Components:
    """Return gray levels on the 8-bit scale: integers for 8-bit images, unrounded and unclipped for others."""
    return frame.cached(gray) if frame.pixels.dtype == np.uint8 else view(frame.pixels).float_luma()


class SourceFrame(FrameCache):
    """Frame of the source, with the results computed from its image, which both pairs of the frame share.

    Parameters
    ----------
    frame : Frame
        The frame, as the source gives it.
    time : Fraction, optional
        Its presentation time, seconds; its own by default.
    output_position, source_position : optional
        See `FrameCache`.
    """

    def __init__(
        self,
        frame: Frame,
        time: Fraction | None = None,
        output_position: Fraction | None = None,
        source_position: SourcePosition | None = None,
    ) -> None:
        super().__init__(frame.image, output_position, source_position)
        self.frame = frame
        self.time = frame.time if time is None else time

    @property
    def position(self) -> SourcePosition:
        """Position of the frame in its clip."""
        assert self.source_position is not None, "known of every frame of a clip"
        return self.source_position


def group_duplicates(
    frames: Iterable[SourceFrame], detector: DuplicateDetector, step: float = math.inf
) -> Iterator[tuple[SourceFrame, ...]]:
    """Group duplicate frames; those of a still, and those at the end of the clip, form groups of one.

    Parameters
    ----------
    frames : iterable of SourceFrame
        Frames in presentation order. At most `detector.most` of them are read ahead.
    detector : DuplicateDetector
        Thresholds.
    step : float
        Difference of the first frame from the picture before it, in 8-bit levels; infinite at the beginning of a clip.

    Yields
    ------
    tuple[SourceFrame, ...]
        Tuples of frames; every frame is in one of them.
    """
    for picture in find_pictures(frames, detector, step):
        yield from zip(picture.frames) if picture.is_still else [picture.frames]


def find_synchronised(
    frames: Iterable[SourceFrame], detector: DuplicateDetector
) -> Iterator[tuple[SourceFrame, float]]:
    """Find the frames from which grouping continues in the same way whatever came before the first of the frames.

    All frames of a group differ by at most `noise` from its first one, and differences obey the triangle inequality:
    two consecutive frames that differ by more than twice the noise are never in one group. So the later one begins a
    group. Grouping continues from there by the difference from the group before, which is certain

    - if the earlier one begins a group, too: then it is the difference of the two;
    - if the difference of the two exceeds `difference_limit`, for it is smaller by the noise at most.

    Yields each frame with the `step` for `group_duplicates` to begin with it. A part of a conversion begins at such a
    frame.
    """
    apart = 2 * detector.noise + ROUNDING
    begins_before = False
    for before, frame in pairwise(frames):
        difference = detector.difference(before, frame)
        begins = difference > apart
        if begins and (begins_before or difference > detector.difference_limit):
            yield frame, difference
        begins_before = begins


class PictureRun(NamedTuple):
    """Consecutive frames that show one picture, or a part of them if it lasts long."""

    frames: tuple[SourceFrame, ...]
    """The frames, at least one."""
    is_still: bool
    """Whether it lasts longer than the detector allows, or until the clip ends, so that no motion follows it."""
    repeats: int
    """Number of frames, at the end of `frames`, that repeat the frame before them."""


def find_pictures(
    frames: Iterable[SourceFrame], detector: DuplicateDetector, step: float = math.inf
) -> Iterator[PictureRun]:
    """Find the frames that show the same picture; parameters as in `group_duplicates`, which reads as many ahead.

    Frames are compared with the first one of the picture and not with the previous one, so that a slow fade or pan is
    not taken for a held picture.
    """
    arriving = iter(frames)
    waiting: deque[SourceFrame] = deque()
    while _read_ahead(1, waiting, arriving):
        first = waiting.popleft()
        count, is_still, is_repeated, step = _find_run(first, step, waiting, arriving, detector)
        repeats = [waiting.popleft() for _ in range(count - 1)]
        yield PictureRun((first, *repeats), is_still, len(repeats) if is_repeated else 0)
        if is_still:
            step = yield from _rest_of_still(first, is_repeated, waiting, arriving, detector)


def _find_run(
    first: SourceFrame,
    step: float,
    waiting: deque[SourceFrame],
    arriving: Iterator[SourceFrame],
    detector: DuplicateDetector,
) -> tuple[int, bool, bool, float]:
    """Find the frames that show the same picture as `first`; those that are read ahead are appended to `waiting`.

    Returns how many there are, `first` included; whether they are a still; whether they repeat the first one, rather
    than differ slightly from it, as in slow motion; and the difference after them.
    """
    differences: list[float] = []
    while True:
        count = len(differences) + 1
        noise = max(differences, default=0.0)
        if not _read_ahead(count, waiting, arriving):  # the clip ends, and no motion follows
            return count, True, detector.repeats_still(noise, step), 0.0
        following = waiting[count - 1]
        lasts = following.time - first.time
        difference = detector.difference(first, following)
        if differences and detector.is_held(noise, step, difference):
            return count, lasts > detector.longest, True, difference
        differences.append(difference)
        if difference > detector.noise:  # motion, or a slow change that has added up
            return 1, False, True, differences[0]
        if count == detector.most or lasts > detector.longest:
            return count, True, detector.repeats_still(max(differences), step), difference


def _rest_of_still(
    first: SourceFrame,
    repeats: bool,
    waiting: deque[SourceFrame],
    arriving: Iterator[SourceFrame],
    detector: DuplicateDetector,
) -> Generator[PictureRun, None, float]:
    """Yield the frames that still show the same picture as `first`, one by one; return the difference after them."""
    while _read_ahead(1, waiting, arriving):
        difference = detector.difference(first, waiting[0])
        if difference > detector.noise:
            return difference
        yield PictureRun((waiting.popleft(),), True, int(repeats))
    return 0.0


def _read_ahead(count: int, waiting: deque[SourceFrame], arriving: Iterator[SourceFrame]) -> bool:
    """Append frames to those that wait until there are `count`, and return whether there are as many."""
    waiting.extend(islice(arriving, max(0, count - len(waiting))))
    return len(waiting) >= count
