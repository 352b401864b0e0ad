"""Options with which an encoder's packets follow from its frames, whatever the machine.

Chunks of one output may be encoded on several machines, and runs are compared by what they have written. By default the
number of cores decides how many threads an encoder has, and with the number of threads many cut pictures into other
slices, search motion within other limits, or name the number in the stream.
"""

from __future__ import annotations

from collections.abc import Collection

import cv2

CPU_AVX_512F = 13  # OpenCV's number of the CPU feature, which has no name in Python

repeatable_parameters = ("asm=avx2",) if cv2.checkHardwareSupport(CPU_AVX_512F) else ()
"""Entries of ``x264-params`` that make x264 repeat itself; empty where none is needed.

With AVX-512, decisions of x264 (core 165) depend on memory next to its tables, so two runs rarely make the same stream.
"""

ENCODER_THREADS = 8
"""Threads of an encoder, on any number of cores.

With x264 at 1920x1080, presets veryfast to slow, they take no more processor time on 1, 2 or 4 cores than the number
that x264 chooses there. On more cores they bound an encoder to 8 of them, more than its share of a conversion. Each
costs x264 about 20 MB at that size. Its packets depend on their number even where ``mvrange-thread`` and
``lookahead-threads`` are set: always from preset slow on, and at veryfast seen in one of many clips.
"""

LARGE_PICTURE = 2560 * 1440
"""Pixels of a picture beyond which the memory of a thread counts for more than its speed."""

THREADS_FOR_LARGE_PICTURES = 6
"""Threads of an encoder beyond `LARGE_PICTURE`: at 3840x2160, x264 keeps 170 of 1040 MB less than with 8."""

threads_of_encoders = {
    "libx265": 4,
    "libvpx": 1,  # it takes no more than there are cores
    "mjpeg": 1,  # with more it cannot choose the codes of a picture, and files grow by 15 %
}
"""Threads of the encoders that have another number, for pictures of any size."""

# PyAV asks for threads that share a picture: slices cost bits, and there are more of them with every thread. The
# look-ahead needs no thread of its own beside a conversion: without one, x264 keeps 5 pictures less, 100 MB at
# 3840x2160, and makes the same stream, save one with a bounded rate.
_x264_options = (
    ("thread_type", "frame"),
    *(("x264-params", each) for each in (*repeatable_parameters, "sync-lookahead=0")),
)

_further_options = {
    "libx264": _x264_options,
    "libx264rgb": _x264_options,
    # As on 16 cores, where it encodes 4 pictures at once: its lookahead decides differently with a pool of less than 4
    # threads. Its note of its own options names the features of the processor.
    "libx265": (("x265-params", "info=0"), ("x265-params", f"pools={ENCODER_THREADS}")),
}

_of_svt_at_a_rate = (("svtav1-params", "lp=1"),)  # with more threads it aims at a rate differently in every run


def repeatable_options(encoder: str, given: Collection[str], pixels: int) -> tuple[tuple[str, str], ...]:
    """Return the options with which an encoder makes the same packets on any number of cores.

    Parameters
    ----------
    encoder : str
        FFmpeg's name.
    given : collection of str
        Names of the other options.
    pixels : int
        Number of pixels of a picture.

    Examples
    --------
    >>> repeatable_options("mjpeg", (), 1920 * 1080)
    (('threads', '1'),)
    """
    usual = THREADS_FOR_LARGE_PICTURES if pixels > LARGE_PICTURE else ENCODER_THREADS
    threads = threads_of_encoders.get(encoder, usual)
    aims_at_a_rate = not {"b", "maxrate"}.isdisjoint(given)
    further = _of_svt_at_a_rate if encoder == "libsvtav1" and aims_at_a_rate else _further_options.get(encoder, ())
    return ("threads", str(threads)), *further
