"""Read start time and presentation times of a file from its index or first packets, before anything is decoded."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import av.container

from fpsboost.io.video.damage import Damage
from fpsboost.io.video.nominal_rate import listed_times
from fpsboost.io.video.packets import clock_may_jump, read_packets

MAX_SURVEY_PACKETS = 1000
"""Maximum number of video packets that are read: enough to tell 23.976 from 24 frames per second in milliseconds."""

MAX_SURVEY_BYTES = 1 << 26
"""Maximum size of the packets that are read, bytes; it limits the time for reading large packets."""

EDIT_LIST_FORMAT = "mov"
"""Start of FFmpeg's name of the container whose edit lists set the delay before each stream, which is kept."""


@dataclass(frozen=True)
class Survey:
    """Presentation times and start time of a file.

    Attributes
    ----------
    times : list of int
        Presentation times of the pictures in increasing order, in ticks of their stream: all that the index lists, or
        the first ones. Pictures without a time are left out.
    start : Fraction
        Start of video and audio on the file's own clock, seconds; it becomes time 0.
    """

    times: list[int]
    start: Fraction


def survey(container: av.container.InputContainer, video: int) -> Survey:
    """Read the index of a file that was opened for this, or else its first packets.

    The clocks of transmitters, cameras and streaming servers start at an arbitrary time, so the start of a file becomes
    time 0. If the clock starts at the beginning, times before 0 are kept: they belong to decoder preroll, such as the
    first samples of AAC and Opus.

    Parameters
    ----------
    container : av.container.InputContainer
    video : int
        Number of the video stream that is read.
    """
    listed = listed_times(container.streams[video])
    if listed and container.format.name.startswith(EDIT_LIST_FORMAT):
        return Survey(listed, Fraction(0))
    sound = {stream.index for stream in container.streams.audio}
    times: list[int] = []
    can_begin = False
    starts: dict[int, Fraction] = {}
    count = size = 0
    for packet in read_packets(container, {video, *sound}, Damage()):
        if packet.pts is not None and packet.time_base:
            time = packet.pts * Fraction(packet.time_base)
            index = packet.stream.index
            if index == video:
                times.append(packet.pts)
                can_begin = can_begin or packet.is_keyframe
            if index != video or can_begin:  # pictures before the first keyframe cannot be decoded
                starts[index] = min(time, starts.get(index, time))
        count += packet.stream.index == video
        size += packet.size
        if count >= MAX_SURVEY_PACKETS or size >= MAX_SURVEY_BYTES:
            break
    return Survey(listed or sorted(set(times)), _start(container, starts))


def _start(container: av.container.InputContainer, starts: dict[int, Fraction]) -> Fraction:
    if not starts or container.format.name.startswith(EDIT_LIST_FORMAT):
        return Fraction(0)
    start = min(starts.values())
    return start if clock_may_jump(container) else max(start, Fraction(0))
