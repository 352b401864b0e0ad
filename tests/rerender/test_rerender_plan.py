"""Plans of what to render: where frames are wrong is found without their truth, and no plan exceeds its budget."""

import json

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from fpsboost import InputError, InUseError, OptionError, OutputError, PlannedFrame, RerenderPlan, plan_rerender
from fpsboost.io.images.files import read_image
from fpsboost.io.new_output import new_folder
from fpsboost.rerender import PlanOptions, parse_budget
from fpsboost.rerender.regions import Rectangle, TileGrid, choose_regions, partition
from fpsboost.rerender.score import comparable, squared_error
from support.exr_truth import write_exr

HEIGHT, WIDTH, TILE = 64, 96, 16
UNPREDICTABLE = Rectangle(48, 16, 32, 32)  # where every frame of `unpredictable_clip` shows something else

masks = arrays.arrays(bool, st.tuples(st.integers(1, 9), st.integers(1, 9)))
score_maps = arrays.arrays(
    np.float64,
    st.tuples(st.integers(1, 5), st.integers(1, 7), st.integers(1, 8)),
    elements=st.one_of(st.just(0.0), st.just(1.0), st.floats(0, 100)),
)


def unpredictable_clip(folder, numbers, name="{:04d}.png"):
    """A texture that pans by a pixel a number, with a square of noise that is new in every frame."""
    folder.mkdir()
    texture = np.random.default_rng(3).integers(60, 200, (HEIGHT, WIDTH + 64, 3)).astype(np.uint8)
    texture = cv2.GaussianBlur(texture, (0, 0), 2)
    for number in numbers:
        image = texture[:, number : number + WIDTH].copy()
        noise = np.random.default_rng(100 + number).integers(0, 256, (4, 4, 3)).astype(np.uint8)
        image[UNPREDICTABLE.part] = cv2.resize(noise, (UNPREDICTABLE.width, UNPREDICTABLE.height))
        path = folder / name.format(number)
        if path.suffix == ".exr":
            write_exr(path, dict(zip("BGR", np.moveaxis(image / np.float32(255), -1, 0), strict=True)))
        else:
            path.write_bytes(cv2.imencode(".png", image)[1].tobytes())
    return folder


@pytest.mark.parametrize("name", ["{:04d}.png", "shot_{:03d}.exr"])
def test_what_cannot_be_predicted_is_rendered(tmp_path, name):
    """The budget of the square that changes goes to that square, in every frame, and hardly anything else."""
    clip = unpredictable_clip(tmp_path / "in", range(1, 14, 2), name)
    share = UNPREDICTABLE.area / (HEIGHT * WIDTH)
    plan = plan_rerender(str(clip), str(tmp_path / "plan"), PlanOptions(share), method="nlm-fast")
    assert [frame.number for frame in plan.frames] == [2, 4, 6, 8, 10, 12]
    assert min(frame.mask(HEIGHT, WIDTH)[UNPREDICTABLE.part].mean() for frame in plan.frames) >= 0.75
    assert plan.remaining_error < 0.3 * plan.expected_error


def test_a_plan_is_a_folder(tmp_path):
    """Masks and rectangles say the same, and reading gives what was written."""
    clip = unpredictable_clip(tmp_path / "in", range(10, 17, 2))
    plan = plan_rerender(str(clip), str(tmp_path / "plan"), PlanOptions(tile=8), method="nlm-fast")
    names = sorted(path.name for path in (tmp_path / "plan").iterdir())
    assert names == ["mask_0011.png", "mask_0013.png", "mask_0015.png", "plan.json"]
    data = json.loads((tmp_path / "plan" / "plan.json").read_bytes())
    assert data["numbers"] == [11, 13, 15]
    assert data["totals"]["rendered_share"] <= 0.1
    for frame in data["frames"]:
        mask = read_image(tmp_path / "plan" / f"mask_{frame['number']:04d}.png")
        drawn = np.zeros_like(mask)
        for x, y, width, height in frame["regions"]:
            drawn[y : y + height, x : x + width] = 255
        assert (mask == drawn).all()
    assert [frame.regions for frame in RerenderPlan.read(tmp_path / "plan").frames] == [
        frame.regions for frame in plan.frames
    ]


@pytest.mark.parametrize(
    ("images", "factor", "planned"),
    [
        pytest.param(range(1, 4), None, [2, 4], id="consecutive: numbered like the output"),
        pytest.param(range(1, 12, 3), None, [2, 3, 5, 6, 8, 9], id="two missing"),
        pytest.param(range(1, 12, 3), 2, [2, 4, 6], id="fewer: numbered anew, as a conversion does"),
    ],
)
def test_frames_between_images_are_planned(tmp_path, images, factor, planned):
    """By the numbers that a conversion gives them."""
    clip = unpredictable_clip(tmp_path / "in", images)
    plan = plan_rerender(str(clip), str(tmp_path / "plan"), PlanOptions(factor=factor), method="nlm-fast")
    assert [frame.number for frame in plan.frames] == planned


def test_a_scene_cut_is_rendered(tmp_path):
    """The frame across a cut repeats a neighbour, which is as often wrong as right."""
    clip = unpredictable_clip(tmp_path / "in", range(1, 10, 2))
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    board = (255 * ((x // 7 + y // 11) % 2)).astype(np.uint8)
    for number in (7, 9):
        (clip / f"{number:04d}.png").write_bytes(cv2.imencode(".png", cv2.merge([board] * 3))[1].tobytes())
    plan = plan_rerender(str(clip), str(tmp_path / "plan"), PlanOptions(0.25), method="nlm-fast")
    assert max(plan.frames, key=lambda frame: frame.expected_error).number == 6


@given(errors=score_maps, share=st.floats(0.001, 1), tile=st.integers(1, 9), cut=st.integers(0, 5))
def test_no_budget_is_exceeded(errors, share, tile, cut):
    """Whatever the errors: all pixels stay within the budget."""
    grid = TileGrid(errors.shape[1] * tile, errors.shape[2] * tile, tile)
    budget = share * grid.height * grid.width * len(errors)
    assert (choose_regions(errors, grid, budget, np.arange(len(errors)) >= cut) * grid.areas).sum() <= budget


def test_regions_do_not_flicker():
    """A tile whose error drops for one frame is rendered with its neighbours in time."""
    errors = np.full((7, 8, 8), 0.01)
    errors[:, 2:5, 2:5] = 1
    errors[3, 2:5, 4] = 0.4
    assert (choose_regions(errors, TileGrid(8, 8, 1), 7 * 9, [0] * 7) == (errors > 0.1)).all()


@given(mask=masks)
def test_rectangles_cover_exactly_the_mask(mask):
    """Each tile of the mask lies in one rectangle, and no other tile in any."""
    count = np.zeros(mask.shape, int)
    for rectangle in partition(mask):
        count[rectangle.part] += 1
    assert (count == mask).all()


@given(size=st.tuples(st.integers(1, 40), st.integers(1, 40)), tile=st.integers(1, 50))
@settings(max_examples=30)
def test_means_of_tiles(size, tile):
    """Each is the mean of its pixels, at the right and the bottom of fewer."""
    values = np.random.default_rng(2).uniform(size=size)
    grid = TileGrid(*size, tile)
    means = grid.means(values)
    for y, x in np.ndindex(*grid.shape):
        part = grid.in_pixels(Rectangle(x, y, 1, 1)).part
        assert means[y, x] == pytest.approx(values[part].mean())
        assert grid.areas[y, x] == values[part].size


def test_what_is_transparent_does_not_show():
    """Colours of straight alpha count by their alpha."""
    pixels = np.array([[[200, 100, 50, 0]], [[0, 0, 0, 0]]], np.uint8)
    assert (squared_error(pixels[:1], pixels[1:]) == 0).all()


def test_exposure_does_not_matter():
    """Errors of linear images are the same in a darker render."""
    light, other = np.random.default_rng(1).random((2, 8, 9, 3), np.float32)
    bright, dark = (squared_error(comparable(light * scale), comparable(other * scale)) for scale in (16, 0.01))
    np.testing.assert_allclose(bright, dark, atol=1e-5)


@pytest.mark.parametrize("text", ["10", "300s", "-5%", "a lot", "nan%", "0%", "110%"])
def test_budgets_that_are_none(text):
    """They are refused, with an example."""
    with pytest.raises(OptionError, match=f"at most 100%, as in 10%, not '{text}'"):
        parse_budget(text, "`budget`")


def test_what_cannot_be_planned(tmp_path, unchanged):
    """Two images, a video, a folder that is not empty: refused, nothing written."""
    clip = unpredictable_clip(tmp_path / "in", range(1, 6, 2))
    few = unpredictable_clip(tmp_path / "few", range(1, 3))
    full = tmp_path / "full"
    full.mkdir()
    (full / "note.txt").write_text("mine")
    (tmp_path / "clip.mp4").write_bytes(b"")
    with unchanged(tmp_path):
        for source, words in (
            (few, "3 at least"),
            (tmp_path / "no", "does not exist"),
            (tmp_path / "clip.mp4", "images"),
        ):
            with pytest.raises(InputError, match=words):
                plan_rerender(str(source), str(tmp_path / "plan"))
        with pytest.raises(OutputError, match="not empty"):
            plan_rerender(str(clip), str(full))


def test_one_run_at_a_time_writes_a_plan(tmp_path):
    """A second run into the same folder is refused before it reads an image, of which none can be read here."""
    for number in range(1, 4):
        (tmp_path / f"{number:04d}.png").write_bytes(b"")
    with new_folder(tmp_path / "plan"), pytest.raises(InUseError, match="another run"):
        plan_rerender(str(tmp_path / "####.png"), str(tmp_path / "plan"))


def test_a_damaged_plan_is_refused(tmp_path):
    """No JSON, another version, a rectangle outside of the frame, a mask of another size or of other pixels."""
    frame = PlannedFrame(2, (Rectangle(0, 0, 4, 4),), whole=False, expected_error=2, remaining_error=1)
    RerenderPlan(8, 6, 4, (frame,)).write(tmp_path)
    assert RerenderPlan.read(tmp_path).frames == (frame,)
    text = (tmp_path / "plan.json").read_bytes()
    for name, changed in (
        ("plan.json", b"{"),
        ("plan.json", text.replace(b'"version": 1', b'"version": 9')),
        ("plan.json", text.replace(b"4\n", b"40\n", 1)),
        *(("mask_0002.png", cv2.imencode(".png", np.zeros(size, np.uint8))[1]) for size in ((6, 9), (6, 8))),
    ):
        sound = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(changed)
        with pytest.raises(InputError, match="plan again"):
            RerenderPlan.read(tmp_path)
        (tmp_path / name).write_bytes(sound)
    assert RerenderPlan.read(tmp_path).rendered_share == pytest.approx(1 / 3)


def test_the_command_says_what_it_planned(tmp_path, fpsboost_):
    """Frames, regions and errors on standard output; nothing with --quiet."""
    unpredictable_clip(tmp_path / "in", range(1, 8, 2))
    told = fpsboost_("plan", "in", "plan", "--budget", "20%", "-m", "nlm-fast")
    assert (told.code, told.err) == (0, "")
    assert "of 3 that are interpolated" in told.out
    assert "expected" in told.out
    assert fpsboost_("plan", "in", "more", "-m", "nlm-fast", "--quiet").out == ""
