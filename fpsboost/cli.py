"""The command line: parse, build objects, call the library, show progress, choose the exit code.

Exit codes: 0 done, 1 failed (without a word if the reader of standard output has gone), 2 wrong usage, 130 stopped by
Ctrl-C.
"""

from __future__ import annotations

import signal
import sys
import threading
import traceback
from dataclasses import replace
from types import FrameType, TracebackType
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from cyclopts import App, CycloptsError, Group, Parameter
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TaskID, TextColumn, TimeRemainingColumn
from rich.text import Text

from fpsboost import __version__
from fpsboost.errors import CompleteAlreadyError, FpsboostError, OptionError, ReaderGoneError, notes_of

if TYPE_CHECKING:
    from fpsboost.frame import ClipInfo
    from fpsboost.interpolator import AtCuts, Interpolator
    from fpsboost.pipeline import Summary

EXAMPLES = """
**Examples**

    fpsboost in.mp4 out.mp4                       twice the frames, sound kept
    fpsboost in.mp4 out.mkv --fps 59.94 --crf 16  a rate instead of a factor
    fpsboost renders/ doubled/ --factor 2         a folder of images
    fpsboost shot_####.png out.mp4 --input-fps 24  images to video
    fpsboost in.mp4 out/ --method nlm-exhaustive  the report's method, as images
    fpsboost a.mp4 b.mov renders/ out/            several, each by its name into a folder
    fpsboost in.gif out.webp                      animations: gif, apng, webp
    fpsboost probe in.mp4                         what a clip is
    ffmpeg -i in.avi -f yuv4mpegpipe - | fpsboost - out.mp4  from a pipe
    fpsboost compare in.mp4 --report page/        which method is best for a clip
"""

COMPILE_HINT_AFTER = 2.5
"""Seconds of silence before the first frame after which a person is told why."""

PIPE = "pipe:"
"""What a lone dash is called from here on, which the parser would take for an option without a name."""

rate = Group("How many frames", sort_key=1)
video_in = Group("Video input", sort_key=2)
motion = Group("How they are made", sort_key=3)
cuts = Group("Scene cuts", sort_key=4)
video = Group("Video output", sort_key=5)
general = Group("Files and messages", sort_key=6)

app = App(
    name="fpsboost",
    help="Raise the frame rate of a video or an image sequence.",
    usage="Usage: fpsboost [OPTIONS] IN OUT\n       fpsboost [OPTIONS] IN... FOLDER\n       fpsboost COMMAND",
    help_epilogue=EXAMPLES,
    help_format="markdown",
    suppress_keyboard_interrupt=False,
    version=f"fpsboost {__version__}",
    default_parameter=Parameter(negative=(), show_default=lambda value: value if value is not False else None),
)


@app.default
def convert(
    input: Annotated[str, Parameter(name="IN")],
    output: Annotated[str, Parameter(name="OUT")],
    /,
    *more: Annotated[str, Parameter(show=False)],
    factor: Annotated[str | None, Parameter(group=rate, name=["--factor", "-f"])] = None,
    fps: Annotated[str | None, Parameter(group=rate)] = None,
    keep_timing: Annotated[bool, Parameter(group=rate)] = False,
    slow_motion: Annotated[bool, Parameter(group=rate)] = False,
    slow_motion_sound: Annotated[Literal["drop", "stretch"] | None, Parameter(group=rate)] = None,
    input_fps: Annotated[str | None, Parameter(group=rate)] = None,
    stream: Annotated[int | None, Parameter(group=video_in)] = None,
    deinterlace: Annotated[bool, Parameter(group=video_in)] = False,
    size_change: Annotated[Literal["stop", "scale"], Parameter(group=video_in)] = "stop",
    start: Annotated[str | None, Parameter(group=rate)] = None,
    end: Annotated[str | None, Parameter(group=rate)] = None,
    method: Annotated[str, Parameter(group=motion, name=["--method", "-m"])] = "nlm",
    search: Annotated[Literal["iterative", "brute-force"] | None, Parameter(group=motion)] = None,
    search_radius: Annotated[int | None, Parameter(group=motion)] = None,
    patch_radius: Annotated[int | None, Parameter(group=motion)] = None,
    window: Annotated[Literal["box", "gaussian"] | None, Parameter(group=motion)] = None,
    v: Annotated[float | None, Parameter(group=motion, name="--v")] = None,
    implementation: Annotated[Literal["fused", "passes"] | None, Parameter(group=motion)] = None,
    vectors: Annotated[str | None, Parameter(group=motion)] = None,
    depth: Annotated[str | None, Parameter(group=motion)] = None,
    block_size: Annotated[int | None, Parameter(group=motion)] = None,
    search_range: Annotated[int | None, Parameter(group=motion)] = None,
    pattern: Annotated[Literal["full", "three-step", "diamond"] | None, Parameter(group=motion)] = None,
    duplicates: Annotated[Literal["interpolate", "keep"], Parameter(group=motion)] = "interpolate",
    at_cuts: Annotated[Literal["repeat", "blend", "extrapolate"], Parameter(group=cuts)] = "repeat",
    cut_threshold: Annotated[float | None, Parameter(group=cuts)] = None,
    no_cuts: Annotated[bool, Parameter(group=cuts)] = False,
    cuts: Annotated[str | None, Parameter(group=cuts)] = None,
    codec: Annotated[str | None, Parameter(group=video)] = None,
    crf: Annotated[int | None, Parameter(group=video)] = None,
    preset: Annotated[str | None, Parameter(group=video)] = None,
    bitrate: Annotated[str | None, Parameter(group=video)] = None,
    lossless: Annotated[bool, Parameter(group=video)] = False,
    pix_fmt: Annotated[str | None, Parameter(group=video)] = None,
    encoder_option: Annotated[list[str] | None, Parameter(group=video)] = None,
    no_audio: Annotated[bool, Parameter(group=video)] = False,
    no_subtitles: Annotated[bool, Parameter(group=video)] = False,
    overwrite: Annotated[bool, Parameter(group=general, name=["--overwrite", "-y"])] = False,
    resume: Annotated[bool, Parameter(group=general)] = False,
    max_memory: Annotated[str | None, Parameter(group=general)] = None,
    verbose: Annotated[bool, Parameter(group=general)] = False,
    quiet: Annotated[bool, Parameter(group=general, name=["--quiet", "-q"])] = False,
) -> None:
    """Raise the frame rate of a video or an image sequence.

    Parameters
    ----------
    input
        A video file, an animation (gif, apng, webp), a folder of images, or a pattern: shot_%04d.png, shot_####.png; or
        - for YUV4MPEG2 from a pipe.
    output
        The same. Video: mp4, m4v, mov, mkv or webm; animation: gif, apng or webp. For several inputs a folder, made
        if it is missing.
    more
        Further names; the last one is the folder.
    factor
        Output frames per input frame, such as 2 or 5/2; doubles if nothing is said.
    fps
        Output frames per second instead: 60, 59.94, 60000/1001.
    keep_timing
        Multiply the frames of each interval; else the output rate is constant.
    slow_motion
        Keep the rate, or that of --fps, and last --factor times as long.
    slow_motion_sound
        Leave the sound of --slow-motion out, or make it last as long at its own pitch; else left out.
    input_fps
        Frames per second of input images.
    stream
        Number of the video stream in its file, as probe prints it; else the largest.
    deinterlace
        Make a frame of each field first, 50 a second of 25i; of every frame, flagged or not.
    size_change
        Where the size changes within the video: stop, or scale to the first frame's.
    start
        Where to begin: seconds, a time like 1:30.5, or a frame like 120f.
    end
        Where to stop, the same; that frame is no part of it.
    method
        nlm, nlm-fast, nlm-best (slower), nlm-exhaustive and nlm-brute-force (the report's), blend or nearest; to
        compare with: dis, farneback, tvl1, dis-warp, farneback-warp, tvl1-warp, block or codec, and with --vectors
        reproject-image or reproject-scene.
    search
        How nlm-exhaustive and reproject-image find source pixels.
    search_radius
        Largest motion for nlm-exhaustive, pixels; else chosen for each pair.
    patch_radius
        Size of the compared patches, pixels each way.
    window
        Weights of the patches of nlm-exhaustive.
    v
        Width of the similarity measure, for colours from 0 to 1.
    implementation
        nlm-exhaustive: one fused kernel, or plain OpenCV passes.
    vectors
        Folder of a renderer's motion vectors, .exr or .flo, one for every frame of the output.
    depth
        Folder of its depth, .exr, for reproject-scene.
    block_size
        Side of the blocks of the method block, pixels.
    search_range
        Largest motion for the method block, pixels each way.
    pattern
        Where the method block looks for a block.
    duplicates
        Frames that show the same as the one before, up to a quarter of a second: make them move, or keep them.
    at_cuts
        Across a scene cut, repeat the nearer frame, mix both, or move each on along its own motion.
    cut_threshold
        Likeness below which a pair is a cut, 0 to 1; else 0.48.
    no_cuts
        Take everything for one scene.
    cuts
        File with a cut on each line, as for --start, or PySceneDetect's list; no others are looked for.
    codec
        h264, hevc, vp9, av1 or any FFmpeg encoder; else h264, in webm vp9.
    crf
        Quality, lower is better.
    preset
        Encoder speed, such as slow or veryfast.
    bitrate
        Bits per second instead of a quality: 8M, 800k.
    lossless
        Decoding gives back exactly what was encoded.
    pix_fmt
        FFmpeg's name of the pixel format, such as yuv420p10le; else the input's.
    encoder_option
        FFmpeg's own option of the encoder, key=value; may be given several times.
    no_audio
        Leave the sound out.
    no_subtitles
        Leave the subtitles out.
    overwrite
        Replace an existing output.
    resume
        Go on where an earlier run with the same input and options was stopped; if there was none, start.
    max_memory
        Refuse what would need more, such as 8G; else what is available.
    verbose
        Say what is used, and show a traceback if something fails.
    quiet
        Say nothing but errors.
    """
    # only now: --help and --version need not wait for OpenCV, numba and FFmpeg
    from fpsboost import pipeline  # noqa: PLC0415
    from fpsboost.cli_many import convert_each  # noqa: PLC0415
    from fpsboost.media.encoding import Encoding, parse_bitrate, parse_encoder_options  # noqa: PLC0415
    from fpsboost.media.excerpt import Excerpt  # noqa: PLC0415
    from fpsboost.media.opening import makes_animation, makes_video  # noqa: PLC0415
    from fpsboost.media.reading import Reading  # noqa: PLC0415
    from fpsboost.memory_limit import parse_memory  # noqa: PLC0415
    from fpsboost.method_table import configure, find_method  # noqa: PLC0415
    from fpsboost.motion.vectors import VectorFolder  # noqa: PLC0415
    from fpsboost.position import parse_position  # noqa: PLC0415
    from fpsboost.timing import parse_number, parse_rate  # noqa: PLC0415

    options = {
        "search": search,
        "search_radius": search_radius,
        "patch_radius": patch_radius,
        "window": window,
        "v": v,
        "implementation": implementation,
        "block_size": block_size,
        "search_range": search_range,
        "pattern": pattern,
    }
    given = {name: value for name, value in options.items() if value is not None}
    if depth is not None and vectors is None:
        raise OptionError("--depth goes with the motion vectors of --vectors; give that too, or leave --depth out.")
    folder = None if vectors is None else VectorFolder(vectors, depth)
    interpolator = configure(find_method(method, folder), method, given)
    interpolator = with_cut_options(interpolator, at_cuts, cut_threshold, no_cuts, cuts)
    schedule_options = {
        "factor": None if factor is None else parse_number(factor, "--factor"),
        "fps": None if fps is None else parse_rate(fps, "--fps"),
        "input_fps": None if input_fps is None else parse_rate(input_fps, "--input-fps"),
    }
    excerpt = Excerpt(
        None if start is None else parse_position(start, "--start"),
        None if end is None else parse_position(end, "--end"),
    )
    encoding = Encoding(
        codec,
        crf,
        preset,
        audio=not no_audio,
        subtitles=not no_subtitles,
        pixel_format=pix_fmt,
        bitrate=None if bitrate is None else parse_bitrate(bitrate),
        lossless=lossless,
        encoder_options=parse_encoder_options(encoder_option or ()),
    )
    limit = None if max_memory is None else parse_memory(max_memory)

    def run(input: str, output: str, place: str = "") -> None:
        if encoding.given and not makes_video(output):
            kind = "an animation, which takes" if makes_animation(output) else "images, which take"
            raise OptionError(f"{output} will be {kind} no {' or '.join(encoding.given)}; leave that out.")
        called = "standard output" if output == PIPE else output
        with Reporter(place + called, quiet=quiet, verbose=verbose) as reporter:
            reporter.say_settings(method, interpolator)
            summary = pipeline.convert(
                input,
                output,
                **schedule_options,
                keep_timing=keep_timing,
                slow_motion=slow_motion,
                slow_motion_sound=slow_motion_sound,
                excerpt=excerpt,
                method=interpolator,
                duplicates=duplicates,
                reading=Reading(stream, deinterlace, size_change),
                encoding=encoding,
                overwrite=overwrite,
                resume=resume,
                limit=limit,
                observer=reporter,
            )
        reporter.say_summary(summary)

    if not more:
        run(input, output)
        return
    if vectors is not None:
        raise OptionError("--vectors belongs to one clip; convert several inputs with vectors one by one.")
    paths = [input, output, *more]
    convert_each(paths[:-1], paths[-1], run, quiet=quiet, verbose=verbose)


app.command(
    "fpsboost.cli_compare:compare",
    help="Hide frames, make them again with each method, and say which comes nearest to the truth.",
    help_epilogue="",
)

app.command(
    "fpsboost.cli_tune:tune",
    help="Try the parameters of the report's method on a few hidden frames, and say which to use.",
    help_epilogue="",
)

app.command(
    "fpsboost.cli_probe:probe",
    help="Say what a clip is: streams, times, duplicates, cuts, damage, and what a conversion would do.",
    help_epilogue="",
)


def with_cut_options(
    interpolator: Interpolator, at_cuts: AtCuts, threshold: float | None, no_cuts: bool, cut_list: str | None
) -> Interpolator:
    """The interpolator with the cut options of the command line.

    Raises
    ------
    OptionError
        They contradict each other, or the list of cuts is none.
    InputError
        That cannot be read.
    """
    from fpsboost.cut_list import read_cuts  # noqa: PLC0415
    from fpsboost.scenes import CutDetector  # noqa: PLC0415

    given = {"--no-cuts": no_cuts, "--cut-threshold": threshold is not None, "--cuts": cut_list is not None}
    names = [name for name, is_given in given.items() if is_given]
    if len(names) > 1:
        raise OptionError(f"{' and '.join(names)} contradict each other; give one of them.")
    policy = interpolator.cuts
    if no_cuts:
        policy = None
    elif cut_list is not None:
        policy = read_cuts(cut_list)
    elif threshold is not None and isinstance(policy, CutDetector):
        policy = replace(policy, threshold=threshold)
    return replace(interpolator, cuts=policy, at_cuts=at_cuts)


class FramesPerSecondColumn(ProgressColumn):
    """Output frames per second so far."""

    def render(self, task: Task) -> Text:
        """See `rich.progress.ProgressColumn.render`."""
        speed = task.finished_speed or task.speed
        return Text("" if speed is None else f"{speed:.1f} frames/s", style="progress.data.speed")


class Reporter:
    """Shows a conversion to a person: a bar on a terminal, nothing when piped, a summary at the end."""

    def __init__(self, output: str, *, quiet: bool, verbose: bool) -> None:
        self._console = Console(stderr=True, quiet=quiet, highlight=False, soft_wrap=True)
        self._output = output
        self._verbose = verbose
        self._info: ClipInfo | None = None
        self._hint = threading.Timer(COMPILE_HINT_AFTER, self._say_compiling)
        self._task: TaskID | None = None
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.completed}/{task.fields[frames]}"),
            FramesPerSecondColumn(),
            TimeRemainingColumn(compact=True),
            console=self._console,
            transient=True,
            disable=quiet or not self._console.is_terminal,
        )

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._hint.cancel()
        self._progress.stop()

    def opened(self, info: ClipInfo, expected_frames: int | None) -> None:
        """See `fpsboost.pipeline.Observer.opened`."""
        self._info = info
        if self._verbose:
            count = "an unknown number of" if info.frame_count is None else info.frame_count
            self._say(f"{info.name}: {info.width}x{info.height}, {count} frames at {readable(info.rate)} fps")
        self._hint.start()
        self._task = self._progress.add_task(
            escape(self._output), total=expected_frames, start=False, frames=expected_frames or "?"
        )

    def ready(self) -> None:
        """See `fpsboost.pipeline.Observer.ready`."""
        self._hint.cancel()
        if self._task is not None:
            self._progress.start_task(self._task)

    def wrote(self, summary: Summary) -> None:
        """See `fpsboost.pipeline.Observer.wrote`."""
        if self._task is not None:
            self._progress.update(self._task, completed=summary.frames_out)

    def say_settings(self, method: str, interpolator: Interpolator) -> None:
        """With --verbose: every option in use."""
        if self._verbose:
            self._say(f"fpsboost {__version__}, method {method}")
            for part in (interpolator.estimator, interpolator.synthesizer, interpolator.cuts or "no scene cuts"):
                self._say(f"  {part}")

    def say_summary(self, summary: Summary) -> None:
        """What was done, and every remark."""
        assert self._info is not None, "a summary comes after opening"
        frames = f"{summary.frames_in} -> {summary.frames_out} frames"
        if summary.duplicates:
            frames += f", {summary.duplicates} duplicate frame{'s' if summary.duplicates > 1 else ''}"
        if summary.scene_cuts:
            frames += f", {summary.scene_cuts} scene cut{'s' if summary.scene_cuts > 1 else ''}"
        if summary.frames_there:
            frames += f", {summary.frames_there} of which were there already"
        speed = (summary.frames_out - summary.frames_there) / max(summary.seconds, 1e-9)
        if self._verbose and summary.details:
            self._say(summary.details)
        self._say(f"{self._output}: {frames} in {summary.seconds:.1f} s ({speed:.1f} frames/s)")
        for remark in summary.remarks:
            self._say(f"Note: {remark}")

    def _say_compiling(self) -> None:
        self._say("Compiling for this machine, once; later runs start at once.")

    def _say(self, text: str) -> None:
        self._console.print(escape(text))


def readable(number: Any) -> str:
    """A rate as people write it: 24, 23.976."""
    return f"{float(number):.3f}".rstrip("0").rstrip(".")


def stop(number: int, frame: FrameType | None) -> None:
    """Treat a request to terminate like Ctrl-C, so that nothing half-written stays behind."""
    raise KeyboardInterrupt


def main() -> None:
    """Run the command line and exit."""
    signal.signal(signal.SIGTERM, stop)
    errors = Console(stderr=True, highlight=False, soft_wrap=True)
    verbose = "--verbose" in sys.argv
    tokens = [PIPE if token == "-" else token for token in sys.argv[1:]]
    try:
        app(tokens, exit_on_error=False, print_error=False, result_action="return_value")
    except KeyboardInterrupt as stopped:
        left = notes_of(stopped)
        errors.print(f"Stopped; {left}" if left else "Stopped." if PIPE in tokens else "Stopped; nothing was written.")
        sys.exit(130)
    except ReaderGoneError:  # as other filters, without a word
        sys.exit(1)
    except CompleteAlreadyError as error:  # what a batch that is started again wants
        if not {"--quiet", "-q"} & set(tokens):
            errors.print(escape(str(error)))
    except CycloptsError as error:
        errors.print(f"[red]fpsboost:[/] {escape(str(error))} See fpsboost --help.")
        sys.exit(2)
    except FpsboostError as error:
        if verbose:
            traceback.print_exc()
        errors.print(f"[red]fpsboost:[/] {escape(' '.join(filter(None, (str(error), notes_of(error)))))}")
        sys.exit(2 if isinstance(error, OptionError) else 1)
    except OSError as error:  # a name or a place that nobody looked at
        if verbose:
            traceback.print_exc()
        place = error.filename or "A file"
        errors.print(f"[red]fpsboost:[/] {escape(f'{place} cannot be used ({error.strerror}); check the place.')}")
        sys.exit(1)
    except MemoryError:
        errors.print("[red]fpsboost:[/] There is not enough memory for this; scale it down, or close other programs.")
        sys.exit(1)
