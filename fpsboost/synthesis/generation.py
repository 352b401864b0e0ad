"""Images of any synthesizer, with layers and confidence; those of a user's synthesizer are checked."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import cv2
import numpy as np

from fpsboost.errors import OptionError
from fpsboost.image import ImageView, view
from fpsboost.layered import FrameImage, LayeredImage
from fpsboost.synthesis import FramePair, FusesHypotheses, InterpolatedImage, Synthesizer
from fpsboost.synthesis.agreement import measure_agreement
from fpsboost.synthesis.layers import MixesLayers


def generate(
    synthesizer: Synthesizer,
    frame_pair: FramePair,
    layered: tuple[LayeredImage, LayeredImage] | None,
    times: Sequence[float],
    *,
    with_confidence: bool = False,
) -> Iterator[InterpolatedImage]:
    """Generate images, with the layers that the frames have, and with their confidence if it is asked for."""
    images: Iterator[FrameImage]
    if layered is None and with_confidence and isinstance(synthesizer, FusesHypotheses):
        return synthesizer.fuse(frame_pair, times)
    if layered is None:
        images = _checked_images(synthesizer, frame_pair, times)
    elif isinstance(synthesizer, MixesLayers):
        images = synthesizer.synthesize_layers(frame_pair, layered, times)
    else:
        raise OptionError("The method makes no layers beside the picture; choose nlm, or give `passes='beauty'`.")
    if not with_confidence:
        return map(InterpolatedImage, images)
    if isinstance(synthesizer, FusesHypotheses):
        confidences = (fused.confidence for fused in synthesizer.fuse(frame_pair, times))
    else:
        confidences = (measure_agreement(frame_pair, t) for t in times)
    return map(InterpolatedImage, images, confidences)


def _checked_images(synthesizer: Synthesizer, frame_pair: FramePair, times: Sequence[float]) -> Iterator[Any]:
    """Yield the images of a synthesizer, which may be a user's; raise `OptionError` unless they are like the frames."""
    image0 = frame_pair.image0
    image1 = frame_pair.image1
    frame = image0.pixels
    told = (
        f"The synthesizer {type(synthesizer).__name__} must yield an image for every time, like "
        f"`frame_pair.image0.array`: of shape {frame.shape} and {frame.dtype}"
    )
    made = synthesizer.synthesize(frame_pair, times)
    images = iter(made if isinstance(made, Iterable) else ())
    for number in range(len(times)):
        image = next(images, images)
        if image is images:
            raise OptionError(f"{told}; it has yielded {number} for {len(times)} times.")
        if not isinstance(image, np.ndarray | ImageView):
            raise OptionError(f"{told}, not {type(image).__name__}.")
        if (image.shape, image.dtype, view(image).coding) != (frame.shape, frame.dtype, view(frame).coding):
            raise OptionError(f"{told}, not {image.shape} and {image.dtype}.")
        if image.dtype == np.float32:
            # every eighth pixel shows another scale; nothing compares with NaN
            limit = 16 * (1 + image0.cached(cv2.norm, cv2.NORM_INF) + image1.cached(cv2.norm, cv2.NORM_INF))
            if cv2.norm(view(image).array()[::8, ::8], cv2.NORM_INF) > limit:
                raise OptionError(f"{told}, in the range of the frames, in which white is 1.0, and not 255.")
        yield image
