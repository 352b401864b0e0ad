"""Rendered regions put back: inside of them what was rendered, outside not a bit changed."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from PIL import ImageCms

from fpsboost import InputError, MergeOptions, OptionError, OutputError, PlannedFrame, Rectangle, RerenderPlan
from fpsboost.io.images.encoder import encode_image
from fpsboost.io.images.exr import read_exr
from fpsboost.io.images.files import ImageMetadata, metadata_of, read_image
from fpsboost.rerender.merging import merge_regions, mix, seam_weights
from support.exr_truth import write_exr

HEIGHT, WIDTH = 24, 32
REGIONS = (Rectangle(0, 0, 8, 8), Rectangle(16, 8, 8, 16))
PROFILE = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
NAMES = {np.uint8: ".png", np.uint16: ".tif", np.float32: ".exr"}


def picture(number, dtype=np.uint8, channels=3):
    values = np.random.default_rng(number).integers(1, 255, (HEIGHT, WIDTH, channels))
    return values.astype(dtype) * (257 if dtype is np.uint16 else 1) / dtype(255 if dtype is np.float32 else 1)


def save(folder, name, image, metadata=ImageMetadata()):
    folder.mkdir(exist_ok=True)
    path = folder / name
    path.write_bytes(encode_image(path, np.ascontiguousarray(image), metadata=metadata, half=False))


def round_trip(folder, dtype=np.uint8, channels=3):
    """Write five frames, a plan for frame 2 in two regions and for all of frame 4, and full renders of both."""
    for number in range(1, 6):
        image = picture(number, dtype, channels).astype(dtype)
        save(folder / "made", f"shot_{number:04d}{NAMES[dtype]}", image)
    for number in (2, 4):
        image = picture(100 + number, dtype, channels).astype(dtype)
        save(folder / "rendered", f"r{number:03d}{NAMES[dtype]}", image)
    write_plan(folder / "plan", {2: REGIONS, 4: (Rectangle(0, 0, WIDTH, HEIGHT),)})
    return str(folder / "made"), str(folder / "rendered"), str(folder / "out"), MergeOptions(str(folder / "plan"), 2)


def write_plan(folder, regions):
    folder.mkdir(exist_ok=True)
    whole = Rectangle(0, 0, WIDTH, HEIGHT)
    frames = (PlannedFrame(number, tuple(each), whole in each, 2, 1) for number, each in regions.items())
    RerenderPlan(WIDTH, HEIGHT, 8, tuple(frames)).write(folder)


def contents(folder):
    return {path.name: path.read_bytes() for path in Path(folder).iterdir()}


@pytest.mark.parametrize(("dtype", "channels"), [(np.uint8, 3), (np.uint8, 4), (np.uint16, 3), (np.uint16, 4)])
@pytest.mark.parametrize("feather", [0, 2])
def test_everything_else_stays(tmp_path, dtype, channels, feather):
    """Images without regions to the byte, pixels outside of regions to the bit; what is inside was rendered."""
    made, rendered, out, options = round_trip(tmp_path, dtype, channels)
    summary = merge_regions(made, rendered, out, MergeOptions(options.plan, feather))
    assert (summary.frames, summary.merged_frames, summary.regions, summary.remarks) == (5, 2, 3, [])
    before, after = contents(made), contents(out)
    suffix = NAMES[dtype]
    assert sorted(before) == sorted(after)
    for number in (1, 3, 5):
        assert after[f"shot_{number:04d}{suffix}"] == before[f"shot_{number:04d}{suffix}"]
    assert after[f"shot_0004{suffix}"] == contents(rendered)[f"r004{suffix}"]
    names = Path(out, f"shot_0002{suffix}"), Path(made, f"shot_0002{suffix}"), Path(rendered, f"r002{suffix}")
    merged, old, new = map(read_image, names)
    inside = PlannedFrame(2, REGIONS, False, 2, 1).mask(HEIGHT, WIDTH)
    assert (merged[~inside] == old[~inside]).all()
    core = np.zeros_like(inside)
    core[:6, :6], core[10:, 18:22] = True, True  # at the frame's edges there is no seam
    assert (merged[core] == new[core]).all()
    assert feather or (merged[inside] == new[inside]).all()


@pytest.mark.parametrize("half", [True, False])
@pytest.mark.parametrize("channels", [3, 4])
def test_float_images_keep_their_precision(tmp_path, half, channels):
    """Half stays half and float stays float, with values beyond white."""
    names = "BGRA"[:channels]
    for folder, numbers in (("made", (1, 2, 3)), ("rendered", (2,))):
        (tmp_path / folder).mkdir()
        for number in numbers:
            planes = np.moveaxis(picture(number, np.float32, channels) * np.float32(7), -1, 0)
            write_exr(tmp_path / folder / f"{number:04d}.exr", dict(zip(names, planes, strict=True)), half=half)
    write_plan(tmp_path / "plan", {2: REGIONS})
    folders = (str(tmp_path / name) for name in ("made", "rendered", "out"))
    merge_regions(*folders, MergeOptions(str(tmp_path / "plan"), 0))
    merged = read_image(tmp_path / "out" / "0002.exr")
    assert (merged == read_image(tmp_path / "made" / "0002.exr")).all()  # the render is the same picture
    assert (np.float16(merged) == merged).all() == half


def test_regions_one_by_one(tmp_path):
    """A file for each region, cropped or of full size, gives the same as one image."""
    made, rendered, out, options = round_trip(tmp_path)
    merge_regions(made, rendered, out, options)
    full = picture(102)
    for place, region in enumerate(REGIONS, start=1):
        save(tmp_path / "parts", f"r0002_{place}.png", full[region.part] if place == 1 else full)
    save(tmp_path / "parts", "r0004.png", picture(104))
    merge_regions(made, str(tmp_path / "parts"), str(tmp_path / "again"), options)
    assert contents(str(tmp_path / "again")) == contents(out)


def test_what_a_file_says_of_itself_stays(tmp_path):
    """Colour profile and resolution of the made frame."""
    made, rendered, out, options = round_trip(tmp_path)
    save(tmp_path / "made", "shot_0002.png", picture(2), ImageMetadata(PROFILE, (300.0, 300.0)))
    merge_regions(made, rendered, out, options)
    assert metadata_of(tmp_path / "out" / "shot_0002.png").profile == PROFILE


def test_images_that_belong_to_no_region_are_told(tmp_path):
    """A folder of a whole sequence may be named; what is not planned is left out, and counted."""
    made, rendered, out, options = round_trip(tmp_path)
    for number in (1, 3):
        save(tmp_path / "rendered", f"r{number:03d}.png", picture(number + 50))
    assert "2 images" in merge_regions(made, rendered, out, options).remarks[0]


def lose_region(folder):
    (folder / "rendered" / "r002.png").unlink()
    save(folder / "rendered", "r002_1.png", picture(102))


def number_otherwise(folder):
    for number in (5, 4):
        (folder / "made" / f"shot_{number:04d}.png").rename(folder / "made" / f"shot_{number + 1:04d}.png")


DAMAGES = {
    "no image of frame 2": lambda folder: (folder / "rendered" / "r002.png").unlink(),
    "no image of region 2 of frame 2": lose_region,
    "several images for one part of frame 2": lambda folder: save(folder / "rendered", "x_0002.png", picture(102)),
    "has 9x9 pixels; render the full 32x24": lambda folder: save(folder / "rendered", "r002.png", picture(1)[:9, :9]),
    "is unlike": lambda folder: save(folder / "rendered", "r002.png", picture(102, np.uint16).astype(np.uint16)),
    "has no frame 4": number_otherwise,
    "the plan 32x24": lambda folder: save(folder / "made", "shot_0002.png", picture(2)[:, :30]),
    "damaged or no image": lambda folder: (folder / "plan" / "mask_0004.png").write_bytes(b"PNG"),
}
"""What can be wrong with a folder made by `round_trip`, by what is said of it."""


@pytest.mark.parametrize("said", DAMAGES)
def test_what_does_not_fit_is_refused(tmp_path, unchanged, said):
    """One sentence that says what to do, and nothing written, not even half of it."""
    made, rendered, out, options = round_trip(tmp_path)
    DAMAGES[said](tmp_path)
    with unchanged(tmp_path), pytest.raises(InputError, match=said):
        merge_regions(made, rendered, out, options)


def test_layers_are_merged_as_what_they_are(tmp_path):
    """Linear layers have a seam like the picture, depth has none; a layer that was not rendered is named."""
    made, rendered, out, options = round_trip(tmp_path, np.float32)
    whole = tmp_path / "rendered" / "r002.exr"
    for folder, name, seed in (("made", "shot_0002.exr", 2), ("rendered", "r002.exr", 102)):
        planes = dict(zip("BGR", np.moveaxis(picture(seed, np.float32), -1, 0), strict=True))
        layers = {f"AO.{each}": planes[each] for each in "RGB"} | {"Depth.Z": planes["B"] + np.float32(seed)}
        write_exr(tmp_path / folder / name, planes | layers, half=False)
    merge_regions(made, rendered, out, options)
    files = [Path(out) / "shot_0002.exr", tmp_path / "made" / "shot_0002.exr", whole]
    merged, before, after = map(read_exr, files)
    mask = next(frame for frame in RerenderPlan.read(Path(options.plan)).frames if frame.number == 2).mask(24, 32)
    np.testing.assert_array_equal([merged[f"AO.{name}"] for name in "RGB"], [merged[name] for name in "RGB"])
    np.testing.assert_array_equal(merged["Depth.Z"], np.where(mask, after["Depth.Z"], before["Depth.Z"]))
    write_exr(whole, {name: plane for name, plane in after.items() if name != "Depth.Z"}, half=False)
    with pytest.raises(InputError, match="has no layer Depth"):
        merge_regions(made, rendered, str(tmp_path / "again"), options)
    assert not (tmp_path / "again").exists()


def test_inputs_are_not_replaced(tmp_path):
    """The output is a new folder, and a plan must be named."""
    made, rendered, _, options = round_trip(tmp_path)
    for folder in (made, rendered, options.plan):
        with pytest.raises(OutputError, match="new folder"):
            merge_regions(made, rendered, str(folder), options)
    with pytest.raises(OptionError, match="plan"):
        merge_regions(made, rendered, str(tmp_path / "out"), MergeOptions())


@given(mask=arrays.arrays(bool, st.tuples(st.integers(1, 20), st.integers(1, 20))), feather=st.integers(0, 9))
def test_seams_lie_inside(mask, feather):
    """Nothing outside of a mask has a share, everything inside has one, and it is whole away from the edges."""
    weights = seam_weights(mask, feather)
    assert ((weights > 0) == mask).all()
    assert weights.max() <= 1
    square = np.ones((3, 3), np.uint8)
    far = cv2.erode(mask.astype(np.uint8), square, iterations=feather, borderType=cv2.BORDER_REPLICATE)
    assert (weights[far > 0] == 1).all()


def test_regions_side_by_side_have_no_seam_between():
    """The edge that two rectangles share is none."""
    plan = PlannedFrame(1, (Rectangle(4, 4, 8, 16), Rectangle(12, 4, 8, 16)), False, 1, 0)
    assert (seam_weights(plan.mask(HEIGHT, WIDTH), 3)[8:16, 8:16] == 1).all()


def test_numbers_that_are_none_stay_where_they_are():
    """Infinity and NaN outside of a region stay, and inside come from the render alone."""
    made, rendered = np.full((1, 3, 3), np.inf, np.float32), np.full((1, 3, 3), np.nan, np.float32)
    made[0, 2] = rendered[0, 0] = 7
    mixed = mix(made, rendered, np.array([[0, 0, 1]], np.float32))
    assert np.isinf(mixed[0, :2]).all()
    assert np.isnan(mixed[0, 2]).all()


def test_colours_of_transparent_pixels_do_not_show():
    """Halfway between opaque red and transparent blue is half-transparent red."""
    red, blue = np.array([[[0, 0, 200, 255]]], np.uint8), np.array([[[200, 0, 0, 0]]], np.uint8)
    assert mix(red, blue, np.full((1, 1), 0.5, np.float32)).ravel().tolist() == [0, 0, 200, 128]


def test_the_command_merges(tmp_path, fpsboost_):
    """It says how many regions it put back, and exits with 1 and one sentence where one is missing."""
    round_trip(tmp_path)
    told = fpsboost_("merge", "made", "rendered", "out", "--plan", "plan")
    assert told.code == 0
    assert "3 regions put back into 2 of 5 frames" in told.err
    (tmp_path / "rendered" / "r004.png").unlink()
    told = fpsboost_("merge", "made", "rendered", "out2", "--plan", "plan")
    assert (told.code, len(told.lines)) == (1, 1)
    assert fpsboost_("merge", "made", "rendered", "out2").code == 2
