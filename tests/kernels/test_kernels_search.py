"""The exhaustive searches against a slow twin and against each other."""

import numpy as np
import pytest

from fpsboost.kernels import level_search
from fpsboost.kernels.constants import TILE
from fpsboost.kernels.level_search import PADDING, OffsetLists, Proposals
from fpsboost.motion.field import MotionField
from fpsboost.motion.full_search import search_by_passes, search_fused
from support.planes import plane_pair
from support.truth import noise
from support.twins import (
    best_offset,
    box_weights,
    gaussian_weights,
    level_similarity,
    patch_scores,
    peak_scores,
    pixel_similarity,
)

TOLERANCE = 1e-5
STRIP_WIDTH = 640
"""Columns that the kernel searches at a time, pixels."""

WEIGHTS = {"box": box_weights, "gaussian": gaussian_weights}


def colours(height: int, width: int, seed: int, dtype: type = np.float32) -> np.ndarray:
    """Noise of low contrast, so that many similarities are far from 0."""
    return 0.3 + 0.4 * noise(height, width, 3, dtype, seed)


def assert_fields_agree(field, expected, tolerance=TOLERANCE):
    """Same scores; same motion wherever the best offset leads clearly."""
    flow, best, lead = expected
    np.testing.assert_allclose(field.similarity, best, rtol=0, atol=tolerance)
    clear = lead > tolerance
    np.testing.assert_array_equal(field.flow[clear], flow[clear])
    assert clear.mean() > 0.5


@pytest.mark.parametrize("window", ["box", "gaussian"])
@pytest.mark.parametrize(
    ("height", "width", "radius"), [(9, 13, 3), (16, 17, 1), (3, 5, 4), (1, 7, 2), (7, 1, 5), (2, 2, 6)]
)
def test_fused_search_equals_its_slow_twin(window, height, width, radius):
    """Both directions find the twin's scores and motion, also in frames smaller than the search radius."""
    image0, image1 = colours(height, width, 1), colours(height, width, 2)
    weights = WEIGHTS[window](2)
    field01, field10 = search_fused(image0, image1, radius, 2, window, 0.25)
    assert_fields_agree(field01, best_offset(patch_scores(image0, image1, radius, weights, 0.25, False)))
    assert_fields_agree(field10, best_offset(patch_scores(image1, image0, radius, weights, 0.25, False), -1))


@pytest.mark.parametrize("window", ["box", "gaussian"])
@pytest.mark.parametrize(
    ("height", "width", "radius", "patch_radius"),
    [(19, 23, 4, 1), (30, 11, 2, 5), (3, STRIP_WIDTH + 21, 1, 2), (12, 50, 1, 20)],
)
def test_fused_search_equals_full_image_passes(window, height, width, radius, patch_radius):
    """The kernel and the report's passes agree, over many rows and strips of columns, for patches of any size."""
    image0, image1 = colours(height, width, 5), colours(height, width, 6)
    fused = search_fused(image0, image1, radius, patch_radius, window, 0.25)
    passes = search_by_passes(image0, image1, radius, patch_radius, window, 0.25)
    for one, other in zip(fused, passes, strict=True):
        np.testing.assert_allclose(one.similarity, other.similarity, rtol=0, atol=TOLERANCE)
        assert (one.flow == other.flow).all(axis=-1).mean() > 0.999


@pytest.mark.parametrize("window", ["box", "gaussian"])
@pytest.mark.parametrize(("height", "width"), [(12, 15), (1, 1), (24, 9), (3, STRIP_WIDTH + 21)])
def test_flat_frames_do_not_move(window, height, width):
    """Where all offsets are equally similar, the smallest motion wins, in every row and strip."""
    flat = np.full((height, width, 3), 0.4, np.float32)
    for field in search_fused(flat, flat, 2, 2, window, 0.25):
        assert not field.flow.any()
        np.testing.assert_allclose(field.similarity, 1, rtol=0, atol=TOLERANCE)


@pytest.mark.parametrize("axis", [0, 1])
def test_ties_go_to_the_smallest_motion_and_then_in_raster_order(axis):
    """Stripes of period 2 that change places fit at -3, -1, 1 and 3 alike; -1 wins, in both fields."""
    stripes = np.zeros([18, 18, 3], np.float32)
    stripes[(slice(None),) * axis + (slice(0, None, 2),)] = 1
    field01, field10 = search_fused(stripes, 1 - stripes, 4, 2, "box", 0.25)
    expected = [0, -1] if axis == 0 else [-1, 0]
    inner = slice(7, -7)
    assert (field01.flow[inner, inner] == expected).all()
    assert (field10.flow[inner, inner] == expected).all()


def test_similarity_is_the_reports_exponential():
    """The fixed-point polynomial is within 2e-6 of the product of Gaussians, from equal to unlike colours."""
    random = np.random.default_rng(7)
    a, spread = random.random((40, 100, 3)), random.random((40, 100, 1)) ** 2
    b = a + (random.random((40, 100, 3)) - 0.5) * spread
    a, b = np.float32(a), np.float32(b)
    for v in (0.06, 0.25):
        exact = pixel_similarity(a.astype(float), b.astype(float), v)
        field, _ = search_fused(a, b, 0, 0, "box", v)
        assert np.abs(field.similarity - exact).max() < 2e-6
        assert exact.min() < 0.02
    assert (search_fused(a, a, 0, 0, "box", 0.25)[0].similarity == 1).all()


@pytest.mark.parametrize("window", ["box", "gaussian"])
def test_motion_pays_its_price(window):
    """With a penalty the exhaustive search finds the twin's best similarity less the price of length."""
    image0, image1 = colours(13, 17, 20), colours(13, 17, 21)
    scores = patch_scores(image0, image1, 4, WEIGHTS[window](2), 0.25, repeat_target=False)
    away = np.abs(np.arange(-4, 5))
    expected = best_offset(scores - 0.01 * (away[:, np.newaxis] + away))
    assert_fields_agree(search_fused(image0, image1, 4, 2, window, 0.25, 0.01)[0], expected)


def level_image(height: int, width: int, seed: int) -> np.ndarray:
    """The same in bytes."""
    return np.uint8(255 * colours(height, width, seed))


def level_scores(image0, image1, radius, patch_radius, most):
    """What the twin finds for every offset, at its best fraction of a pixel."""
    return peak_scores(patch_scores(image0, image1, radius, box_weights(patch_radius), most, True, level_similarity))


def list_tiles(
    image0, image1, radius, patch_radius, most, step=1, capacity=1, expected=(99, 99), every=1, proposals=None
):
    """The tile kernel for all offsets of a square, or for proposals: how many each point has, values, and offsets."""
    height, width = image0.shape[:2]
    still = np.zeros((height, width, 2), np.int32)
    points = -(-height // step), -(-width // step)
    count, best = np.empty(points, np.int32), np.empty((*points, capacity), np.float32)
    flows = np.empty((*points, capacity, 2), np.float32)
    pair = plane_pair(image0, image1, PADDING + patch_radius, most)
    around = 2 * radius if proposals is None else 0
    proposals = proposals or Proposals(still, np.full_like(still, expected), 1)
    lists = OffsetLists(count, best, flows, np.empty(points, np.float32))
    level_search.search_tiles(pair, proposals, step, around, radius, patch_radius, every, lists)
    return count, best, flows


def search_tiles(image0, image1, radius, patch_radius, most, step=1):
    """The best of what the tile kernel lists."""
    _, best, flows = list_tiles(image0, image1, radius, patch_radius, most, step, capacity=2)
    return MotionField(flows[:, :, 0], best[..., 0].clip(0, 1))


@pytest.mark.parametrize("most", [1, 40, 255])
@pytest.mark.parametrize(("height", "width", "radius"), [(9, 13, 3), (3, 5, 2), (1, 1, 2), (2, TILE + 7, 3)])
def test_tile_search_equals_its_slow_twin(height, width, radius, most):
    """Tiles find the twin's best similarity; edges repeat for targets too."""
    image0, image1 = level_image(height, width, 8), level_image(height, width, 9)
    flow, best, lead = best_offset(level_scores(image0, image1, radius, 2, most))
    field = search_tiles(image0, image1, radius, 2, most)
    np.testing.assert_allclose(field.similarity, best.clip(0, 1), rtol=0, atol=TOLERANCE)
    clear = lead > TOLERANCE
    np.testing.assert_array_equal(field.flow[clear], flow[clear])


def test_sums_over_the_largest_patches_do_not_overflow():
    """21 x 21 equal pixels are as alike as they can be, at the largest truncation there is."""
    white = np.full((TILE + 3, 2 * TILE, 3), 255, np.uint8)
    _, best, _ = list_tiles(white, white, 1, 10, 255)
    np.testing.assert_array_equal(best, 1)


@pytest.mark.parametrize("capacity", [1, 3, 40])
def test_tiles_list_the_local_maxima(capacity):
    """Each point has every offset that beats all those next to it, the best first, as long as there is room."""
    radius, most = 3, 200
    image0, image1 = level_image(9, 7, 15), level_image(9, 7, 16)
    scores = level_scores(image0, image1, radius, 1, most)
    count, best, flows = list_tiles(image0, image1, radius, 1, most, capacity=capacity)
    assert count.min() >= 1
    assert count.max() == capacity or count.max() < capacity == 40
    for y, x in np.ndindex(9, 7):
        known = count[y, x]
        values, offsets = best[y, x, :known], [tuple(offset) for offset in flows[y, x, :known].astype(int).tolist()]
        assert len(set(offsets)) == known
        assert (np.diff(values) <= 0).all()
        expected = [scores[y, x, dy + radius, dx + radius] for dx, dy in offsets]
        np.testing.assert_allclose(values, expected, atol=TOLERANCE)
        around = np.pad(scores[y, x], 1, constant_values=-np.inf)
        for dx, dy in np.ndindex(2 * radius + 1, 2 * radius + 1):
            near = np.delete(around[dy : dy + 3, dx : dx + 3].ravel(), 4)
            value = scores[y, x, dy, dx]
            if value > near.max() + TOLERANCE and (known < capacity or value > values[-1] + TOLERANCE):
                assert (dx - radius, dy - radius) in offsets


def test_what_is_expected_is_kept():
    """As one of the best where it is, else as the last in the list, with its own similarity."""
    radius, most, expected = 3, 200, (-2, 1)
    image0, image1 = level_image(9, 12, 15), level_image(9, 12, 16)
    scores = level_scores(image0, image1, radius, 1, most)[:, :, 1 + radius, -2 + radius]
    options = {"radius": radius, "patch_radius": 1, "most": most, "capacity": 3}
    _, best, flows = list_tiles(image0, image1, **options, expected=expected)
    plain_count, _, plain_flows = list_tiles(image0, image1, **options)
    here = (flows == expected).all(axis=3)
    assert (here.sum(axis=2) == 1).all()
    np.testing.assert_allclose(best[here], scores.ravel(), atol=TOLERANCE)
    listed = (plain_flows == expected).all(axis=3) & (np.arange(3) < plain_count[..., np.newaxis])
    assert here[~listed.any(axis=2)][:, 1:].any(axis=1).all()
    np.testing.assert_array_equal(here[listed.any(axis=2)], listed[listed.any(axis=2)])
    np.testing.assert_array_equal(flows[..., 0, :], plain_flows[..., 0, :])


@pytest.mark.parametrize("step", [2, 4, 8])
def test_tiles_search_at_points_a_few_pixels_apart(step):
    """Every point has what the search of every pixel finds there, over several tiles, to the frame's edges."""
    image0, image1 = level_image(TILE + 5, TILE + 11, 11), level_image(TILE + 5, TILE + 11, 12)
    every, some = (search_tiles(image0, image1, 1, 2, 200, each) for each in (1, step))
    points = every.flow[step // 2 :: step, step // 2 :: step]
    rows, columns = points.shape[:2]
    np.testing.assert_array_equal(some.flow[:rows, :columns], points)
    np.testing.assert_array_equal(
        some.similarity[:rows, :columns], every.similarity[step // 2 :: step, step // 2 :: step]
    )


@pytest.mark.parametrize("step", [4, 8])
def test_every_second_row_of_the_patches_may_do(step):
    """Then the similarity is the mean over the first, the third, and so on, to the last row."""
    size, radius, patch_radius, most = (TILE + 5, TILE + 9), 1, 3, 200
    image0, image1 = level_image(*size, 21), level_image(*size, 22)
    weights = box_weights(patch_radius)
    weights[1::2] = 0
    scores = peak_scores(patch_scores(image0, image1, radius, weights / weights.sum(), most, True, level_similarity))
    count, best, flows = list_tiles(image0, image1, radius, patch_radius, most, step, capacity=9, every=2)
    for row, column in np.ndindex(count.shape):
        y, x = row * step + step // 2, column * step + step // 2
        if y < size[0] and x < size[1]:
            known = count[row, column]
            expected = [scores[y, x, dy + radius, dx + radius] for dx, dy in flows[row, column, :known].astype(int)]
            np.testing.assert_allclose(best[row, column, :known], expected, atol=TOLERANCE)


@pytest.mark.parametrize("motion", [(0, TILE - 1), (0, -TILE), (TILE - 1, 0), (-TILE, 0)])
@pytest.mark.parametrize("step", [1, 8])
def test_tiles_that_lead_far_outside_read_nothing_else(motion, step):
    """The last, partial tiles stay within the planes at the largest offsets."""
    image = level_image(TILE + 1, TILE + 1, 13)
    motions = np.full((1, 1, 2), motion, np.int32)
    proposals = Proposals(motions, motions, 2 * TILE)
    count, best, _ = list_tiles(image, image, TILE, 2, 200, step, capacity=2, proposals=proposals)
    assert np.isfinite(best).all()
    assert (count <= 2).all()  # no motion is the other
