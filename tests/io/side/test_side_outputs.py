"""Confidence and motion written beside a conversion: what is in the files, their names, and when they appear."""

import json
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from fpsboost import (
    ByFactor,
    CutDetector,
    DecodeOptions,
    FpsboostError,
    Frame,
    InputError,
    Interpolator,
    OptionError,
    OutputError,
    Position,
    RunOptions,
    SideOutputs,
    Timing,
    Trim,
    VectorFolder,
    convert,
    find_method,
    methods,
    run_conversion,
)
from fpsboost.io.images.exr import read_exr
from fpsboost.io.images.files import read_image
from fpsboost.io.side.flow import flow_picture
from fpsboost.motion.field import ZeroMotion
from fpsboost.synthesis.blend import Blend
from fpsboost.timeline import TimelineOptions
from support.memory_frames import FakeSink, FakeSource, make_frames
from support.vector_truth import constant, save_flows
from support.video_truth import write_clip

BLEND = Interpolator(ZeroMotion(), Blend(), cuts=None, compensate_illumination=False)
SHIFT = 8, 4  # pixels to the right and down from each frame of `pan` to the next


def pan(number: int) -> np.ndarray:
    """A window that moves over a smooth texture."""
    texture = cv2.GaussianBlur(np.random.default_rng(1).integers(0, 256, (160, 200, 3)).astype(np.float32), (0, 0), 2)
    texture = cv2.normalize(texture, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    x, y = 64 - SHIFT[0] * number, 48 - SHIFT[1] * number
    return np.ascontiguousarray(texture[y : y + 64, x : x + 96])


def save_pan(folder: Path, numbers: range, name: str = "shot_{:04d}.png") -> Path:
    folder.mkdir()
    for number in numbers:
        (folder / name.format(number)).write_bytes(cv2.imencode(".png", pan(number))[1].tobytes())
    return folder


def beside(overwrite: bool = False, **paths: Any) -> RunOptions:
    return RunOptions(side=SideOutputs(**{name: str(path) for name, path in paths.items()}), overwrite=overwrite)


def names_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def two_scenes() -> list[np.ndarray]:
    rng = np.random.default_rng(2)
    return [cv2.resize(rng.integers(0, 256, (5, 7, 3)).astype(np.uint8), (96, 64)) for _ in range(2)]


class AskingSink(FakeSink):
    """A sink that asks for all there is."""

    needs_confidence = needs_motion = True


def blended(sink: FakeSink, factor: int) -> list[Frame]:
    """What a sink gets of three flat frames."""
    source = FakeSource(make_frames(map(Fraction, range(3)), Fraction(3)))
    run_conversion(source, BLEND, sink, ByFactor(Fraction(factor)), options=TimelineOptions(duplicates=None))
    return sink.frames


def test_only_frames_that_are_made_have_a_confidence():
    """Originals have none; what is repeated behind the last is not known at all."""
    confidences = [frame.confidence for frame in blended(AskingSink(), 2)]
    assert [each is not None for each in confidences] == [False, True, False, True, False, True]
    assert [bool(each.max() > 0.5) for each in confidences[1::2]] == [True, True, False]


def test_motion_comes_once_for_each_pair():
    """With the first frame made between two of the source, whose places it says."""
    frames = blended(AskingSink(), 9)
    motions = {index: frame.motion for index, frame in enumerate(frames) if frame.motion is not None}
    assert {index: (motion.number0, motion.number1) for index, motion in motions.items()} == {1: (0, 1), 10: (1, 2)}
    assert motions[1].flow01.shape == (*frames[0].array.shape[:2], 2)


def test_a_sink_that_does_not_ask_costs_nothing(monkeypatch):
    """Neither confidence nor motion is computed for it."""

    def fail(*_: Any) -> None:
        raise AssertionError

    monkeypatch.setattr("fpsboost.synthesis.generation.measure_agreement", fail)
    monkeypatch.setattr("fpsboost.streaming.PairMotion", fail)
    frames = blended(FakeSink(), 2)
    assert {(frame.confidence is None, frame.motion is None) for frame in frames} == {(True, True)}


@pytest.mark.parametrize("at_cuts", ["repeat", "blend", "extrapolate"])
def test_nothing_is_known_across_a_cut(at_cuts):
    """Whatever is shown there has confidence 0, and there is no motion between the two scenes."""
    scenes = two_scenes()
    frames = [Frame(np.roll(scenes[k // 3], 2 * k, 1), Fraction(k), Fraction(1)) for k in range(6)]
    sink, method = AskingSink(holds_last_frame=False), replace(methods["blend"], cuts=CutDetector(), at_cuts=at_cuts)
    assert run_conversion(FakeSource(frames), method, sink, ByFactor(Fraction(2))).scene_cuts == 1
    made = sink.frames[1::2]
    assert [bool(frame.confidence.any()) for frame in made] == [True, True, False, True, True]
    assert [frame.motion is None for frame in made] == [False, False, True, False, False]


def test_a_still_until_a_cut_is_certain():
    """A picture that is held is repeated with confidence 1 up to its last frame."""
    scenes = two_scenes()
    frames = [Frame(scenes[k // 3], Fraction(k), Fraction(1)) for k in range(4)]
    sink, method = AskingSink(holds_last_frame=False), replace(methods["blend"], cuts=CutDetector())
    run_conversion(FakeSource(frames), method, sink, ByFactor(Fraction(2)))
    assert [None if each.confidence is None else float(each.confidence.mean()) for each in sink.frames] == [
        *(None, 1, None, 1, None, 0, None),
    ]


@pytest.mark.parametrize("method", ["nlm", "dis-warp", "blend"])
@pytest.mark.parametrize("target", ["out", "out.mp4"])
def test_frames_are_the_same_with_and_without(tmp_path, method, target):
    """Byte for byte, images and video."""
    source = save_pan(tmp_path / "in", range(1, 5))
    written = []
    for run in (RunOptions(), beside(overwrite=True, confidence=tmp_path / "conf", save_motion=tmp_path / "motion")):
        out = tmp_path / f"{len(written)}" / target
        out.parent.mkdir()
        decoding = DecodeOptions(input_fps=24) if "." in target else None
        convert(str(source), str(out), method=method, run=run, decoding=decoding)
        written.append([path.read_bytes() for path in (sorted(out.iterdir()) if out.is_dir() else [out])])
    assert written[0] == written[1]


def test_files_are_named_like_the_images(tmp_path):
    """Confidence after the frames made between images that keep their numbers, motion after those images."""
    source = save_pan(tmp_path / "in", range(1, 6, 2))
    run = beside(confidence=tmp_path / "conf", save_motion=tmp_path / "motion")
    convert(str(source), str(tmp_path / "out"), method="nlm", run=run)
    assert names_in(tmp_path / "conf") == ["shot_0002.png", "shot_0004.png"]
    kinds = ["backward.flo", "backward.png", "forward.flo", "forward.png"]
    assert names_in(tmp_path / "motion") == [f"shot_{k:04d}_{kind}" for k in (1, 3, 5) for kind in kinds]
    certain = read_image(tmp_path / "conf" / "shot_0002.png")
    assert certain.shape == (64, 96, 1)
    assert certain.dtype == np.uint8
    assert np.median(certain[20:-20, 30:-30]) > 180
    assert names_in(tmp_path) == ["conf", "in", "motion", "out"]


def test_of_a_video_files_are_counted_from_one(tmp_path):
    """Confidence by frames of the output, motion by frames of the source; also where only a part is read."""
    clip = write_clip(tmp_path / "in.mp4", times=range(6))
    run = beside(confidence=tmp_path / "conf", save_motion=tmp_path / "m_###.exr")
    decoding = DecodeOptions(trim=Trim(start=Position(Fraction(2), is_frame=True)))
    convert(str(clip), str(tmp_path / "out.mp4"), method="blend", run=run, decoding=decoding)
    assert names_in(tmp_path / "conf") == [f"{k:06d}.png" for k in (2, 4, 6, 8)]
    assert [name for name in names_in(tmp_path) if name.endswith(".exr")] == [f"m_{k:03d}.exr" for k in (1, 2, 3, 4)]


def test_confidence_as_exr_is_that_of_png(tmp_path):
    """Half, one channel Y, 1 for certain."""
    source = save_pan(tmp_path / "in", range(1, 4))
    for number, path in enumerate((tmp_path / "png", tmp_path / "c_##.exr")):
        convert(str(source), str(tmp_path / f"out{number}"), method="dis", run=beside(confidence=path))
    exr = read_exr(tmp_path / "c_02.exr")
    assert list(exr) == ["Y"]
    np.testing.assert_allclose(exr["Y"], read_image(tmp_path / "png" / "shot_0002.png")[..., 0] / 255, atol=0.003)


@pytest.mark.parametrize("pattern", ["motion", "motion_####.exr"])
def test_motion_can_be_read_as_vectors(tmp_path, pattern):
    """Of a clip with all frames: pixels from each to the next, as vectors for making every second one of them."""
    every = save_pan(tmp_path / "all", range(1, 6), "{:04d}.png")
    convert(str(every), str(tmp_path / "twice"), method="nlm", run=beside(save_motion=tmp_path / pattern))
    vectors = VectorFolder(tmp_path / pattern)
    assert len(vectors.files) == (10 if pattern == "motion" else 5)
    for number in range(5):
        backward, forward, _ = vectors.at(number)
        np.testing.assert_allclose(np.median(forward, axis=(0, 1)), SHIFT, atol=0.1)
        np.testing.assert_allclose(np.median(backward, axis=(0, 1)), np.negative(SHIFT), atol=0.1)
    second = save_pan(tmp_path / "second", range(1, 6, 2), "{:04d}.png")
    convert(str(second), str(tmp_path / "out"), method=find_method("reproject-image", vectors))
    made = read_image(tmp_path / "out" / "0002.png").astype(int)
    assert np.abs(made - pan(2))[16:-16, 24:-24].mean() < 4


def test_in_place_only_missing_images_have_a_confidence(tmp_path):
    """Each map has the number of the image that was made."""
    source = save_pan(tmp_path / "in", range(1, 6, 2))
    (source / "shot_0006.png").write_bytes((source / "shot_0005.png").read_bytes())
    run = RunOptions(in_place=True, side=SideOutputs(confidence=str(tmp_path / "conf")))
    assert convert(str(source), method="blend", timing=Timing(fill_gaps=True), run=run).completed_frames == 0
    assert names_in(tmp_path / "conf") == ["shot_0002.png", "shot_0004.png"]
    assert len(names_in(source)) == 6


def test_repeats_have_no_motion_of_their_own(tmp_path):
    """It leads past them, from the first of them to the next that differs."""
    source = save_pan(tmp_path / "in", range(1, 5), "{:04d}.png")
    (source / "0002.png").write_bytes((source / "0001.png").read_bytes())
    convert(str(source), str(tmp_path / "out"), method="dis", run=beside(save_motion=tmp_path / "m_#.exr"))
    assert sorted(path.name for path in tmp_path.glob("*.exr")) == ["m_1.exr", "m_3.exr", "m_4.exr"]


def test_a_renderers_vectors_are_followed(tmp_path):
    """The confidence of scene-assisted frames is how well the frames agree where the vectors lead."""
    source = save_pan(tmp_path / "in", range(1, 6, 2), "{:04d}.png")
    for number in range(1, 6):
        vectors = (constant(64, 96, *(sign * each for each in SHIFT)) for sign in (-1, 1))
        save_flows(tmp_path / "right", f"{number:04d}", *vectors)
        save_flows(tmp_path / "wrong", f"{number:04d}", *(constant(64, 96, 0, 0) for _ in range(2)))
    means = []
    for name in ("right", "wrong"):
        method = find_method("reproject-scene", VectorFolder(tmp_path / name))
        convert(
            str(source), str(tmp_path / f"{name}-out"), method=method, run=beside(confidence=tmp_path / f"c-{name}")
        )
        means.append(read_image(tmp_path / f"c-{name}" / "0002.png")[16:-16, 24:-24].mean())
    assert means[0] > 250
    assert means[1] < 60


@pytest.mark.parametrize(
    ("option", "factor", "sentence"),
    [("save_motion", 2, "No motion was found"), ("confidence", 1, "No frame was made")],
)
def test_what_is_empty_is_said(tmp_path, option, factor, sentence):
    """Vectors that are all 0 come with a remark; where all frames are originals, there is nothing to write."""
    source = str(save_pan(tmp_path / "in", range(1, 4)))
    run = beside(**{option: tmp_path / "beside"})
    summary = convert(source, str(tmp_path / "out"), factor=factor, method="blend", run=run)
    assert any(sentence in remark for remark in summary.remarks)
    assert (tmp_path / "beside").exists() == (factor == 2)


@pytest.mark.parametrize("output", ["out", "out.mp4"])
def test_what_fails_in_the_middle_leaves_nothing(tmp_path, snapshot, output):
    """Neither the output nor anything beside it."""
    source = save_pan(tmp_path / "in", range(1, 6))
    (source / "shot_0004.png").write_bytes(b"\x89PNG broken")
    before = snapshot(tmp_path)
    run = beside(confidence=tmp_path / "conf", save_motion=tmp_path / "motion")
    with pytest.raises(InputError):
        convert(str(source), str(tmp_path / output), method="nearest", run=run, decoding=DecodeOptions(input_fps=24))
    assert snapshot(tmp_path) == before


def test_files_that_appear_meanwhile_stop_the_output(tmp_path, monkeypatch):
    """They are looked for once more before anything gets its name."""
    source, conf = save_pan(tmp_path / "in", range(1, 4)), tmp_path / "conf"

    def write(path: Path, data: bytes) -> None:
        conf.mkdir(exist_ok=True)
        (conf / "mine.txt").write_text("here first")
        path.write_bytes(data)

    monkeypatch.setattr("fpsboost.io.side.sink.write_safely", write)
    with pytest.raises(OutputError, match="not empty"):
        convert(str(source), str(tmp_path / "out"), method="blend", run=beside(confidence=conf))
    assert [name for name in names_in(tmp_path) if not name.startswith(".")] == ["conf", "in"]
    assert names_in(conf) == ["mine.txt"]


def test_overwrite_replaces_files_of_the_same_names_alone(tmp_path):
    """Maps of an earlier run go, numbers that are not written again too; anything else stays."""
    source, conf = save_pan(tmp_path / "in", range(1, 4)), tmp_path / "conf"
    conf.mkdir()
    for name in ("shot_0002.png", "shot_0040.png", "notes.txt"):
        (conf / name).write_bytes(b"old")
    with pytest.raises(OutputError, match="overwrite"):
        convert(str(source), str(tmp_path / "out"), method="blend", run=beside(confidence=conf))
    convert(str(source), str(tmp_path / "out"), method="blend", run=beside(True, confidence=conf))
    assert names_in(conf) == ["notes.txt", "shot_0002.png", "shot_0004.png"]
    assert (conf / "shot_0002.png").read_bytes() != b"old"


def test_files_that_were_set_aside_are_kept(tmp_path, monkeypatch):
    """A run that is killed while it replaces files leaves them where it has put them, and the next one says where."""
    source, conf = save_pan(tmp_path / "in", range(1, 4)), tmp_path / "conf"
    conf.mkdir()
    (conf / "shot_0002.png").write_bytes(b"old")

    def move_some(moves: list[tuple[Path, Path]], _: object) -> None:
        moves[0][0].rename(moves[0][1])
        raise KeyboardInterrupt

    monkeypatch.setattr("fpsboost.io.new_output.move_all", move_some)
    with pytest.raises(KeyboardInterrupt):
        convert(str(source), str(tmp_path / "out"), method="blend", run=beside(True, confidence=conf))
    with pytest.raises(OutputError, match="replaced holds files that a run had set aside to replace them; move them"):
        convert(str(source), str(tmp_path / "out2"), method="blend", run=beside(True, confidence=conf))
    assert [path.read_bytes() for path in conf.rglob("shot_0002.png") if path.parent.name == "replaced"] == [b"old"]


@pytest.mark.parametrize(
    ("paths", "kind", "sentence"),
    [
        ({"confidence": "x.png"}, OptionError, "needs a folder"),
        ({"confidence": ""}, OptionError, "needs a folder"),
        ({"confidence": "c_##.tif"}, OptionError, "writes .png or .exr"),
        ({"save_motion": "m_##.png"}, OptionError, "writes .flo or .exr"),
        ({"confidence": "in"}, OptionError, "folder of its own"),
        ({"save_motion": "out"}, OptionError, "folder of its own"),
        ({"confidence": "maps", "save_motion": "maps"}, OptionError, "folder of its own"),
        ({"confidence": "missing/maps"}, OutputError, "does not exist"),
        ({"save_motion": "missing/m_##.exr"}, OutputError, "does not exist"),
        ({"confidence": "in/shot_0001.png/maps"}, OutputError, "shot_0001.png is a file"),
    ],
)
def test_places_that_cannot_be_taken_are_refused(tmp_path, monkeypatch, snapshot, paths, kind, sentence):
    """Before anything is read or written, in one sentence."""
    save_pan(tmp_path / "in", range(1, 4))
    monkeypatch.chdir(tmp_path)
    before = snapshot(tmp_path)
    with pytest.raises(FpsboostError, match=sentence) as refused:
        convert("in", "out", method="blend", run=beside(**paths))
    assert isinstance(refused.value, kind)
    assert snapshot(tmp_path) == before


def test_the_command_line_writes_them(fpsboost_, tmp_path):
    """And refuses them for several inputs, with its own names of the options."""
    save_pan(tmp_path / "in", range(1, 4))
    result = fpsboost_("in", "out", "--method", "blend", "--confidence", "conf", "--save-motion", "motion")
    assert result.code == 0
    assert names_in(tmp_path / "conf") == ["shot_0002.png", "shot_0004.png"]
    several = fpsboost_("in", "out", "folder", "--confidence", "conf2")
    assert (several.code, "--confidence" in several.err) == (2, True)
    resumed = fpsboost_("in", "out2", "--resume", "--save-motion", "motion2")
    assert (resumed.code, "--save-motion" in resumed.err) == (2, True)


def test_progress_as_json(fpsboost_, tmp_path):
    """Every line is an object; each frame is said, and the last line has the remarks."""
    save_pan(tmp_path / "in", range(1, 6, 2))
    result = fpsboost_("in", "out", "--method", "blend", "--progress", "json")
    assert (result.code, result.out) == (0, "")
    lines = [json.loads(line) for line in result.lines]
    assert [line["frame"] for line in lines if line["stage"] == "converting"] == [1, 2, 3, 4, 5]
    assert {line["frames"] for line in lines} == {5}
    assert lines[0]["stage"] == "opened"
    assert [line.get("done") for line in lines[-2:]] == [None, True]
    assert lines[-1]["output"] == "out"
    assert lines[-1]["frames_made"] == 2
    assert lines[-1]["least_certain"]["frame"] in (1, 3)
    remarks = {remark["kind"]: remark["values"] for remark in lines[-1]["remarks"]}
    assert len(remarks) == 2
    assert remarks["last-image"] == {"frames": 3, "images": 5, "expected": 6}


def test_errors_stay_sentences(fpsboost_):
    """One line that is no object, and the exit code."""
    result = fpsboost_("none.mp4", "out.mp4", "--progress", "json")
    assert result.code == 1
    assert result.lines == ["fpsboost: none.mp4 does not exist; check the name."]
    both = fpsboost_("none.mp4", "out.mp4", "--progress", "json", "--quiet")
    assert (both.code, "--quiet and --progress json cannot be combined" in both.err) == (2, True)


def test_colours_say_direction_and_length():
    """No motion is white, more than most of the lengths is darker, below a pixel pale, and what is not known black."""
    flow = np.float32([[[0, 0], [4, 0], [2, 0], [8, 0], [-4, 0], [np.nan, 0], *[[4, 0]] * 994]])
    white, full, half, beyond, opposite, unknown = flow_picture(flow)[0, :6].tolist()
    assert (white, full, half) == ([255, 255, 255], [0, 0, 255], [128, 128, 255])
    assert beyond == [0, 0, 191]
    assert opposite[2] == 0
    assert unknown == [0, 0, 0]
    flow = np.zeros((50, 50, 2), np.float32)
    flow[..., 0], flow[0, 0] = 5, 500
    assert flow_picture(flow)[20, 20].tolist() == [0, 0, 255]
    assert flow_picture(flow * 0.02)[20, 20].min() > 200
