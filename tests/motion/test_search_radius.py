"""The report's search radius: the largest motion plus 20 %, from a renderer's vectors or estimated."""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from functools import partial

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from truth import SCENES, Clip, affine, frozen, layers, moving_object, needs_scenes, noise, translation
from twins import shortest_motions
from vector_truth import save_translation

from fpsboost.errors import OptionError
from fpsboost.frame_cache import FrameCache
from fpsboost.kernels.jit import LANES
from fpsboost.kernels.planes import PlanePair
from fpsboost.kernels.shortest import ShortestMotion, find_shortest
from fpsboost.kernels.similarity import UNIT, colour_scale
from fpsboost.method_table import find_method
from fpsboost.motion.components import contrast_components, padded_planes
from fpsboost.motion.exhaustive import choose_search_radius
from fpsboost.motion.rendered import RenderedMotion
from fpsboost.render.folder import VectorFolder

LOWEST, HIGHEST = 0.8, 1.6
"""Of the true largest motion plus 20 %."""


def least(image) -> float:
    """The radius that no motion is too small for."""
    return max(image.shape[:2]) / 32


@needs_scenes
@pytest.mark.parametrize("number", [0, 6, 14, 20])
@pytest.mark.parametrize("scene", ["glass", "reflective", "texture"])
def test_the_radius_of_rendered_scenes_is_near_the_renderers(scene, number):
    """Mirrors, glass and patterns: what looks most alike far away in a pattern does not count as motion."""
    images = (
        FrameCache(cv2.imread(str(SCENES / scene / f"{each:04d}.png")), Fraction(each)) for each in (number, number + 2)
    )
    image0, image1 = images
    vectors = VectorFolder(SCENES / scene / "vectors")
    true = 1.2 * max(float(np.abs(field.flow).max()) for field in RenderedMotion(vectors).estimate(image0, image1))
    assert LOWEST * true <= choose_search_radius(image0, image1) <= HIGHEST * true
    assert choose_search_radius(image0, image1, vectors) == math.ceil(max(true, least(image0.pixels)))


@pytest.mark.parametrize(
    "make",
    [
        partial(affine, 216, 384, shift=(15, 5)),
        partial(affine, 216, 384, shift=(-30, 10)),
        partial(affine, 216, 384, shift=(20, -60)),
        partial(translation, 180, 320, -24, 12),
        partial(affine, 216, 384, zoom=1.1),
        partial(affine, 216, 384, zoom=0.8),
        partial(affine, 216, 384, degrees=8),
        partial(affine, 96, 800, shift=(60, 5)),
        partial(layers, 216, 384, box=(80, 100, 96, 116), shift=(45, -22), bright=True),
        partial(layers, 216, 384, box=(80, 100, 104, 124), shift=(25, -12), background=(3, 1)),
        partial(layers, 216, 384, box=(80, 100, 120, 140), shift=(-45, 20), background=(3, 1)),
        partial(moving_object, 216, 384, box=(80, 100, 104, 124), dx=25, dy=-12),
    ],
    ids=[
        "pan", "fast pan", "steep pan", "pan over noise", "zoom in", "zoom out", "rotation", "large frame",
        "small bright thing", "small thing", "thing", "small thing of noise",
    ],
)  # fmt: skip
def test_the_radius_is_near_the_constructed_motion(make: Callable[[], Clip]):
    """Pans, zooms, turns and small fast things: 0.8 to 1.6 times the largest motion plus 20 %."""
    clip = make()
    true = 1.2 * max(np.abs(clip.flow01[clip.seen0]).max(), np.abs(clip.flow10[clip.seen1]).max())
    assert LOWEST * true <= choose_search_radius(*clip.prepared) <= HIGHEST * true


def test_vectors_choose_the_radius_of_the_reports_method(tmp_path):
    """The renderer's largest motion plus 20 %, whatever the image does; the field says what was chosen."""
    vectors = VectorFolder(save_translation(tmp_path, 3, (60, 80), 5.5, -1))
    image0, image1 = FrameCache(noise(60, 80), Fraction(0)), FrameCache(noise(60, 80, seed=1), Fraction(2))
    for name in ("nlm-exhaustive", "nlm-brute-force"):
        estimator = find_method(name, vectors).estimator
        assert [field.search_radius for field in estimator.estimate(image0, image1)] == [14, 14]
    with pytest.raises(OptionError, match="whole factor"):
        choose_search_radius(FrameCache(noise(60, 80)), image1, vectors)


@given(st.integers(0, 2**32), st.integers(0, 2), st.sampled_from([2, 4]))
def test_shortest_motions_equal_their_slow_twin(seed, around, step):
    """The shortest motion around each point that explains it nearly as well, and the best similarity there is."""
    random = np.random.default_rng(seed)
    height, width, radius, padding = 14, 18, 2, 40
    image0, image1 = noise(height, width, seed=seed % 1000), noise(height, width, seed=seed % 1000)
    components = [
        contrast_components(frozen(np.roll(image, shift, axis=1))) for image, shift in ((image0, 0), (image1, 3))
    ]
    planes = [padded_planes(each, padding, 0, 2 * LANES, colour_scale(0.3)) for each in components]
    flow = random.integers(-6, 7, (-(-height // step), -(-width // step), 2)).astype(np.float32)
    flow[random.random(flow.shape[:2]) < 0.5] = (3, 0)
    results = [np.empty(flow.shape[:2], np.float32) for _ in range(3)]
    tolerance = np.float32(0.2)
    pair = PlanePair(*planes, padding, height, width, UNIT)
    find_shortest(pair, step, radius, LANES, around, tolerance, flow, ShortestMotion(*results))
    for result, expected in zip(
        results, shortest_motions(*components, step, radius, around, 0.2, 0.3, flow), strict=True
    ):
        np.testing.assert_allclose(result, expected, atol=2e-3)
