"""CPU milliseconds of one method per in-between frame, made as a sequence: ``python benchmarks/sequence_cost.py CLIP``.

The clip is read and the library of kernels loaded beforehand. One thread. The last line is JSON.
"""

from __future__ import annotations

import argparse
import json
import time

from scoring import make_between, one_thread, read_frames

from fpsboost.colour import Coding
from fpsboost.image import Image, YCbCrImage
from fpsboost.io.video.ycc import from_bgr, in_planes
from fpsboost.method_table import find_method


def as_video(image: Image) -> YCbCrImage:
    """Convert a frame to planes as video stores them: 4:2:0, 8 bits, limited range, BT.709."""
    coding = Coding(8, 1, full_range=False, chroma_location="left", pixel_format="yuv420p")  # 1: BT.709
    return in_planes(from_bgr(image, coding.pixel_format, coding.color_space, full_range=False), coding)


def main() -> None:
    """Make the in-between frames, discard them, and print the time that they took."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clip")
    parser.add_argument("--method", default="nlm")
    parser.add_argument("--frames", type=int, default=31, help="frames read at most; the last is one end of a pair")
    parser.add_argument("--video", action="store_true", help="in planes of 4:2:0, 8 bits, and not as arrays of BGR")
    arguments = parser.parse_args()
    one_thread()
    frames = read_frames(arguments.clip, arguments.frames)
    if arguments.video:
        frames = [as_video(frame) for frame in frames]
    interpolator = find_method(arguments.method)
    list(make_between(interpolator, frames[:4]))
    wall, cpu = time.perf_counter(), time.process_time()
    made = sum(1 for _ in make_between(interpolator, frames))
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    height, width = frames[0].shape[:2]
    figures = {
        "method": arguments.method,
        "size": [width, height],
        "n_interp": made,
        "cpu_per_interp_ms": cpu * 1e3 / made,
        "wall_per_interp_ms": wall * 1e3 / made,
    }
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
