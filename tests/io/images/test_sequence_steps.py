"""Sequences rendered with a step, frames that are missing, and both beside the originals."""

import os
import shutil
from collections.abc import Iterable, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fpsboost import CutDetector, VectorFolder, convert, find_method, methods
from fpsboost.analysis.scene_cuts import CutList
from fpsboost.cli.compare import match_vectors
from fpsboost.contracts import SilentObserver, Summary
from fpsboost.errors import CompleteAlreadyError, FpsboostError, InputError, OptionError, OutputError
from fpsboost.io import new_output
from fpsboost.io.images.files import read_image
from fpsboost.io.images.sequence import Numbering
from fpsboost.io.images.source import find_numbers
from fpsboost.probing import probe
from fpsboost.timing.position import Position, Trim
from support.conversion_options import grouped
from support.vector_truth import constant, save_flows, save_vectors

HEIGHT, WIDTH = 12, 16
BLEND = replace(methods["blend"], cuts=None)
PER_NUMBER = 2  # how much brighter the picture is at each next number: a mix of two tells its own number


def picture(number: float, first: int = 0) -> np.ndarray:
    """A picture that says its number, as far as it lies behind the first."""
    texture = np.random.default_rng(5).integers(0, 40, (HEIGHT, WIDTH, 3))
    return np.rint(texture + PER_NUMBER * (number - first)).astype(np.uint8)


def fill(folder: Path, numbers: Iterable[int], name: str = "{:04d}.png", first: int = 0) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for number in numbers:
        save(folder / name.format(number), picture(number, first))
    return folder


def save(path: Path, image: np.ndarray) -> None:
    path.write_bytes(cv2.imencode(path.suffix, image)[1].tobytes())


def names_in(folder: Path) -> list[str]:
    return sorted(os.listdir(folder))


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def times(folder: Path) -> dict[str, tuple[bytes, int]]:
    return {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in folder.iterdir() if path.is_file()}


def made(folder: Path, name: str) -> float:
    """The number that a picture says."""
    return float((read_image(folder / name).astype(float) - picture(0)).mean() / PER_NUMBER)


def run(source: Path | str, target: Path | str | None = None, method: object = BLEND, **options: object) -> Summary:
    return convert(str(source), None if target is None else str(target), method=method, **grouped(**options))


steps = st.sampled_from(
    [(step, factor) for step in range(2, 13) for factor in range(1, step + 1) if step % factor == 0]
)
namings = st.tuples(
    st.sampled_from(["", "shot_", "a.b-", "take 2_"]), st.integers(1, 6), st.sampled_from(["", "_left"])
)


@pytest.mark.slow
@settings(max_examples=15)
@given(
    steps,
    st.one_of(st.integers(0, 120), st.integers(10**9, 10**9 + 50)),
    st.integers(2, 4),
    namings,
    st.booleans(),
    st.booleans(),
)
def test_missing_numbers_are_made(step_and_factor, first, count, naming, as_pattern, in_place):
    """Whatever the step, the factor, the first number and the padding: names complete the numbering, originals stay."""
    step, factor = step_and_factor
    prefix, digits, suffix = naming
    with TemporaryDirectory() as work:
        folder = Path(work) / "in"
        naming = Numbering(folder, prefix, digits, f"{suffix}.png")
        numbers = range(first, first + step * count, step)
        folder.mkdir()
        for number in numbers:
            save(naming.path(number), picture(number, first))
        before = times(folder)
        path = folder / naming.pattern if as_pattern else folder
        if in_place and factor > 1:
            summary, target = run(path, factor=factor, in_place=True), folder
        else:
            summary, target = run(path, Path(work) / "out", factor=factor), Path(work) / "out"
        complete = range(numbers[0], numbers[-1] + 1, step // factor)
        assert names_in(target) == sorted(naming.path(number).name for number in complete)
        assert times(folder).items() >= before.items()
        assert contents(target).items() >= {name: data for name, (data, _) in before.items()}.items()
        assert summary.frames_out == len(complete)
        for number in set(complete) - set(numbers):
            found = read_image(target / naming.path(number).name).astype(int)
            assert np.abs(found - picture(number, first)).max() <= 1
        assert any(f"rise by {step}" in remark for remark in summary.remarks)


@pytest.mark.parametrize(
    ("step", "options", "expected", "is_anew"),
    [
        (2, {"factor": 3}, range(1, 8), True),
        (4, {"factor": 2}, range(1, 10, 2), False),
        (4, {"factor": 3}, range(1, 8), True),
        (3, {"factor": Fraction(3, 2)}, range(1, 8, 2), False),
        (3, {}, range(1, 6), True),
        (2, {"fps": 48, "input_fps": 24}, range(1, 6), False),
        (2, {"fps": 60, "input_fps": 24}, range(1, 7), True),
        (1, {"factor": 2}, range(1, 6), False),
    ],
)
def test_factors_that_fit_and_others(tmp_path, step, options, expected, is_anew):
    """Numbers are kept where the factor divides the step; otherwise they count one by one, and that is said."""
    summary = run(fill(tmp_path / "in", range(1, 2 + 2 * step, step)), tmp_path / "out", **options)
    assert names_in(tmp_path / "out") == [f"{number:04d}.png" for number in expected]
    assert summary.frames_out == len(expected)
    assert any("numbered anew" in remark for remark in summary.remarks) is is_anew


@pytest.mark.parametrize(
    ("numbers", "begin", "end", "options", "expected"),
    [(range(1, 12, 2), 1, 4, {}, range(3, 8)), ([1, 2, 5, 6, 9], 1, 6, {"fill_gaps": True}, range(2, 7))],
)
def test_a_part_keeps_its_numbers(tmp_path, numbers, begin, end, options, expected):
    """`--start` and `--end` count images, or numbers where gaps are filled; a part has the numbers of the whole."""
    source = fill(tmp_path / "in", numbers)
    part = Trim(Position.parse(f"{begin}f", "--start"), Position.parse(f"{end}f", "--end"))
    run(source, tmp_path / "out", trim=part, **options)
    assert names_in(tmp_path / "out") == [f"{number:04d}.png" for number in expected]
    originals = {name: data for name, data in contents(source).items() if int(name[:4]) in expected}
    assert contents(tmp_path / "out").items() >= originals.items()


def test_video_of_a_step_says_its_rate(tmp_path):
    """Each image is shown at --input-fps, and a sentence says what that means for the scene."""
    source = fill(tmp_path / "in", range(1, 10, 2))
    summary = run(source, tmp_path / "out.gif", input_fps=Fraction(10))
    assert (summary.frames_in, summary.frames_out) == (5, 10)
    assert any("24/2" in remark for remark in summary.remarks)
    summary = run(source, tmp_path / "filled.gif", input_fps=Fraction(10), fill_gaps=True)
    assert summary.frames_out == 9
    assert not any("24/2" in remark for remark in summary.remarks)


def test_probe_says_the_step(tmp_path, fpsboost_):
    """In JSON and for people; None for what has no numbers."""
    fill(tmp_path / "in", range(1, 10, 2))
    assert probe(str(tmp_path / "in")).number_step == 2
    assert probe(str(fill(tmp_path / "one", range(1, 4)))).number_step == 1
    assert "in steps of 2" in fpsboost_("probe", "in").out
    for name in "abc":
        save(tmp_path / f"{name}.png", picture(1))
    assert probe(str(tmp_path)).number_step is None
    assert find_numbers(str(fill(tmp_path / "gap", [1, 2, 4]))) is find_numbers("in.mp4") is None


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ([1, 2, 4], r"0003\.png is missing from its sequence; .*`fill_gaps`"),
        ([1, 3, 5, 9], r"0007\.png is missing from its sequence \(in steps of 2\); .*`fill_gaps`"),
        ([1, 3, 5, 6, 7], r"0002\.png is missing from its sequence, and 1 more are; .*`fill_gaps`"),
        ([0, 5, 15, 30], r"0010\.png is missing from its sequence \(in steps of 5\), and 2 more are"),
    ],
)
def test_a_hole_is_an_error_that_names_it(tmp_path, numbers, message):
    """In a step of 1 and of any other; nothing is written."""
    with pytest.raises(InputError, match=message):
        run(fill(tmp_path / "in", numbers), tmp_path / "out")
    assert names_in(tmp_path) == ["in"]


@pytest.mark.slow
@settings(max_examples=15)
@given(st.sets(st.integers(0, 20), min_size=2, max_size=8), st.integers(0, 900), st.booleans())
def test_gaps_of_any_pattern_are_filled(offsets, first, in_place):
    """Just the missing frames are made, each at its true time; the others are the same files."""
    numbers = sorted(first + offset for offset in offsets)
    with TemporaryDirectory() as work:
        folder = fill(Path(work) / "in", numbers, first=numbers[0])
        before, is_complete = contents(folder), len(numbers) == numbers[-1] - numbers[0] + 1
        if in_place and is_complete:
            with pytest.raises(OutputError, match="No image is missing"):
                run(folder, fill_gaps=True, in_place=True)
            return
        target = folder if in_place else Path(work) / "out"
        summary = run(folder, None if in_place else target, fill_gaps=True, in_place=in_place)
        everything = range(numbers[0], numbers[-1] + 1)
        assert names_in(target) == [f"{number:04d}.png" for number in everything]
        assert contents(target).items() >= before.items()
        assert (summary.frames_out, summary.frames_made) == (len(everything), len(everything) - len(numbers))
        for number in everything:
            found = read_image(target / f"{number:04d}.png").astype(int)
            assert np.abs(found - picture(number, numbers[0])).max() <= 1
        assert not any("varies" in remark or "shows nothing new" in remark for remark in summary.remarks)


def test_missing_images_are_no_scene_cut(tmp_path):
    """The mix of both is made between images of nothing in common; a list of cuts counts all the same."""
    images = {number: np.random.default_rng(number // 4).integers(0, 256, (60, 80, 3)) for number in (0, 1, 4, 5)}
    for number, image in images.items():
        (tmp_path / "in").mkdir(exist_ok=True)
        save(tmp_path / "in" / f"{number:04}.png", image)
    cuts = CutList((Position.parse("2f", "`cuts`"),))
    for policy, shown in ((CutDetector(), images[0] * 2 / 3 + images[4] / 3), (cuts, images[0])):
        target = tmp_path / type(policy).__name__
        summary = run(tmp_path / "in", target, replace(BLEND, cuts=policy), fill_gaps=True)
        assert summary.scene_cuts == isinstance(policy, CutList)
        np.testing.assert_allclose(read_image(target / "0002.png"), shown, atol=0.6)


def test_long_gaps_are_no_pauses(tmp_path):
    """What would be held in a video for its length is made here."""
    run(fill(tmp_path / "in", [0, 1, 60, 61]), tmp_path / "out", fill_gaps=True)
    assert len(names_in(tmp_path / "out")) == 62
    assert made(tmp_path / "out", "0030.png") == pytest.approx(30, abs=0.3)


def test_repeated_images_are_not_missing(tmp_path):
    """An original that shows the same as the one before stays what it is."""
    source = fill(tmp_path / "in", range(0, 12, 2))
    for number in (2, 6, 10):
        shutil.copy(source / f"{number - 2:04d}.png", source / f"{number:04d}.png")
    before = contents(source)
    for name, options in {"filled": {"fill_gaps": True}, "doubled": {}}.items():
        run(source, tmp_path / name, **options)
        assert contents(tmp_path / name).items() >= before.items()
    run(source, in_place=True)
    assert contents(source).items() >= before.items()


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"fill_gaps": True, "keep_timing": True, "output": "out"}, OptionError, "`fill_gaps` .*`keep_timing`"),
        ({"fill_gaps": True, "in_place": True, "factor": 2}, OptionError, "leave `factor` out"),
        ({"in_place": True, "factor": 3}, OptionError, "`in_place` keeps; give `factor=2`, or `fill_gaps`"),
        ({"in_place": True, "factor": 1}, OptionError, "`in_place` keeps"),
        ({"in_place": True, "overwrite": True}, OptionError, "replaces nothing"),
        (
            {"in_place": True, "duplicates": "drop"},
            OptionError,
            "`duplicates='drop'` and `in_place` cannot be combined",
        ),
        ({"in_place": True, "gaps": "1"}, OptionError, "`gaps` and `in_place` cannot be combined"),
        ({"in_place": True, "output": "out"}, OptionError, "leave the output out out"),
    ],
)
def test_contradictions(tmp_path, options, error, message):
    """Each in a sentence, with nothing written."""
    source = fill(tmp_path / "in", [1, 3, 5])
    before = times(source)
    with pytest.raises(error, match=message):
        convert(str(source), **({"method": BLEND} | grouped(**options)))
    assert times(source) == before


def test_only_images_with_numbers_have_gaps(tmp_path):
    """Names without numbers, and videos; and dates are no frame numbers."""
    for name in "abc":
        save(tmp_path / f"{name}.png", picture(1))
    with pytest.raises(OptionError, match="`fill_gaps` goes by numbers"):
        run(tmp_path, tmp_path / "out", fill_gaps=True)
    with pytest.raises(OptionError, match="`in_place` needs images with numbers"):
        run(tmp_path, in_place=True)
    (tmp_path / "in.mp4").write_bytes(b"")
    for option in ("fill_gaps", "in_place"):
        with pytest.raises(OptionError, match=r"is for a folder or a pattern of images, which .*in\.mp4 is not"):
            run(tmp_path / "in.mp4", "out.mp4" if option == "fill_gaps" else None, **{option: True})
    dates = fill(tmp_path / "dates", [20240131, 20240201, 20250101])
    with pytest.raises(InputError, match=r"9899 images are missing between .*20240201\.png and 20250101\.png"):
        run(dates, tmp_path / "out", fill_gaps=True)


class StoppedError(Exception):
    """Raised on purpose."""


def stop_moving(monkeypatch: pytest.MonkeyPatch, after: int, error: BaseException) -> None:
    """Let a run be killed when so many files have got their names: nothing is put back then."""
    calls = iter(range(after))

    def move_some(moves: Sequence[tuple[Path, Path]], move: object = None) -> None:
        for here, there in moves:
            if next(calls, None) is None:
                raise error
            os.rename(here, there)
        raise error

    monkeypatch.setattr(new_output, "move_all", move_some)


@pytest.mark.parametrize("moved", [0, 1, 3, 5])
def test_a_run_in_place_that_was_killed(tmp_path, monkeypatch, moved):
    """While frames get their names: without --resume it is refused, with it the same files come out."""
    whole = fill(tmp_path / "whole", range(1, 12, 2))
    run(whole, in_place=True)
    source = fill(tmp_path / "in", range(1, 12, 2))
    with monkeypatch.context() as context:  # nothing is tidied up behind it
        stop_moving(context, moved, StoppedError())
        context.setattr("fpsboost.media.staging.shutil.rmtree", lambda *arguments, **options: None)
        context.setattr("pathlib.Path.unlink", lambda path, **options: None)
        with pytest.raises(StoppedError):
            run(source, in_place=True)
    assert len(contents(source)) == 6 + moved
    with pytest.raises(FpsboostError, match="`resume` goes on with that"):
        run(source, in_place=True)
    run(source, in_place=True, resume=True)
    assert contents(source) == contents(whole)
    assert names_in(source) == names_in(whole)
    with pytest.raises(CompleteAlreadyError, match="No image is missing"):
        run(source, in_place=True, resume=True)


def test_a_run_in_place_that_was_stopped(tmp_path):
    """Finished frames stay hidden, and the next run goes on with them; originals are not looked for twice."""
    whole = fill(tmp_path / "whole", range(1, 12, 2))
    run(whole, in_place=True)
    source = fill(tmp_path / "in", range(1, 12, 2))
    before = times(source)

    class Impatient(SilentObserver):
        def wrote(self, summary: Summary) -> None:
            if summary.frames_out == 7:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as stopped:
        run(source, in_place=True, observer=Impatient())
    assert times(source) == before
    assert "`resume` goes on from there" in " ".join(stopped.value.__notes__)
    summary = run(source, in_place=True, resume=True)
    assert 1 <= summary.completed_frames <= 3  # of 7, four are originals
    assert contents(source) == contents(whole)
    assert [name for name in names_in(source) if name.startswith(".")] == []


def test_what_appears_meanwhile_is_not_replaced(tmp_path):
    """A frame that a renderer writes while others are made stays, and nothing else is put there."""
    source = fill(tmp_path / "in", [1, 3, 5])

    class Renderer(SilentObserver):
        def ready(self) -> None:
            (source / "0004.png").write_bytes(b"mine")

    before = contents(source)
    with pytest.raises(OutputError, match=r"0004\.png has appeared meanwhile"):
        run(source, in_place=True, observer=Renderer())
    assert contents(source) == {**before, "0004.png": b"mine"}


def test_other_files_beside_the_images_stay(tmp_path):
    """Other sequences in the folder, notes, and images of another padding."""
    source = fill(tmp_path / "in", [1, 3, 5], "Image{:04d}.png")
    fill(source, [1, 2, 3], "Depth{:04d}.png")
    (source / "notes.txt").write_text("mine")
    save(source / "Image2.png", picture(9))
    before = times(source)
    run(source / "Image####.png", in_place=True)
    assert times(source).items() >= before.items()
    assert sorted(set(names_in(source)) - set(before)) == ["Image0002.png", "Image0004.png"]


def test_the_command_line_in_place(tmp_path, fpsboost_):
    """No OUT; several inputs, each beside its own; --resume says that nothing is missing; else a folder beside it."""
    fill(tmp_path / "a", [1, 3, 5])
    fill(tmp_path / "b", [1, 2, 4, 7])
    result = fpsboost_("a", "b", "--in-place", "--fill-gaps", "-m", "blend")
    assert result.code == 0, result.err
    assert names_in(tmp_path / "a") == [f"{number:04d}.png" for number in range(1, 6)]
    assert names_in(tmp_path / "b") == [f"{number:04d}.png" for number in range(1, 8)]
    assert fpsboost_("a", "--in-place", "-m", "blend").code == 1
    result = fpsboost_("a", "--in-place", "--resume", "-m", "blend")
    assert (result.code, "No image is missing" in result.err) == (0, True)
    result = fpsboost_("a", "-m", "blend")
    assert (result.code, (tmp_path / "a-2x").is_dir()) == (0, True)


def save_pass(folder: Path, numbers: Iterable[int], dx: float = 1.0, size: tuple[int, int] = (HEIGHT, WIDTH)) -> Path:
    """Vectors that go `dx` pixels to the right from number to number."""
    for number in numbers:
        save_vectors(folder / f"Vector{number:04d}.exr", constant(*size, -dx, 0), constant(*size, dx, 0))
    return folder


def numbered_vectors(folder: Path, numbers: Iterable[int], kind: str = ".exr") -> VectorFolder:
    """Vectors whose length is their number."""
    for number in numbers:
        flows = constant(HEIGHT, WIDTH, -number, 0), constant(HEIGHT, WIDTH, number, 0)
        if kind == ".exr":
            save_vectors(folder / f"v{number:04d}.exr", *flows)
        else:
            save_flows(folder, f"v{number:04d}", *flows)
    return VectorFolder(folder)


@pytest.mark.parametrize("kind", [".exr", ".flo"])
def test_vectors_have_their_frames_numbers(tmp_path, kind):
    """Image 3 takes vectors 3, whatever comes before; one that is missing is named when it is needed."""
    vectors = numbered_vectors(tmp_path, [1, 2, 3, 4, 5, 7, 9], kind)
    matched = vectors.matched(range(3, 10, 2), must_match=True)
    assert [matched.at(frame).forward[0, 0, 0] for frame in range(4)] == [3, 5, 7, 9]
    assert matched.step == 2
    every = vectors.matched(range(3, 10), must_match=True)
    with pytest.raises(InputError, match=r"v0006(_backward)?\.(exr|flo) is missing, the vectors of output frame 6"):
        every.at(3)
    with pytest.raises(InputError, match="is missing"):
        vectors.at(0)


def test_numbers_that_do_not_match_leave_the_order(tmp_path):
    """Images that are numbered anew take vectors by number where all are there, and in order otherwise."""
    vectors = numbered_vectors(tmp_path, range(9))
    by_number = vectors.matched(range(1, 8), must_match=False)
    assert (by_number.at(0).forward[0, 0, 0], by_number.remarks) == (1, [])
    in_order = vectors.matched(range(101, 108), must_match=False)
    assert in_order.at(0).forward[0, 0, 0] == 0
    assert "numbered from 0 on and the output from 101" in in_order.remarks[0]
    assert vectors.matched(range(101, 110), must_match=False).remarks == []


SIZE = 32, 48


def moved(number: int) -> np.ndarray:
    """A texture that goes one pixel to the right from number to number."""
    texture = cv2.GaussianBlur(np.random.default_rng(2).integers(0, 256, (SIZE[0], 160, 3), np.uint8), (5, 5), 0)
    return np.ascontiguousarray(texture[:, 60 - number : 60 - number + SIZE[1]])


@pytest.mark.parametrize(
    ("options", "images", "vectors"),
    [
        ({"factor": 2}, range(3, 12, 2), range(1, 20)),
        ({"factor": 2}, range(3, 16, 4), range(1, 20)),
        ({"factor": 2}, range(3, 12, 2), range(3, 12, 2)),
        ({"factor": 2}, range(10, 19, 2), range(1, 20)),
        ({"fill_gaps": True}, [1, 2, 5, 8], range(12)),
    ],
)
@pytest.mark.parametrize("method", ["reproject-image", "reproject-scene"])
def test_numbered_renders_with_vectors(tmp_path, method, options, images, vectors):
    """The true frames, from vectors of all numbers or, for the report's search, of the images' alone."""
    (tmp_path / "in").mkdir()
    for number in images:
        save(tmp_path / "in" / f"{number:04d}.png", moved(number))
    folder = VectorFolder(save_pass(tmp_path / "v", vectors, size=SIZE))
    if method == "reproject-scene" and vectors == images:
        with pytest.raises(InputError, match=rf"Vector{images[0] + 1:04d}\.exr is missing"):
            run(tmp_path / "in", tmp_path / "out", method=find_method(method, folder), **options)
        return
    run(tmp_path / "in", tmp_path / "out", method=find_method(method, folder), **options)
    numbers = range(images[0], images[-1] + 1, 1 if "fill_gaps" in options else (images[1] - images[0]) // 2)
    assert names_in(tmp_path / "out") == [f"{number:04d}.png" for number in numbers]
    for number in numbers:
        found = read_image(tmp_path / "out" / f"{number:04d}.png")
        np.testing.assert_array_equal(found[8:-8, 8:-8], moved(number)[8:-8, 8:-8])


def test_a_comparison_takes_vectors_by_number(tmp_path):
    """Of a stepped sequence each frame takes the vectors of its number; what has no numbers takes them in order."""
    fill(tmp_path / "in", range(5, 14, 2))
    numbered_vectors(tmp_path / "v", range(20))
    folder = VectorFolder(tmp_path / "v")
    vectors = match_vectors(str(tmp_path / "in"), folder)
    assert [vectors.at(frame).forward[0, 0, 0] for frame in range(5)] == [5, 7, 9, 11, 13]
    assert vectors.step == 2
    assert match_vectors("in.mp4", folder).at(1).forward[0, 0, 0] == 1


@pytest.mark.parametrize(("step", "options"), [(2, {"factor": 3}), (1, {"factor": 2, "fill_gaps": True})])
def test_vectors_need_numbers_that_fit(tmp_path, step, options):
    """Where images are numbered anew, no number says which vectors are theirs: one sentence, nothing written."""
    source = fill(tmp_path / "in", [1, 1 + step, 1 + 3 * step] if "fill_gaps" in options else range(1, 8, step))
    method = find_method("reproject-image", numbered_vectors(tmp_path / "v", range(20)))
    with pytest.raises(OptionError, match=rf"vectors go by the numbers of .* give `factor={step}`\."):
        convert(str(source), str(tmp_path / "out"), method=method, **grouped(**options))
    assert not (tmp_path / "out").exists()
