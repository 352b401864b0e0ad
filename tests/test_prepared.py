"""What is computed from one frame alone: once, however many ask for it, and forgotten with the frame."""

import threading
import weakref
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from itertools import pairwise
from pkgutil import resolve_name
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from fpsboost import RunOptions, convert, methods
from fpsboost.frame_cache import FrameCache, Results
from fpsboost.synthesis import multi_hypothesis
from support.truth import noise

PER_FRAME = (
    "fpsboost.motion.components.small_copy",
    "fpsboost.analysis.illumination.small_copy",
    "fpsboost.motion.nlm.pyramid",
    "fpsboost.motion.nlm.contrast_components",
    "fpsboost.motion.nlm.contrast_planes",
    "fpsboost.synthesis.spline_samples.find_coefficients",
)
"""What the default method asks of each frame of one level, under the names that it knows."""


@pytest.fixture
def counters(monkeypatch) -> dict[str, Mock]:
    """Functions that count their calls in place of those of `PER_FRAME`."""
    counters = {name: Mock(wraps=resolve_name(name)) for name in PER_FRAME}
    for name, counter in counters.items():
        monkeypatch.setattr(name, counter)
    return counters


@pytest.mark.parametrize("result", [np.zeros(3), None, 0])
def test_a_function_is_called_once(result):
    """On the pixels, when it is first asked for; after that the very same result comes back, None and 0 too."""
    counter, image = Mock(return_value=result), FrameCache(noise(3, 4))
    assert not counter.called
    assert all(image.cached(counter) is result for _ in range(3))
    counter.assert_called_once()


@pytest.mark.parametrize(("factor", "calls"), [(Fraction(3), 5), (Fraction(5, 2), 5), (Fraction(1), 0)], ids=str)
def test_a_conversion_prepares_every_frame_once(tmp_path, save_images, counters, factor, calls):
    """One call for each frame, however many pairs and times it is part of; none where nothing lies between."""
    save_images(tmp_path / "in", count=5)
    assert convert(str(tmp_path / "in"), str(tmp_path / "out"), factor=factor).scene_cuts == 0
    assert {name: counter.call_count for name, counter in counters.items()} == dict.fromkeys(PER_FRAME, calls)


def test_a_conversion_forgets_what_is_behind_it(tmp_path, save_images, monkeypatch):
    """What was made of a frame goes with it: of 20 frames, the samples of no more than six are there at a time."""
    alive: set[int] = set()
    most = 0
    samples = multi_hypothesis.spline_samples

    def followed(image: Any) -> Any:
        nonlocal most
        result = samples(image)
        planes = result[0].planes
        alive.add(id(planes))
        weakref.finalize(planes, alive.discard, id(planes))
        most = max(most, len(alive))
        return result

    monkeypatch.setattr(multi_hypothesis, "spline_samples", followed)
    save_images(tmp_path / "in", count=20)
    convert(str(tmp_path / "in"), str(tmp_path / "out"), run=RunOptions(threads=2))
    assert 2 <= most <= 6
    assert not alive


def test_a_settled_pair_serves_its_neighbours_as_before():
    """The frames of the next pair are the same, bit by bit."""
    images = [np.roll(noise(40, 48), 2 * k, axis=1) for k in range(4)]
    interpolator = methods["nlm"]
    made = []
    for settles in (False, True):
        frames = [FrameCache(image) for image in images]
        pairs = [interpolator.pair(*both) for both in pairwise(frames)]
        list(interpolator.images(pairs[0].between(None, pairs[1]), [0.5]))
        if settles:
            pairs[0].release_caches()
        made.append(next(interpolator.images(pairs[1].between(pairs[0], pairs[2]), [0.5])).image)
    np.testing.assert_array_equal(*made)


def test_what_both_pairs_have_had_is_forgotten():
    """The second one gets the first one's, and a third would get its own."""
    image = FrameCache(np.arange(6))
    first, second, third = (image.cached_for_both_pairs(np.negative) for _ in range(3))
    assert first is second
    assert third is not second


def test_threads_that_ask_at_once_get_one_result():
    """The first one computes it, and the others wait for it."""
    results, calls, asked, release = Results(), [], threading.Barrier(5), threading.Event()

    def compute() -> object:
        calls.append(1)
        assert release.wait(10)
        return object()

    def ask() -> object:
        asked.wait(10)
        return results.cached("key", compute)

    with ThreadPoolExecutor(4) as pool:
        futures = [pool.submit(ask) for _ in range(4)]
        asked.wait(10)
        release.set()
        found = {id(future.result()) for future in futures}
    assert len(found) == len(calls) == 1
    assert results.get("key") is not None


def test_what_is_discarded_while_it_is_computed_is_not_kept():
    """The thread that computes it gets it, and who asks next gets a result of its own, which is kept."""
    results, started, release = Results(), threading.Event(), threading.Event()

    def compute() -> object:
        started.set()
        assert release.wait(10)
        return object()

    with ThreadPoolExecutor(1) as pool:
        first = pool.submit(results.cached, "key", compute)
        assert started.wait(10)
        results.discard({"key"}.__contains__)
        second = results.cached("key", object)
        release.set()
        assert first.result() is not second
    assert results.cached("key", object) is second


def test_what_could_not_be_computed_is_tried_again():
    """An error is that of whoever asked."""
    results = Results()
    with pytest.raises(ZeroDivisionError):
        results.cached("key", lambda: 1 // 0)
    assert results.get("key") is None
    assert results.cached("key", lambda: 1) == 1
