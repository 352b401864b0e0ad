"""Timing of the output: its options, the resulting schedule for a clip, and the intervals between its frames."""

from __future__ import annotations

from dataclasses import dataclass, replace
from fractions import Fraction
from typing import TYPE_CHECKING, Annotated, Literal

from fpsboost.errors import InputError, OptionError, rounded
from fpsboost.media import ALL_SPEEDS, FOREVER, OutputTiming, TimeMap, is_implausible
from fpsboost.options import AnyDuplicates, Checked, PathName, Range, Rate, option
from fpsboost.remarks import Remarks
from fpsboost.timing.position import Gaps, Replacement, format_time
from fpsboost.timing.retime import parse_curve, parse_speeds, read_curve
from fpsboost.timing.schedule import (
    MAX_FACTOR,
    MAX_FILLED,
    MAX_RATE,
    ByFactor,
    ByRate,
    RetimeSchedule,
    Schedule,
    longest_interval,
    parse_number,
    parse_rate,
    representable,
)
from fpsboost.timing.shutter import DEFAULT_SAMPLES, Shutter

if TYPE_CHECKING:  # --help does not wait for NumPy
    from fpsboost.frame import ClipInfo

DEFAULT_FACTOR = Fraction(2)
"""Output frames per source frame if no rate is given."""

Factor = Annotated[Rate, Range(above=0, most=MAX_FACTOR)]
OutputRate = Annotated[Rate, Range(above=0, most=MAX_RATE)]
SlowSound = Literal["drop", "stretch"]
"""Treatment of sound at other speeds than the source's."""


@dataclass(frozen=True)
class Timing(Checked):
    """What the output shows when, and its frame rate; by default constant, and twice the source's.

    Parameters
    ----------
    factor : Fraction, int, float or str, optional
        Output frames per source frame: 3, 2.5, ``"5/2"``.
    fps : Fraction, int, float or str, optional
        Output frames per second, instead of `factor`; 23.976, 29.97, 59.94 and 119.88 mean the exact rates of NTSC,
        such as 60000/1001.
    keep_timing : bool
        Multiply the frames of each interval, so that a variable rate stays variable.
    slow_motion : bool
        Play `factor` times as long, at the source's rate or at `fps`.
    slow_motion_sound : {'drop', 'stretch'}, optional
        Whether the audio of slow motion is dropped, the default, or stretched at its own pitch; with `retime` or
        `speed`, it is stretched by default where the speed is constant and from 0.5 to 2, with ``stretch`` at any
        constant speed above 0, and silent elsewhere.
    retime : str or os.PathLike, optional
        Which time of the source each output time shows, ``0=0 2s=2s 3s=2.25s``, or the name of a file; see
        `fpsboost.timing.retime.parse_curve`. The output has the source's rate, unless `factor` or `fps` is given.
    speed : str, optional
        The same as speeds of parts of the source; see `fpsboost.timing.retime.parse_speeds`.
    loop : bool
        Make a loop: the last frame leads to the first one, and the frames between these two are made, too. The clip
        lasts as long as before, and n frames become n times the factor, rounded up. The clip must be a file or a
        folder, which is read twice at its end.
    fill_gaps : bool
        Interpolate the missing images of a numbered sequence, whose numbers are its clock: `factor` then counts frames
        per number, 1 by default, and no gap is too long.
    replace : Replacement, str or os.PathLike, optional
        Damaged frames (``120-123,340,1:02.5``, or ``auto``), which are interpolated from the good ones around them.
        All others stay, repeated ones too; unless a rate is given, the output has one frame per source frame.
    gaps : Gaps, str or os.PathLike, optional
        Frames of a clip of constant rate behind which the camera dropped one or, with ``x2``, more
        (``120,340x2,1:02.5``), or ``auto``, which finds gaps in camera motion. All frames after a gap are shown later,
        and the missing ones are interpolated; sound stays as it is. Unless a rate is given, the output has the source's
        frames and the missing ones. With ``auto``, the clip is read twice.
    shutter : Fraction, int, float or str, optional
        Motion blur: shutter angle, degrees, above 0 and at most 360. Every frame, the source's own too, becomes the
        mean of several that are made around its time, over this share of the interval between output frames.
    shutter_samples : int
        Number of frames that are averaged, odd. No steps are visible with one for each pixel of the
        fastest motion during the exposure.
    duplicates : {'interpolate', 'keep', 'drop'}
        Frames that repeat the one before: replaced by interpolated ones; kept as they are; or left out before anything
        else. Then the clip has the rate of its pictures, which is constant where the repeats have a regular cadence,
        and otherwise variable. `factor` multiplies it, by 1 unless it is given. The clip is read twice.

    Raises
    ------
    OptionError
        Options contradict each other, or one is out of range.

    Examples
    --------
    >>> Timing(factor=4, slow_motion=True).stretch, Timing(fps=59.94).fps
    (Fraction(4, 1), Fraction(60000, 1001))
    """

    factor: Factor | None = option(
        None, "Output frames per input frame: 3, 5/2; else 2.", short="f", metavar="N", parse=parse_number
    )
    fps: OutputRate | None = option(None, "Output frames per second: 60, 59.94, 60000/1001.", parse=parse_rate)
    keep_timing: bool = option(False, "Keep a variable rate: multiply each interval.")
    slow_motion: bool = option(False, "Keep the rate and play `factor` times as long.")
    slow_motion_sound: SlowSound | None = option(None, "Audio at other speeds: drop or stretch.")
    retime: PathName | None = option(
        None, "Speed ramp OUT=IN: 0=0 2s=2s 3s=2.25s, or a file.", metavar="CURVE", parse=read_curve
    )
    speed: str | None = option(None, "Speed of parts of the input: 0.25@60s-1:05.", metavar="SPEEDS")
    loop: bool = option(False, "Make a loop: the last frame leads to the first.")
    fill_gaps: bool = option(False, "Interpolate only the missing image numbers.", group="Input")
    replace: Replacement | None = option(
        None,
        "Damaged frames: 120-123,1:02.5,62s, FILE or auto.",
        metavar="FRAMES",
        group="Input",
        parse=Replacement.parse,
    )
    gaps: Gaps | None = option(
        None,
        "Frames before missing ones: 120,340x2, FILE, auto.",
        metavar="FRAMES",
        group="Input",
        parse=Gaps.parse,
    )
    shutter: Annotated[Rate, Range(above=0, most=360, unit=" degrees")] | None = option(
        None, "Motion blur of this shutter angle, up to 360.", metavar="DEGREES", parse=parse_number
    )
    shutter_samples: int = option(DEFAULT_SAMPLES, "Frames averaged for motion blur, odd.")
    duplicates: AnyDuplicates = option("interpolate", "Repeats: interpolate, keep, drop.", group="Input")

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.exposure  # raises an error for a wrong number of samples

    @property
    def exposure(self) -> Shutter | None:
        """Shutter of the motion blur; None without it."""
        return None if self.shutter is None else Shutter(Fraction(self.shutter), self.shutter_samples)

    @property
    def multiple(self) -> Fraction:
        """Output frames per source frame, for a clip without `fps`."""
        if self.factor is not None:
            return Fraction(self.factor)
        return Fraction(1) if self.fill_gaps or self.retimes or self.keeps_frames else DEFAULT_FACTOR

    @property
    def slow_map(self) -> TimeMap | None:
        """Time map of slow motion; None without it."""
        return None if self.stretch == 1 else TimeMap.through([(Fraction(0), Fraction(0))], onward=1 / self.stretch)

    @property
    def retimes(self) -> bool:
        """Whether `retime` or `speed` changes the speed."""
        return self.retime is not None or self.speed is not None

    def time_map(self, info: ClipInfo, first_number: int = 1) -> TimeMap | None:
        """Return the time map of a clip; None if the whole clip plays at its own speed.

        `first_number` is the number that Nuke gives the clip's first frame, for curves of bare frame numbers. Raises
        `OptionError` if the curve cannot be read, or goes beyond the end of the clip.
        """
        rate = info.rate * self.multiple if self.fps is None else Fraction(self.fps)
        if self.retime is not None:
            curve = parse_curve(str(self.retime), rate, info.rate, first_number)
        elif self.speed is not None:
            curve = parse_speeds(self.speed, info.rate)
        else:
            return None
        latest = max(each.source0 for each in curve.segments) if curve.is_open else curve.top
        if info.duration is not None and latest > info.duration + 1 / info.rate:
            places = f"goes to {format_time(latest)} of {info.name}, which ends at {format_time(info.duration)}"
            raise OptionError(f"`{'speed' if self.retime is None else 'retime'}` {places}; lower the source's times.")
        if self.slow_motion_sound == "stretch":
            curve = replace(curve, sound_speeds=ALL_SPEEDS)
        return None if curve.is_plain(info.duration) else curve

    @property
    def keeps_frames(self) -> bool:
        """Whether the output has exactly the source's frames, of which some are replaced, left out or added."""
        edits = self.replace is not None or self.gaps is not None or self.duplicates == "drop"
        return edits and self.factor is None and self.fps is None and not self.slow_motion and not self.retimes

    def of_passage(self) -> Timing:
        """Return the same for a passage by itself, of which neither gaps nor repeats to be dropped are known."""
        if self.duplicates != "drop" and self.gaps is None:
            return self
        factor = self.multiple if self.fps is None else self.factor
        return replace(self, duplicates="keep", gaps=None, factor=factor)

    @property
    def follows_source(self) -> bool:
        """Whether the output's rate is neither given nor that of the source's own frames."""
        return self.factor is None and self.fps is None and not self.keeps_frames

    @property
    def stretch(self) -> Fraction:
        """Duration of the output as a multiple of the source's; 1 but in slow motion."""
        return self.multiple if self.slow_motion else Fraction(1)

    def schedule(self, info: ClipInfo, *, has_clock: bool = True, curve: TimeMap | None = None) -> Schedule:
        """Return the schedule of the output frames on the source's clock, before slow motion is applied.

        Parameters
        ----------
        info : ClipInfo
            Information about the clip: its rate and time base.
        has_clock : bool
            Whether the output stores presentation times. Where it does not, as with images, a factor counts frames and
            not time.
        curve : TimeMap, optional
            Time map of the clip; see `time_map`.

        Raises
        ------
        OptionError
            The rate is out of range.
        InputError
            No rate is given, and the source's own is implausible.
        """
        factor = self.multiple
        keeps_timing = self.keep_timing or self.keeps_frames or self.duplicates == "drop" or not has_clock
        if self.fps is None and not self.fill_gaps and self.gaps is None and curve is None and keeps_timing:
            longest = FOREVER if factor == 1 else longest_interval(info.rate)
            return ByFactor(factor, longest, shutter=self.exposure)
        if self.fps is None and info.mean_rate is not None and is_implausible(info.rate, info.mean_rate):
            raise InputError(
                f"{info.name} plays at {float(info.rate):.6g} frames per second by its clock and holds "
                f"{rounded(float(info.mean_rate), 3)} of them per second; give the output's rate with `fps`, "
                "such as `fps=60`, or multiply the frames of each interval with `keep_timing`."
            )
        rate = info.rate * factor if self.fps is None else Fraction(self.fps) * self.stretch
        if rate > MAX_RATE:
            raise OptionError(
                f"`factor={factor}` makes {float(rate):g} frames per second of {info.name}, and {MAX_RATE} are the "
                "most; choose a smaller one."
            )
        grid = ByRate(rate) if self.fill_gaps else ByRate.forgiving(rate, info.rate, info.time_base)
        grid = replace(grid, shutter=self.exposure)
        return grid if curve is None else RetimeSchedule(**vars(grid), curve=curve)

    def output_timing(self, info: ClipInfo, schedule: Schedule) -> OutputTiming:
        """Return the rate and time base of the output of a schedule, after slow motion is applied."""
        base = schedule.time_base(info.time_base)
        rate = schedule.rate(info.rate) / self.stretch
        return OutputTiming(rate, representable(base / self.stretch.denominator, base))

    def remarks(self, info: ClipInfo, schedule: Schedule, frame_intervals: FrameIntervals) -> Remarks:
        """Return the remarks on how the timing of the output differs from the source's.

        `frame_intervals` are those of all frames, so that this is called at the end.
        """
        remarks = Remarks()
        if not isinstance(schedule, ByFactor | ByRate):
            return remarks
        follows_rate = self.fps is None and not self.fill_gaps and not self.retimes and self.gaps is None
        if isinstance(schedule, ByRate) and follows_rate and frame_intervals.varies(info):
            slowest, fastest = (
                rounded(float(1 / each), 4) for each in (frame_intervals.longest, frame_intervals.shortest)
            )
            rate = float(schedule.frames_per_second / self.stretch)
            remarks.add("rate-made-constant", name=info.name, slowest=slowest, fastest=fastest, rate=rate)
        longest = frame_intervals.longest
        if longest > schedule.longest:
            as_one = "" if longest <= MAX_FILLED else " as one long frame"
            begin = float(frame_intervals.begin)
            limit = float(schedule.longest)
            remarks.add("picture-held", name=info.name, longest=float(longest), begin=begin, as_one=as_one, limit=limit)
        return remarks


def readable(number: Rate) -> str:
    """Return a rate with at most three decimals: 24, 23.976."""
    return f"{float(number):.3f}".rstrip("0").rstrip(".")


@dataclass
class FrameIntervals:
    """Shortest and longest interval between consecutive frames, of those noted so far.

    Examples
    --------
    >>> intervals = FrameIntervals()
    >>> for time in (0, 1, 2, 5):
    ...     intervals.note(Fraction(time, 25), Fraction(0))
    >>> str(intervals.shortest), str(intervals.longest), str(intervals.begin)
    ('1/25', '3/25', '2/25')
    """

    shortest: Fraction = Fraction(0)
    """Shortest interval, seconds; 0 for fewer than two frames."""
    longest: Fraction = Fraction(0)
    """Longest interval, seconds; 0 for fewer than two frames."""
    begin: Fraction = Fraction(0)
    """Start of the longest interval, seconds after the first frame."""
    _last: Fraction | None = None
    """Time of the frame noted last, seconds; None before any was."""

    def note(self, time: Fraction, start: Fraction) -> None:
        """Add the presentation time of the next frame, seconds; `start` is that of the clip's first frame."""
        if self._last is not None:
            interval = time - self._last
            self.shortest = min(self.shortest or interval, interval)
            if interval > self.longest:
                self.longest = interval
                self.begin = self._last - start
        self._last = time

    def varies(self, info: ClipInfo) -> bool:
        """Return whether the intervals differ by more than the rounding and jitter of a clock.

        That is two ticks of the clock, or a tenth of a frame.
        """
        return self.longest - self.shortest > max(2 * info.time_base, 1 / info.rate / 10)
