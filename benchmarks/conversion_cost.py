"""What one conversion from file to file takes: ``python benchmarks/conversion_cost.py CLIP OUTPUT``. Linux only.

It says `ready` when the kernels are loaded, and goes on when it is given a line, so that several begin together. The
last line is JSON: seconds and CPU seconds from then on, and the peak of resident memory.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import time
from pathlib import Path

from fpsboost.contracts import SilentObserver
from fpsboost.conversion import convert
from fpsboost.errors import FpsboostError
from fpsboost.frame import ClipInfo
from fpsboost.io.video.encode_options import Encoding
from fpsboost.memory import limit_free_memory
from fpsboost.method_table import methods
from fpsboost.run_options import RunOptions
from fpsboost.threads import one_opencv_thread

READY = "ready"


class Starting(SilentObserver):
    """Observer that waits for a line on standard input before the first frame is made."""

    size = (0, 0)
    begin = 0.0

    def opened(self, info: ClipInfo, expected_frames: int | None) -> None:
        """Keep the size for the report."""
        self.size = info.width, info.height

    def ready(self) -> None:
        """Print `READY`, wait for a line, and start the clock."""
        print(READY, flush=True)
        if not sys.stdin.readline():
            raise SystemExit("Nobody is left to say when to begin.")
        self.begin = time.process_time()


def main() -> None:
    """Convert a clip, and print the time and the memory that it took."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clip")
    parser.add_argument("output")
    parser.add_argument("--method", default="nlm", choices=methods)
    parser.add_argument("--workers", type=int, default=1)
    arguments = parser.parse_args()
    limit_free_memory()  # as the command does
    observer = Starting()
    try:
        with one_opencv_thread():  # likewise
            summary = convert(
                arguments.clip,
                arguments.output,
                method=arguments.method,
                encoding=Encoding(preset="veryfast"),
                run=RunOptions(observer=observer, overwrite=True, threads=arguments.workers),
            )
    except FpsboostError as error:
        raise SystemExit(str(error)) from error
    # not getrusage's: that holds what the parent had when it started this process
    peak = re.search(r"VmHWM:\s*(\d+) kB", Path("/proc/self/status").read_text())
    assert peak is not None
    figures = {
        "size": observer.size,
        "frames_out": summary.frames_out,
        "seconds": summary.seconds,
        "frames_per_s": summary.frames_out / summary.seconds,
        "cpu_s": time.process_time() - observer.begin,
        "peak_mb": int(peak[1]) / 1024,
    }
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
