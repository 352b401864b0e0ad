"""CPU milliseconds of one method per in-between frame, made as a sequence: ``python benchmarks/sequence_cost.py CLIP``.

The clip is read and the kernels are compiled beforehand. One thread. The last line is JSON.
"""

from __future__ import annotations

import argparse
import json
import time

from scoring import make_between, one_thread, read_frames

from fpsboost.method_table import find_method


def main() -> None:
    """Make the frames, forget them, and print what they cost."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clip")
    parser.add_argument("--method", default="nlm")
    parser.add_argument("--frames", type=int, default=31, help="frames read at most; the last is one end of a pair")
    arguments = parser.parse_args()
    one_thread()
    frames = read_frames(arguments.clip, arguments.frames)
    interpolator = find_method(arguments.method)
    interpolator.compile_for(frames[0])
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
