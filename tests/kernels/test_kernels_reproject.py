"""The report's two searches for a source pixel, splatting, and the colours they fetch, against slow twins."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fpsboost.kernels.reproject import bin_landings, fetch_both, search_iteratively, search_nearest_landing, splat
from fpsboost.motion.field import MotionField
from fpsboost.synthesis import FramePair
from fpsboost.synthesis.reproject import Reproject
from support.truth import affine, frozen, noise, prepared
from support.twins import brute_force_search, fetched, iterative_search, landed, miss


@st.composite
def flows(draw):
    """Flows in eighths of pixels, so that float32 is exact and ties and half pixels are common."""
    height, width = draw(st.integers(1, 9)), draw(st.integers(1, 9))
    largest = draw(st.sampled_from([0, 4, 12, 40, 160, 8_000_000]))  # eighths: up to far beyond the frame
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    flow = random.integers(-largest, largest + 1, (height, width, 2)) / 8
    if draw(st.booleans()):
        flow = np.rint(flow)
    if draw(st.booleans()):  # two layers, so that there are holes and overlaps
        flow[random.random((height, width)) < 0.7] = 0
    return flow.astype(np.float32)


exact_times = st.sampled_from([0.0, 0.25, 0.5, 0.625, 0.75, 1.0])


def iterative(flow, t, iterations):
    """Call the kernel."""
    source, found = np.full(flow.shape[:2], -1, np.int32), np.zeros(flow.shape[:2], np.bool_)
    search_iteratively(flow, np.float32(t), iterations, source, found)
    return source, found


def brute_force(flow, t, radius):
    """Call both kernels."""
    pixels = flow.shape[0] * flow.shape[1]
    starts, members = np.full(pixels + 1, -1, np.int32), np.full(pixels, -1, np.int32)
    bin_landings(flow, np.float32(t), starts, members)
    source, found = np.full(flow.shape[:2], -1, np.int32), np.zeros(flow.shape[:2], np.bool_)
    search_nearest_landing(flow, np.float32(t), radius, starts, members, source, found)
    return source, found


@pytest.mark.parametrize(
    ("search", "slow_twin", "reach"),
    [(iterative, iterative_search, st.integers(1, 6)), (brute_force, brute_force_search, st.integers(0, 12))],
    ids=["iterative", "brute-force"],
)
@given(flow=flows(), t=exact_times, data=st.data())
def test_searches_equal_their_slow_twins(search, slow_twin, reach, flow, t, data):
    """The same sources, and the same decision whether they land; the nearest landing, ties to the nearest source."""
    steps = data.draw(reach)
    np.testing.assert_array_equal(search(flow, t, steps), slow_twin(flow, t, steps))


@pytest.mark.slow
def test_brute_force_search_finds_the_nearest_for_any_real_motion():
    """With flows that float32 must round, the source found is as near as the nearest, to rounding."""
    random = np.random.default_rng(3)
    for scale in (0.3, 3, 30):
        flow = (random.normal(size=(17, 23, 2)) * scale).astype(np.float32)
        source, _ = brute_force(flow, 0.4, 40)
        expected, _ = brute_force_search(flow, 0.4, 40)
        for place in np.ndindex(17, 23):
            here, there = (
                np.hypot(*miss(flow, 0.4, divmod(int(which[place]), 23), place)) for which in (source, expected)
            )
            assert here == pytest.approx(there, rel=1e-5, abs=1e-5)


@pytest.mark.parametrize("search", ["iterative", "brute-force"])
@pytest.mark.parametrize("shift", [(1, 0), (3, 3), (5, 1)])
def test_pans_by_odd_amounts_give_the_same_error_in_every_direction(search, shift):
    """A mirrored or transposed pan gives the mirrored or transposed frame: no source frame wins by its direction."""
    clip = affine(24, 24, shift=shift)
    field01, field10 = (np.rint(flow).astype(np.float32) for flow in (clip.flow01, clip.flow10))
    method = Reproject(search=search)

    def error(turned, flow01, flow10):
        images = prepared(*(frozen(turned(image)) for image in (clip.image0, clip.image1)))
        fields = (MotionField(np.ascontiguousarray(flow), np.ones((24, 24), np.float32)) for flow in (flow01, flow10))
        (made,) = method.synthesize(FramePair(*images, *fields), [0.5])
        inner = slice(6, -6)
        return ((made.astype(float) - turned(clip.at(0.5)))[inner, inner] ** 2).mean()

    expected = error(lambda image: image, field01, field10)
    for mirror_x, mirror_y, transpose in product((1, -1), (1, -1), (False, True)):

        def turned(image, mirrored=(slice(None, None, mirror_y), slice(None, None, mirror_x)), transpose=transpose):
            image = image[mirrored]
            return image.transpose(1, 0, 2) if transpose else image

        signs = np.float32([mirror_x, mirror_y])
        flows = (turned(flow * signs)[..., ::-1] if transpose else turned(flow * signs) for flow in (field01, field10))
        assert error(turned, *flows) == expected


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_fetched_colours_equal_the_slow_twin(dtype, channels):
    """Blended where both or neither was found, alone where one was, rounded half up."""
    random = np.random.default_rng(channels)
    image0, image1 = (noise(7, 9, channels, dtype, seed).copy() for seed in (1, 2))
    sources = [random.integers(0, 63, (7, 9)).astype(np.int32) for _ in range(2)]
    founds = [random.random((7, 9)) < 0.5 for _ in range(2)]
    half = np.float32(0 if dtype is np.float32 else 0.5)
    for t in (0.25, 0.5, 0.75):
        out = np.empty_like(image0)
        fetch_both(image0, image1, np.float32(t), half, sources[0], founds[0], sources[1], founds[1], out)
        expected = fetched(image0, image1, t, sources[0], founds[0], sources[1], founds[1])
        rounded = expected if dtype is np.float32 else np.floor(expected + 0.5)
        np.testing.assert_allclose(out, rounded, rtol=0, atol=1e-6)


def sources(flow, similarity, least, t):
    """Call the kernel."""
    source0, source1 = (np.full(similarity.shape, -99, np.int32) for _ in range(2))
    splat(flow, similarity, np.float32(least), np.float32(t), source0, source1)
    return source0, source1


@given(flows(), st.integers(0, 2**32), exact_times, st.sampled_from([0.0, 0.25, 0.5, 1.0]))
def test_splatting_equals_its_slow_twin(flow, seed, t, least):
    """The most similar that lands on each place, the first of several, and nothing where nothing usable does."""
    random = np.random.default_rng(seed)
    similarity = random.integers(0, random.choice([1, 5]), flow.shape[:2]).astype(np.float32) / 4  # many are equal
    np.testing.assert_array_equal(sources(flow, similarity, least, t), landed(flow, similarity, least, t))


@pytest.mark.parametrize("value", [1e6, -1e30, np.inf, np.nan])
def test_vast_motion_is_splatted_nowhere(value):
    """Nor does it lead out of the arrays."""
    flow, similarity = np.full((6, 8, 2), value, np.float32), np.ones((6, 8), np.float32)
    np.testing.assert_array_equal(sources(flow, similarity, 0, 0.5), [np.arange(48).reshape(6, 8)] * 2)
