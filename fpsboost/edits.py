"""Edits of an opened clip: backwards, without repeats, with the time that gaps took, and as a loop.

Each reads what it must know, and lists the frames anew; see `fpsboost.timing.edit.Edit`.
"""

import math
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise

from fpsboost.analysis.cadence import Repeats
from fpsboost.analysis.duplicates import DuplicateDetector, SourceFrame
from fpsboost.analysis.gaps import find_gaps
from fpsboost.contracts import Entry, FrameSource, OutputRange, RandomAccess
from fpsboost.derived_sources import EditedSource
from fpsboost.errors import OptionError
from fpsboost.frame import ClipInfo
from fpsboost.frame_cache import FrameCache, SourcePosition
from fpsboost.io import DescribedSource
from fpsboost.io.images.source import ImageSource
from fpsboost.io.opening import Target
from fpsboost.io.video.source import VideoSource
from fpsboost.media import TimeMap, Window, counted
from fpsboost.remarks import Remarks
from fpsboost.timeline import positions_of
from fpsboost.timing.edit import Edit
from fpsboost.timing.options import readable
from fpsboost.timing.position import Gaps
from fpsboost.timing.schedule import MAX_FILLED, ByRate, Schedule, count_frames

MAX_LISTED = 40  # gaps that a remark lists

LOOP_CONTEXT = 12
"""Frames of a loop that are read again before its first and after its last one.

Repeated frames are found within `DuplicateDetector.most` frames, and motion within two more.
"""


@dataclass(frozen=True)
class OpenedClip:
    """Source of a conversion: the whole clip, the part that is converted, and its window; None for all."""

    target: Target
    """Where the output goes, which determines how the source is read."""
    whole: DescribedSource
    source: RandomAccess
    read_from: Callable[[int], AbstractContextManager[FrameSource]]
    """Opens `source` once more while a block lasts, to be read from a frame on."""
    window: Window | None
    curve: TimeMap | None = None
    """Which time of the source every output time shows; None where it plays at its own speed."""
    clip_curve: TimeMap | None = None
    """The same of the clip itself, which a source that never plays backwards unfolds."""

    def begin_near(self, seconds: Fraction) -> Fraction | None:
        """Let the whole clip begin where reading can begin next to a time, if it can; return the origin of its times.

        Times count from the clip's first frame. Must be called before the first frame is read.
        """
        if isinstance(self.whole, ImageSource):
            self.whole.keep(int(seconds * self.whole.info.rate), None)
            return -self.whole.position_of(0, Fraction(0)).seconds
        if isinstance(self.whole, VideoSource):
            origin = self.whole.first_time()
            self.whole.skip_to(origin + seconds)
            return origin
        return None

    def edited(self, edit: Edit, info: ClipInfo, remarks: Iterable[str] = ()) -> "OpenedClip":
        """Return the clip with its frames as an edit lists them; the length in `info` is ignored."""
        position_of = positions_of(self.source)
        remarks = Remarks([*self.whole.remarks, *remarks])
        source = EditedSource(edit.of_info(info), remarks, edit, self.read_from, position_of)
        return replace(self, source=source, read_from=source.again)


def played_backwards(clip: OpenedClip, curve: TimeMap) -> OpenedClip:
    """Return a clip whose frames come in the order in which a curve shows them, and so never backwards."""
    times = clip.source.frame_times() if clip.whole.stream_info.files else None
    if times is None:
        raise OptionError(
            f"`retime` plays {clip.whole.info.name} backwards, which needs a file that says when each frame is shown; "
            "let no time fall, or convert it with `factor=1` first."
        )
    edit, unfolded = Edit.whole(times).unfolded(curve)
    return replace(clip.edited(edit, clip.source.info), curve=unfolded)


def without_repeats(clip: OpenedClip) -> OpenedClip:
    """Read a clip, and return it without the frames that repeat a picture.

    Raises `OptionError` if it can be read only once.
    """
    if not clip.whole.stream_info.files:
        raise OptionError("`duplicates='drop'` reads a clip twice, which a pipe does not allow; name a file.")
    found = Repeats(DuplicateDetector())
    for _ in found.groups(map(SourceFrame, clip.source)):
        pass
    info = replace(clip.source.info, mean_rate=None)
    cadence = found.cadence(info.rate)
    edit = found.kept(cadence)
    how = "keep their own times"
    if cadence is not None and cadence.is_certain:
        info = replace(info, rate=cadence.rate, time_base=ByRate(cadence.rate).time_base(info.time_base))
        how = f"are evenly spaced, {readable(info.rate)} per second ({cadence.name})"
    all_frames = len(found.times)
    remarks = Remarks()
    remarks.add("repeats-dropped", count=all_frames - len(edit.frames), frames=all_frames, how=how)
    return clip.edited(edit, info, remarks)


def with_gaps(clip: OpenedClip, gaps: Gaps) -> OpenedClip:
    """Return a clip with each of its frames later by the frames that are missing before it.

    These are found by reading the clip, unless all are listed. Raises `OptionError` if its rate is not constant, or the
    last frame is listed.
    """
    info = clip.source.info
    times = clip.source.frame_times() or ()
    if not times or any(abs((after - time) * info.rate - 1) > Fraction(1, 2) for time, after in pairwise(times)):
        raise OptionError(
            f"`gaps` needs a constant rate and a file that says when each frame is shown, unlike {info.name}; convert "
            "it with `factor=1` first."
        )
    gaps.check("gaps", replace(info, frame_count=len(times), duration=times[-1] - times[0]))
    found = find_gaps(FrameCache(frame.image) for frame in clip.source) if gaps.detect else {}
    missing = [
        gaps.times_listed(number, begin - times[0], end - times[0]) or found.get(number, 0)
        for number, (begin, end) in enumerate(pairwise(times))
    ]
    edit = Edit.whole(times).with_gaps(missing, 1 / info.rate)
    return clip.edited(edit, info, _remarks_on_gaps(missing, info.rate))


def _remarks_on_gaps(missing: list[int], rate: Fraction) -> Remarks:
    """Return the remark on which frames are missing, by their numbers behind each frame."""
    remarks = Remarks()
    places = [f"{number}" + (f"x{count}" if count > 1 else "") for number, count in enumerate(missing) if count]
    if places:
        listed = ",".join(places[:MAX_LISTED]) + (", ..." if len(places) > MAX_LISTED else "")
        total = sum(missing)
        remarks.add("frames-missing", listed=listed, frames=counted(total, "frame"), seconds=float(total / rate))
    else:
        remarks.add("no-frames-missing")
    return remarks


def looped(clip: OpenedClip, schedule: Schedule, *, keeps_sound: bool) -> tuple[EditedSource, OutputRange]:
    """Return the source of a clip as it loops, and the output frames of one round. Decodes the last frame.

    The source goes on with its first frames after its last one, and comes from its last ones before its first; one
    round of it is kept, which lasts until the end of the last frame. So the seam has frames before and after it like
    any other place: pairs, cuts, repeated frames, exposures and side outputs need to know nothing of it.

    Raises
    ------
    OptionError
        The source cannot be read twice, or does not list its frames; or one of them is shown for minutes.
    """
    source = clip.source
    name = clip.whole.info.name
    times = source.frame_times() if clip.whole.stream_info.files else None
    if times is None:
        raise OptionError(
            f"`loop` reads {name} again from its beginning, and needs a file that says when each frame is shown; "
            "convert it with `factor=1` first."
        )
    source.begin_at(0)  # so that the window on the other streams is known
    count = len(times)
    start = times[0]
    with clip.read_from(count - 1) as again:
        *_, last = again
    end = schedule.presentation_time(start, last.time + (last.duration or 1 / source.info.rate))
    if any(after - time > MAX_FILLED for time, after in pairwise([*times, end])):
        raise OptionError(f"`loop` shows no frame for minutes, as {name} does; leave it out.")
    window = clip.window
    if window is not None and window.skipped + count < len(clip.whole.frame_times() or ()):
        window.end = window.begin + end - start  # the clip goes on, and so does its sound
    info = replace(source.info, frame_count=count, duration=end - start)
    total = count_frames(schedule, info, holds_last_frame=True)
    remarks = Remarks(clip.whole.remarks)
    video = clip.whole.stream_info.video
    if keeps_sound and video and "sound" in video.auxiliary_streams:
        remarks.add("loop-of-sound", name=name, frames=total)
    seam = [step.t for step in schedule.steps(count - 1, start, times[-1], end) if not step.is_sample]
    if len(seam) > 1 and not any(seam):
        remarks.add("loop-holds-last", name=name)
    edit = Edit.whole(times).looped(end - start, LOOP_CONTEXT)
    before = schedule.output_position(-LOOP_CONTEXT, start, schedule.presentation_time(start, edit.times[0]))

    def position_of(number: int, seconds: Fraction) -> SourcePosition:
        return positions_of(source)(number % count, seconds % (end - start))

    return (
        EditedSource(info, remarks, edit, clip.read_from, position_of),
        OutputRange(stop=total, entry=Entry(-LOOP_CONTEXT, start, math.ceil(before)), end=end),
    )
