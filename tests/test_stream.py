"""Frames as arrays: from captures of OpenCV, from arrays, from paths."""

import gc
import subprocess
import sys
import threading
from collections.abc import Iterator
from itertools import count
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from fpsboost import InputError, OptionError, convert, stream
from support.video_truth import write_clip


def gray_frames(*levels: int) -> list[np.ndarray]:
    return [np.full((32, 48, 3), level, np.uint8) for level in levels]


def test_arrays_come_out_with_what_lies_between_them():
    """Twice as many, the last one repeated, as a video of them would hold."""
    made = stream(gray_frames(0, 40, 80), method="blend", duplicates="keep")
    assert [int(image.mean()) for image in made] == [0, 20, 40, 60, 80, 80]


def test_gray_arrays_need_no_axis_for_channels():
    """As OpenCV reads them."""
    made = list(stream([image[..., 0] for image in gray_frames(0, 40)], method="blend", duplicates="keep"))
    assert [image.shape for image in made] == [(32, 48, 1)] * 4


@pytest.mark.parametrize("factor", [2, 3])
def test_a_capture_gives_what_the_arrays_do_that_it_reads(tmp_path, factor):
    """And it stays open: it belongs to the caller."""
    path = str(write_clip(tmp_path / "in.mp4", times=range(5)))
    capture = cv2.VideoCapture(path)
    read = [image for is_there, image in iter(capture.read, (False, None)) if is_there]
    capture.set(cv2.CAP_PROP_POS_FRAMES, 0)
    made = list(stream(capture, factor=factor, method="blend"))
    assert capture.isOpened()
    expected = list(stream(read, factor=factor, method="blend"))
    assert len(made) == len(expected) == 5 * factor
    np.testing.assert_array_equal(made, expected)


def test_a_rate_is_that_of_the_capture(tmp_path):
    """25 frames a second become 60: 5 frames become 12."""
    capture = cv2.VideoCapture(str(write_clip(tmp_path / "in.mp4", times=range(5))))
    assert capture.get(cv2.CAP_PROP_FPS) == 25
    assert len(list(stream(capture, fps=60, method="blend"))) == 12


def test_a_path_gives_as_many_frames_as_its_conversion(tmp_path):
    """And of the same size."""
    path = str(write_clip(tmp_path / "in.mp4", times=range(5)))
    made = list(stream(path, method="blend"))
    assert len(made) == convert(path, str(tmp_path / "out.mp4"), method="blend").frames_out


@pytest.mark.parametrize("threads", [1, 3])
def test_no_more_is_read_than_it_says(threads):
    """Of a source without an end; and reading stops when the caller does."""
    read: list[int] = []

    def endless() -> Iterator[np.ndarray]:
        for number in count():
            read.append(number)
            yield np.full((32, 48, 3), number % 7 * 30, np.uint8)

    frames = stream(endless(), method="blend", duplicates="keep", threads=threads)
    for _ in range(20):
        next(frames)
    assert len(read) <= 10 + 8 + 2 * threads
    frames.close()
    stopped = len(read)
    assert next(iter(endless())) is not None
    assert len(read) == stopped + 1


@pytest.mark.parametrize(
    ("images", "options", "error"),
    [
        ([], {}, InputError),
        (gray_frames(0), {}, InputError),
        ([*gray_frames(0), np.zeros((16, 16, 3), np.uint8)], {}, InputError),
        (gray_frames(0, 40), {"fps": 60}, OptionError),
        (gray_frames(0, 40), {"factor": 2, "fps": 60, "input_fps": 24}, OptionError),
        (gray_frames(0, 40), {"threads": 0}, OptionError),
        (cv2.VideoCapture("missing.mp4"), {}, InputError),
    ],
)
def test_what_cannot_be_streamed_is_refused(images, options, error):
    """In a sentence, which names the option if it is one."""
    with pytest.raises(error, match=rf"{next(iter(options), '')}.*\.$"):
        list(stream(images, method="blend", **options))


def test_the_decoder_can_be_opencv(fpsboost_, tmp_path):
    """All frames come through; what is lost is said."""
    write_clip(tmp_path / "in.mp4", times=range(5), sound="aac")
    done = fpsboost_("in.mp4", "out.mp4", "--decoder", "opencv", "-m", "blend")
    assert done.code == 0
    assert "5 -> 10 frames" in done.err
    assert "without sound" in done.err
    capture = cv2.VideoCapture(str(tmp_path / "out.mp4"))
    assert capture.get(cv2.CAP_PROP_FRAME_COUNT) == 10


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("in.mp4", "--stream", "0"), "--decoder opencv and --stream cannot be combined"),
        (("missing.mp4",), "cannot be opened by OpenCV"),
        (("folder",), "--decoder is for video files"),
    ],
)
def test_what_opencv_cannot_read_is_refused(fpsboost_, tmp_path, save_images, arguments, sentence):
    """Before anything is written."""
    write_clip(tmp_path / "in.mp4", times=range(3))
    save_images(tmp_path / "folder")
    done = fpsboost_(*arguments, "out.mp4", "--decoder", "opencv")
    assert done.code != 0
    assert sentence in done.err
    assert not Path(tmp_path / "out.mp4").exists()


LOOP = """
import itertools, threading
import fpsboost, numpy

def source(stops):
    for number in itertools.count():
        yield numpy.full((32, 48, 3), number % 7 * 30, numpy.uint8)
        if stops and number == 30:
            threading.Event().wait()  # as a camera that gives no more

def loop(end, **options):
    global frames  # named until the interpreter ends
    frames = fpsboost.stream(source("waits" in end), method="blend", **options)
    for number, frame in enumerate(frames):
        if number == 5 and "raise" in end:
            raise {"raise": ZeroDivisionError, "raise^C": KeyboardInterrupt, "raise exit": SystemExit}[end]
        if number == 5:
            break
    if end == "close":
        frames.close()
        assert threading.enumerate() == [threading.main_thread()]
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("end", "code", "threads"),
    [
        *(("break", 0, threads) for threads in (1, 3)),
        *(("raise^C", -2, threads) for threads in (1, 3)),
        *(("waits", 0, 3), ("close", 0, 1), ("raise", 1, 3), ("raise exit", 0, 1)),
    ],
)
def test_a_script_ends_however_its_loop_does(end, code, threads):
    """With the generator still named, and a source that gives no frame any more."""
    run = subprocess.run([sys.executable, "-c", f"{LOOP}loop({end!r}, threads={threads})"], timeout=120, check=False)
    assert run.returncode == code


@pytest.mark.slow
@pytest.mark.parametrize("daemon", [False, True])
def test_a_conversion_beside_the_end_of_a_script_is_whole_or_not_there(tmp_path, daemon):
    """A thread that Python waits for finishes it; another one is cut off, and no part of the output appears."""
    source, made = write_clip(tmp_path / "in.mp4", times=range(60)), tmp_path / "out.mp4"
    script = f"""{LOOP}
from fpsboost.contracts import SilentObserver

class Told(SilentObserver):
    def wrote(self, summary):
        begun.set()

begun = threading.Event()
run = fpsboost.RunOptions(observer=Told())
convert = lambda: fpsboost.convert({str(source)!r}, {str(made)!r}, method="blend", run=run)
threading.Thread(target=convert, daemon={daemon}).start()
begun.wait()
"""
    subprocess.run([sys.executable, "-c", script], timeout=120, check=True)
    assert made.exists() or daemon
    if made.exists():
        with av.open(str(made)) as file:
            assert sum(1 for _ in file.decode(video=0)) == 120


def test_a_loop_that_is_collected_in_a_thread_of_its_own_ends():
    """Its generator is part of a cycle, and Python looks for those in any thread."""
    before, is_dropped = set(threading.enumerate()), threading.Event()

    def endless() -> Iterator[np.ndarray]:
        for number in count():
            if is_dropped.is_set():
                gc.collect()
            yield np.full((32, 48, 3), number % 7 * 30, np.uint8)

    cycle: list[object] = [stream(endless(), method="blend", threads=3)]
    next(cycle[0])  # type: ignore[call-overload]
    cycle.append(cycle)
    threads = set(threading.enumerate()) - before
    del cycle
    is_dropped.set()
    gc.collect()
    for thread in threads:
        thread.join(60)
        assert not thread.is_alive()
