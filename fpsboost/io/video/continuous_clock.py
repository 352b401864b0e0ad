"""One clock for recordings that were joined: where the times of a stream jump, they go on from where they were."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import av

MAX_STEP_BACK = Fraction(1, 10)
"""Seconds by which decoding times may run backwards, as in damaged streams, without a new recording beginning."""

MAX_GAP = Fraction(10)
"""Seconds without any packet after which a recording counts as interrupted. Both are what FFmpeg's programs take."""


class ContinuousClock:
    """Moves packets, read in the order of their file, so that pictures and sound go on across jumps.

    Streams jump at different places of the file, because they lie woven into each other. The first one to jump decides
    how far everything behind is moved, so that pictures and sound stay as far apart as they are in every recording.

    Attributes
    ----------
    jumps : int
        How often a recording ended and another one began.
    """

    def __init__(self) -> None:
        self.jumps = 0
        self._moves = [Fraction(0)]
        """How far each recording is moved, seconds."""
        self._places: dict[int, int] = {}
        """Which recording each stream is in."""
        self._ends: dict[int, Fraction] = {}
        """Where the last packet of each stream ended."""

    def move(self, packet: av.Packet[Any]) -> None:
        """Move a packet of pictures, sound or anything else to where it belongs."""
        time = packet.pts if packet.dts is None else packet.dts
        if time is None:
            return
        tick, index = Fraction(packet.time_base), packet.stream.index
        if packet.stream.type in ("video", "audio"):
            place = self._place_of(index, time * tick)
            self._places[index] = place
            self._ends[index] = (time + (packet.duration or 0)) * tick + self._moves[place]
        else:
            place = max(self._places.values(), default=0)
        ticks = round(self._moves[place] / tick)
        if ticks:
            packet.dts = None if packet.dts is None else packet.dts + ticks
            packet.pts = None if packet.pts is None else packet.pts + ticks

    def _place_of(self, index: int, time: Fraction) -> int:
        """Which recording a time of a stream belongs to: the one before, a later one, or a new one."""
        place = self._places.get(index, 0)
        if index not in self._ends or self._goes_on(index, time + self._moves[place]):
            return place
        for later in range(place + 1, len(self._moves)):
            if abs(time + self._moves[later] - self._ends[index]) <= MAX_GAP:
                return later
        self._moves.append(self._ends[index] - time)
        self.jumps += 1
        return len(self._moves) - 1

    def _goes_on(self, index: int, time: Fraction) -> bool:
        return self._ends[index] - MAX_STEP_BACK <= time <= max(self._ends.values()) + MAX_GAP
