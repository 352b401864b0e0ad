"""The convention in which a renderer's motion vectors are stored, found by fetching frames along them.

The right signs, directions and axes make one rendered frame out of the other. All that the channels allow are tried on
a few pairs of frames; the usual one of the channels' names is kept unless another is clearly better, so that still or
noisy frames decide nothing.
"""

from collections import defaultdict
from collections.abc import Iterable
from copy import copy
from itertools import product
from typing import NamedTuple, get_args

import cv2
import numpy as np

from fpsboost.colour import normalised
from fpsboost.image import Image
from fpsboost.remarks import Remarks
from fpsboost.render import Direction, StoredVectors, VectorConvention
from fpsboost.render.folder import VectorFolder

CLEARLY_BETTER = 0.8  # ratio of the errors of two conventions below which one is clearly better
MIN_SHARE_INSIDE = 0.5  # minimum share of the pixels whose motion ends within the frame
LARGEST_COLOUR = 4  # colours are clipped at this multiple of their mean, so that highlights do not decide alone


class RenderedPair(NamedTuple):
    """Two rendered frames and the stored vectors of both."""

    image0: Image
    image1: Image
    channels0: np.ndarray
    """Vectors of the first frame as stored, (H, W, 2 or 4) float32."""
    channels1: np.ndarray
    """Vectors of the second frame as stored."""
    distance: int
    """Number of vectors from one frame to the other."""


class VectorFit(NamedTuple):
    """Convention of motion vectors, and how well they fit the frames."""

    convention: VectorConvention
    """The convention that fits best."""
    error: float
    """Mean squared difference between each frame and the other one fetched along the vectors, in squared mean
    colours."""
    still_error: float
    """The same without motion, for comparison."""


def fit_vectors(folder: VectorFolder, frames: Iterable[tuple[tuple[int, Image], tuple[int, Image]]]) -> VectorFolder:
    """Return the vectors under the convention that connects the frames, with remarks where it is not the usual one.

    Parameters
    ----------
    folder : VectorFolder
        Returned as it is if its convention was given, or if it holds ``.flo`` files.
    frames : iterable of two (int, image)
        Pairs of rendered frames with their numbers, counted like output frames.
    """
    if folder.convention is not None or folder.is_flow:
        return folder
    pairs = []
    usual = None
    for (number0, image0), (number1, image1) in frames:
        channels0, usual = folder.channels_at(number0)
        channels1, _ = folder.channels_at(number1)
        folder.check_size(channels0, image0)
        folder.check_size(channels1, image1)
        pairs.append(RenderedPair(image0, image1, channels0, channels1, (number1 - number0) * folder.step))
    if usual is None:
        return folder
    fit = fit_convention(pairs, usual)
    fitted = copy(folder)
    fitted.convention = fit.convention
    fitted.remarks = Remarks(folder.remarks)
    if fit.convention != usual:
        fitted.remarks.add("vectors-convention", name=folder.path, convention=fit.convention)
    if fit.error > fit.still_error:
        fitted.remarks.add("vectors-unlike-motion", name=folder.path)
    return fitted


def fit_convention(pairs: Iterable[RenderedPair], usual: VectorConvention) -> VectorFit:
    """Find the convention under which vectors connect the frames; the names of channels suggest the `usual` one.

    All directions and signs that the channels allow are compared by the mean squared difference between each frame and
    the other one fetched along the vectors. Of those that fit about as well as the best, the one nearest to `usual` is
    taken.
    """
    errors = defaultdict[tuple[int, StoredVectors], float](float)
    still = 0.0
    count = len(usual.pairs)
    meanings = [StoredVectors(*meaning) for meaning in product(get_args(Direction), (1, -1), (1, -1))]
    for pair in pairs:
        ends = _comparable(pair.image0), _comparable(pair.image1)
        still += float(((ends[0] - ends[1]) ** 2).mean())
        for number, meaning in product(range(count), meanings):
            from_first = meaning.direction == "forward"
            here, there = ends if from_first else ends[::-1]
            channels = (pair.channels0 if from_first else pair.channels1)[..., 2 * number : 2 * number + 2]
            errors[number, meaning] += _fetch_error(here, there, meaning.read(channels) * np.float32(pair.distance))

    def error_of(chosen: tuple[StoredVectors, ...]) -> float:
        return sum(errors[meaning] for meaning in enumerate(chosen)) / count

    def changes(chosen: tuple[StoredVectors, ...]) -> int:
        return int((np.array(chosen) != np.array(usual.pairs)).sum())

    # no two pairs of channels lead to the same frame
    choices = [each for each in product(meanings, repeat=count) if len({pair.direction for pair in each}) == count]
    best = min(map(error_of, choices))
    # of those that fit about as well as the best one, the most similar to the usual one
    as_good = [chosen for chosen in choices if CLEARLY_BETTER * error_of(chosen) <= best]
    chosen = min(as_good, key=lambda chosen: (changes(chosen), error_of(chosen)))
    return VectorFit(VectorConvention(chosen), error_of(chosen), still)


def _comparable(image: Image) -> np.ndarray:
    """Return the colours of an image in units of their mean, (H, W, C) float32."""
    colours = normalised(image)
    return (colours / max(float(np.abs(colours).mean()), 1e-6)).clip(-LARGEST_COLOUR, LARGEST_COLOUR)


def _fetch_error(here: np.ndarray, there: np.ndarray, motion: np.ndarray) -> float:
    """Return the mean squared difference between a frame and the other one fetched along the motion.

    Pixels whose motion leaves the frame are left out; if most do, the error is that without motion.
    """
    height, width = motion.shape[:2]
    rows, columns = np.mgrid[:height, :width].astype(np.float32)
    x = columns + motion[..., 0]
    y = rows + motion[..., 1]
    inside = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    if inside.mean() < MIN_SHARE_INSIDE:
        return float(((there - here) ** 2).mean())
    fetched = cv2.remap(there, x, y, cv2.INTER_LINEAR).reshape(here.shape)
    return float(((fetched - here)[inside] ** 2).mean())
