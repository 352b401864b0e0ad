"""What headers and first packets of a video file say, before a picture is decoded."""

from fractions import Fraction
from typing import NamedTuple

from fpsboost.media.clock import VideoClock, survey
from fpsboost.media.demuxer import Demuxer, VideoFile, is_fragmented, is_raw, remark_on_others
from fpsboost.media.errors import OptionError
from fpsboost.media.frame_rate import ASSUMED_RATE, measure_rate, nominal_rate
from fpsboost.media.info import ClipInfo
from fpsboost.media.pyav import as_fraction
from fpsboost.media.remarks import Remarks
from fpsboost.media.side_data import HeaderData, read_header
from fpsboost.media.tags import ORDER, unread_of_chapters


class ClipHeader(NamedTuple):
    """What headers and first packets of a video file say."""

    info: ClipInfo
    """Size, frame rate and length."""
    file: VideoFile
    """The file, whose other streams a writer can carry over."""
    clock: VideoClock
    """Its clock."""
    sides: HeaderData
    """Crop, and Dolby Vision."""
    clear: Fraction | None
    """How long the pictures last that are before an encrypted one, seconds; None if none is."""


def read_clip_header(demuxer: Demuxer, remarks: Remarks) -> ClipHeader:
    """Return what headers and first packets of a file say.

    Adds remarks on a crop, ignored video streams, ordered chapters and an assumed frame rate. Raises `OptionError` for
    a frame rate that the file declares itself.
    """
    name = demuxer.name
    reading = demuxer.reading
    streams = demuxer.container.streams
    stream = demuxer.stream
    context = stream.codec_context
    reading.check_size(name, context.width, context.height)
    sides = read_header(stream)
    left, top, right, bottom = sides.crop or (0, 0, 0, 0)
    width = context.width - left - right
    height = context.height - top - bottom
    if sides.crop is not None:
        remarks.add("cropped", name=name, shown=f"{width}x{height}", coded=f"{context.width}x{context.height}")
    with demuxer.open_again() as again:
        times, start, clear = survey(again, stream.index)
    tick = as_fraction(stream.time_base)
    measured = None if tick is None else measure_rate(times, tick)
    remark_on_others(remarks, demuxer.container, stream, name)
    if ORDER in unread_of_chapters(demuxer.container):
        remarks.add("ordered-chapters", name=name)
    raw = is_raw(demuxer.container)
    said_rate, rate_is_known = nominal_rate(stream, measured, raw=raw)
    coded_rate = reading.input_fps or said_rate
    if reading.input_fps and rate_is_known and not raw:
        raise OptionError(f"`input_fps` is for images and raw streams; {name} says its own frame rate.")
    if not reading.input_fps and not rate_is_known:
        remarks.add("rate-assumed", name=name, rate=ASSUMED_RATE, advice="; pass `input_fps` to set it")
    tick = 1 / (2 * coded_rate) if raw else tick or 1 / coded_rate
    fields = 2 if reading.deinterlace else 1
    clock = VideoClock(demuxer, start, tick, tick / fields, coded_rate * fields, raw_rate=said_rate if raw else None)
    auxiliary = ["sound"] * bool(streams.audio) + ["subtitles"] * bool(streams.subtitles)
    file = VideoFile(demuxer.path, name, stream.index, start, coded_rate, auxiliary, reading.allow_playlists)
    ticks = demuxer.duration
    count = None if is_fragmented(stream) else fields * stream.frames or None
    duration = None if ticks is None else ticks * tick
    mean_rate = None if measured is None else measured.mean_rate * fields
    info = ClipInfo(name, height, width, clock.rate, clock.time_base, count, duration, mean_rate)
    return ClipHeader(info, file, clock, sides, clear)
