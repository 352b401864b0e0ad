"""Repair of sequences: damaged frames are detected, and grouped with the good ones between which they are replaced."""

from collections.abc import Iterable, Iterator

import numpy as np

from fpsboost.analysis.duplicates import SourceFrame
from fpsboost.analysis.scene_cuts import CutDetector
from fpsboost.errors import InputError
from fpsboost.pair import triplewise
from fpsboost.remarks import Remarks
from fpsboost.timing.position import MAX_RUN, TOO_LONG, Replacement, as_ranges

MAX_MATCH_RATIO = 0.78
"""Largest match score of a band of a damaged frame, as a fraction of that of its neighbours with each other. It is 0.83
and more in 27 clips without damage."""
MIN_MATCH = 0.3  # match score of the neighbours with each other from which a band is looked at
BAND_HEIGHT = 0.2  # height of a band, as a fraction of that of the frame
CERTAIN_AFTER = 2
"""Number of frames, from where reading begins, of which it is not certain whether they are damaged."""

Marked = tuple[SourceFrame, bool]
"""Frame, and whether it is damaged."""


def find_damaged(frames: Iterable[SourceFrame]) -> Iterator[Marked]:
    """Yield each frame and whether no neighbour explains it: single frames with flashes, dropouts or torn fields.

    Somewhere, such a frame matches both of its neighbours far less than they match each other. In fast motion, it is
    the other way round: frames two apart match less than those one apart. As damage often lies in a part of the lines,
    match scores are compared in bands of them. Where frames that stand out follow each other or alternate with others,
    as in a strobe, none is taken for damaged: the two frames before and the two after it decide.
    """
    for before, (frame, is_out), after in triplewise(_standing_out(frames)):
        yield frame, is_out and not any(each[1] for each in (before, after) if each)


def _standing_out(frames: Iterable[SourceFrame]) -> Iterator[Marked]:
    matched_before = nothing_known = np.ones((1, 1), np.float32)
    for before, frame, after in triplewise(frames):
        matched = nothing_known if after is None else _match(frame, after)
        own = _bands(np.maximum(matched_before, matched))
        is_out = False
        if before is not None and after is not None and own.min() < MAX_MATCH_RATIO:  # or no match can exceed it enough
            across = _bands(_match(before, after))
            is_out = bool(((own < MAX_MATCH_RATIO * across) & (across >= MIN_MATCH)).any())
        yield frame, is_out
        matched_before = matched


def _match(frame0: SourceFrame, frame1: SourceFrame) -> np.ndarray:
    """Return how well the thumbnails of two frames match, the worse direction at each pixel."""
    return np.asarray(np.minimum(*CutDetector().match_maps(frame0, frame1)))


def _bands(matched: np.ndarray) -> np.ndarray:
    """Return the means of all bands of lines."""
    lines = max(1, round(BAND_HEIGHT * len(matched)))
    return np.convolve(matched.mean(axis=1), np.full(lines, 1 / lines), "valid")


def group_replaced(
    frames: Iterable[SourceFrame], replacement: Replacement, remarks: Remarks, *, begins_clip: bool = True
) -> Iterator[tuple[SourceFrame, ...]]:
    """Group each good frame with the frames to be replaced that follow it.

    The first frame and those at the end have no good frame on one side and are kept. `remarks` say so, if reading
    begins with the first one, and which frames are not there. Raises `InputError` where too many follow each other.
    """
    group: list[SourceFrame] = []
    number = 0
    end = None
    marked = find_damaged(frames) if replacement.detect else ((frame, False) for frame in frames)
    for _, (frame, is_damaged), after in triplewise(marked):
        place = frame.position
        number = place.number
        end = after[0].position.seconds if after else place.seconds + frame.frame.duration
        is_replaced = is_damaged or replacement.times_listed(number, place.seconds, end) > 0
        if is_replaced and group:
            group.append(frame)
            if len(group) > MAX_RUN + 1:
                raise InputError(f"`replace` has more frames in a row up to {number}, and {TOO_LONG}.")
            continue
        if is_replaced and begins_clip:
            remarks.add("frame-without-good-before", number=number)
        if group:
            yield tuple(group)
        group = [frame]
    yield from zip(group)
    if group[1:]:
        kept = as_ranges(range(number - len(group) + 2, number + 1))
        remarks.add("frames-without-good-after", numbers=kept)
    behind = [] if end is None else replacement.behind(number, end)
    if behind:
        remarks.add("replace-behind-end", number=number, behind=", ".join(behind))
