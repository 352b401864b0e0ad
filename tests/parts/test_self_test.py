"""The digest by which two machines tell whether they compute the same bits."""

from collections.abc import Callable
from typing import Literal

import cv2
import numpy as np
import pytest

from fpsboost import Coding, YCbCrImage
from fpsboost.layered import FrameImage, Layer, LayeredImage
from fpsboost.method_table import configure, methods
from fpsboost.parts.manifest import self_test
from fpsboost.synthesis.blend import Blend


def in_planes(pixel_format: str, bits: int, chroma: tuple[int, int]) -> YCbCrImage:
    """Return a small gray image of 4 x 6 pixels in planes."""
    dtype = np.uint8 if bits == 8 else np.uint16
    y, cb, cr = (np.full(size, 1 << (bits - 1), dtype) for size in ((4, 6), chroma, chroma))
    return YCbCrImage((y, cb, cr), Coding(bits, 1, False, "left", pixel_format))


def with_layers(kind: Literal["depth", "linear"] = "depth") -> LayeredImage:
    """Return a small image with a layer of each kind, or with another kind of the first one."""
    zeros = np.zeros((4, 6), np.float32)
    layers = (
        Layer("Z", kind, {"Z": zeros}),
        Layer("N", "normals", {f"N.{name}": zeros for name in "XYZ"}),
        Layer("Light", "linear", {name: zeros.astype(np.float16) for name in "RGB"}),
        Layer("Object", "nearest", {"Object": zeros.astype(np.uint32)}),
    )
    return LayeredImage(np.zeros((4, 6, 3), np.float32), layers)


kinds: dict[str, Callable[[], FrameImage]] = {
    "gray": lambda: np.zeros((4, 6, 1), np.uint8),
    "gray and alpha": lambda: np.zeros((4, 6, 2), np.uint16),
    "BGR": lambda: np.zeros((4, 6, 3), np.uint8),
    "deep": lambda: np.zeros((4, 6, 3), np.uint16),
    "float": lambda: np.zeros((4, 6, 3), np.float32),
    "BGRA": lambda: np.zeros((4, 6, 4), np.uint8),
    "4:2:0": lambda: in_planes("yuv420p", 8, (2, 3)),
    "4:2:2": lambda: in_planes("yuv422p10le", 10, (4, 3)),
    "layers": with_layers,
    "layers of other kinds": lambda: with_layers("linear"),
}


@pytest.mark.parametrize("method", methods)
def test_a_digest_repeats_itself(method):
    """Twice the same, and the image stays as it is."""
    image = np.full((2, 3, 3), 7, np.uint8)
    first = self_test(methods[method], image)
    assert first == self_test(methods[method], np.zeros((9, 5, 3), np.uint8))
    assert len(first) == 64
    assert (image == 7).all()


@pytest.mark.slow
def test_another_method_has_another_digest():
    """Methods, and parameters of one; but not two forms of the same search."""
    image = np.zeros((4, 6, 3), np.uint8)
    digests = {name: self_test(each, image) for name, each in methods.items() if name != "nlm-passes"}
    assert len(set(digests.values())) == len(digests)
    assert self_test(configure(methods["nlm"], {"patch_radius": 3}), image) not in digests.values()


@pytest.mark.parametrize("method", ["nlm", "blend"])
def test_every_kind_of_image_has_its_digest(method):
    """Types, channels, planes and layers; none is like another one."""
    assert len({self_test(methods[method], make()) for make in kinds.values()}) == len(kinds)


@pytest.mark.parametrize("method", ["nlm", "dis", "farneback"])
def test_threads_do_not_matter(method):
    """With one thread OpenCV makes what it makes with four."""
    image = np.zeros((4, 6, 3), np.uint8)
    before = cv2.getNumThreads()
    try:
        digests = set()
        for threads in (1, 4):
            cv2.setNumThreads(threads)
            digests.add(self_test(methods[method], image))
    finally:
        cv2.setNumThreads(before)
    assert len(digests) == 1


def test_one_bit_is_noticed(monkeypatch):
    """A sample that is off by one changes the digest."""
    image, original = np.zeros((4, 6, 3), np.uint8), Blend.synthesize

    def off_by_one(self, pair, times):
        for made in original(self, pair, times):
            made[3, 5, 0] ^= 1
            yield made

    expected = self_test(methods["blend"], image)
    monkeypatch.setattr(Blend, "synthesize", off_by_one)
    assert self_test(methods["blend"], image) != expected
