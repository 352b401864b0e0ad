"""Read the packets of selected streams of a file, past damaged places."""

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
"""Number of consecutive read errors without a packet after which the rest of a file counts as unreadable."""

MAX_LOST_SAMPLES = 1000
"""Maximum number of consecutive samples beyond the end of a file; each costs one attempt of a few microseconds."""

SAMPLE_INDEX_FORMATS = ("mov", "avi")
"""Containers with an index of every sample, where a truncated sample ends one demuxing pass but not other streams."""

UNTIMED_FORMAT = "avi"
"""Container that stores no times, only packets in order; FFmpeg guesses presentation times from picture types."""


def clock_may_jump(container: av.container.InputContainer) -> bool:
    """Return whether a container's clock may start at any time and may jump, as in transport and program streams."""
    return bool(Flags(container.format.flags) & Flags.ts_discont)


def read_packets(
    container: av.container.InputContainer, wanted: Collection[int], damage: Damage
) -> Iterator[av.Packet[Any]]:
    """Yield the non-empty packets of the wanted streams, past damaged places and with clock jumps removed.

    If a container has no presentation times, they are set from the decoding times; `ReorderBuffer` corrects them.

    Parameters
    ----------
    container : av.container.InputContainer
        Its other streams are discarded from now on, so that damage to them has no effect.
    wanted : collection of int
        Numbers of the streams.
    damage : Damage
        Counts of unreadable places and clock jumps, which are updated.
    """
    clock = ContinuousClock() if clock_may_jump(container) else None
    for stream in container.streams:
        tells_time = clock is not None and stream.type in ("video", "audio")  # all readers must see the same jumps
        if stream.index not in wanted and not tells_time:
            stream.discard = av.stream.Discard.all
    for packet in _demux_past_damage(container, damage):
        if clock is not None:
            clock.move(packet)
            damage.joints = clock.jumps
        if packet.stream.index in wanted:
            yield packet


def _demux_past_damage(container: av.container.InputContainer, damage: Damage) -> Iterator[av.Packet[Any]]:
    delays: dict[int, int] = {}
    is_timed_by_decoding = container.format.name == UNTIMED_FORMAT
    is_listed = container.format.name.startswith(SAMPLE_INDEX_FORMATS)
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
