"""Remove timestamp discontinuities from joined recordings, so that times continue across each jump."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import av

MAX_STEP_BACK = Fraction(1, 10)
"""Maximum backward step of decoding times, as in damaged streams, that is not taken for a new recording, seconds."""

MAX_GAP = Fraction(10)
"""Maximum gap between packets that is not taken for a new recording, seconds.

Both values are those of FFmpeg's programs.
"""


class ContinuousClock:
    """Offsets for the times of packets, read in file order, that make video and audio continuous across jumps.

    Streams jump at different places of the file because their packets are interleaved. The first stream to jump
    determines the offset of everything after it, so that video and audio keep the distance that they have in each
    recording.

    Attributes
    ----------
    jumps : int
        Number of jumps, each from the end of one recording to the start of the next.
    """

    def __init__(self) -> None:
        self.jumps = 0
        self._moves = [Fraction(0)]
        """Time offset of each recording, seconds."""
        self._places: dict[int, int] = {}
        """Index of the current recording of each stream."""
        self._ends: dict[int, Fraction] = {}
        """End of the last packet of each stream after its offset, seconds."""

    def move(self, packet: av.Packet[Any]) -> None:
        """Add the offset of its recording to the times of a packet of any stream."""
        time = packet.pts if packet.dts is None else packet.dts
        if time is None:
            return
        tick, index = Fraction(packet.time_base), packet.stream.index
        if packet.stream.type in ("video", "audio"):
            place = self._recording_of(index, time * tick)
            self._places[index] = place
            self._ends[index] = (time + (packet.duration or 0)) * tick + self._moves[place]
        else:
            place = max(self._places.values(), default=0)
        ticks = round(self._moves[place] / tick)
        if ticks:
            packet.dts = None if packet.dts is None else packet.dts + ticks
            packet.pts = None if packet.pts is None else packet.pts + ticks

    def _recording_of(self, index: int, time: Fraction) -> int:
        """Return the recording that a time of a stream belongs to: the current one, a later one, or a new one."""
        place = self._places.get(index, 0)
        if index not in self._ends or self._is_continuous(index, time + self._moves[place]):
            return place
        for later in range(place + 1, len(self._moves)):
            if abs(time + self._moves[later] - self._ends[index]) <= MAX_GAP:
                return later
        self._moves.append(self._ends[index] - time)
        self.jumps += 1
        return len(self._moves) - 1

    def _is_continuous(self, index: int, time: Fraction) -> bool:
        return self._ends[index] - MAX_STEP_BACK <= time <= max(self._ends.values()) + MAX_GAP
