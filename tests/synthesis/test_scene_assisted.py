"""Scene-assisted reprojection against true in-between frames, and both methods with vectors from end to end."""

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest

from fpsboost import FrameCache, InputError, Interpolator, OptionError, VectorFolder, convert
from fpsboost.io.images.files import read_image
from fpsboost.method_table import find_method, interpolate, vector_methods
from fpsboost.motion.field import ZeroMotion
from fpsboost.synthesis import FramePair
from fpsboost.synthesis.scene_assisted import SceneAssisted
from support.command_line import assert_refused
from support.exr_truth import write_exr
from support.truth import Clip, as_type, frozen, moved_waves, moving_object, noise, translation
from support.vector_truth import constant, save_object, save_translation, save_vectors


def made(
    synthesizer: SceneAssisted, image0: np.ndarray, image1: np.ndarray, span: int | Fraction, times: Sequence[float]
) -> list[np.ndarray]:
    """Images between two frames that are `span` output frames apart, the first of them number 0."""
    placed = [FrameCache(image0, Fraction(0)), FrameCache(image1, Fraction(span))]
    return list(synthesizer.synthesize(FramePair(*placed, *ZeroMotion().estimate(*placed)), times))


def between(synthesizer: SceneAssisted, clip: Clip, span: int = 4) -> list[np.ndarray]:
    return made(synthesizer, clip.image0, clip.image1, span, [number / span for number in range(1, span)])


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_images_are_like_the_frames(tmp_path, channels, dtype):
    """Shape, type and values of a still, but for colours that nobody can see."""
    image = noise(19, 23, channels, dtype).copy()
    if channels in {2, 4} and dtype is not np.float32:
        image[..., -1] = image[..., -1].clip(1)
    vectors = VectorFolder(save_translation(tmp_path, 3, (19, 23), 0, 0))
    (middle,) = made(SceneAssisted(vectors), image, image, 2, [0.5])
    assert middle.dtype == dtype
    assert middle.flags.carray  # contiguous and writeable
    np.testing.assert_allclose(middle, image, rtol=1e-6 if dtype is np.float32 else 0)


@pytest.mark.parametrize("shift", [(8, 0), (0, -8), (-8, 0), (0, 8), (-8, 4)])
def test_translations_are_exact(tmp_path, shift):
    """What leaves the frame comes from the one, what enters it from the other; up is up and down is down.

    Of a slanting translation, what neither frame shows in two corners is a mixture.
    """
    clip = translation(30, 40, *shift, seed=1)
    vectors = VectorFolder(save_translation(tmp_path, 5, (30, 40), shift[0] / 4, shift[1] / 4))
    for number, image in enumerate(between(SceneAssisted(vectors), clip), 1):
        wrong = (image != clip.at(number / 4)).any(axis=-1)
        if all(shift):
            wrong[:number, : 2 * (4 - number)] = False  # came from above, and leaves to the left
            wrong[30 - (4 - number) :, 40 - 2 * number :] = False
        assert not wrong.any()


def test_each_frame_has_vectors_of_its_own(tmp_path):
    """What speeds up is where the in-between frame says, not half-way: x = 0, 2, 8 at output frames 0, 1, 2."""
    canvas = noise(20, 60)
    image0, middle, image1 = (frozen(canvas[:, 20 - x : 50 - x]) for x in (0, 2, 8))
    for number, (before, after) in enumerate([(0, 2), (-2, 6), (-6, 0)]):
        save_vectors(tmp_path / f"{number}.exr", constant(20, 30, before, 0), constant(20, 30, after, 0))
    (image,) = made(SceneAssisted(VectorFolder(tmp_path)), image0, image1, 2, [0.5])
    np.testing.assert_array_equal(image, middle)


def moving(tmp_path: Path) -> tuple[Clip, VectorFolder, VectorFolder]:
    """An object before a background, its vectors with depth and without."""
    clip = moving_object(40, 60, box=(12, 10, 28, 30), dx=16, dy=4)
    save_object(tmp_path / "v", tmp_path / "d", (40, 60), (12, 10, 28, 30), 5, (4, 1))
    return clip, VectorFolder(tmp_path / "v", tmp_path / "d"), VectorFolder(tmp_path / "v")


def test_with_depth_nothing_is_seen_through_an_object(tmp_path):
    """Object, background, and what one frame hides: all exact; without depth the object leaves ghosts."""
    clip, with_depth, without_depth = moving(tmp_path)
    truths = [clip.at(t) for t in (0.25, 0.5, 0.75)]
    np.testing.assert_array_equal(between(SceneAssisted(with_depth), clip), truths)
    for image, truth in zip(between(SceneAssisted(without_depth), clip), truths, strict=True):
        assert 0.02 < (image != truth).any(axis=-1).mean() < 0.2


def test_the_tolerance_of_depth(tmp_path):
    """A frame that is nearer by more than the tolerance does not count; where neither counts, both are mixed."""
    image0, image1 = (np.full((6, 8, 1), value, np.uint8) for value in (40, 80))
    save_translation(tmp_path / "v", 3, (6, 8), 0, 0)
    (tmp_path / "d").mkdir()
    for depths, tolerance, expected in (
        ((10.0, 10.0, 10.0), 0.05, 60),
        ((9.6, 10.0, 9.6), 0.05, 60),
        ((9.4, 10.0, 10.0), 0.05, 80),
        ((9.4, 10.0, 10.0), 0.1, 60),
        ((12.0, 10.0, 9.4), 0.05, 40),
        ((1.0, 10.0, 1.0), 0.05, 60),
        ((np.inf, np.inf, np.inf), 0.05, 60),
        ((np.inf, np.inf, 10.0), 0.05, 40),
        ((1e10, 1e10, 1e10), 0.05, 60),
    ):
        for number, depth in enumerate(depths):
            write_exr(tmp_path / "d" / f"{number}.exr", {"Z": np.full((6, 8), depth, np.float32)}, half=False)
        synthesizer = SceneAssisted(VectorFolder(tmp_path / "v", tmp_path / "d"), depth_tolerance=tolerance)
        (image,) = made(synthesizer, image0, image1, 2, [0.5])
        assert (image == expected).all(), (depths, tolerance)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_colours_that_alpha_hides_do_not_bleed(tmp_path, dtype):
    """Half a pixel between a red one and a hidden green one is red, half hidden."""
    white = np.iinfo(dtype).max
    image = np.zeros((4, 6, 4), dtype)
    image[..., 1] = white
    image[:, :3] = 0, 0, white, white
    for number in range(3):
        save_vectors(tmp_path / f"{number}.exr", constant(4, 6, -0.5, 0), constant(4, 6, -0.5, 0))
    (made_image,) = made(SceneAssisted(VectorFolder(tmp_path)), image, image, 2, [0.5])
    np.testing.assert_array_equal(made_image[1, 3], [0, 0, white, white // 2 + 1])
    np.testing.assert_array_equal(made_image[1, 5], [0, white, 0, 0])


def test_times_that_are_no_output_frames_are_refused(tmp_path):
    """A time between two output frames, or frames that nobody placed; a third of the way is exact enough."""
    image = noise(6, 8)
    synthesizer = SceneAssisted(VectorFolder(save_translation(tmp_path, 4, (6, 8), 0, 0)))
    assert len(made(synthesizer, image, image, 3, [1 / 3, 2 / 3])) == 2
    assert len(made(synthesizer, image, image, Fraction(5, 2), [0.4, 0.8])) == 2
    clip, with_depth, _ = moving(tmp_path)
    for used, frame, span, t in (
        (synthesizer, image, 2, 0.4),
        (synthesizer, image, Fraction(5, 2), 0.5),
        (SceneAssisted(with_depth), clip.image0, Fraction(5, 2), 0.4),  # depth is compared at output frames alone
    ):
        with pytest.raises(OptionError, match="need a whole factor"):
            made(used, frame, frame, span, [t])
    with pytest.raises(OptionError, match="need a whole factor"):
        Interpolator(ZeroMotion(), synthesizer).interpolate(image, image, [0.5])


def test_vectors_of_another_size_are_refused(tmp_path):
    """With both sizes."""
    vectors = VectorFolder(save_translation(tmp_path, 4, (6, 8), 0, 0))
    with pytest.raises(InputError, match="8x6 pixels, and the frames have 9x6"):
        made(SceneAssisted(vectors), noise(6, 9), noise(6, 9), 2, [0.5])


def test_methods_need_vectors_and_others_take_none(tmp_path):
    """Each mistake in a sentence that names the option; an unknown method lists all."""
    vectors = VectorFolder(save_translation(tmp_path, 3, (6, 8), 0, 0))
    for name in vector_methods:
        assert find_method(name, vectors) == find_method(name, vectors)
        with pytest.raises(OptionError, match=rf"'{name}' needs the renderer's motion vectors; give `vectors=DIR`, or"):
            find_method(name)
        with pytest.raises(OptionError, match="`vectors=DIR`"):
            interpolate(noise(6, 8), noise(6, 8), method=name)
    with pytest.raises(OptionError, match="`vectors` does not apply to the method 'blend'"):
        find_method("blend", vectors)
    with pytest.raises(OptionError, match=r"nlm, .*reproject-image, reproject-scene"):
        find_method("magic")


HEIGHT, WIDTH, MOTION = 48, 64, (3, -2)
COUNT = 7


def true_frame(number: int) -> np.ndarray:
    """A smooth picture that moves by MOTION from output frame to output frame."""
    return as_type(moved_waves((HEIGHT, WIDTH), number * MOTION[0], number * MOTION[1]), np.uint8)


@pytest.fixture
def renders(tmp_path) -> Path:
    """Every second frame as PNG, and vectors of all of them."""
    (tmp_path / "in").mkdir()
    for number in range(0, COUNT, 2):
        cv2.imwrite(str(tmp_path / "in" / f"shot_{number // 2 + 1:04d}.png"), true_frame(number))
    save_translation(tmp_path / "vectors", COUNT, (HEIGHT, WIDTH), *MOTION)
    return tmp_path


@pytest.mark.parametrize("method", list(vector_methods))
def test_folders_from_end_to_end(renders, method):
    """The true frames, exactly; but for the edge, where nothing lands, or the corners come from neither frame."""
    vectors = VectorFolder(renders / "vectors")
    summary = convert(str(renders / "in"), str(renders / "out"), factor=2, method=find_method(method, vectors))
    assert (summary.frames_in, summary.frames_out, summary.scene_cuts) == (4, COUNT, 0)
    inner = slice(4, -4)
    for number in range(COUNT):
        image = read_image(renders / "out" / f"shot_{number + 1:04d}.png")
        np.testing.assert_array_equal(image[inner, inner], true_frame(number)[inner, inner])


def test_the_command_line(renders, fpsboost_):
    """The same by options, with depth too."""
    for number in range(COUNT):
        write_exr(renders / "vectors" / f"Depth{number}.exr", {"Z": np.ones((HEIGHT, WIDTH), np.float32)})
    line = "in out --method reproject-scene --vectors vectors/v_####.exr --depth vectors/Depth#.exr"
    assert fpsboost_(*line.split()).code == 0
    image = read_image(renders / "out" / "shot_0004.png")
    np.testing.assert_array_equal(image[4:-4, 4:-4], true_frame(3)[4:-4, 4:-4])


@pytest.mark.parametrize(
    ("line", "code", "words"),
    [
        ("--method reproject-scene", 2, "'reproject-scene' needs the renderer's motion vectors; give --vectors DIR"),
        ("--method blend --vectors vectors", 2, "--vectors does not apply to the method 'blend'"),
        ("--depth vectors", 2, "--depth needs --vectors"),
        ("--method reproject-image --vectors none", 1, "none is not a folder with motion vectors"),
        ("--method reproject-image --vectors vectors --factor 5/2", 2, "need a whole factor"),
        ("--method reproject-scene --vectors vectors --factor 3", 1, "vectors has no vectors for output frame 9"),
        ("--method reproject-image --vectors vectors --factor 3", 1, "vectors has no vectors for output frame 9"),
    ],
)
def test_mistakes_are_one_sentence_and_nothing_is_written(renders, fpsboost_, unchanged, line, code, words):
    """Exit code 2 for options, 1 for files."""
    with unchanged(renders):
        assert_refused(fpsboost_("in", "out", *line.split()), code, words)


def test_a_gap_in_the_vectors(renders, fpsboost_, unchanged):
    """One sentence, exit code 1, nothing written."""
    (renders / "vectors" / "v_0003.exr").unlink()
    with unchanged(renders):
        result = fpsboost_("in", "out", "--method", "reproject-image", "--vectors", "vectors")
    assert_refused(result, 1, "v_0003.exr is missing")
