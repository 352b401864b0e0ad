"""Packets follow from frames, whatever the number of cores; and encoders leave the priority of threads alone."""

import hashlib
import os
import re
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from fpsboost import ClipInfo, Encoding
from fpsboost.io.output import Output
from fpsboost.io.video.sink import traits_of_image
from fpsboost.io.video.ycc import from_bgr
from fpsboost.media import OutputTiming, VideoEncoder, VideoTraits
from fpsboost.media.encoding import ENCODER_THREADS, choose_encoder, repeatable_parameters

RATE = Fraction(25)


def output_of(encoding: Encoding, height: int = 96, width: int = 128) -> Output:
    """Return an output of pictures of this size."""
    info = ClipInfo("noise", height, width, RATE, 1 / RATE, 12)
    return Output("out.mkv", info, OutputTiming(RATE, Fraction(1, 1000)), encoding=encoding)


def packets_of_noise(encoding: Encoding) -> bytes:
    """Encode twelve small pictures and return extradata and packets, one after the other."""
    images = np.random.default_rng(0).integers(0, 256, (12, 96, 128, 3), dtype=np.uint8)
    traits = traits_of_image(images[0], VideoTraits())
    video = VideoEncoder(output_of(encoding), traits)
    extradata = bytes(video.stream.codec_context.extradata or b"")
    pictures = [from_bgr(image, video.pixel_format, 1, full_range=False) for image in images]
    packets = [
        each for k, picture in enumerate(pictures) for each in video.encode(picture, 40 * k, 40, is_original=False)
    ]
    return extradata + b"".join(bytes(each) for each in (*packets, *video.finish()))


@pytest.mark.parametrize(
    ("encoding", "wanted"),
    [
        (Encoding("h264"), {"threads": str(ENCODER_THREADS), "thread_type": "frame"}),
        (Encoding("libx264rgb"), {"threads": str(ENCODER_THREADS), "thread_type": "frame"}),
        (Encoding("hevc"), {"threads": "4", "x265-params": "log-level=none:info=0:pools=8"}),
        (Encoding("hevc", lossless=True), {"x265-params": "log-level=none:lossless=1:info=0:pools=8"}),
        (Encoding("vp9"), {"threads": str(ENCODER_THREADS)}),
        (Encoding("mjpeg"), {"threads": "1"}),
        (Encoding("ffv1"), {"threads": str(ENCODER_THREADS)}),
        (Encoding("av1", bitrate=100_000), {"svtav1-params": "lp=1"}),
        (Encoding("av1", encoder_options=(("maxrate", "100000"),)), {"svtav1-params": "lp=1"}),
    ],
)
def test_numbers_of_threads_are_given(encoding, wanted):
    """No encoder is left to choose its own."""
    _, options = choose_encoder(output_of(encoding))
    assert wanted.items() <= options.items()


@pytest.mark.parametrize(("width", "height", "threads"), [(2560, 1440, 8), (1440, 2561, 6), (3840, 2160, 6)])
def test_large_pictures_have_fewer_threads(width, height, threads):
    """The size decides, and not the machine; encoders with a number of their own keep it."""
    assert choose_encoder(output_of(Encoding("h264"), height, width))[1]["threads"] == str(threads)
    assert choose_encoder(output_of(Encoding("hevc"), height, width))[1]["threads"] == "4"


def test_a_quality_of_av1_needs_no_single_thread():
    """Only where SVT-AV1 aims at a rate does it depend on its threads."""
    assert "svtav1-params" not in choose_encoder(output_of(Encoding("av1")))[1]


def test_options_of_the_user_win():
    """Their number of threads stays, by either of its names."""
    own = Encoding("h264", encoder_options=(("threads", "2"), ("thread_type", "slice"), ("x264-params", "ref=2")))
    _, options = choose_encoder(output_of(own))
    assert (options["threads"], options["thread_type"]) == ("2", "slice")
    assert options["x264-params"] == ":".join([*repeatable_parameters, "sync-lookahead=0", "ref=2"])
    by_parameter = Encoding("h264", preset="ultrafast", encoder_options=(("x264-params", "threads=3"),))
    assert b" threads=3 " in packets_of_noise(by_parameter)


def test_x264_says_what_it_was_given():
    """The note in the stream names as many threads as anywhere, and no slices."""
    found = re.search(rb" threads=(\d+) lookahead_threads=\d+ sliced_threads=(\d)", packets_of_noise(Encoding("h264")))
    assert found is not None
    assert found.groups() == (b"8", b"0")


def test_x265_says_nothing_of_the_processor():
    """Neither its features nor its cores."""
    assert b"cpuid" not in packets_of_noise(Encoding("hevc", preset="ultrafast"))


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="cores cannot be taken away here")
def test_cores_do_not_matter():
    """A process with one core makes the packets that this one makes."""
    program = (
        "import os, sys, hashlib; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})\n"
        "from test_repeatable_encoding import *\n"
        "for name in sys.argv[1:]: print(hashlib.sha256(packets_of_noise(Encoding(name))).hexdigest())"
    )
    names = ["libx264", "libx264rgb", "libvpx-vp9", "mpeg4"]
    command = [sys.executable, "-c", program, *names]
    digests = subprocess.run(command, cwd=Path(__file__).parent, capture_output=True, text=True, check=True).stdout
    assert digests.split() == [hashlib.sha256(packets_of_noise(Encoding(name))).hexdigest() for name in names]


POLICIES = """if True:
    import os, sys
    from fpsboost.media.encoder import VideoEncoder

    opened, seen = VideoEncoder._open_encoder, set()

    def open_and_look(self, context):
        opened(self, context)
        seen.update(os.sched_getscheduler(int(task)) for task in os.listdir("/proc/self/task"))

    VideoEncoder._open_encoder = open_and_look
    from fpsboost.conversion import convert
    from fpsboost.io.video.decode_options import DecodeOptions
    from fpsboost.io.video.encode_options import Encoding

    rate, av1 = DecodeOptions(input_fps=24), Encoding(codec="av1")
    convert(sys.argv[1], sys.argv[2], method="blend", decoding=rate, encoding=av1)
    print(sorted(seen), os.sched_getscheduler(0))
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="threads are looked at as Linux shows them")
def test_av1_is_encoded_at_ordinary_priority(save_images, tmp_path):
    """SVT-AV1, which takes real-time priority where its user may have it, leaves no thread there."""
    save_images(tmp_path / "in", count=3)
    command = [sys.executable, "-c", POLICIES, str(tmp_path / "in"), str(tmp_path / "out.mkv")]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert told.strip() == f"{[os.SCHED_OTHER]} {os.SCHED_OTHER}"
