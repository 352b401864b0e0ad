"""Masks: areas of the frames that stay as they are, such as HUDs, titles, logos and subtitles that are burnt in.

What stays is that of the source frame that is nearest in time, in the pixels or the planes of the video itself. Or it
is a layer: every frame is then divided into what is behind, filled from its surroundings where the mask hides it, and
the layer, whose alpha is the mask. Motion is found in either without the other. Where the mask stands still, only parts
of the layer that move as a whole are moved, and the rest is that of the nearer frame, as digits that change.
"""

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Self

import cv2
import numpy as np

from fpsboost.colour import has_alpha, normalised
from fpsboost.errors import InputError, OptionError, explained
from fpsboost.frame import ClipInfo
from fpsboost.frame_cache import FrameCache
from fpsboost.image import Pixels, rounding_offset, view
from fpsboost.io.images.files import read_image
from fpsboost.io.images.sequence import NumberedImages
from fpsboost.io.images.source import find_images
from fpsboost.io.opening import stands_for_images
from fpsboost.io.video.ycc import in_coding, turned_upright
from fpsboost.layered import FrameImage, LayeredImage
from fpsboost.options import MaskAs, PathName, checked
from fpsboost.synthesis import InterpolatedImage
from fpsboost.synthesis.agreement import mix_by_weight


class Mask:
    """Mask of a clip: one image for all of its frames, or one for each.

    White stays as in the source frame that is nearest in time, black is interpolated, and gray mixes the two. The luma
    of an image counts, in 8 bits; what is transparent counts as black.

    Parameters
    ----------
    mask : str or os.PathLike
        An image, or a folder or pattern of images (``mask_####.png``), the first of which is for the first frame of
        the clip, whatever their numbers. They have the size of the frames as they are displayed: a video that is
        turned by its tag takes masks that are upright.
    mask_as : {'keep', 'layer'}
        Keep white areas as in the nearest frame, or interpolate them as a layer, apart from the picture behind them.

    Attributes
    ----------
    files : list of Path
        All images, with absolute paths.
    counts_frames : bool
        Whether every frame has a mask of its own.
    parts : tuple of functions
        `background` and `layer`, if these are interpolated by themselves.

    Raises
    ------
    InputError
        There is no such folder or sequence, or an image is missing from it. Images are read when the mask is fitted.

    Examples
    --------
    >>> Mask("hud.png").counts_frames  # doctest: +SKIP
    False
    """

    _from_upright: tuple[int, ...] | None = None  # inverse of the display matrix of the clip that it is fitted to
    _weights: np.ndarray | None = None  # of all frames of that clip, if all have the same

    @checked
    def __init__(self, mask: PathName, *, mask_as: MaskAs = "keep") -> None:
        self.parts = () if mask_as == "keep" else (self.background, self.layer)
        self._name = str(Path(mask).absolute())  # a job may be taken to another process
        self.counts_frames = stands_for_images(self._name)
        with explained(InputError, "read", self._name, "check `mask`"):
            images = find_images(self._name) if self.counts_frames else NumberedImages([Path(self._name)])
        images.check_complete(images.step, "add it, because every frame has a mask of its own")
        self.files = [file.absolute() for file in images.files]

    def __str__(self) -> str:
        """Return what it does, without the path, by which the parts of a conversion tell whether they do the same."""
        return f"one mask{' for each frame' if self.counts_frames else ''}{', as a layer' if self.parts else ''}"

    def fitted(self, info: ClipInfo, matrix: tuple[int, ...] | None, times: Sequence[Fraction] | None) -> Self:
        """Return the mask for a clip; see `fpsboost.interpolator.FrameMask`."""
        if self.counts_frames and times is not None and len(times) != len(self.files):
            raise InputError(
                f"The number of masks in {self._name}, {len(self.files)}, is not that of the frames of {info.name}, "
                f"{len(times)}; give `mask` one image for each, or one for all."
            )
        fitted = type(self)(self._name, mask_as="layer" if self.parts else "keep")
        fitted._from_upright = matrix and (matrix[0], matrix[3], 0, matrix[1], matrix[4])
        weights = fitted._read(np.empty((info.height, info.width)), 0)
        fitted._weights = None if self.counts_frames else weights
        return fitted

    def weight(self, frame: FrameCache) -> np.ndarray:
        """Return where a frame of the source is kept, (H, W) float32, 0 to 1."""
        number = frame.source_position.number if self.counts_frames and frame.source_position else 0
        return frame.cached(self._read, number) if self._weights is None else self._weights

    def _read(self, pixels: Pixels, number: int) -> np.ndarray:
        """Return the weights for the pixels of a frame, by its number in the clip; for `FrameCache.cached`."""
        if number >= len(self.files):
            raise InputError(
                f"The number of masks in {self._name} is {len(self.files)}, and there is none for frame {number}, "
                "counted from 0; give `mask` one image for each, or one for all."
            )
        levels = turned_upright(view(read_image(self.files[number])).gray()[..., np.newaxis], self._from_upright)
        if levels.shape[:2] != pixels.shape[:2]:
            turned = " when it is turned as the frames are stored" if self._from_upright else ""
            raise InputError(
                f"{self.files[number]} is {levels.shape[1]}x{levels.shape[0]}{turned}, and the frames are "
                f"{pixels.shape[1]}x{pixels.shape[0]}; make the mask of the size at which they are displayed."
            )
        return levels[..., 0] / np.float32(255)

    def keep(self, made: InterpolatedImage, nearest: FrameCache) -> InterpolatedImage:
        """Return an image with the areas of a frame of the source that are kept, which are certain."""
        weights = self.weight(nearest)
        # where the light changes, frames of planes are made in BGR
        kept = _put_over(view(made.image).picture, view(nearest.image).picture, weights)
        confidence = None if made.confidence is None else np.maximum(made.confidence, weights)
        return InterpolatedImage(_with_picture(made.image, kept), confidence)

    def background(self, frame: FrameCache) -> FrameCache:
        """Return what is behind the mask: where it hides that, the nearest pixels around it."""
        image = view(frame.image).picture
        weights = self.weight(frame)

        def filled(plane: np.ndarray) -> np.ndarray:
            hidden = (cv2.resize(weights, plane.shape[1::-1], interpolation=cv2.INTER_AREA) > 0).astype(np.uint8)
            hidden[0, 0] = 0  # there may be no other
            _, nearest = cv2.distanceTransformWithLabels(hidden, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
            return np.asarray(plane[hidden == 0][nearest - 1])  # those that are not hidden are numbered row by row

        return frame.with_image(_with_picture(frame.image, mix_by_weight(image, view(image).map(filled), weights)))

    def layer(self, frame: FrameCache) -> FrameCache:
        """Return what the mask shows, in BGR if it was in planes, with the mask as alpha."""
        colours = view(view(frame.image).to_bgr())
        weights = self.weight(frame)[..., np.newaxis]
        if has_alpha(colours):
            raise OptionError("`mask_as='layer'` needs frames without alpha; leave it out.")
        alpha = np.asarray(weights * colours.white + rounding_offset(colours.picture)).astype(colours.dtype)
        # alpha of float is premultiplied
        layer = np.dstack([colours.array() * (weights if alpha.dtype == np.float32 else 1), alpha])
        return frame.with_image(_with_picture(frame.image, layer))

    def composite(self, behind: InterpolatedImage, shown: InterpolatedImage) -> InterpolatedImage:
        """Return a background with a layer over it; see `fpsboost.interpolator.FrameMask`."""
        layer = view(shown.image).array()
        colours = layer[..., :-1]
        alpha = normalised(layer[..., -1]).clip(0, 1)
        if layer.dtype == np.float32:
            colours = colours / np.maximum(alpha, np.float32(1e-6))[..., np.newaxis]
        return InterpolatedImage(
            _with_picture(behind.image, _put_over(view(behind.image).picture, colours, alpha)),
            None if behind.confidence is None else behind.confidence * (1 - alpha) + shown.confidence * alpha,
        )


def _put_over(image: Pixels, other: Pixels, weights: np.ndarray) -> Pixels:
    """Return an image with another one mixed in; if one of them has planes and the other colours, in planes."""
    coding = view(image).coding or view(other).coding
    return mix_by_weight(in_coding(image, coding), in_coding(other, coding), weights)


def _with_picture(image: FrameImage, picture: Pixels) -> FrameImage:
    """Return a picture as one of scene-linear colours if an image is that."""
    return replace(image, colour=view(picture).array()) if isinstance(image, LayeredImage) else picture
