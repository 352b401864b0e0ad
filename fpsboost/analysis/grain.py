"""Grain matching: interpolated frames get back the noise that the mixture of several pixels has removed.

A mean of two independent samples keeps half of their variance, and a mean of many hypotheses less, so that in a noisy
clip every interpolated frame is smoother than its neighbours and the picture pulses. The missing part of the noise is
measured and synthesized, as film grain is in AV1 (Norkin and Birkbeck, Film Grain Synthesis for AV1 Video Codec, DCC
2018, doi:10.1109/DCC.2018.00008): a noise level function (Liu et al., Automatic Estimation and Removal of Noise from a
Single Image, TPAMI 2008, doi:10.1109/TPAMI.2007.1176) from flat blocks gives its strength, and a power spectrum its
coarseness. No pixel is copied from a frame.

Flat blocks are those with the least contrast among the blocks of similar intensity. What the two frames have in common
there, along the motion, is texture and no noise. Blocks are chosen by the other frame's contrast: its noise is
independent, so that the choice does not favour blocks that happen to have little noise. Texture that moves without
being followed cannot be told from grain, unless there are flatter parts.

Float images are linear light, in which noise grows with the intensity: they are measured as square roots, whose noise
has one variance if it is that of counted photons or paths (Anscombe, Biometrika 1948, doi:10.1093/biomet/35.3-4.246).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from fpsboost.image import Pixels, view
from fpsboost.motion.field import MotionField

BLOCK_SIZE = 16
"""Side of the blocks in which noise is measured, samples of a plane."""

BLOCK_SPACING = 8  # distance between blocks, samples

MAX_BLOCKS = 1024
"""Number of blocks of a plane above which only every second, third... is measured."""
MAX_FLAT_BLOCKS = 256
"""Number of flat blocks of a plane above which only every second, third... is measured."""

MAX_LEVELS = 8
"""Maximum number of intensities at which noise is measured."""
MIN_BLOCKS_PER_LEVEL = 64
"""Minimum number of blocks for each intensity."""

FLATTEST_SHARE = 0.05
"""Share of an intensity's blocks that are its flattest."""
MAX_CONTRAST_RATIO = 2.0
"""How many times the variance of the flattest blocks a flat block may have: the noise of one intensity has one
variance, and textures have many."""

MAX_CORRELATION = 0.35  # correlation of two frames along the motion above which a block shows texture rather than noise
MAX_COHERENCE = 0.35  # coherence of gradients above which a block shows an edge, 0 to 1
MIN_FLAT_BLOCKS = 12  # minimum number of flat blocks of an intensity at which its noise counts as known

MAX_VARIANCE_RATIO = 4.0
"""Ratio of an intensity's noise variance to the lowest of the plane's, and to that of the other frame, above which it
is not believed: texture varies more with the intensity than noise does."""

MIN_RELATIVE_VARIANCE = 1e-9
"""Variance, as a share of the squared intensity, below which a surface is constant, as black bars and clipped white
are: its missing noise has no meaning for other surfaces."""

MIN_DEVIATION = 0.5
"""Standard deviation of missing noise below which none is added to whole-numbered samples, code values."""

LEVELS = 256
"""Number of intensities at which noise levels are tabulated."""


class FlatBlocks(NamedTuple):
    """Flat blocks of one plane of a frame."""

    corners: np.ndarray  # (n, 2) int: row and column of the first sample
    motion: np.ndarray  # (n, 2) float32: rows and columns to the other frame
    residuals: np.ndarray  # (n, size, size) float32: samples without their linear trend
    intensities: np.ndarray  # (n,) float32: mean intensity
    level: np.ndarray  # (n,) int: number of the intensity that the block belongs to, from 0


class Plane(NamedTuple):
    """One plane of an image."""

    values: np.ndarray  # (rows, columns) float32: as the image has them
    samples: np.ndarray  # (rows, columns) float32: on a scale on which noise depends little on the intensity
    intensity: np.ndarray
    """(rows, columns) float32: what the noise depends on, luma for chroma and else the samples."""


@dataclass(frozen=True)
class PairGrain:
    """Grain of two frames, measured once per pair and used for all frames between them."""

    blocks: list[tuple[FlatBlocks, FlatBlocks]]  # flat blocks of each plane in frame 0 and in frame 1
    mixing: np.ndarray
    """(planes, planes) float32: factors that make correlated noise of independent noise; see `_mixing`."""


def measure_grain(image0: Pixels, image1: Pixels, field01: MotionField, field10: MotionField) -> PairGrain:
    """Find the flat blocks of two frames, and the noise in them, by the motion between them.

    Parameters
    ----------
    image0, image1 : array or YCbCrImage
        Two frames of one size and type.
    field01, field10 : MotionField
        Motion in both directions, by which blocks are compared with the same surface in the other frame.
    """
    planes0 = _planes(image0)
    planes1 = _planes(image1)
    blocks = [
        (_find_flat_blocks(plane0, plane1, field01), _find_flat_blocks(plane1, plane0, field10))
        for plane0, plane1 in zip(planes0, planes1, strict=True)
    ]
    return PairGrain(blocks, _mixing(planes0, blocks))


def match_grain(image: Pixels, grain: PairGrain, t: float, seed: Sequence[int]) -> Pixels:
    """Return an in-between frame with as much noise as the two frames have.

    It is unchanged where these have no noise, and where black or white is clipped.

    Parameters
    ----------
    image : array or YCbCrImage
        In-between frame, of the same size and type as the two frames.
    grain : PairGrain
        Noise of the two frames, see `measure_grain`.
    t : float
        Time of the frame, in (0, 1).
    seed : sequence of int
        Seed of the random numbers: the same seed gives the same noise, so that a conversion can be repeated.
    """
    planes = _planes(image)
    random = np.random.default_rng(seed)
    white = [random.standard_normal(plane.samples.shape, np.float32) for plane in planes]
    if grain.mixing.size:
        white = list(np.tensordot(grain.mixing, np.stack(white), 1))
    lowest, highest = view(image).value_range
    least = 0.0 if image.dtype == np.float32 else MIN_DEVIATION
    compared = [
        [_compare(plane, flat, distance) for flat, distance in zip(blocks, (t, 1 - t), strict=True)]
        for plane, blocks in zip(planes, grain.blocks, strict=True)
    ]
    lowest_variances = [min(each.lowest for each in comparisons) for comparisons in compared]
    if view(image).luma is None:  # channels of colours are alike in noise, and luma and chroma are not
        lowest_variances = [min(lowest_variances)] * len(planes)
    grainy = []
    for plane, comparisons, noise, variance in zip(planes, compared, white, lowest_variances, strict=True):
        missing = _find_missing_noise(comparisons, t, least, MAX_VARIANCE_RATIO * variance)
        if missing is None:
            grainy.append(plane.values)
            continue
        deviation = missing.at(plane.intensity)
        deviation[(plane.values <= lowest) | (plane.values >= highest)] = 0
        added = deviation * cv2.filter2D(noise, -1, missing.kernel, borderType=cv2.BORDER_REFLECT)
        grainy.append(_add_squared(plane, added, deviation) if image.dtype == np.float32 else plane.values + added)
    if image.dtype != np.float32:
        grainy = [np.rint(values.clip(lowest, highest)).astype(image.dtype) for values in grainy]
    return view(image).with_channels(grainy)


def _planes(image: Pixels) -> list[Plane]:
    """Return the planes of an image that hold noise: luma and chroma, or all channels but alpha."""
    channels = [channel.astype(np.float32) for channel in view(image).channels()]
    if view(image).luma is not None:
        luma, *chroma = channels
        rows, columns = chroma[0].shape
        small = cv2.resize(luma, (columns, rows), interpolation=cv2.INTER_AREA)
        return [Plane(luma, luma, luma), *(Plane(plane, plane, small) for plane in chroma)]
    samples = [np.sqrt(np.maximum(each, 0)) for each in channels] if image.dtype == np.float32 else channels
    return [Plane(channel, sample, sample) for channel, sample in zip(channels, samples, strict=True)]


def _add_squared(plane: Plane, added: np.ndarray, deviation: np.ndarray) -> np.ndarray:
    """Add noise to the square roots of linear light; the mean stays, and nothing becomes darker than black."""
    roots = np.where(deviation > 0, plane.samples, 0)  # infinity, which has no noise, times 0 is no number
    change = 2 * roots * added + np.square(added) - np.square(deviation)
    return np.asarray(np.maximum(plane.values + change, np.minimum(plane.values, 0)))


def _find_flat_blocks(plane: Plane, other: Plane, field: MotionField) -> FlatBlocks:
    """Find the flat blocks of a plane, whose motion leads to the other frame's plane."""
    corners, motion = _block_grid(plane.samples.shape, field)
    residuals, inside = _residuals(plane.samples, corners)
    others, inside_other = _residuals(other.samples, corners + np.rint(motion).astype(int))
    inside &= inside_other
    corners, motion, residuals, others = (each[inside] for each in (corners, motion, residuals, others))
    variance, contrast = (np.square(each).mean(axis=(1, 2)) for each in (residuals, others))
    common = (residuals * others).mean(axis=(1, 2))
    is_noise = (common <= MAX_CORRELATION * np.sqrt(variance * contrast)) & (_coherence(residuals) <= MAX_COHERENCE)
    intensities = _blocks(plane.intensity, corners).mean(axis=(1, 2))
    count = int(np.clip(len(corners) // MIN_BLOCKS_PER_LEVEL, 1, MAX_LEVELS))
    level = (np.argsort(np.argsort(intensities, kind="stable")) * count) // max(len(corners), 1)
    chosen = np.zeros(len(corners), bool)
    for each in range(count):
        of_level = level == each
        if of_level.any():
            flattest = np.quantile(contrast[of_level], FLATTEST_SHARE)
            chosen |= of_level & is_noise & (contrast <= MAX_CONTRAST_RATIO * flattest)
    chosen = _thinned(np.flatnonzero(chosen), MAX_FLAT_BLOCKS)
    return FlatBlocks(corners[chosen], motion[chosen], residuals[chosen], intensities[chosen], level[chosen])


def _thinned(items: np.ndarray, most: int) -> np.ndarray:
    """Return every second, third... item, so that there are no more than `most`."""
    return items[:: max(-(-len(items) // most), 1)]


def _block_grid(size: tuple[int, ...], field: MotionField) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of blocks side by side, and the motion of their centres, (n, 2) as rows and columns."""
    rows, columns = (np.arange(0, length - BLOCK_SIZE + 1, BLOCK_SPACING) for length in size)
    corners = np.stack(np.meshgrid(rows, columns, indexing="ij"), -1).reshape(-1, 2)
    corners = _thinned(corners, MAX_BLOCKS)
    subsampling = np.array([round(whole / part) for whole, part in zip(field.shape, size, strict=True)])
    centres = (corners + BLOCK_SIZE // 2) * subsampling // field.spacing
    return corners, field.vectors[centres[:, 0], centres[:, 1], ::-1] / subsampling


def _residuals(plane: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the samples of blocks without their linear trend, and whether each block lies within the plane."""
    limit = np.array(plane.shape) - BLOCK_SIZE
    inside = ((corners >= 0) & (corners <= limit)).all(axis=1)
    blocks = _blocks(plane, corners.clip(0, limit))
    inside &= np.isfinite(blocks).all(axis=(1, 2))
    blocks[~inside] = 0
    blocks = blocks - blocks.mean(axis=(1, 2), keepdims=True)
    ramp = np.arange(BLOCK_SIZE, dtype=np.float32) - np.float32((BLOCK_SIZE - 1) / 2)
    ramp /= np.sqrt(np.square(ramp).sum() * BLOCK_SIZE)
    for slope in (ramp[:, np.newaxis], ramp[np.newaxis]):
        blocks -= (blocks * slope).sum(axis=(1, 2), keepdims=True) * slope
    return blocks, inside


def _blocks(plane: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return a copy of the samples of blocks, (n, size, size) float32."""
    if not len(corners):  # such as in an image smaller than a block
        return np.empty((0, BLOCK_SIZE, BLOCK_SIZE), np.float32)
    return np.asarray(sliding_window_view(plane, (BLOCK_SIZE, BLOCK_SIZE))[corners[:, 0], corners[:, 1]])


def _coherence(blocks: np.ndarray) -> np.ndarray:
    """Return how far the gradients of each block have one direction, 0 to 1: 0 in noise, 1 at a straight edge."""
    # central differences: those to the next sample would share one, and correlate in noise
    down = blocks[:, 2:, 1:-1] - blocks[:, :-2, 1:-1]
    across = blocks[:, 1:-1, 2:] - blocks[:, 1:-1, :-2]
    yy, xx, xy = (np.sum(one * other, axis=(1, 2)) for one, other in ((down, down), (across, across), (down, across)))
    return np.asarray(np.hypot(yy - xx, 2 * xy) / np.maximum(yy + xx, np.finfo(np.float32).tiny))


def _mixing(planes: list[Plane], blocks: list[tuple[FlatBlocks, FlatBlocks]]) -> np.ndarray:
    """Return factors that give independent noise of all planes the correlation that it has in frame 0.

    (planes, planes) float32; empty if planes differ in size, as subsampled chroma does, or no block is flat.
    """
    corners = np.concatenate([each.corners for each, _ in blocks])
    if len({plane.samples.shape for plane in planes}) > 1 or not len(corners):
        return np.empty((0, 0), np.float32)
    residuals = np.stack([_residuals(plane.samples, corners)[0].ravel() for plane in planes]).astype(np.float64)
    covariance = residuals @ residuals.T
    scale = np.sqrt(np.diag(covariance)) + np.finfo(np.float64).tiny
    # a small part of independent noise keeps the matrix positive definite for equal channels, as of gray pictures
    correlation = covariance / np.outer(scale, scale) * (1 - 1e-6)
    np.fill_diagonal(correlation, 1)
    return np.linalg.cholesky(correlation).astype(np.float32)


class MissingNoise(NamedTuple):
    """Noise that an in-between frame lacks: its strength by intensity, and its spectrum as a filter."""

    intensities: np.ndarray  # (LEVELS,) float32, rising by equal steps
    deviations: np.ndarray  # (LEVELS,) float32: standard deviation at each intensity
    kernel: np.ndarray  # (size, size) float32: filter that makes it of white noise, of norm 1

    def at(self, intensity: np.ndarray) -> np.ndarray:
        """Return the standard deviation at each sample, float32."""
        low = self.intensities[0]
        step = self.intensities[1] - self.intensities[0]
        places = np.nan_to_num((intensity - low) / step + np.float32(0.5))
        return np.asarray(self.deviations[places.clip(0, LEVELS - 1).astype(np.intp)])


class NoiseComparison(NamedTuple):
    """Noise in the flat blocks of a frame, and on the same surfaces of an in-between frame."""

    residuals: np.ndarray  # (n, size, size) float32: of the frame
    left: np.ndarray  # (n, size, size) float32: of the in-between frame
    missing: list[tuple[float, float]]  # rising intensities, and the variance that is missing at each
    lowest: float  # the lowest of these variances where the frame is not constant; infinite if it is everywhere


def _compare(plane: Plane, flat: FlatBlocks, distance: float) -> NoiseComparison:
    """Compare the noise of a frame with that of an in-between frame's plane, which is `distance` intervals away."""
    left, inside = _residuals(plane.samples, flat.corners + np.rint(flat.motion * distance).astype(int))
    missing = []
    lowest = np.inf
    for each in range(MAX_LEVELS):
        of_level = inside & (flat.level == each)
        if of_level.sum() < MIN_FLAT_BLOCKS:
            continue
        there, here = (np.median(np.square(blocks[of_level]).mean(axis=(1, 2))) for blocks in (flat.residuals, left))
        intensity = float(flat.intensities[of_level].mean())
        variance = max(float(there - here), 0.0)
        missing.append((intensity, variance))
        if there > MIN_RELATIVE_VARIANCE * intensity * intensity:
            lowest = min(lowest, variance)
    return NoiseComparison(flat.residuals[inside], left[inside], missing, lowest)


def _find_missing_noise(
    comparisons: Sequence[NoiseComparison], t: float, least: float, most: float
) -> MissingNoise | None:
    """Combine the comparisons with both frames; None if the missing deviation is nowhere above `least`.

    `most` is the highest variance that is added.
    """
    window = np.outer(*2 * (np.hanning(BLOCK_SIZE + 2)[1:-1].astype(np.float32),))
    usable = [(each, share) for each, share in zip(comparisons, (1 - t, t), strict=True) if each.missing]
    if not usable:
        return None
    measured = [level for each, _ in usable for level, _ in each.missing]
    low = min(measured)
    high = max(measured)
    smallest = LEVELS * float(np.finfo(np.float32).eps) * max(abs(high), 1.0)  # steps that float32 tells apart
    intensities = np.linspace(low, max(high, low + smallest), LEVELS, dtype=np.float32)
    spectrum = np.zeros(window.shape, np.float32)
    curves = []
    for each, share in usable:
        levels, variances = np.array(each.missing).T
        curves.append(np.interp(intensities, levels, np.minimum(variances, most)).astype(np.float32))
        there, here = (
            np.square(np.abs(np.fft.fft2(blocks * window))).sum(axis=0) for blocks in (each.residuals, each.left)
        )
        spectrum += np.float32(share) * (there - here)
    limited = [np.minimum(curve, MAX_VARIANCE_RATIO * other) for curve, other in zip(curves, curves[::-1], strict=True)]
    missing = np.float32(1 - t) * limited[0] + np.float32(t) * limited[-1]
    missing[missing < least * least] = 0
    spectrum = np.maximum(spectrum, 0)
    # the lowest frequency was removed together with the linear trend
    spectrum[0, 0] = (spectrum[0, 1] + spectrum[1, 0]) / 2
    kernel = np.fft.fftshift(np.fft.ifft2(np.sqrt(spectrum)).real)
    norm = np.sqrt(np.square(kernel).sum())
    if norm == 0 or not missing.any():
        return None
    return MissingNoise(intensities, np.sqrt(missing), (kernel / norm).astype(np.float32))
