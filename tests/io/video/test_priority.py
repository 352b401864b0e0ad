"""Encoders leave the priority of threads alone."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="threads are looked at as Linux shows them")

POLICIES = """if True:
    import os, sys
    from fpsboost.io.video.encoder import VideoEncoder

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


def test_av1_is_encoded_at_ordinary_priority(save_images, tmp_path):
    """SVT-AV1, which takes real-time priority where its user may have it, leaves no thread there."""
    save_images(tmp_path / "in", count=3)
    command = [sys.executable, "-c", POLICIES, str(tmp_path / "in"), str(tmp_path / "out.mkv")]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert told.strip() == f"{[os.SCHED_OTHER]} {os.SCHED_OTHER}"
