"""What lies in the part of a source that is written: packets and chapters, at their times in the output."""

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from av.container import InputContainer
from av.stream import Stream

from fpsboost.media.clock import Window
from fpsboost.media.pyav import Packet, packet_of, printable


def packets_within(window: Window, packet: Packet, stream: Stream, *, exact_times: bool) -> Sequence[Packet]:
    """Return a packet of a stream, moved like the pictures, if it lies in a window; a cue as often as it is shown.

    With `exact_times`, the container can hold packets before time 0, and hides them.
    """
    tick = Fraction(packet.time_base)
    dts = packet.dts or 0
    pts = dts if packet.pts is None else packet.pts
    begin = pts * tick
    end = (pts + max(packet.duration or 0, 1)) * tick
    # Matroska has no times before 0: there all packets are offset, as of a whole clip, or what comes before is lost
    leads = not exact_times and packet.stream.type == "audio" and window.begin == window.origin
    if (end <= window.begin and not leads) or (window.end is not None and begin >= window.end):
        return []
    moved = round(window.begin / tick)
    packet.pts = pts - moved
    packet.dts = dts - moved
    if packet.stream.type == "subtitle":
        begin = max(begin, window.begin)
        end = end if window.end is None else min(end, window.end)
        if packet.duration or window.reverses:
            times = [(round(time0 / tick), round(time1 / tick)) for time0, time1 in window.passages(begin, end)]
            return [_shown_from(packet, stream, time0, time1) for time0, time1 in times if time0 < time1]
        packet.pts = packet.dts = round(window.output_time(begin) / tick)
    return [packet] if packet.pts >= 0 or exact_times or leads else []


def _shown_from(packet: Packet, stream: Stream, begin: int, end: int) -> Packet:
    """Return a copy of a cue of a stream that is shown from one tick to another."""
    again = packet_of(bytes(packet), stream, packet.time_base, begin, end - begin)
    for data in packet.iter_sidedata():
        again.set_sidedata(data)
    return again


def chapters_within(file: InputContainer, window: Window, start: Fraction) -> list[Any]:
    """Return the chapters that overlap a window, cut to it, with their output times."""
    kept: list[Any] = []
    for chapter in file.chapters():
        tick = Fraction(chapter["time_base"] or 1)
        begin = max(chapter["start"] * tick - start, window.begin)
        end = chapter["end"] * tick - start
        end = end if window.planned_end is None else min(end, window.planned_end)
        for time0, time1 in window.passages(begin, end) if begin < end else ():
            times = {"start": round(time0 / tick), "end": round(time1 / tick)}
            if times["start"] < times["end"]:
                kept.append({**chapter, **times, "metadata": printable(chapter["metadata"])})
    if window.reverses:
        kept.sort(key=lambda chapter: chapter["start"] * Fraction(chapter["time_base"] or 1))
        kept = [{**chapter, "id": number} for number, chapter in enumerate(kept, 1)]  # one may come several times
    return kept
