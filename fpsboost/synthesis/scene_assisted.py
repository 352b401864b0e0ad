"""Scene-assisted interpolation (Yang et al. 2011): every in-between pixel is looked up along the renderer's vectors.

It serves as a baseline for scenes whose motion is known, and shows where known motion does not suffice: shading,
shadows, reflections and refractions do not move with the surfaces.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from fpsboost.colour import premultiplied
from fpsboost.frame_cache import FrameCache
from fpsboost.image import Image, as_image
from fpsboost.motion.field import ends_inside
from fpsboost.motion.rendered import FrameVectors, RenderedVectors, frame_number, output_frame_between
from fpsboost.options import Checked, Range
from fpsboost.synthesis import FramePair, InterpolatedImage
from fpsboost.synthesis.agreement import measure_agreement_along
from fpsboost.synthesis.blend import Blend

Flow = NDArray[Any]
"""Motion from an in-between frame to one of the two frames, (H, W, 2) float32."""


@dataclass(frozen=True)
class SceneAssisted(Checked):
    """Lookup of both frames along the in-between frame's own motion vectors (section 2.2 of the report).

    The renderer provides everything of the in-between frame but its shading. Its vectors point to the adjacent output
    frames and are extrapolated linearly if the two frames are farther away. Pixels that both frames show are blended in
    time; positions that are outside of a frame or occluded are ignored; if both are ignored, both are blended.

    Parameters
    ----------
    vectors : RenderedVectors
        Motion vectors; with depth, occlusion is detected.
    depth_tolerance : float
        A pixel is occluded where the other frame is nearer by more than this share of its depth.

    References
    ----------
    L. Yang, Y.-C. Tse, P. V. Sander, J. Lawrence, D. Nehab, H. Hoppe and C. L. Wilkins, Image-based Bidirectional Scene
    Reprojection, ACM Transactions on Graphics 2011, doi:10.1145/2070781.2024184
    """

    needs_every_frame: ClassVar[bool] = True

    vectors: RenderedVectors
    depth_tolerance: Annotated[float, Range(0, below=1)] = 0.05

    def without_vectors(self) -> Blend:
        """Return a blend, as there is no motion without vectors."""
        return Blend()

    def synthesize(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[Image]:
        """Generate images from the renderer's vectors, not from estimated motion; see `Synthesizer.synthesize`.

        Raises
        ------
        OptionError
            An in-between frame is not an output frame, or one of the two frames is not and depth is compared.
        InputError
            The in-between frame has no vectors, or vectors of another size.
        """
        for t in times:
            yield self._image_at(frame_pair, t)

    def fuse(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[InterpolatedImage]:
        """Generate the images of `synthesize` with the agreement of both frames where the vectors lead."""
        image0, image1 = frame_pair.image0, frame_pair.image1
        for image, t in zip(self.synthesize(frame_pair, times), times, strict=True):
            _, *flows = self._flows(image0, image1, t)
            yield InterpolatedImage(image, measure_agreement_along(image0, image1, *flows))

    def _flows(self, image0: FrameCache, image1: FrameCache, t: float) -> tuple[FrameVectors, Flow, Flow]:
        """Return the vectors of the in-between frame, and the motion from it to each of the two frames."""
        place0, place1 = image0.output_position, image1.output_position
        number = output_frame_between(place0, place1, t)
        assert place0 is not None, "else there would be no frame between"
        assert place1 is not None
        here, step = self.vectors.for_image(number, image0.array), self.vectors.step
        to_first = here.backward * np.float32((number - place0) * step)
        return here, to_first, here.forward * np.float32((place1 - number) * step)

    def _image_at(self, frame_pair: FramePair, t: float) -> Image:
        """Return the in-between frame at time t."""
        image0, image1 = frame_pair.image0, frame_pair.image1
        here, *flows = self._flows(image0, image1, t)
        weights, colours = [], []
        for image, flow, weight in zip((image0, image1), flows, (1 - t, t), strict=True):
            height, width = here.backward.shape[:2]
            y, x = np.mgrid[:height, :width].astype(np.float32)
            x, y = x + flow[..., 0], y + flow[..., 1]
            seen = ends_inside(flow)
            if here.depth is not None:
                there = self.vectors.for_image(frame_number(image.output_position), image0.array).depth
                assert there is not None, "all frames of a folder have depth, or none"
                # the nearest pixel, since depth must not be mixed across an edge
                nearest = there[_index(np.rint(y), height), _index(np.rint(x), width)]
                seen &= nearest >= here.depth * np.float32(1 - self.depth_tolerance)
            weights.append(seen * np.float32(weight))
            colours.append(_between_pixels(image.cached(premultiplied), x, y))
        total = weights[0] + weights[1]
        share = np.divide(weights[1], total, out=np.full_like(total, t), where=total > 0)[..., np.newaxis]
        return as_image((1 - share) * colours[0] + share * colours[1], image0.array, image1.array, t)


def _between_pixels(values: NDArray[Any], x: NDArray[Any], y: NDArray[Any]) -> NDArray[Any]:
    """Return (H, W, C) values at positions, interpolated bilinearly, with repeated edges."""
    height, width = values.shape[:2]
    x, y = x.clip(0, width - 1), y.clip(0, height - 1)
    left, top = np.floor(x), np.floor(y)
    across, down = (x - left)[..., np.newaxis], (y - top)[..., np.newaxis]
    columns, rows = ([_index(first, size), _index(first + 1, size)] for first, size in ((left, width), (top, height)))
    upper, lower = (values[row, columns[0]] * (1 - across) + values[row, columns[1]] * across for row in rows)
    return np.asarray(upper * (1 - down) + lower * down)


def _index(places: NDArray[Any], size: int) -> NDArray[Any]:
    return places.clip(0, size - 1).astype(np.intp)
