"""The command line: exit codes, one sentence on stderr, nothing on stdout, and no trace of a run that was stopped."""

import json
import os
import re
import shlex
import signal
import subprocess
import sys
from dataclasses import is_dataclass, replace
from pathlib import Path

import cv2
import pytest

import fpsboost
from fpsboost.cli import app
from fpsboost.cli.compare import choose
from fpsboost.cli.flags import MAIN_OPTIONS
from fpsboost.interpolator import Interpolator
from fpsboost.method_table import methods, vector_methods
from fpsboost.timing.schedule import parse_number, parse_rate
from support.command_line import SUMMARY, Result, assert_refused, environment
from support.video_truth import packets_of, pictures_of, png, spoil_packets, write_clip

ROOT = Path(__file__).parents[2]
ORBIT = ROOT / "samples" / "orbit.mp4"
CHEAP = ("--method", "nearest")


@pytest.fixture
def clip(tmp_path) -> Path:
    """Six frames at 25 per second."""
    return write_clip(tmp_path / "in.mp4", times=range(6))


def run_python(folder: Path, *arguments: str) -> subprocess.CompletedProcess[bytes]:
    """Run Python in a process of its own, with its output piped."""
    command = [sys.executable, *arguments]
    return subprocess.run(command, cwd=folder, env=environment(), capture_output=True, timeout=100, check=False)


RUN = """
        sys.argv = ["fpsboost", "in.mp4", "out.mp4"]
        from fpsboost.__main__ import main
        main()
"""


@pytest.mark.slow
def test_piped_run_is_plain_text(clip, tmp_path):
    """A whole process that nobody watches: exit code 0, a file, no bar, no colour, no control characters, one line."""
    done = run_python(tmp_path, "-m", "fpsboost", "in.mp4", "out.mp4", *CHEAP)
    assert (done.returncode, done.stdout) == (0, b"")
    assert re.fullmatch(SUMMARY.format(r"out\.mp4", 6, 12) + "\r?\n", done.stderr.decode())
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in.mp4", "out.mp4"]
    assert len(packets_of(tmp_path / "out.mp4", "video")) == 12


def test_a_terminal_gets_a_bar(fpsboost_, clip, monkeypatch):
    """On a terminal there is a bar with numbers, and the same line at the end; a name still is only a name."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "100")
    result = fpsboost_("in.mp4", "[bold]\x1b]0;title\x07.mp4", *CHEAP)
    assert result.code == 0
    assert not {"\x1b]", "\x07"} & set(re.findall(r"\x1b\]|\x07", result.err))
    plain = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", result.err)
    name = r"\[bold\]\\x1b\]0;title\\x07\.mp4"
    assert re.search(name + " .*[0-9]+/12", plain)
    assert re.search(SUMMARY.format(name, 6, 12), plain)
    assert "\x1b[?25h" in result.err.split("\x1b[?25l")[-1]  # the cursor is back
    write_clip(clip.with_name("in.h264"), times=range(6), container="h264")  # which does not say how many frames it has
    assert "/?" in fpsboost_("in.h264", "out.mp4", *CHEAP).err


def test_verbose_says_what_is_used(fpsboost_, clip):
    """Version, method with its options, and what the input is; the summary stays the last line."""
    result = fpsboost_("in.mp4", "out.mp4", "--verbose", "--method", "blend", "--cut-threshold", "0.25")
    assert result.code == 0
    assert fpsboost.__version__ in result.lines[0]
    assert "Blend()" in result.err
    assert "threshold=0.25" in result.err
    assert "in.mp4: 64x48, 6 frames at 25 fps" in result.lines
    assert result.lines[-2].startswith("out.mp4: libx264, yuv420p, preset=medium")
    assert re.fullmatch(SUMMARY.format(r"out\.mp4", 6, 12), result.lines[-1])


def test_opencv_has_one_thread_during_a_conversion(fpsboost_, clip, tmp_path, monkeypatch):
    """Pairs of frames are worked on side by side instead; its setting is as before afterwards."""
    seen = []
    pair = Interpolator.pair
    monkeypatch.setattr(
        Interpolator, "pair", lambda *given, **options: seen.append(cv2.getNumThreads()) or pair(*given, **options)
    )
    before = cv2.getNumThreads()
    cv2.setNumThreads(2)
    try:
        assert fpsboost_("in.mp4", "out.mp4", *CHEAP).code == 0
        assert (set(seen), cv2.getNumThreads()) == ({1}, 2)
    finally:
        cv2.setNumThreads(before)


@pytest.mark.parametrize(
    ("number", "module"),
    [
        (signal.SIGINT, "fpsboost.cli.app"),
        (signal.SIGTERM, "cyclopts"),
        (signal.SIGINT, "numpy"),
        (signal.SIGTERM, "fpsboost.io"),
    ],
)
def test_it_can_be_stopped_while_modules_are_imported(clip, tmp_path, number, module):
    """One sentence and exit code 130, whichever module is about to be imported."""
    code = f"""if True:
        import os, sys
        class Stopping:
            def find_spec(self, name, path=None, target=None):
                if name == {module!r}:
                    sys.meta_path.remove(self)
                    os.kill(os.getpid(), {int(number)})
        sys.meta_path.insert(0, Stopping()){RUN}"""
    result = run_python(tmp_path, "-c", code)
    said = result.stderr.splitlines()
    assert (result.returncode, result.stdout, said) == (130, b"", [b"Stopped; nothing was written."])
    assert [path.name for path in tmp_path.iterdir()] == ["in.mp4"]


LOSSES = {
    "a destructor": """
        class Destroyed:
            def __del__(self):
                signal.raise_signal(number)
        Destroyed()""",
    "an error in its place": """
        try:
            try:
                signal.raise_signal(number)
            finally:
                cleaned = threading.Event().wait(4 * AGAIN_AFTER)
                raise OSError
        except OSError:
            pass""",
    "a callback of FFmpeg": """
        import av, io
        class Full(io.BytesIO):
            def write(self, data):
                signal.raise_signal(number)
        try:
            with av.open(Full(), "w", format="matroska") as output:
                output.add_stream("mpeg4")
                output.start_encoding()
        except av.error.FFmpegError:
            pass""",
}


@pytest.mark.parametrize("loss", LOSSES)
def test_a_request_to_stop_is_repeated_if_it_is_lost(loss):
    """Whatever swallows the exception or replaces it; while others clean up because of it, they are not disturbed."""
    code = f"""if True:
        import signal, threading
        from fpsboost.cli.stopping import AGAIN_AFTER, stopping_on
        number, cleaned = signal.SIGTERM, None
        with stopping_on(number):
            try:{LOSSES[loss].replace(chr(10), chr(10) + 8 * " ")}
                print("went on", flush=True)
                threading.Event().wait()
            except KeyboardInterrupt:
                print("stopped", cleaned)
                threading.Event().wait(4 * AGAIN_AFTER)
    """
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    cleaned = False if "error" in loss else None
    assert result.stdout.split("\n") == ["went on", f"stopped {cleaned}", ""]
    assert "Traceback" not in result.stderr


def test_without_arguments_there_is_the_short_help(fpsboost_):
    """The main options, on standard output, as with -h, and exit code 0; the version is name and number."""
    alone = fpsboost_()
    assert (alone.code, alone.err, len(alone.out.splitlines())) == (0, "", 29)
    assert alone == fpsboost_("-h") == fpsboost_("in.mp4", "-h")
    assert re.findall(r"^  (--[a-z-]+)", alone.out, re.MULTILINE) == [*MAIN_OPTIONS]
    assert all(name in alone.out for name in app.app if not name.startswith("-"))
    assert fpsboost_("join", "-h") == fpsboost_("join", "--help")
    assert fpsboost_("--version") == Result(0, f"fpsboost {fpsboost.__version__}\n", "")


def test_options_may_stand_anywhere(fpsboost_, clip, tmp_path):
    """Before, between and behind the two names."""
    assert fpsboost_("-m", "nearest", "in.mp4", "--factor", "3", "out.mp4", "-q") == Result(0, "", "")
    assert len(packets_of(tmp_path / "out.mp4", "video")) == 18


def test_images_in_and_out(fpsboost_, tmp_path, save_images):
    """A folder to a folder, to a video and to a pattern."""
    save_images(tmp_path / "in", count=4)
    assert fpsboost_("in", "out", *CHEAP).code == 0
    assert len(list((tmp_path / "out").iterdir())) == 7
    assert fpsboost_("in/shot_####.png", "out.mp4", "--input-fps", "24", *CHEAP).code == 0
    assert len(packets_of(tmp_path / "out.mp4", "video")) == 8
    assert fpsboost_("in", "new_%03d.jpg", *CHEAP).code == 0
    assert len(list(tmp_path.glob("new_*.jpg"))) == 7


def test_video_options_reach_the_encoder(fpsboost_, tmp_path):
    """Codec, quality, speed, sound left out, pixel format, losslessness, and several options of the encoder's own."""
    write_clip(tmp_path / "in.mp4", times=range(6), sound="aac")
    options = ("--codec", "vp9", "--crf", "40", "--preset", "8", "--no-audio", "--no-subtitles")
    assert fpsboost_("in.mp4", "out.webm", *options, *CHEAP).code == 0
    assert len(packets_of(tmp_path / "out.webm", "video")) == 12
    options = ("--pix-fmt", "yuv444p", "--lossless", "--encoder-option", "g=4", "--encoder-option", "bf=0")
    assert fpsboost_("in.mp4", "out.mp4", *options, *CHEAP).code == 0
    pictures = pictures_of(tmp_path / "out.mp4")
    assert {picture.format.name for picture in pictures} == {"yuv444p"}
    assert [k for k, picture in enumerate(pictures) if picture.key_frame] == [0, 4, 8]


# Everything below is done in a folder that `material` fills.
FAILURES: dict[str, tuple[str, str]] = {
    "missing file": ("none.mp4 out.mp4", "none.mp4"),
    "missing folder": ("none/ out", "none"),
    "address": ("https://host/in.mp4 out.mp4", "https://host/in.mp4 is an address, and only files are read; download"),
    "empty folder": ("empty out", "empty is empty"),
    "empty folder, to a video": ("empty out.mp4", "empty is empty"),
    "folder without images": ("notes out", "notes holds no images"),
    "not a video": ("text.mp4 out.mp4", "text.mp4"),
    "zero bytes": ("zero.mp4 out.mp4", "zero.mp4"),
    "a video cut before its index": ("cut.mp4 out.mp4", "cut.mp4"),
    "one frame": ("one.mp4 out.mp4", "one.mp4"),
    "one image": ("single out.mp4 --input-fps 24", "single"),
    "output exists": ("in.mp4 there.mp4", "there.mp4"),
    "output folder missing": ("in.mp4 none/out.mp4", "none/out.mp4"),
    "output is input": ("in.mp4 in.mp4", "in.mp4"),
    "sound that does not fit": ("sound.mp4 out.webm --audio-codec copy", "--no-audio"),
    "mask that is missing": ("in.mp4 out.mp4 --mask none.png", "none.png"),
    "mask that is no image": ("in.mp4 out.mp4 --mask text.mp4", "text.mp4"),
    "mask of another size": ("in.mp4 out.mp4 --mask small.png", "small.png is 16x16, and the frames are 64x48"),
    "too few masks": ("in.mp4 out.mp4 --mask other", "other, 2, is not that of the frames of in.mp4, 3"),
    "too few masks for a part": (
        "in.mp4 out.mp4 --mask single --start 0",
        "single is 1, and there is none for frame 1",
    ),
}

MISTAKES: dict[str, tuple[str, str]] = {
    "codec for images": ("in.mp4 frames/ --codec h264", "--codec"),
    "encoder option for images": ("in.mp4 frames/ --encoder-option g=3", "--encoder-option"),
    "unknown ending": ("in.mp4 out.xyz", "out.xyz"),
    "unknown method": ("in.mp4 out.mp4 --method magic", "magic"),
    "unknown codec": ("in.mp4 out.mp4 --codec h246", "did you mean 'h264'?"),
    "part 0": ("in.mp4 out.mp4 --chunk 0/8", "--chunk 0/8 does not exist; parts are numbered from 1 to N"),
    "parts 0": ("in.mp4 out.mp4 --chunk 1/0", "--chunk 1/0 does not exist; parts are numbered from 1 to N"),
    "output that is an address": ("in.mp4 rtmp://host/live.mp4", "rtmp://host/live.mp4 is an address"),
    "factor 1e5000": ("in.mp4 out.mp4 --factor 1e5000", "--factor"),
    "fps fast": ("in.mp4 out.mp4 --fps fast", "--fps"),
    "images without a rate": ("single out.mp4", "--input-fps"),
    "option of another method": ("in.mp4 out.mp4 --method dis --search-radius 8", "search-radius"),
    "option given twice": ("in.mp4 out.mp4 --method nlm:v=0.1 --v 0.2", "gives v twice"),
    "search radius 0": ("in.mp4 out.mp4 --method nlm-exhaustive --search-radius 0", "--search-radius"),
    "bad pixel format": ("in.mp4 out.mp4 --pix-fmt magic", "--pix-fmt"),
    "codec in the wrong place": ("in.mp4 out.webm --codec h264", "--codec"),
    "cut threshold": ("in.mp4 out.mp4 --method blend --cut-threshold 3", "--cut-threshold"),
    "use of no mask": ("in.mp4 out.mp4 --mask-as layer", "--mask-as needs --mask"),
    "layer of frames with alpha": (
        "alpha.mkv out.mkv --codec ffv1 --mask single/shot_0001.png --mask-as layer",
        "--mask-as layer needs frames without alpha",
    ),
    # the parser's own
    "crf is no number": ("in.mp4 out.mp4 --crf low", "--crf"),
    "half a pixel": ("in.mp4 out.mp4 --patch-radius 4.5", "--patch-radius must be a whole number, not 4.5"),
    "at-cuts": ("in.mp4 out.mp4 --at-cuts jump", "--at-cuts"),
    "unknown option": ("in.mp4 out.mp4 --faster 2", "--faster"),
    "option without value": ("in.mp4 out.mp4 --fps", "--fps"),
    "the same folder twice": ("other other/ --in-place", "other is named twice; name it once"),
    "the same video twice": ("in.mp4 ./in.mp4 out", "in.mp4 is named twice; name it once"),
    "three names": ("in.mp4 out.mp4 more.mp4", "more.mp4"),
    "no output": ("-", "output"),
    "trial of a pipe": ("- out.mp4 --dry-run", "--dry-run"),
    "trial of a part": ("in.mp4 out.mp4 --dry-run --chunk 1/2", "--chunk"),
}


@pytest.fixture
def material(tmp_path, save_images) -> None:
    """Good and bad inputs of every kind."""
    write_clip(tmp_path / "in.mp4", times=range(3))
    write_clip(tmp_path / "sound.mp4", times=range(3), sound="aac")
    write_clip(tmp_path / "one.mp4", times=[0])
    write_clip(tmp_path / "alpha.mkv", times=range(3), codec="ffv1", pixel_format="bgra")
    (tmp_path / "text.mp4").write_text("not a video\n" * 100)
    (tmp_path / "zero.mp4").touch()
    (tmp_path / "small.png").write_bytes(png())
    (tmp_path / "cut.mp4").write_bytes((tmp_path / "in.mp4").read_bytes()[:1500])
    (tmp_path / "there.mp4").write_bytes(b"precious")
    (tmp_path / "empty").mkdir()
    (tmp_path / "notes" / "more").mkdir(parents=True)
    save_images(tmp_path / "single", count=1)
    save_images(tmp_path / "other", count=2)


@pytest.mark.usefixtures("material")
@pytest.mark.parametrize("case", [*FAILURES, *MISTAKES])
def test_refusals(fpsboost_, tmp_path, unchanged, case):
    """Exit code 1 for what files do not allow, 2 for what can never work; a sentence names it, nothing changes."""
    with unchanged(tmp_path):
        code, method, (arguments, word) = (1, CHEAP, FAILURES[case]) if case in FAILURES else (2, (), MISTAKES[case])
        assert_refused(fpsboost_(*shlex.split(arguments), *method), code, word)


@pytest.mark.usefixtures("material")
def test_values_are_right_for_pydantic(fpsboost_):
    """The parser of arguments has it check all of them, defaults too, where another library has loaded it."""
    pytest.importorskip("pydantic")
    assert fpsboost_("in.mp4", "out.mp4", *CHEAP).code == 0


@pytest.mark.usefixtures("material")
@pytest.mark.parametrize(
    "arguments",
    [
        "in.mp4 out.mp4 --fps 14.985014985014985",  # 15000/1001, as a program prints it
        "in.mp4 out.mkv --fps 14.985014985014985",
        "in.mp4 out.mp4 --factor 1.2345678901234",
        "in.mp4 out.mp4 --fps 1/3000000000",
        "other out.mp4 --input-fps 14.985014985014985",
        "other out.mp4 --input-fps 1e12",
        "other out.mp4 --input-fps 1e-12",
    ],
)
def test_rates_beyond_32_bits(fpsboost_, tmp_path, arguments):
    """A rate that no container can write exactly is approximated or refused as an option, never a crash."""
    result = fpsboost_(*shlex.split(arguments), *CHEAP)
    if result.code == 0:
        assert len(result.lines) == 1
    else:
        assert_refused(result, 2, arguments.split()[-2])


def test_a_corrupt_video_is_converted_with_a_note(fpsboost_, tmp_path):
    """Broken packets in the middle are told and not fatal, and FFmpeg prints nothing of its own; nothing if quiet."""
    spoil_packets(write_clip(tmp_path / "in.mp4", times=range(30)), [8, 9])
    result = fpsboost_("in.mp4", "out.mp4", *CHEAP)
    assert (result.code, result.out, len(result.lines)) == (0, "", 3)
    assert re.fullmatch(r"Note: in\.mp4 is damaged: .*\.", result.lines[1])
    assert re.fullmatch(r"Note: in\.mp4 varies from .*\.", result.lines[2])
    for option in ("--quiet", "-q"):
        (tmp_path / "out.mp4").unlink()
        assert fpsboost_("in.mp4", "out.mp4", option, *CHEAP) == Result(0, "", "")
    assert (tmp_path / "out.mp4").exists()


WAITING = """
import sys
from fpsboost.__main__ import main
from fpsboost.cli.messages import Reporter


def wrote(self, summary):
    if summary.frames_out == number:
        print("so many frames are on their way", file=sys.stderr, flush=True)
        sys.stdin.read()  # which nobody ends


Reporter.wrote = wrote
number = int(sys.argv.pop())
main()
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="Windows sends no such signals")
@pytest.mark.parametrize(
    ("number", "output", "factor", "frames", "finished"),
    [
        (signal.SIGINT, "out.mp4", 40, 270, "240 of 320"),
        (signal.SIGINT, "frames/", 5, 20, "[12]?[0-9] of 36"),
        (signal.SIGTERM, "out.mov", 40, 270, "240 of 320"),
        (signal.SIGTERM, "f_#.png", 5, 20, "[12]?[0-9] of 36"),
        (signal.SIGHUP, "out.mkv", 40, 270, "240 of 320"),
    ],
)
def test_a_stopped_run_says_what_it_leaves(tmp_path, number, output, factor, frames, finished):
    """Ctrl-C and a request to end, in the middle: exit code 130, no output, and one line that says what can go on."""
    write_clip(tmp_path / "in.mp4", times=range(8))
    arguments = ["in.mp4", output, "--factor", str(factor), "--duplicates", "keep", *CHEAP]
    command = [sys.executable, "-c", WAITING, *arguments, str(frames)]
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with subprocess.Popen(command, cwd=tmp_path, env=environment(), **pipes) as process:
        assert process.stderr.readline() == b"so many frames are on their way\n"
        process.send_signal(number)
        out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (130, b"")
    sentence = rf"Stopped; {finished} frames are finished, and --resume goes on from there\.\n"
    assert re.fullmatch(sentence, err.decode())
    assert {path.name for path in tmp_path.iterdir()} == {"in.mp4", f".{output.strip('/')}.unfinished"}


STAGES = {
    "opening": "fpsboost.io.video.source.VideoSource.__init__",
    "reading": "fpsboost.io.video.source.VideoSource.__iter__",
    "method": "fpsboost.interpolator.Interpolator.images",
    "writing a video": "fpsboost.io.video.sink.VideoSink.write",
    "writing images": "fpsboost.io.images.encoder.ImageEncoder.content",
    "finishing a video": "fpsboost.media.writer.FileWriter._finish",
    "finishing images": "fpsboost.io.images.sink.ImageSink._finish",
    "finishing an animation": "fpsboost.io.animation.writers.AnimationWriter.finish",
    "summary": "fpsboost.conversion.closing_remarks",
}


@pytest.mark.parametrize("stage", STAGES)
def test_what_nobody_foresaw_is_one_sentence(fpsboost_, clip, tmp_path, snapshot, monkeypatch, stage):
    """With the file's name and exit code 1, and nothing is left; the whole error comes with --verbose."""
    before = snapshot(tmp_path)
    output = "out/" if "images" in stage else "out.gif" if "animation" in stage else "out.mp4"
    with monkeypatch.context() as patched:
        patched.setattr(STAGES[stage], lambda *_, **__: {}["a\nb"])
        result = fpsboost_("in.mp4", output, *CHEAP)
        assert_refused(result, 1, "in.mp4", "KeyError", "--verbose")
        if stage != "summary":  # where the output is complete
            assert snapshot(tmp_path) == before
        verbose = fpsboost_("in.mp4", output, *CHEAP, "--verbose", "-y")
        assert (verbose.code, verbose.lines[-1]) == (1, result.lines[0])
        assert "Traceback" in verbose.err


@pytest.mark.parametrize("command", ["probe", "compare", "preview"])
def test_no_command_ends_in_a_traceback(fpsboost_, clip, tmp_path, unchanged, monkeypatch, command):
    """Those without details to say take --verbose all the same."""
    with unchanged(tmp_path):
        monkeypatch.setattr("fpsboost.io.video.source.VideoSource.__init__", lambda *_, **__: 1 / 0)
        assert_refused(fpsboost_(command, "in.mp4"), 1, "in.mp4", "division by zero")
        assert "Traceback" in fpsboost_(command, "in.mp4", "--verbose").err


FAULTS = {
    "binding.LIBRARY = Path('missing.so')": "reinstall fpsboost with pip.",
    "os.environ['FPSBOOST_CPU'] = 'avx1024'": "FPSBOOST_CPU is avx1024, and this processor has baseline",
}


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_kernels_that_cannot_be_used_are_one_sentence(clip, tmp_path, unchanged, fault):
    """It says what to do: install again, or choose a level that this processor has; nothing is written."""
    commands = ["in.mp4 out.mp4", "in.mp4 out/", "compare in.mp4", "doctor"]
    code = f"""if True:
        import io, json, os, sys
        from contextlib import redirect_stderr, redirect_stdout
        from pathlib import Path
        from fpsboost.__main__ import main
        from fpsboost.kernels import binding
        {fault}
        for command in {commands}:
            sys.argv, code, out, err = ["fpsboost", *command.split()], 0, io.StringIO(), io.StringIO()
            with redirect_stdout(out), redirect_stderr(err):
                try:
                    main()
                except SystemExit as stop:
                    code = stop.code
            print(json.dumps([code, out.getvalue(), err.getvalue()]))"""
    with unchanged(tmp_path):
        results = [Result(*json.loads(line)) for line in run_python(tmp_path, "-c", code).stdout.splitlines()]
    for command, result in zip(commands, results, strict=True):
        out = "" if command == "doctor" else result.out  # which lists what works, too
        assert_refused(replace(result, out=out), 1, FAULTS[fault])


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("comapre in.mp4", "did you mean fpsboost compare?"),
        ("Probe in.mp4", "did you mean fpsboost probe?"),
        ("help", "did you mean fpsboost --help?"),
        ("compare", "IN is missing. See fpsboost compare --help."),
        ("compare in.mp4 --bogus", "See fpsboost compare --help."),
        ("compare in.mp4 --retime=0=0", "not take --retime, an option of conversions. See fpsboost compare --help."),
        ("plan a b --uncertain blend", "not take --uncertain, an option of conversions. See fpsboost plan --help."),
        ("in.mp4 -fps 60", "-fps is not an option; write --fps 60, with two dashes."),
        ("in.mp4 \N{EN DASH}factor=3", "\N{EN DASH}factor=3 is not an option; write --factor=3, with two dashes."),
        ("in.mp4 -overwrite out.mp4", "-overwrite is not an option; write --overwrite, with two dashes."),
        ("in.mp4 -methd nlm", "-methd is not an option; write --method nlm, with two dashes."),
        ("ui -port 1", "-port is not an option; write --port 1, with two dashes."),
        ("in.mp4 out.mp4 -m nml", "There is no method 'nml'; did you mean 'nlm'?"),
        ("in.mp4 out.mp4 -m nlm:fusion=bare", "`fusion` must be one of learnt, plain, not 'bare'."),
        ("in.mp4 out.mp4 --preset slwo", "did you mean 'slow'?"),
        ("in.mp4 --at-cuts rpeat", 'Did you mean "repeat"? See fpsboost --help.'),
        ("in.mp4 --crf 1e1", "--crf must be a whole number, not '1e1'. See fpsboost --help."),
        ("in.mp4 --below low", "--below must be a number, not 'low'. See fpsboost --help."),
        ("doctor extra", "fpsboost doctor does not take extra. See fpsboost doctor --help."),
    ],
)
def test_wrong_words_are_told_what_is_meant(fpsboost_, clip, arguments, said):
    """A command that is nearly right, and the help of the command in question."""
    result = fpsboost_(*arguments.split())
    assert (result.code, result.out, len(result.lines)) == (2, "", 1)
    assert result.err.endswith(f"{said}\n")


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the device is Linux's")
@pytest.mark.parametrize(
    ("arguments", "ends", "code"),
    [
        ("in.mp4 out.mp4", "2", 0),
        ("in.mp4 out.mp4 --progress json", "2", 0),
        ("none.mp4 out.mp4", "2", 1),
        ("probe in.mp4", "1", 1),
        ("probe in.mp4 --json", "1", 1),
        ("--help", "1", 1),
    ],
)
def test_ends_that_take_no_text(clip, tmp_path, arguments, ends, code):
    """A message that cannot be written is no failure, a result is one."""
    command = f"{shlex.quote(sys.executable)} -m fpsboost {arguments} {ends}>/dev/full"
    assert subprocess.run(command, shell=True, cwd=tmp_path, env=environment(), check=False).returncode == code
    assert (tmp_path / "out.mp4").exists() == (code == 0)


@pytest.mark.parametrize("name", ["[red]gone[", "go\\ne", "100%", "go'ne", "a" * 120])
def test_odd_names_in_errors(fpsboost_, name):
    """A message prints a name as it was given, brackets and backslashes included, and is not wrapped at 80 columns."""
    assert_refused(fpsboost_(f"{name}.mp4", "out.mp4"), 1, f"{name}.mp4 does not exist")


def examples() -> list[str]:
    """Every command in the help and in the README, without its remark."""
    readme = ROOT / "README.md"
    text = app.EXAMPLES + (readme.read_text("utf-8") if readme.exists() else "")
    lines = [line.strip().removeprefix("$ ") for line in text.replace("\\\n", " ").splitlines()]
    lines = [re.split(r"\s#\s|\s{2,}", line)[0].strip() for line in lines if re.match(r"fpsboost\s+[^\s=]", line)]
    return list(dict.fromkeys(lines))


@pytest.mark.parametrize("line", examples())
def test_examples_parse(line):
    """What the help and the README show can be typed."""
    tokens = shlex.split(line)[1:]
    if {"--help", "-h", "--version"} & set(tokens):
        return
    _, bound, *_ = app.app.parse_args(tokens, exit_on_error=False, print_error=False)
    given = dict(bound.arguments)
    for group in filter(is_dataclass, bound.arguments.values()):
        given |= vars(group)
    if "methods" in given:
        choose(given["methods"], None)
    else:
        assert given.get("method", "nlm") in (vector_methods if given.get("vectors") else methods)
    if given.get("factor"):
        parse_number(given["factor"], "--factor")
    for option in ("fps", "input_fps"):
        if given.get(option):
            parse_rate(given[option])


def options() -> list[str]:
    names = [argument.name for argument in app.app.assemble_argument_collection() if argument.parse and argument.show]
    return [name for name in names if name.startswith("--")]


def test_help_shows_everything(fpsboost_, monkeypatch):
    """Every option with a sentence, every method and every example, on stdout."""
    monkeypatch.setenv("COLUMNS", "120")
    result = fpsboost_("--help")
    assert (result.code, result.err) == (0, "")
    for option in options():
        assert re.search(rf"{option}\b.*\s[A-Za-z].*", result.out), option
    assert all(name in result.out for name in (*methods, *vector_methods))
    flat = re.sub(r"\s+", " ", result.out)
    assert all(re.sub(r"\s+", " ", line.strip()) in flat for line in app.EXAMPLES.splitlines()[2:])


def test_help_fits_a_small_terminal(fpsboost_, monkeypatch):
    """At 80 columns every option has one line, groups come as people think, and no example is broken."""
    monkeypatch.setenv("COLUMNS", "80")
    lines = fpsboost_("--help").out.splitlines()
    first = next(number for number, line in enumerate(lines) if "─ Main options ─" in line)
    assert [line for line in lines[first:] if line.startswith("│    ") and line.strip("│ ")] == []
    assert lines[:3] == [
        "Usage: fpsboost [OPTIONS] IN [OUT]",
        "       fpsboost [OPTIONS] IN... FOLDER",
        "       fpsboost COMMAND",
    ]
    groups = re.findall(r"^╭─ (.*?) ─", "\n".join(lines), re.MULTILINE)
    assert groups == [
        "Arguments",
        *("Main options", "Rate", "Method", "Encoding", "Input", "Scenes", "Streams", "Side outputs", "Run"),
        "Method options",
        "Commands",
    ]
    assert {*app.EXAMPLES.splitlines()[2:]} <= {line.rstrip() for line in lines}


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["compare", "--help"]])
def test_what_needs_no_work_is_light(tmp_path, arguments):
    """Neither the package nor its command line loads OpenCV, the kernels or FFmpeg before there is work."""
    heavy = "{'cv2', 'fpsboost.kernels.binding', 'av', 'numpy', 'matplotlib', 'jinja2'}"
    run = f"import sys; from fpsboost.cli import app; app.app({arguments}, result_action='return_value')"
    code = f"{run}\nprint({heavy} & set(sys.modules), file=sys.stderr)"
    assert run_python(tmp_path, "-c", code).stderr.strip() == b"set()"


def test_usage_is_explained(fpsboost_, tmp_path):
    """A value that begins with a dash, and one where there is none to give."""
    for words, said in {
        "in.mp4 --start -1s": "--start '-1s' is not a position in a clip; write seconds",
        "in.mp4 --start --end 5s": "--start '--end' is not a position in a clip; write seconds",
        "in.mp4 --start": "--start needs a value; write one that begins with a dash as --start=-1.",
        "plan in/ out/ --budget -5%": "--budget must be a share of the pixels",
        "in.mp4 --retime -x": "Cannot read -x (No such file or directory); give --retime a file, or points",
        "in.mp4 --mask -x": "--mask needs a value; write one that begins with a dash as --mask=-1.",
        "--help=foo": "--help takes no value; write it alone.",
        "probe --help=foo": "--help takes no value; write it alone.",
    }.items():
        result = fpsboost_(*words.split())
        assert (result.code, said in result.err) == (2, True)
