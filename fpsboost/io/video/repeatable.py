"""Options with which an encoder's packets follow from its frames, whatever the machine.

Chunks of one output may be encoded on several machines, and runs are compared by what they have written. By default the
number of cores decides how many threads an encoder has, and with the number of threads many cut pictures into other
slices, search motion within other limits, or name the number in the stream.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import cv2

from fpsboost.io.video.encode_options import Encoding

CPU_AVX_512F = 13  # OpenCV's number of the CPU feature, which has no name in Python

repeatable_parameters = ("asm=avx2",) if cv2.checkHardwareSupport(CPU_AVX_512F) else ()
"""Entries of ``x264-params`` that make x264 repeat itself; empty where none is needed.

With AVX-512, decisions of x264 (core 165) depend on memory next to its tables, so two runs rarely make the same stream.
"""

ENCODER_THREADS = 8
"""Threads of an encoder whose packets depend on their number, on any number of cores.

With x264 at 1920x1080, presets veryfast to slow, they take no more processor time on 1, 2 or 4 cores than the number
that x264 chooses there. On more cores they bound an encoder to 8 of them, more than its share of a conversion.
"""

threads_of_encoders = {
    "libx265": 4,
    "libvpx": 1,  # it takes no more than there are cores
    "mjpeg": 1,  # with more it cannot choose the codes of a picture, and files grow by 15 %
}
"""Threads of the encoders that have another number than `ENCODER_THREADS`."""

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


def repeatable_options(encoder: str, given: Collection[str] = ()) -> tuple[tuple[str, str], ...]:
    """Return the options with which an encoder makes the same packets on any number of cores.

    Parameters
    ----------
    encoder : str
        FFmpeg's name.
    given : collection of str
        Names of the other options.

    Examples
    --------
    >>> repeatable_options("mjpeg")
    (('threads', '1'),)
    """
    threads = threads_of_encoders.get(encoder, ENCODER_THREADS)
    aims_at_a_rate = not {"b", "maxrate"}.isdisjoint(given)
    further = _of_svt_at_a_rate if encoder == "libsvtav1" and aims_at_a_rate else _further_options.get(encoder, ())
    return ("threads", str(threads)), *further


_lookahead_threads = {"ultrafast": 1, "superfast": 1, "veryfast": 2, "faster": 2, "fast": 1, "medium": 1}
"""Threads of x264's look-ahead by preset, as with `ENCODER_THREADS`.

Slower presets are missing: they choose how to predict motion by what other threads have finished (``direct=auto``).
"""

THREAD_HEIGHT = 24
"""Lines that a thread of x264 works on at a time, its ``X264_THREAD_HEIGHT``."""


def with_threads_for(
    cores: int, encoder: str, options: Mapping[str, str], encoding: Encoding, height: int
) -> dict[str, str]:
    """Return an encoder's options with no more threads than the cores keep busy, where the packets stay the same.

    Every thread has pictures of its own: 20 MB for x264 at 1920x1080, 70 MB at 3840x2160. Its packets depend on the
    number of threads by how far motion may reach into pictures that others work on and by how the look-ahead is
    divided, which can be set, and where it aims at a rate. Those of x265 depend on it only there.

    Parameters
    ----------
    cores : int
    encoder : str
        FFmpeg's name.
    options : mapping of str to str
        The encoder's options, those of `repeatable_options` among them.
    encoding : Encoding
        What was asked for. Options for the encoder itself leave everything as it is.
    height : int
        Of the pictures, pixels.

    Examples
    --------
    >>> with_threads_for(2, "libx265", {"threads": "4", "x265-params": "info=0"}, Encoding(), 1080)
    {'threads': '2', 'x265-params': 'info=0:pools=4'}
    """
    if encoding.bitrate is not None or encoding.encoder_options:
        return dict(options)
    if encoder == "libx265":
        # With a single picture at once, or a smaller pool, it decides differently.
        threads = 2 if cores < 8 else 3 if cores < 16 else 4
        added = {"pools": min(max(cores, 4), ENCODER_THREADS)}
    elif encoder in ("libx264", "libx264rgb") and (encoding.preset or "medium") in _lookahead_threads:
        threads = min(max(cores * 3 // 2, 2), ENCODER_THREADS)
        reach = ((height + THREAD_HEIGHT) // ENCODER_THREADS - THREAD_HEIGHT) // 2  # as x264 would choose for them
        added = {
            "lookahead-threads": _lookahead_threads[encoding.preset or "medium"],
            "mvrange-thread": max(reach, 1),
        }
    else:
        return dict(options)
    name = f"{encoder.removesuffix('rgb').removeprefix('lib')}-params"
    parameters = [options[name], *(f"{key}={value}" for key, value in added.items())]
    return {**options, "threads": str(threads), name: ":".join(parameters)}


def with_named_threads(packet: bytes, used: str, named: str) -> bytes:
    """Return the first packet of x264 with a note of its options that names the threads which make the same packets.

    Parameters
    ----------
    packet : bytes
        That of another encoder is returned as it is.
    used, named : str
        Number of threads that x264 was given, and the one to name: digits, as many in one as in the other.

    Examples
    --------
    >>> with_named_threads(b"options: threads=3 lookahead_threads=1", "3", "8")
    b'options: threads=8 lookahead_threads=1'
    """
    before, after = (f" threads={each} lookahead_threads=".encode() for each in (used, named))
    return packet.replace(before, after, 1)
