"""What the first packets of a file say about its clocks, before anything is decoded."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import av.container

from fpsboost.io.video.damage import Damage
from fpsboost.io.video.nominal_rate import listed_times
from fpsboost.io.video.packets import clock_may_jump, read_packets

PACKETS_LOOKED_AT = 1000
"""Pictures whose times are looked at: enough to tell 23.976 from 24 per second by times in milliseconds."""

BYTES_LOOKED_AT = 1 << 26
"""Where pictures are large, fewer of them are looked at, so that nobody waits for the disk."""

TIMED_BY_EDITS = "mov"
"""The container whose edit lists say how much nothing comes before a stream; that is kept."""


@dataclass(frozen=True)
class Survey:
    """The clocks of a file.

    Attributes
    ----------
    times : list of int
        When pictures are shown, ticks of their stream, rising: all that the index lists, or the first ones. Pictures
        without a time are left out.
    start : Fraction
        Where pictures and sound begin on the file's own clock, seconds; becomes 0.
    """

    times: list[int]
    start: Fraction


def survey(container: av.container.InputContainer, video: int) -> Survey:
    """Read the index of a file that was opened for this, or else its first packets.

    Transmitters, cameras and streaming servers count from some moment of their own, so what a file begins with is
    shown at 0. Times before 0 are kept where a clock counts from the beginning: they are what a decoder needs to get
    going, as the first samples of AAC and Opus.

    Parameters
    ----------
    container : av.container.InputContainer
    video : int
        Number of the video stream that is read.
    """
    listed = listed_times(container.streams[video])
    if listed and container.format.name.startswith(TIMED_BY_EDITS):
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
            if index != video or can_begin:  # what comes before the first key frame cannot be shown
                starts[index] = min(time, starts.get(index, time))
        count += packet.stream.index == video
        size += packet.size
        if count >= PACKETS_LOOKED_AT or size >= BYTES_LOOKED_AT:
            break
    return Survey(listed or sorted(set(times)), _start(container, starts))


def _start(container: av.container.InputContainer, starts: dict[int, Fraction]) -> Fraction:
    if not starts or container.format.name.startswith(TIMED_BY_EDITS):
        return Fraction(0)
    start = min(starts.values())
    return start if clock_may_jump(container) else max(start, Fraction(0))
