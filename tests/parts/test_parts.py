"""Parts of a conversion: however it is cut, what is joined is what one run makes."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from numpy.typing import NDArray

from fpsboost import DecodeOptions, Encoding, Position, Timing, Trim, VectorFolder, convert, find_method, join
from fpsboost.contracts import Summary
from fpsboost.errors import CompleteAlreadyError, FpsboostError, InputError, OptionError, OutputError
from fpsboost.io.video.sink import VideoPartSink, VideoSink
from fpsboost.parts.manifest import MANIFEST_NAME, Manifest
from fpsboost.run_options import Part, RunOptions, parse_part
from support.comparison_truth import save_clip
from support.exr_truth import write_exr
from support.stopping import StopAfter
from support.vector_truth import save_vectors
from support.video_truth import packets_of, scene, write_clip

FAST = Encoding(preset="ultrafast")
CHUNK_FRAMES = 30  # instead of 240, for speed
FACTOR = 2  # so that a chunk of the output lies between few frames of the source
FRAMES = 54


@pytest.fixture(autouse=True)
def short_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cut and encode in shorter chunks, so that clips of some chunks are short."""
    monkeypatch.setattr("fpsboost.parts.plan.CHUNK_FRAMES", CHUNK_FRAMES)
    for kind in (VideoSink, VideoPartSink):
        monkeypatch.setitem(kind.__init__.__kwdefaults__, "chunk_frames", CHUNK_FRAMES)


def film(index: int, height: int, width: int) -> NDArray[np.uint8]:
    """Motion, animation on threes, a still, motion again, with cuts between; hard edges, so that motion shows."""
    shot = index // 18
    step = {0: index, 1: index // 3 * 3, 2: 36}.get(shot, index)
    picture = scene(5 * step + 200 * shot, height, width)
    picture[10:30, 4 + 2 * step % 40 : 16 + 2 * step % 40] = 255 - 60 * shot
    return picture


def convert_in_parts(count: int, source: Path, target: Path, **options: Any) -> list[Summary]:
    """Make all parts, the last one first."""
    run = options.pop("run", RunOptions())
    return [
        convert(str(source), str(target), run=replace(run, chunk=Part(number, count)), **options)
        for number in range(count, 0, -1)
    ]


def parts_of(target: Path) -> list[str]:
    """Return the folders of all parts of an output."""
    return [str(path) for path in sorted(target.with_name(target.name + ".parts").glob("[0-9]*"))]


def packets(path: Path) -> list[object]:
    """Return the packets of pictures and sound; Matroska has random numbers in its header."""
    with av.open(str(path)) as file:
        kinds = [stream.type for stream in file.streams]
    return [packets_of(path, kind) for kind in kinds]


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_clip(
        tmp_path_factory.mktemp("clip") / "in.mkv",
        times=range(FRAMES),
        picture=film,
        sound="aac",
        options={"preset": "ultrafast", "crf": "0", "g": "17"},
    )


def facts_of(summary: Summary) -> tuple[object, ...]:
    """Return what a summary says of the frames."""
    intervals = summary.frame_intervals
    return (
        *(summary.frames_in, summary.frames_out, summary.frames_made, summary.scene_cuts, summary.duplicates),
        *(intervals.shortest, intervals.longest, intervals.begin),
        [remark.partition(" holds ")[2] or remark for remark in summary.remarks],  # without the name of the output
    )


VIDEO_OPTIONS: dict[str, dict[str, Any]] = {
    "a factor": {"factor": FACTOR},
    "a fraction of a frame": {"factor": Fraction(41, 24)},
    "the same rhythm": {"timing": Timing(FACTOR, keep_timing=True)},
    "a rate": {"timing": Timing(fps=Fraction(60000, 1001))},
    "slow motion": {"timing": Timing(FACTOR, slow_motion=True, slow_motion_sound="stretch")},
    "a range": {"factor": FACTOR, "decoding": DecodeOptions(Trim(Position(Fraction(2, 5)), Position(Fraction(2))))},
    "a range between frames": {"factor": 1, "decoding": DecodeOptions(Trim(Position(Fraction(19, 10))))},
    "a range of frames": {
        "factor": FACTOR,
        "decoding": DecodeOptions(Trim(Position(Fraction(11), is_frame=True), Position(Fraction(50), is_frame=True))),
    },
    "a retime curve": {"timing": Timing(2, retime="smooth 0=4f 2s=1s 2.5s=1s 4s=2s")},
    "motion blur": {"timing": Timing(2, shutter=Fraction(300), shutter_samples=3)},
    "without repeats": {"timing": Timing(FACTOR, duplicates="drop")},
    "missing frames": {"timing": Timing(FACTOR, gaps="20,33x2")},
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "parts"),
    [*((options, 3) for options in VIDEO_OPTIONS.values()), ({"factor": 1}, 5)],
    ids=[*VIDEO_OPTIONS, "more parts than chunks"],
)
def test_a_video_joined_of_parts_is_that_of_one_run(tmp_path, clip, options, parts):
    """The same bytes, and the same summary; some parts begin in motion or in a still, or are empty."""
    options = {"method": "blend", "encoding": FAST, **options}
    whole = convert(str(clip), str(tmp_path / "whole.mp4"), **options)
    target = tmp_path / "joined.mp4"
    empty = [each.frames_out for each in convert_in_parts(parts, clip, target, **options)].count(0)
    assert parts == 3 or empty == 3
    joined = join(str(target), parts_of(target))
    assert target.read_bytes() == (tmp_path / "whole.mp4").read_bytes()
    assert facts_of(joined) == facts_of(whole)


@pytest.mark.slow
@pytest.mark.parametrize(("times", "container"), [("variable", "mp4"), ("with a pause", "mkv"), ("jitter", "mkv")])
def test_a_variable_rate_in_parts(tmp_path, times, container):
    """Times that vary, pause or jitter give the same frames at the same times, with motion that is followed."""
    random = np.random.default_rng(3)
    steps = {
        "variable": random.integers(20, 60, FRAMES),
        "with a pause": np.where(np.arange(FRAMES) == 31, 1500, 40),
        "jitter": 40 + random.integers(-4, 5, FRAMES),
    }[times]
    source = write_clip(
        tmp_path / f"in.{container}",
        times=[0, *np.cumsum(steps)[:-1].tolist()],
        time_base=Fraction(1, 1000),
        rate=Fraction(25),
        picture=film,
    )
    options = {"method": "nlm-fast", "factor": FACTOR, "encoding": FAST}
    convert(str(source), str(tmp_path / "whole.mkv"), **options)
    convert_in_parts(3, source, tmp_path / "out.mkv", **options)
    join(str(tmp_path / "out.mkv"), [tmp_path / "out.mkv.parts"])
    assert packets(tmp_path / "out.mkv") == packets(tmp_path / "whole.mkv")


def image_conversion(tmp_path: Path, snapshot: Callable[..., Any], source: str, output: str, **options: Any) -> None:
    """Compare images that one run makes with those of parts."""
    for name in ("whole", "joined"):
        (tmp_path / name).mkdir()
    whole = convert(source, str(tmp_path / "whole" / output), **options)
    for count in (1, 4):
        convert_in_parts(count, Path(source), tmp_path / "joined" / output, **options)
        parts = tmp_path / "joined" / f"{Path(output).name}.parts"
        joined = join(str(tmp_path / "joined" / output), [parts], overwrite=True)
        shutil.rmtree(parts)
        assert facts_of(joined)[1:-1] == facts_of(whole)[1:-1]
    assert snapshot(tmp_path / "joined") == snapshot(tmp_path / "whole")


@pytest.mark.slow
@pytest.mark.parametrize("factor", [2, Fraction(5, 2), 1])
@pytest.mark.parametrize("output", ["frames", "new_%05d.png"])
def test_images_joined_of_parts_are_those_of_one_run(tmp_path, snapshot, save_images, factor, output):
    """The same names and bytes, also where a part begins between two images of the source, each with its own mask."""
    save_images(tmp_path / "in", count=13)
    image_conversion(
        tmp_path, snapshot, str(tmp_path / "in"), output, factor=factor, method="nlm-fast", mask=tmp_path / "in"
    )


def test_missing_images_in_parts(tmp_path, snapshot, save_images):
    """Parts follow the numbers where gaps are filled."""
    save_images(tmp_path / "in", count=16)
    for number in (3, 4, 7, 11, 12):
        (tmp_path / "in" / f"shot_{number:04d}.png").unlink()
    image_conversion(tmp_path, snapshot, str(tmp_path / "in"), "out", timing=Timing(fill_gaps=True), method="blend")


@pytest.mark.slow
def test_a_video_to_images_in_parts(tmp_path, snapshot, clip):
    """Frames of a video get the same numbers."""
    image_conversion(tmp_path, snapshot, str(clip), "out", factor=2, method="blend")


@pytest.fixture
def made(tmp_path: Path) -> Path:
    """A folder of images in three parts, whose output is its name without ``.parts``."""
    save_clip(tmp_path / "in", map(scene, range(7)))
    convert_in_parts(3, tmp_path / "in", tmp_path / "out", method="blend")
    return tmp_path / "out.parts"


def spoil(path: Path) -> None:
    """Change one byte in the middle of a file."""
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


@pytest.mark.slow
def test_parts_that_cannot_be_joined(tmp_path, made):
    """Each fault is one sentence that names the part, and nothing is written."""
    target = str(tmp_path / "out")
    one, two, three = sorted(made.iterdir())

    def refused(*parts: Path | str) -> str:
        with pytest.raises(FpsboostError) as caught:
            join(target, parts)
        assert not Path(target).exists()
        return str(caught.value)

    assert "No parts" in refused()
    assert "is not the folder of a part" in refused(tmp_path / "nothing")
    assert "2 is missing" in refused(one, three)
    assert "2, 3 are missing" in refused(one)
    copy = shutil.copytree(two, tmp_path / "copy")
    assert "are both part 2/3" in refused(one, two, copy, three)
    image = sorted(copy.glob("*.png"))[1]
    spoil(image)
    assert f"{image} is damaged; make part 2/3 again" in refused(one, copy, three)
    image.unlink()
    assert f"{image} is missing" in refused(one, copy, three)
    (copy / MANIFEST_NAME).write_text("{}")
    assert "is damaged" in refused(one, copy, three)
    (copy / MANIFEST_NAME).unlink()
    assert "make this part again" in refused(one, copy, three)
    convert_in_parts(4, tmp_path / "in", tmp_path / "other", method="blend")
    assert "one of 3 parts" in refused(one, two, tmp_path / "other.parts" / "0003-of-0004")
    convert_in_parts(3, tmp_path / "in", tmp_path / "nearest", method="nearest")
    assert "differ in their" in refused(one, tmp_path / "nearest.parts" / two.name, three)
    spoil(tmp_path / "in" / "0003.png")
    assert "is not the input of the parts" in refused(made)


def test_join_takes_an_input_that_was_moved(tmp_path, made):
    """By its content, wherever it is; an output of another type is refused, as parts are made for one container."""
    with pytest.raises(OptionError, match="another type"):
        join(str(tmp_path / "out.mp4"), [made], input=str(tmp_path / "in"))
    (tmp_path / "in").rename(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="does not exist"):
        join(str(tmp_path / "out"), [made])
    assert join(str(tmp_path / "out"), [made], input=str(tmp_path / "elsewhere")).frames_out == 13
    assert len(list((tmp_path / "out").iterdir())) == 13


def test_what_cannot_be_cut(tmp_path, clip, made):
    """Pipes, animations, side outputs, and frames beside the input."""
    run = RunOptions(chunk=Part(1, 2))
    for target in ("-", str(tmp_path / "out.gif")):
        with pytest.raises(OptionError, match="`chunk`"):
            convert(str(clip), target, run=run)
    with pytest.raises(OptionError, match="`in_place`"):
        RunOptions(chunk=Part(1, 2), in_place=True)
    for text in ("3", "0/3", "4/3", "1/0", "a/b", "1/99999"):
        with pytest.raises(OptionError):
            parse_part(text)


def test_a_part_that_exists(tmp_path, made):
    """It is refused, left as it is, or replaced, as the options say."""
    again = partial(convert, str(tmp_path / "in"), str(tmp_path / "out"), method="blend")
    with pytest.raises(OutputError, match="exists already"):
        again(run=RunOptions(chunk=Part(2, 3)))
    with pytest.raises(CompleteAlreadyError):
        again(run=RunOptions(chunk=Part(2, 3), resume=True))
    spoil(min((made / "0002-of-0003").glob("*.png")))
    again(run=RunOptions(chunk=Part(2, 3), overwrite=True))
    join(str(tmp_path / "out"), [made])


@pytest.mark.slow
def test_a_part_goes_on_where_it_was_stopped(tmp_path, clip):
    """Finished chunks are kept, and the joined file is the same."""
    options: dict[str, Any] = {"method": "blend", "factor": FACTOR, "encoding": FAST}
    convert(str(clip), str(tmp_path / "whole.mp4"), **options)
    again = partial(convert, str(clip), str(tmp_path / "out.mp4"), **options)
    with pytest.raises(KeyboardInterrupt) as stopped:
        again(run=RunOptions(chunk=Part(2, 2), observer=StopAfter(CHUNK_FRAMES + 10)))
    assert f"{CHUNK_FRAMES} of" in stopped.value.__notes__[0]
    assert again(run=RunOptions(chunk=Part(2, 2), resume=True)).completed_frames == CHUNK_FRAMES
    again(run=RunOptions(chunk=Part(1, 2)))
    join(str(tmp_path / "out.mp4"), [tmp_path / "out.mp4.parts"])
    assert (tmp_path / "out.mp4").read_bytes() == (tmp_path / "whole.mp4").read_bytes()


def test_nothing_is_left_of_a_part_that_fails(tmp_path, clip, snapshot):
    """Neither its folder nor that of all parts."""
    run = RunOptions(chunk=Part(2, 2), observer=StopAfter(3))
    with pytest.raises(KeyboardInterrupt):
        convert(str(clip), str(tmp_path / "out.mp4"), method="blend", factor=FACTOR, run=run)
    assert snapshot(tmp_path) == {}


def test_a_part_that_cannot_be_read_back_is_not_published(tmp_path, clip, monkeypatch):
    """A chunk that is damaged on its way to the disk ends in a sentence."""
    monkeypatch.setattr("fpsboost.media.chunks.sync", lambda path: path.write_bytes(path.read_bytes()[:-40]))
    with pytest.raises(OutputError, match="cannot be read back"):
        convert_in_parts(1, clip, tmp_path / "out.mp4", method="nearest")
    assert not parts_of(tmp_path / "out.mp4")


def test_a_manifest_comes_back_as_it_was(made, tmp_path):
    """Every field, and none of another version's."""
    folder = made / "0002-of-0003"
    manifest = Manifest.read(folder)
    manifest.write(tmp_path)
    assert Manifest.read(tmp_path) == manifest
    assert manifest.part.folder(str(tmp_path / "out")) == folder
    (tmp_path / MANIFEST_NAME).write_text(json.dumps({**json.loads((folder / MANIFEST_NAME).read_text()), "format": 0}))
    with pytest.raises(InputError, match="another version"):
        Manifest.read(tmp_path)


@pytest.mark.slow
def test_parts_on_the_command_line(fpsboost_, tmp_path, clip):
    """Made and joined as the help says."""
    assert fpsboost_(clip, "whole.mkv", "-m", "blend").code == 0
    for part in ("1/2", "2/2"):
        assert fpsboost_(clip, "out.mkv", "-m", "blend", "--chunk", part).code == 0
    done = fpsboost_("join", "out.mkv", "out.mkv.parts")
    assert done.code == 0
    assert "54 -> 108 frames" in done.err
    assert packets(tmp_path / "out.mkv") == packets(tmp_path / "whole.mkv")
    refused = fpsboost_("join", "other.mkv", "out.mkv.parts/0001-of-0002")
    assert (refused.code, "2 is missing" in refused.err) == (1, True)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["in.ts", "in.m2v"])
def test_a_video_that_does_not_list_its_frames(tmp_path, name):
    """All before a part is decoded then, which is said; also where nothing says how many frames there are."""
    codec = "libx264" if name == "in.ts" else "mpeg2video"
    write_clip(tmp_path / name, times=range(FRAMES), picture=film, codec=codec)
    options: dict[str, Any] = {"method": "blend", "factor": FACTOR, "encoding": FAST}
    whole = convert(str(tmp_path / name), str(tmp_path / "whole.mkv"), **options)
    convert_in_parts(2, tmp_path / name, tmp_path / "out.mkv", **options)
    joined = join(str(tmp_path / "out.mkv"), [tmp_path / "out.mkv.parts"])
    assert any("does not list its frames" in remark for remark in joined.remarks)
    assert packets(tmp_path / "out.mkv") == packets(tmp_path / "whole.mkv")
    assert joined.frames_out == whole.frames_out


@pytest.mark.slow
def test_openexr_with_vectors_in_parts(tmp_path, snapshot):
    """Layers, and a renderer's motion as a candidate, go by the numbers of frames."""
    (tmp_path / "in").mkdir()
    for number in range(1, 18, 2):
        colours = scene(number).astype(np.float32) / 64
        channels = {name: colours[..., place] for place, name in enumerate("BGR")}
        depth = {"Depth.Z": np.full(colours.shape[:2], number, np.float32)}
        write_exr(tmp_path / "in" / f"{number:04d}.exr", channels | depth)
        motion = np.full((*colours.shape[:2], 2), (2, 0), np.float32)
        save_vectors(tmp_path / "vectors" / f"{number:04d}.exr", -motion, motion)
    method = find_method("nlm-fast", VectorFolder(tmp_path / "vectors"))
    image_conversion(tmp_path, snapshot, str(tmp_path / "in"), "out", factor=2, method=method)
