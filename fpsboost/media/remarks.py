"""Remarks on a video file: the damage that was found while it was read, and what a target does not hold of it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction


@dataclass
class Damage:
    """Counts of the errors found while a video is read."""

    undecodable: int = 0  # packets
    unreadable: int = 0  # places of the file
    corrupt: int = 0  # frames that decoded with errors
    misplaced: int = 0  # frames no later than the one before that were left out
    displaced: int = 0  # such frames that were moved into the gap that follows
    far_ahead: int = 0  # frames far ahead of the next one, which were moved back before it
    jumps: int = 0  # places where the times of the video stream jump back
    joints: int = 0  # places where the clock of the whole file jumps
    untimed: int = 0  # frames

    def remarks(self, name: str, frames: int) -> list[str]:
        """Return the remarks on all faults of a file, of which so many frames could be read."""
        losses = (
            (self.undecodable, "packet", "could not be decoded"),
            (self.unreadable, "place", "could not be read"),
            (self.corrupt, "frame", "decoded with errors"),
        )
        parts = " and ".join(f"{counted(count, what)} {how}" for count, what, how in losses if count)
        damaged = [f"{name} is damaged: {parts}; {counted(frames, 'frame')} could be read."] if parts else []
        times = (
            (self.misplaced, "shows", "no later than the one before; left out."),
            (self.displaced, "gives", "no later time than the one before; put into the gap that follows."),
            (self.far_ahead, "gives", "a time far ahead of the next; put back between its neighbours."),
        )
        of_joined = "as where recordings were joined; pictures, sound and subtitles go on from there."
        of_pictures = "the pictures go on from there, but sound and subtitles may not."
        others = (
            (self.jumps, f"The times of {name} jump back at", "place", f"; {of_pictures}"),
            (self.joints, f"The clock of {name} jumps at", "place", f", {of_joined}"),
            (self.untimed, f"{name} gives no time for", "frame", "; the nominal rate was used."),
        )
        return [
            *damaged,
            *(f"{name} {verb} {counted(count, 'frame')} {how}" for count, verb, how in times if count),
            *(f"{begin} {counted(count, what)}{end}" for count, begin, what, end in others if count),
        ]


def counted(count: int, what: str) -> str:
    """Return a count with its noun: ``1 frame``, ``2 frames``."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def interlaced_remark(name: str, which: str = "", advice: str = "deinterlace it first") -> str:
    """Return the remark on an interlaced clip; `which` may restrict it: `` in 2 of 10 frames``."""
    return f"{name} is interlaced{which} and its fields were taken as whole pictures; {advice} for smooth motion."


def encrypted_sentence(name: str, begin: Fraction = Fraction(0)) -> str:
    """Return the sentence that a video is encrypted from a time on, seconds."""
    if begin <= 0:
        return f"{name} is encrypted (DRM) and cannot be decoded; name a copy that is not."
    end = f"{math.floor(begin * 1000) / 1000:.3f}".rstrip("0").rstrip(".")
    return f"{name} is encrypted (DRM) from {end} s on; `end={end}` converts what is before."


def encrypted_stream_sentence(name: str, kind: str, index: int) -> str:
    """Return the sentence that another stream than the video is encrypted."""
    without = {"audio": "`audio=False`", "subtitle": "`subtitles=False`"}.get(kind, "a copy without it")
    return f"{name} has encrypted {kind} (DRM) in stream {index}; take {without}."


def lost_alpha_remark(name: str) -> str:
    """Return the remark on alpha that the target cannot hold, with the targets that can."""
    return (
        f"{name} has an alpha channel, which was left out; a .webm, images as .png, or `codec='prores_ks'` in a .mov "
        "keep it."
    )


def lost_companions_remark(name: str, companions: Sequence[str], target: str) -> str:
    """Return the remark on audio, subtitles and side data that a type of target cannot hold."""
    return f"{name} has {' and '.join(companions)}, which {target} cannot hold; left out."


def dolby_vision_sentence(name: str) -> str:
    """Return why Dolby Vision without an ordinary base layer is refused."""
    return (
        f"{name} is Dolby Vision whose colours only its own decoders know (profile 5 or a like one); convert it to "
        "HDR10 first, or pass `force_colours=True` to take them for ordinary ones, which turns them green and purple."
    )


def lost_shape_remark(name: str, aspect: Fraction | None) -> str:
    """Return the remark on non-square pixels where images are written."""
    return f"{name} has pixels of the shape {aspect}, which images cannot say; they come out unscaled."


def not_held_remark(name: str, what: str, keeping: Sequence[str]) -> str:
    """Return the remark on a stream that is left out; `keeping` holds the suffixes of containers that keep it."""
    way = f"write {' or '.join(keeping)} to keep it" if keeping else "none of the containers written here does"
    return f"{name} does not hold {what} of its source; {way}."
