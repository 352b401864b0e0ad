"""Packets of a file, read past damage, and without what nobody wants."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

import av
import av.container
import av.error
import av.stream
from av.format import Flags

from fpsboost.io.video.continuous_clock import ContinuousClock
from fpsboost.io.video.damage import Damage

MAX_FAILURES = 10
"""Errors without a packet between them after which a file counts as unreadable from there on."""

MAX_LOST_SAMPLES = 1000
"""Samples in a row that may lie behind the end of a file. Each takes one attempt of a few microseconds."""

LISTED_BY_SAMPLE = ("mov", "avi")
"""Containers whose index leads to every sample: one that is cut off ends the demuxing, but not the other streams."""

TIMED_BY_DECODING = "avi"
"""The container that has a place for each packet and no times; FFmpeg guesses when a picture is shown by its type."""


def clock_may_jump(container: av.container.InputContainer) -> bool:
    """Whether a container's clock begins anywhere and may begin anew, as that of transport and program streams."""
    return bool(Flags(container.format.flags) & Flags.ts_discont)


def read_packets(
    container: av.container.InputContainer, wanted: Collection[int], damage: Damage
) -> Iterator[av.Packet[Any]]:
    """Yield the packets of some streams that hold data, past damage, on a clock that goes on where the file's jumps.

    Where a container tells only when pictures are decoded, that is their time, and `ShowingOrder` puts it right.

    Parameters
    ----------
    container : av.container.InputContainer
        Streams that nobody wants are skipped from now on, so that damage to them does no harm.
    wanted : collection of int
        Numbers of streams.
    damage : Damage
        Counts places that cannot be read, and jumps of the clock.
    """
    clock = ContinuousClock() if clock_may_jump(container) else None
    for stream in container.streams:
        tells_time = clock is not None and stream.type in ("video", "audio")  # which all readers must agree about
        if stream.index not in wanted and not tells_time:
            stream.discard = av.stream.Discard.all
    for packet in _past_damage(container, damage):
        if clock is not None:
            clock.move(packet)
            damage.joints = clock.jumps
        if packet.stream.index in wanted:
            yield packet


def _past_damage(container: av.container.InputContainer, damage: Damage) -> Iterator[av.Packet[Any]]:
    delays: dict[int, int] = {}
    is_timed_by_decoding = container.format.name == TIMED_BY_DECODING
    is_listed = container.format.name.startswith(LISTED_BY_SAMPLE)
    failures = ends = 0
    while failures < MAX_FAILURES and ends < (MAX_LOST_SAMPLES if is_listed else 1):
        try:
            for packet in container.demux():
                if not packet.size:
                    continue
                failures = ends = 0
                if is_timed_by_decoding and packet.dts is not None:
                    first = packet.dts if packet.pts is None else packet.pts
                    packet.pts = packet.dts + delays.setdefault(packet.stream.index, first - packet.dts)
                yield packet
            ends += 1
        except av.error.FFmpegError:
            failures += 1
            damage.unreadable += failures == 1
