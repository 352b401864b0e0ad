"""Options of a conversion, one class per group, and the library objects that they stand for.

Heavy modules are imported only when an option is used, so that --help need not wait for OpenCV, numba and FFmpeg.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Group, Parameter

from fpsboost.errors import OptionError

if TYPE_CHECKING:
    from fpsboost import conversion
    from fpsboost.interpolator import Interpolator
    from fpsboost.io.video.decode_options import DecodeOptions
    from fpsboost.io.video.encoding import Encoding
    from fpsboost.timing.rate import OutputRate


@Parameter(name="*", group=Group("Input", sort_key=1))
@dataclass(frozen=True)
class InputOptions:
    """Options for the part of the input that is converted, and for how it is read.

    Parameters
    ----------
    start
        Start position: 90, 1:30.5, or frame 120f.
    end
        End position (exclusive); same syntax as --start.
    input_fps
        Frames per second of input images.
    stream
        Video stream, numbered as in probe; else the largest.
    deinterlace
        Make one frame per field: 50 per second from 25i.
    size_change
        At a change of size: stop or scale.
    decoder
        Read videos by ffmpeg or opencv.
    fill_gaps
        Make only the images missing from the numbering.
    """

    start: Annotated[str | None, Parameter(metavar="TIME")] = None
    end: Annotated[str | None, Parameter(metavar="TIME")] = None
    input_fps: Annotated[str | None, Parameter(metavar="RATE")] = None
    stream: Annotated[int | None, Parameter(metavar="N")] = None
    deinterlace: bool = False
    size_change: Annotated[Literal["stop", "scale"], Parameter(metavar="HOW")] = "stop"
    decoder: Annotated[Literal["ffmpeg", "opencv"], Parameter(metavar="HOW")] = "ffmpeg"
    fill_gaps: bool = False

    def decoding(self) -> DecodeOptions:
        """Return how the input is read."""
        from fpsboost.io.trim import Trim  # noqa: PLC0415
        from fpsboost.io.video.decode_options import DecodeOptions  # noqa: PLC0415
        from fpsboost.timing.position import parse_position  # noqa: PLC0415

        trim = Trim(
            None if self.start is None else parse_position(self.start, "--start"),
            None if self.end is None else parse_position(self.end, "--end"),
        )
        return DecodeOptions(trim, self.image_rate(), self.stream, self.deinterlace, self.size_change, self.decoder)

    def image_rate(self) -> Fraction | None:
        """Return the frames per second of images, None if not given."""
        from fpsboost.timing.schedule import parse_rate  # noqa: PLC0415

        return None if self.input_fps is None else parse_rate(self.input_fps, "--input-fps")


@Parameter(name="*", group=Group("Rate", sort_key=2))
@dataclass(frozen=True)
class RateOptions:
    """Options for the frame rate of the output.

    Parameters
    ----------
    factor
        Output frames per input frame: 3, 5/2; else 2.
    fps
        Output frames per second: 60, 59.94, 60000/1001.
    keep_timing
        Multiply each interval, for a variable rate.
    slow_motion
        Keep the rate and play --factor times as long.
    slow_motion_sound
        Audio of slow motion: drop or stretch; else drop.
    """

    factor: Annotated[str | None, Parameter(name=["--factor", "-f"], metavar="N")] = None
    fps: Annotated[str | None, Parameter(metavar="RATE")] = None
    keep_timing: bool = False
    slow_motion: bool = False
    slow_motion_sound: Annotated[Literal["drop", "stretch"] | None, Parameter(metavar="HOW")] = None

    def rate(self, *, fill_gaps: bool) -> OutputRate:
        """Return the rate of the output; `fill_gaps` is an option of the input."""
        from fpsboost.timing.rate import OutputRate  # noqa: PLC0415
        from fpsboost.timing.schedule import parse_number, parse_rate  # noqa: PLC0415

        return OutputRate(
            None if self.factor is None else parse_number(self.factor, "--factor"),
            None if self.fps is None else parse_rate(self.fps, "--fps"),
            self.keep_timing,
            self.slow_motion,
            self.slow_motion_sound,
            fill_gaps,
        )


@Parameter(name="*", group=Group("Method options", sort_key=8))
@dataclass(frozen=True)
class TuningOptions:
    """Options of single methods.

    Parameters
    ----------
    patch_radius
        nlm*: patch radius, pixels.
    v
        nlm*: similarity bandwidth, for colours from 0 to 1.
    search_radius
        nlm-exhaustive: largest motion, pixels; else auto.
    window
        nlm-exhaustive: patch window, box or gaussian.
    implementation
        nlm-exhaustive: fused kernel or OpenCV passes.
    search
        reproject-image too: iterative or brute-force.
    iterations
        The same: iteration limit; else 10.
    block_size
        block: block size, pixels.
    search_range
        block: largest motion, pixels.
    pattern
        block: search pattern, full, three-step or diamond.
    """

    patch_radius: Annotated[int | None, Parameter(metavar="N")] = None
    v: Annotated[float | None, Parameter(name="--v", metavar="X")] = None
    search_radius: Annotated[int | None, Parameter(metavar="N")] = None
    window: Annotated[Literal["box", "gaussian"] | None, Parameter(metavar="HOW")] = None
    implementation: Annotated[Literal["fused", "passes"] | None, Parameter(metavar="HOW")] = None
    search: Annotated[Literal["iterative", "brute-force"] | None, Parameter(metavar="HOW")] = None
    iterations: Annotated[int | None, Parameter(metavar="N")] = None
    block_size: Annotated[int | None, Parameter(metavar="N")] = None
    search_range: Annotated[int | None, Parameter(metavar="N")] = None
    pattern: Annotated[Literal["full", "three-step", "diamond"] | None, Parameter(metavar="HOW")] = None

    @property
    def given(self) -> dict[str, Any]:
        """Options that were given, by the field names of estimators and synthesizers."""
        return {name: value for name, value in asdict(self).items() if value is not None}


@Parameter(name="*", group=Group("Method", sort_key=3))
@dataclass(frozen=True)
class MotionOptions:
    """Options for how frames are made.

    Parameters
    ----------
    method
        nlm, nlm-fast, blend or nearest;
        the report's: nlm-exhaustive, nlm-brute-force,
        nlm-passes (the same in passes of OpenCV);
        with --vectors: reproject-image, reproject-scene;
        to compare: dis, farneback, tvl1, dis-warp, tvl1-warp,
        farneback-warp, block, codec.
    duplicates
        Repeats: interpolate or keep.
    vectors
        Folder of rendered vectors, one file per output frame.
    depth
        Folder of rendered depth, for reproject-scene.
    """

    method: Annotated[str, Parameter(name=["--method", "-m"], metavar="NAME")] = "nlm"
    duplicates: Annotated[Literal["interpolate", "keep"], Parameter(metavar="HOW")] = "interpolate"
    vectors: Annotated[str | None, Parameter(metavar="DIR")] = None
    depth: Annotated[str | None, Parameter(metavar="DIR")] = None

    def interpolator(self, tuning: TuningOptions) -> Interpolator:
        """Return the method with its options.

        Raises
        ------
        OptionError
            The method is unknown, or has no such option.
        InputError
            The vectors cannot be read.
        """
        from fpsboost.io.vector_folder import VectorFolder  # noqa: PLC0415
        from fpsboost.method_table import configure, find_method  # noqa: PLC0415

        if self.depth is not None and self.vectors is None:
            raise OptionError("--depth goes with the motion vectors of --vectors; give that too, or leave --depth out.")
        folder = None if self.vectors is None else VectorFolder(self.vectors, self.depth)
        interpolator = configure(find_method(self.method, folder), self.method, tuning.given)
        return interpolator if self.duplicates == "interpolate" else replace(interpolator, duplicates=None)


@Parameter(name="*", group=Group("Scenes", sort_key=4))
@dataclass(frozen=True)
class CutOptions:
    """Options for where scenes end, and for what is shown there.

    Parameters
    ----------
    at_cuts
        At a cut: repeat, blend or extrapolate.
    cut_threshold
        Largest match score of a cut, 0 to 1; else 0.5.
    no_cuts
        Treat the clip as one scene.
    cuts
        Cut list: a time or frame per line, or PySceneDetect's.
    """

    at_cuts: Annotated[Literal["repeat", "blend", "extrapolate"], Parameter(metavar="HOW")] = "repeat"
    cut_threshold: Annotated[float | None, Parameter(metavar="X")] = None
    no_cuts: bool = False
    cuts: Annotated[str | None, Parameter(metavar="FILE")] = None

    @property
    def given(self) -> dict[str, Any]:
        """Options that differ from the defaults, by their names on the command line."""
        values = {
            "--at-cuts": self.at_cuts if self.at_cuts != "repeat" else None,
            "--no-cuts": self.no_cuts or None,
            "--cut-threshold": self.cut_threshold,
            "--cuts": self.cuts,
        }
        return {name: value for name, value in values.items() if value is not None}

    def applied_to(self, interpolator: Interpolator) -> Interpolator:
        """Return the interpolator with these options applied.

        Raises
        ------
        OptionError
            Options contradict each other, or the file of cuts is not a list of positions.
        InputError
            The file of cuts cannot be read.
        """
        from fpsboost.analysis.cut_list import read_cuts  # noqa: PLC0415
        from fpsboost.analysis.scene_cuts import CutDetector  # noqa: PLC0415

        names = [name for name in self.given if name != "--at-cuts"]
        if len(names) > 1:
            raise OptionError(f"{' and '.join(names)} contradict each other; give one of them.")
        policy = interpolator.cuts
        if self.no_cuts:
            policy = None
        elif self.cuts is not None:
            policy = read_cuts(self.cuts)
        elif self.cut_threshold is not None and isinstance(policy, CutDetector):
            policy = replace(policy, threshold=self.cut_threshold)
        return replace(interpolator, cuts=policy, at_cuts=self.at_cuts)


STREAMS = Group("Streams", sort_key=6)


@Parameter(name="*", group=Group("Encoding", sort_key=5))
@dataclass(frozen=True)
class VideoOptions:
    """Options for how video is encoded, and for the streams that are kept.

    Parameters
    ----------
    codec
        h264, hevc, vp9, av1 or any FFmpeg encoder.
    crf
        Constant rate factor; lower is better.
    preset
        Encoder speed, for example slow or veryfast.
    bitrate
        Bits per second instead of --crf: 8M, 800k.
    lossless
        Encode without loss.
    pix_fmt
        Pixel format: yuv420p10le...; else the input's.
    encoder_option
        Option of the encoder itself; repeatable.
    audio_codec
        Audio encoder: aac, opus, flac...; else copy.
    no_audio
        Drop the audio.
    no_subtitles
        Drop the subtitles.
    """

    codec: Annotated[str | None, Parameter(metavar="NAME")] = None
    crf: Annotated[int | None, Parameter(metavar="N")] = None
    preset: Annotated[str | None, Parameter(metavar="NAME")] = None
    bitrate: Annotated[str | None, Parameter(metavar="N")] = None
    lossless: bool = False
    pix_fmt: Annotated[str | None, Parameter(metavar="NAME")] = None
    encoder_option: Annotated[tuple[str, ...] | None, Parameter(metavar="KEY=VALUE")] = None
    audio_codec: Annotated[str | None, Parameter(metavar="NAME", group=STREAMS)] = None
    no_audio: Annotated[bool, Parameter(group=STREAMS)] = False
    no_subtitles: Annotated[bool, Parameter(group=STREAMS)] = False

    def encoding(self) -> Encoding:
        """Return the options for encoding video."""
        from fpsboost.io.video.encoding import Encoding, parse_bitrate, parse_encoder_options  # noqa: PLC0415

        return Encoding(
            self.codec,
            self.crf,
            self.preset,
            audio=not self.no_audio,
            audio_codec=self.audio_codec,
            subtitles=not self.no_subtitles,
            pixel_format=self.pix_fmt,
            bitrate=None if self.bitrate is None else parse_bitrate(self.bitrate),
            lossless=self.lossless,
            encoder_options=parse_encoder_options(self.encoder_option or ()),
        )


@Parameter(name="*", group=Group("Run", sort_key=7))
@dataclass(frozen=True)
class RunOptions:
    """Options for what may be overwritten, for resources, and for messages.

    Parameters
    ----------
    overwrite
        Replace an existing output.
    in_place
        Write beside the input images; leave OUT out.
    resume
        Continue the same job where it was interrupted.
    max_memory
        Refuse jobs that need more: 8G; else what is free.
    threads
        Pairs of frames made in parallel; else one per core.
    verbose
        Print details, and a traceback on errors.
    quiet
        Print errors only.
    """

    overwrite: Annotated[bool, Parameter(name=["--overwrite", "-y"])] = False
    in_place: bool = False
    resume: bool = False
    max_memory: Annotated[str | None, Parameter(metavar="SIZE")] = None
    threads: Annotated[int | None, Parameter(metavar="N")] = None
    verbose: bool = False
    quiet: Annotated[bool, Parameter(name=["--quiet", "-q"])] = False

    def run(self) -> conversion.RunOptions:
        """Return how the conversion is run; it has no observer yet."""
        from fpsboost import conversion  # noqa: PLC0415
        from fpsboost.io.memory_limit import parse_memory  # noqa: PLC0415

        limit = None if self.max_memory is None else parse_memory(self.max_memory)
        return conversion.RunOptions(self.overwrite, self.resume, self.in_place, limit, self.threads)
