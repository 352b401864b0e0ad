"""How fast the output plays: what is asked for, what that means for a clip, and how evenly the clip itself plays."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Literal, get_args

from fpsboost.errors import InputError, OptionError, check_choice
from fpsboost.frame import ClipInfo, Frame
from fpsboost.timing.schedule import (
    MAX_FILLED,
    MAX_RATE,
    ByFactor,
    ByRate,
    OutputTiming,
    Schedule,
    is_implausible,
    representable,
)

DOUBLE = Fraction(2)

SlowSound = Literal["drop", "stretch"]


@dataclass(frozen=True)
class OutputRate:
    """How fast the output plays; twice the source's rate, and constant, unless told.

    Parameters
    ----------
    factor : Fraction, optional
        Output frames per source frame.
    fps : Fraction, optional
        Output frames per second, instead of `factor`.
    keep_timing : bool
        Multiply the frames of each interval, so that a variable rate stays variable.
    slow_motion : bool
        Last `factor` times as long, at the source's rate or at `fps`.
    slow_motion_sound : {'drop', 'stretch'}, optional
        Whether sound is left out then, as it is unless told, or lasts as long at its own pitch.
    fill_gaps : bool
        The source is images whose numbers are their clock: a factor counts frames per number, 1 unless told, and
        nothing is held, however many are missing.

    Raises
    ------
    OptionError
        They contradict each other, or one is out of range.
    """

    factor: Fraction | None = None
    fps: Fraction | None = None
    keep_timing: bool = False
    slow_motion: bool = False
    slow_motion_sound: SlowSound | None = None
    fill_gaps: bool = False

    def __post_init__(self) -> None:
        if self.slow_motion_sound is not None:
            check_choice("--slow-motion-sound", self.slow_motion_sound, get_args(SlowSound))
            if not self.slow_motion:
                raise OptionError("--slow-motion-sound goes with --slow-motion; give that too, or leave it out.")
        if self.factor is not None and self.fps is not None and not self.slow_motion:
            raise OptionError("--factor and --fps say the same thing in two ways; give one of them.")
        if self.fps is not None:
            if self.keep_timing:
                raise OptionError("--fps makes the rate constant and --keep-timing does not; give one of them.")
            ByRate(self.fps)
        if self.fill_gaps and self.keep_timing:
            raise OptionError("--fill-gaps makes the rate constant and --keep-timing does not; give one of them.")
        if self.factor is not None:
            ByFactor(self.factor)

    @property
    def multiple(self) -> Fraction:
        """Output frames per source frame, where no rate is given."""
        if self.factor is not None:
            return self.factor
        return Fraction(1) if self.fill_gaps else DOUBLE

    @property
    def stretch(self) -> Fraction:
        """How many times as long the output lasts."""
        return self.multiple if self.slow_motion else Fraction(1)

    def schedule(self, info: ClipInfo, *, has_clock: bool = True) -> Schedule:
        """Where output frames lie, on the source's clock; slow motion comes after.

        Parameters
        ----------
        info : ClipInfo
            Of the source.
        has_clock : bool
            Whether the output says when its frames are shown; among images, a factor means frames and not time.

        Raises
        ------
        OptionError
            The rate of the output would be out of range.
        InputError
            Nobody has said a rate, and the source's own is absurd.
        """
        factor = self.multiple
        if self.fps is None and not self.fill_gaps and (self.keep_timing or not has_clock):
            return ByFactor(factor)
        if self.fps is None:
            _check_density(info)
        rate = info.rate * factor if self.fps is None else self.fps * self.stretch
        if rate > MAX_RATE:
            raise OptionError(
                f"--factor {factor} makes {float(rate):g} frames per second of {info.name}, and {MAX_RATE} are the "
                "most; choose a smaller one."
            )
        return ByRate(rate) if self.fill_gaps else ByRate.forgiving(rate, info.rate, info.time_base)

    def timing(self, info: ClipInfo, schedule: Schedule) -> OutputTiming:
        """The clock of the output."""
        base = schedule.time_base(info.time_base)
        return OutputTiming(
            schedule.rate(info.rate) / self.stretch, representable(base / self.stretch.denominator, base)
        )

    def remarks(self, info: ClipInfo, schedule: Schedule, frame_intervals: FrameIntervals) -> list[str]:
        """What to say where the output does not play as the source does.

        Parameters
        ----------
        info : ClipInfo
        schedule : Schedule
            Came from `schedule`.
        frame_intervals : FrameIntervals
            Of the source, to its end.
        """
        if not isinstance(schedule, ByRate) or self.fill_gaps:
            return []
        remarks = []
        if self.fps is None and frame_intervals.varies(info):
            slowest, fastest, rate = (
                float(rate)
                for rate in (
                    1 / frame_intervals.longest,
                    1 / frame_intervals.shortest,
                    schedule.frames_per_second / self.stretch,
                )
            )
            remarks.append(
                f"{info.name} varies from {slowest:.4g} to {fastest:.4g} frames per second; the output is constant at "
                f"{rate:.5g}, and --keep-timing keeps the rhythm."
            )
        if schedule.is_pause(frame_intervals.longest):
            filled = "held there" if frame_intervals.longest <= MAX_FILLED else "held there as one long frame"
            remarks.append(
                f"{info.name} shows nothing new for {float(frame_intervals.longest):.1f} s from "
                f"{float(frame_intervals.begin):.1f} s on; "
                f"the picture was {filled}, as in all pauses of more than {float(schedule.longest or 0):g} s."
            )
        return remarks


def _check_density(info: ClipInfo) -> None:
    """Refuse a source's rate where nearly all frames would be made where nothing moves on."""
    mean = info.mean_rate
    if mean is None or not is_implausible(info.rate, mean):
        return
    raise InputError(
        f"{info.name} plays at {float(info.rate):.6g} frames per second by its clock and holds {float(mean):.3g} of "
        "them per second; say with --fps how fast the output plays, such as --fps 60, or multiply the frames of each "
        "interval with --keep-timing."
    )


def stretched(frames: Iterable[Frame], stretch: Fraction) -> Iterator[Frame]:
    """The same frames for `stretch` times as long, from the time of the first on."""
    start: Fraction | None = None
    for frame in frames:
        start = frame.time if start is None else start
        yield replace(frame, time=start + (frame.time - start) * stretch, duration=frame.duration * stretch)


@dataclass
class FrameIntervals:
    """How far apart frames are.

    Attributes
    ----------
    shortest, longest : Fraction
        Seconds from one frame to the next; 0 for fewer than two frames.
    begin : Fraction
        When the longest interval begins, seconds after the first frame.
    """

    shortest: Fraction = Fraction(0)
    longest: Fraction = Fraction(0)
    begin: Fraction = Fraction(0)
    _first: Fraction | None = None
    _last: Fraction = Fraction(0)

    def note(self, time: Fraction) -> None:
        """Take another frame into account, the one after that before."""
        if self._first is None:
            self._first = time
        else:
            interval = time - self._last
            self.shortest = min(self.shortest or interval, interval)
            if interval > self.longest:
                self.longest, self.begin = interval, self._last - self._first
        self._last = time

    def varies(self, info: ClipInfo) -> bool:
        """Whether that is more than the rounding and jitter of a clock."""
        return self.longest - self.shortest > max(2 * info.time_base, 1 / info.rate / 10)
