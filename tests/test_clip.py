"""Whole clips of arrays: their types, orders and layouts, iterators, loops."""

from collections.abc import Callable, Iterator
from fractions import Fraction
from itertools import count, islice
from typing import Any

import cv2
import numpy as np
import pytest
from conversion_options import keeping_duplicates
from numpy.typing import NDArray
from PIL import Image
from video_truth import scene

from fpsboost import InputError, OptionError, interpolate_clip, stream


def turntable(frames: int, step: int = 4) -> NDArray[np.uint8]:
    """A picture that moves to the side and comes in again on the other, BGR; a round takes `frames` of them."""
    noise = np.random.default_rng(1).random((12, frames * step // 4, 3))
    blown = cv2.resize(np.tile(noise, (1, 3, 1)), None, fx=4, fy=4, interpolation=cv2.INTER_CUBIC).clip(0, 1)
    picture = np.rint(blown[:, frames * step :][:, : frames * step] * 255).astype(np.uint8)
    return np.stack([np.roll(picture, number * step, axis=1) for number in range(frames)])


class Tensor:
    """Tensor of another library, which offers nothing but DLPack."""

    def __init__(self, array: NDArray[Any]) -> None:
        self.__dlpack__, self.__dlpack_device__ = array.__dlpack__, array.__dlpack_device__


@pytest.mark.parametrize(("kind", "white"), [("uint8", 255), ("uint16", 65535), ("float32", 1)])
@pytest.mark.parametrize("order", ["rgb", "bgr"])
@pytest.mark.parametrize("layout", ["nhwc", "nchw"])
@pytest.mark.parametrize("channels", [3, 4])
def test_frames_are_those_of_stream(kind, white, order, layout, channels):
    """To the bit, in the clip's own type, order and layout, with the times at which they are shown."""
    colours = np.stack([scene(3 * number) for number in range(4)])[..., [0, 1, 2, 0][:channels]]
    bgr = (colours * np.float32(white / 255)).astype(kind)
    places = [2, 1, 0, 3][:channels] if order == "rgb" else slice(None)
    axes = (0, 3, 1, 2) if layout == "nchw" else (0, 1, 2, 3)
    clip = bgr[..., places].transpose(axes)
    frames, times = interpolate_clip(clip, 16, 60, method="nlm-fast", order=order, layout=layout)
    wanted = np.stack(list(stream(list(bgr), fps=60, input_fps=16, method="nlm-fast")))[..., places].transpose(axes)
    assert frames.dtype == kind
    np.testing.assert_array_equal(frames, wanted)
    assert times == [Fraction(number, 60) for number in range(15)]
    lazy = zip(*interpolate_clip(iter(clip), 16, 60, method="nlm-fast", order=order, layout=layout), strict=True)
    np.testing.assert_array_equal(next(lazy), wanted)
    assert list(next(lazy)) == times


@pytest.mark.parametrize(
    "wrap",
    [
        *(Tensor, list, memoryview),
        lambda clip: list(map(Image.fromarray, clip)),
        lambda clip: pytest.importorskip("torch", reason="torch is not installed").from_numpy(clip),
    ],
)
def test_clips_may_be_arrays_of_any_kind(wrap: Callable[[Any], Any]):
    """Tensors, lists of arrays or of PIL's images, buffers; two frames for one unless a rate is given."""
    clip = turntable(4)
    frames, _ = interpolate_clip(wrap(clip), fps=24, method="blend")
    np.testing.assert_array_equal(frames, interpolate_clip(clip, 24, "48", method="blend")[0])
    assert len(frames) == 8


def test_an_iterator_is_read_as_frames_are_made():
    """One without an end; the clip's length is not told."""
    read, told = list[int](), list[tuple[int, int | None]]()

    def endless() -> Iterator[NDArray[np.uint8]]:
        for number in count():
            read.append(number)
            yield scene(number)

    method = keeping_duplicates("blend")
    made = interpolate_clip(
        endless(), 25, method=method, loop=True, threads=1, progress=lambda *done: told.append(done)
    )
    assert read == []
    assert len(list(islice(made, 40))) == 40
    assert len(read) <= 20 + 12 + 10
    assert told == [(number, None) for number in range(1, 41)]
    made.close()


@pytest.mark.parametrize(("fps", "turn"), [(24, 3), (60, 8), (90, 4)])
@pytest.mark.parametrize("repeated", [False, True])
def test_a_loop_has_no_first_frame(fps, turn, repeated):
    """Turned clips give the same frames in turned order, to the bit, with repeated pictures across the seam too."""
    clip = turntable(8).repeat(1 + repeated, axis=0)
    frames, times = interpolate_clip(clip, 24, fps, loop=True)
    turned, _ = interpolate_clip(np.roll(clip, -turn, axis=0), 24, fps, loop=True)
    assert len(frames) == len(times) == len(clip) * fps / 24
    np.testing.assert_array_equal(turned, np.roll(frames, -turn * fps // 24, axis=0))


def test_the_seam_of_a_loop_is_as_even_as_the_rest():
    """A quarter of a step moves a turntable by one pixel, everywhere; for iterators too, at which it ends in time."""
    clip = turntable(12)
    frames, _ = interpolate_clip(clip, 24, factor=4, loop=True)
    truth = [np.roll(clip[0], number, axis=1).astype(float) for number in range(48)]
    errors = np.abs(frames - truth).mean(axis=(1, 2, 3))
    assert errors[-4:].max() <= errors.max() < np.abs(truth[1] - truth[0]).mean() / 4
    lazy = [frame for frame, _ in interpolate_clip(iter(clip), 24, factor=4, loop=True)]
    np.testing.assert_array_equal(lazy[4:], frames[4:])


@pytest.mark.parametrize(
    ("frames", "options", "error", "sentence"),
    [
        (turntable(4), {"factor": 2, "to_fps": 60}, OptionError, "`to_fps` and `factor` both"),
        (turntable(4), {"fps": "0"}, OptionError, "`fps` and `to_fps` must be above 0"),
        (turntable(4), {"to_fps": "soon"}, OptionError, "`to_fps` 'soon' is not a number"),
        (turntable(4), {"order": "grb"}, OptionError, "`order` must be one of rgb, bgr"),
        (turntable(4), {"layout": "nchw"}, InputError, "`frames`, read as `layout=nchw`, must have the shape"),
        (turntable(4).astype(float), {}, InputError, "`frames`.*uint8, uint16 or float32, not float64"),
        (turntable(4)[:1], {}, InputError, "`frames` holds one frame"),
        ([], {"loop": True}, InputError, "`frames` gives no frame"),
        (iter([]), {"loop": True}, InputError, "`frames` gives no frame"),
        (turntable(4)[:, :0], {}, InputError, "`frames`.* must have the shape"),
        (5, {}, InputError, "`frames`.* must have the shape"),
        ([turntable(4)[0], turntable(5)[0]], {}, InputError, "must be alike"),
    ],
)
def test_what_is_no_clip_is_refused(frames, options, error, sentence):
    """In a sentence that names the argument."""
    with pytest.raises(error, match=rf"{sentence}.*\.$"):
        list(interpolate_clip(frames, **{"fps": 16, "method": "blend", **options}))
