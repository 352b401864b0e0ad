"""Scene-assisted interpolation (Yang et al. 2011): every in-between pixel is looked up along the renderer's vectors.

It serves as a baseline for scenes whose motion is known, and shows where known motion does not suffice: shading,
shadows, reflections and refractions do not move with the surfaces.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from fpsboost.colour import premultiplied
from fpsboost.image import Image, as_image
from fpsboost.motion.field import ends_inside
from fpsboost.motion.rendered import RenderedVectors, frame_number, output_frame_between
from fpsboost.options import Checked, Range
from fpsboost.synthesis import FramePair, InterpolatedImage
from fpsboost.synthesis.agreement import measure_agreement_along
from fpsboost.synthesis.blend import Blend

Flow = np.ndarray
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
            image, _ = self._look_up(frame_pair, t)
            yield image

    def fuse(self, frame_pair: FramePair, times: Sequence[float]) -> Iterator[InterpolatedImage]:
        """Generate the images of `synthesize` with the agreement of both frames where the vectors lead."""
        for t in times:
            image, flows = self._look_up(frame_pair, t)
            yield InterpolatedImage(image, measure_agreement_along(frame_pair.image0, frame_pair.image1, *flows))

    def _look_up(self, frame_pair: FramePair, t: float) -> tuple[Image, list[Flow]]:
        """Return the in-between frame at time t, and the motion from it to each of the two frames."""
        image0 = frame_pair.image0
        image1 = frame_pair.image1
        number = output_frame_between(image0.output_position, image1.output_position, t)
        here = self.vectors.for_image(number, image0.array)
        height, width = here.backward.shape[:2]
        flows = []
        weights = []
        colours = []
        for image, adjacent, weight in ((image0, here.backward, 1 - t), (image1, here.forward, t)):
            assert image.output_position is not None, "else there would be no frame between"
            flow = adjacent * np.float32(abs(image.output_position - number) * self.vectors.step)
            seen = ends_inside(flow)
            y, x = np.indices((height, width), np.float32)
            x = (x + flow[..., 0]).clip(0, width - 1)
            y = (y + flow[..., 1]).clip(0, height - 1)
            if here.depth is not None:
                there = self.vectors.for_image(frame_number(image.output_position), image0.array).depth
                assert there is not None, "all frames of a folder have depth, or none"
                # the nearest pixel, since depth must not be mixed across an edge
                nearest = there[np.rint(y).astype(np.intp), np.rint(x).astype(np.intp)]
                seen &= nearest >= here.depth * np.float32(1 - self.depth_tolerance)
            flows.append(flow)
            weights.append(seen * np.float32(weight))
            colours.append(_between_pixels(image.cached(premultiplied), x, y))
        total = weights[0] + weights[1]
        share = np.divide(weights[1], total, out=np.full_like(total, t), where=total > 0)[..., np.newaxis]
        return as_image((1 - share) * colours[0] + share * colours[1], image0.array, image1.array, t), flows


def _between_pixels(values: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return (H, W, C) values at positions within the image, interpolated bilinearly."""
    height, width = values.shape[:2]
    left = x.astype(np.intp)
    top = y.astype(np.intp)
    right = np.minimum(left + 1, width - 1)
    bottom = np.minimum(top + 1, height - 1)
    across = (x % 1)[..., np.newaxis]
    down = (y % 1)[..., np.newaxis]
    upper = values[top, left] * (1 - across) + values[top, right] * across
    lower = values[bottom, left] * (1 - across) + values[bottom, right] * across
    return np.asarray(upper * (1 - down) + lower * down)
