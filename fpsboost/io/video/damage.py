"""Counts of the errors in a video file, gathered while it is read, and remarks on them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Damage:
    """Counts of the errors found while a video is read.

    Attributes
    ----------
    undecodable, unreadable : int
        Packets that could not be decoded, and places of the file that could not be read.
    corrupt : int
        Frames that decoded with errors.
    misplaced, displaced : int
        Frames whose time is not later than the frame before: left out, and moved into the gap that follows.
    far_ahead : int
        Frames whose time is far ahead of the next frame's, and which were moved back before it.
    jumps : int
        Places where the times of the video stream jump back; the times after each are offset to continue.
    joints : int
        Places where the clock of the whole file jumps; the times after each are offset to continue.
    untimed : int
        Frames without a time.
    """

    undecodable: int = 0
    unreadable: int = 0
    corrupt: int = 0
    misplaced: int = 0
    displaced: int = 0
    far_ahead: int = 0
    jumps: int = 0
    joints: int = 0
    untimed: int = 0

    def remarks(self, name: str, frames: int) -> list[str]:
        """Return remarks on the errors of a file of which `frames` frames could be read."""
        parts = []
        if self.undecodable:
            parts.append(f"{counted(self.undecodable, 'packet')} could not be decoded")
        if self.unreadable:
            parts.append(f"{counted(self.unreadable, 'place')} could not be read")
        if self.corrupt:
            parts.append(f"{counted(self.corrupt, 'frame')} decoded with errors")
        said = []
        if parts:
            said.append(f"{name} is damaged: {' and '.join(parts)}; {counted(frames, 'frame')} could be read.")
        if self.misplaced:
            said.append(f"{name} shows {counted(self.misplaced, 'frame')} no later than the one before; left out.")
        if self.displaced:
            said.append(
                f"{name} gives {counted(self.displaced, 'frame')} no later time than the one before; put into the gap "
                "that follows."
            )
        if self.far_ahead:
            said.append(
                f"{name} gives {counted(self.far_ahead, 'frame')} a time far ahead of the next; put back between its "
                "neighbours."
            )
        if self.jumps:
            said.append(
                f"The times of {name} jump back at {counted(self.jumps, 'place')}; the pictures go on from there, but "
                "sound and subtitles may not."
            )
        if self.joints:
            said.append(
                f"The clock of {name} jumps at {counted(self.joints, 'place')}, as where recordings were joined; "
                "pictures, sound and subtitles go on from there."
            )
        if self.untimed:
            said.append(f"{name} gives no time for {counted(self.untimed, 'frame')}; the nominal rate was used.")
        return said


def counted(count: int, what: str) -> str:
    """Return a count with its noun: ``1 frame``, ``2 frames``."""
    return f"{count} {what}{'' if count == 1 else 's'}"
