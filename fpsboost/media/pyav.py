"""PyAV 18.1 and 19 from one code, and what its FFmpeg was built with.

PyAV 19 has rational numbers of its own, which are 0/1 where PyAV 18 has None, and keeps bytes of texts that are not
UTF-8 as surrogates, which cannot be printed; PyAV 18 raises for them, or replaces them if asked to.
"""

import errno
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal, TypeAlias

import av
from av.codec.codec import UnknownCodecError
from av.stream import Stream

from fpsboost.media.errors import OutputError

REFUSALS = (av.error.FFmpegError, ValueError)
"""Exceptions that tell that FFmpeg refuses something: its own, and PyAV's where it does not know a value."""

Packet: TypeAlias = "av.Packet[Any]"
"""Packet of a stream of any kind."""

KEEPS_UNDECODABLE_BYTES = int(av.__version__.partition(".")[0]) >= 19


formats_of_other_files = {"concat", "dash", "hls", "imf", "rtp", "rtsp", "sap", "sdp", "vobsub", "webm_dash_manifest"}
"""FFmpeg's formats of files that name other files, or streams of a network, which are read in their place."""


def open_input(file: Any, *, playlists: bool = False) -> av.container.InputContainer:
    """Open a file for demuxing, and no other without `playlists`; what of its texts is not UTF-8 becomes U+FFFD.

    With `playlists`, the files that HLS names may have any ending, since keys of encrypted segments have none of media.
    """
    allowed = {"allowed_extensions": "ALL"}
    if not playlists:
        formats = ",".join(sorted(av.formats_available - formats_of_other_files))
        allowed = {"format_whitelist": formats, "protocol_whitelist": "file"}
    options: dict[str, Any] = {} if KEEPS_UNDECODABLE_BYTES else {"metadata_errors": "replace"}
    container: av.container.InputContainer = av.open(file, "r", container_options=allowed, **options)
    for tags in (container.metadata, *(stream.metadata for stream in container.streams)):
        texts = printable(tags)
        tags.clear()
        tags.update(texts)
    return container


def pulled(graph: av.filter.Graph) -> Iterator[Any]:
    """Yield the pictures or sounds that a filter graph has ready."""
    with suppress(av.error.BlockingIOError, av.error.EOFError):
        while True:
            yield graph.pull()


@contextmanager
def trial_file() -> Iterator[Path]:
    """Yield the path of a file for a trial; from PyAV's calls of a file object no KeyboardInterrupt comes through."""
    with TemporaryDirectory() as folder:
        yield Path(folder) / "trial"


def packet_of(data: bytes, stream: Stream, time_base: Fraction, begin: int, duration: int) -> Packet:
    """Return a packet of a stream that begins at a time, and lasts, in ticks of a time base."""
    packet = av.Packet(data)
    packet.stream = stream
    packet.time_base = time_base
    packet.pts = packet.dts = begin
    packet.duration = duration
    return packet


def printable(tags: Mapping[str, str]) -> dict[str, str]:
    """Return tags with U+FFFD in place of bytes that are not UTF-8."""

    def replaced(text: str) -> str:
        return text.encode("utf-8", "surrogateescape").decode("utf-8", "replace")

    return {replaced(key): replaced(value) for key, value in tags.items()}


def as_fraction(value: Any) -> Fraction | None:
    """Convert a rational of FFmpeg, which may also be absent, 0/1 or 1/0, into an exact Fraction or None."""
    return Fraction(value.numerator, value.denominator) if value else None


def pyav_version() -> str:
    """Return the version of PyAV."""
    return av.__version__


def ffmpeg_version() -> str:
    """Return the version of the FFmpeg that PyAV brings."""
    return av.ffmpeg_version_info


def find_codec(name: str, mode: Literal["r", "w"]) -> av.Codec | None:
    """Return a decoder (``r``) or an encoder (``w``), or None if FFmpeg was built without it."""
    with suppress(UnknownCodecError):
        return av.Codec(name, mode)
    return None


def missing_codecs(names: Iterable[str], mode: Literal["r", "w"]) -> list[str]:
    """Return those of some decoders (``r``) or encoders (``w``) that FFmpeg was built without.

    Examples
    --------
    >>> missing_codecs(["ffv1", "none-such"], "w")
    ['none-such']
    """
    return [name for name in names if find_codec(name, mode) is None]


@contextmanager
def explained_writing(name: str) -> Iterator[None]:
    """Convert errors of FFmpeg and the operating system into an `OutputError` with a sentence about the file."""
    try:
        yield
    except (av.error.FFmpegError, OSError) as error:
        other = f"could not be written ({error.strerror or error}); try another `codec` or container."
        raise OutputError(f"{name} {_reasons.get(error.errno or 0, other)}") from error


_reasons = dict.fromkeys((errno.EACCES, errno.EPERM), "may not be written; check the permissions of its folder.")
_reasons |= {
    errno.ENOSPC: "could not be finished because the disk is full; free some space and run again.",
    errno.EDQUOT: "could not be finished because the disk quota is used up; free some space and run again.",
    errno.EROFS: "lies on a read-only disk; choose another folder.",
    errno.EFBIG: "grew larger than the disk or the system allows; choose another disk or a higher `crf`.",
}
