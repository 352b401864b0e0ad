"""Folders of published test sets, built small: which frames are shown and hidden, and how papers score them."""

import importlib
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from fpsboost.errors import InputError

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
SIZE = 32, 48


@pytest.fixture
def sets(monkeypatch):
    """The module of the benchmarks."""
    monkeypatch.syspath_prepend(BENCHMARKS)
    return importlib.import_module("published_sets")


def picture(value: int, size: tuple[int, int] = SIZE) -> np.ndarray:
    """A frame that tells which one it is."""
    return np.full((*size, 3), value, np.uint8)


def save(folder: Path, name: str, value: int, size: tuple[int, int] = SIZE) -> None:
    """Write a frame, and the folders that it needs."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(cv2.imencode(path.suffix, picture(value, size))[1].tobytes())


def save_vimeo(folder: Path) -> None:
    for clip in ("00001/0001", "00001/0002"):
        for k in (1, 2, 3):
            save(folder, f"sequences/{clip}/im{k}.png", k)
    (folder / "tri_testlist.txt").write_text("00001/0002\n\n")


def save_septuplets(folder: Path) -> None:
    for k in range(1, 8):
        save(folder, f"sequences/00001/0001/im{k}.png", k)
    (folder / "sep_testlist.txt").write_text("00001/0001\n")


def save_ucf101(folder: Path) -> None:
    for clip in ("1", "11"):
        for k, name in enumerate(("frame_00", "frame_01_gt", "frame_02"), start=1):
            save(folder, f"{clip}/{name}.png", k)
        save(folder, f"{clip}/frame_01_ours.png", 99)


def save_snu_film(folder: Path) -> None:
    for level in ("easy", "extreme"):
        names = [f"test/GOPRO_test/A/{level}{k}.png" for k in (1, 2, 3)]
        for k, name in enumerate(names, start=1):
            save(folder, name, k)
        (folder / f"test-{level}.txt").write_text(" ".join(f"data/SNU-FILM/{name}" for name in names) + "\n")


def save_xiph(folder: Path, form: str = "{}-{:03d}.png") -> None:
    for name in ("Crosswalk", "Tango"):
        for k in range(1, 6):
            save(folder, form.format(name, k), k)


def save_xiph_folders(folder: Path) -> None:
    save_xiph(folder, "{}/{:03d}.png")


def save_x_test(folder: Path) -> None:
    for k in range(33):
        save(folder, f"Type1/TEST01_003_f0433/{k:04d}.png", k)


def save_middlebury(
    folder: Path, shown: str = "other-data", hidden: str = "other-gt-interp", clip: str = "Venus"
) -> None:
    save(folder, f"{shown}/{clip}/frame10.png", 1)
    save(folder, f"{shown}/{clip}/frame11.png", 3)
    save(folder, f"{hidden}/{clip}/frame10i11.png", 2)
    save(folder, f"{shown}/Army/frame10.png", 1)  # of the sequences whose truth is not public


def save_one_folder(folder: Path) -> None:
    save_middlebury(folder, ".", ".")


def save_davis_triplets(folder: Path) -> None:
    save_middlebury(folder, "input", "gt", "boxing")


def save_davis(folder: Path) -> None:
    for clip, count in (("bear", 10), ("walking", 7)):
        for k in range(count):
            save(folder, f"JPEGImages/480p/{clip}/{k:05d}.jpg", k)


TRIPLET = ([1, 3], [2])
LAYOUTS = [
    (save_vimeo, {"Vimeo90K": [TRIPLET]}),
    (save_septuplets, {"Vimeo90K septuplets": [([1, 3, 5, 7], [4])]}),
    (save_ucf101, {"UCF101": [TRIPLET, TRIPLET]}),
    (save_snu_film, {"SNU-FILM easy": [TRIPLET], "SNU-FILM extreme": [TRIPLET]}),
    (save_xiph, {name: [TRIPLET, ([3, 5], [4])] * 2 for name in ("Xiph 2K", "Xiph 4K")}),
    (save_xiph_folders, {name: [TRIPLET, ([3, 5], [4])] * 2 for name in ("Xiph 2K", "Xiph 4K")}),
    (save_x_test, {name: [([0, 32], [4, 8, 12, 16, 20, 24, 28])] for name in ("X-TEST 2K", "X-TEST 4K")}),
    (save_middlebury, {"Middlebury": [TRIPLET]}),
    (save_one_folder, {"Middlebury": [TRIPLET]}),
    (save_davis_triplets, {"DAVIS triplets": [TRIPLET]}),
    (save_davis, {"DAVIS": [([2, 4], [3]), ([4, 6], [5]), ([2, 4], [3])]}),
]


def values(images: list[np.ndarray]) -> list[int]:
    """Which frames they are."""
    return [int(image[0, 0, 0]) for image in images]


@pytest.mark.parametrize(("build", "expected"), LAYOUTS, ids=lambda value: getattr(value, "__name__", ""))
@pytest.mark.parametrize("below", [".", "set"])
def test_each_set_shows_and_hides_the_frames_that_papers_do(sets, tmp_path, build, expected, below):
    """In the folder itself or one above it: each row of the table, its samples, and the frames that count."""
    build(tmp_path / below)
    found: dict[str, list[Any]] = {}
    for each in sets.find_sets(tmp_path):
        for sample in each.samples:
            clip = each.read(sample)
            found.setdefault(each.name, []).append((values(clip.shown), values([clip.hidden[k] for k in clip.scored])))
    assert found == expected


def test_hidden_frames_have_their_times(sets, tmp_path):
    """Those of X-TEST divide the interval into eight."""
    save_x_test(tmp_path)
    each = sets.find_sets(tmp_path)[0]
    (interval,) = each.read(each.samples[0]).intervals
    assert [float(hidden.t) for hidden in interval.hidden] == [k / 8 for k in range(1, 8)]


def test_other_folders_are_no_published_set(sets, tmp_path):
    """Folders of clips with numbered images, and no folder at all."""
    for clip in ("Type1", "walk"):
        for k in range(3):
            save(tmp_path, f"{clip}/{k:04d}.png", k)
    assert sets.find_sets(tmp_path) == sets.find_sets(tmp_path / "walk") == sets.find_sets(tmp_path / "none") == []


def test_sizes_are_those_of_the_evaluations(sets, tmp_path):
    """2K is half the size, 4K of Xiph the middle, and 4K of X-TEST the whole."""
    save_xiph(tmp_path / "xiph")
    save_x_test(tmp_path / "x")
    sizes = {
        each.name: each.read(each.samples[0]).hidden[0].shape[:2]
        for folder in ("xiph", "x")
        for each in sets.find_sets(tmp_path / folder)
    }
    assert sizes == {"Xiph 2K": (16, 24), "Xiph 4K": (16, 24), "X-TEST 2K": (16, 24), "X-TEST 4K": SIZE}
    ramp = np.arange(32 * 48 * 3, dtype=np.uint32).reshape(32, 48, 3).astype(np.uint8)
    np.testing.assert_array_equal(sets.cropped(ramp), ramp[8:24, 12:36])


def test_frames_of_another_size_or_missing_ones_name_the_file(sets, tmp_path):
    """A set that was not unpacked as a whole."""
    save_vimeo(tmp_path)
    each = sets.find_sets(tmp_path)[0]
    save(tmp_path, "sequences/00001/0002/im2.png", 2, (16, 16))
    with pytest.raises(InputError, match=r"0002/im2\.png has other pixels"):
        each.read(each.samples[0])
    (tmp_path / "sequences/00001/0002/im2.png").unlink()
    with pytest.raises(InputError, match=r"0002/im2\.png"):
        each.read(each.samples[0])


def test_measures_are_those_of_the_evaluations(sets):
    """PSNR and SSIM as scikit-image has them; SSIM through the colours is its SSIM of a padded volume."""
    random = np.random.default_rng(5)
    truth = cv2.GaussianBlur(random.integers(0, 256, (40, 56, 3), np.uint8), (5, 5), 1)
    image = np.clip(truth + random.normal(0, 9, truth.shape), 0, 255).astype(np.uint8)
    assert sets.psnr(truth, image) == pytest.approx(peak_signal_noise_ratio(truth, image))
    assert sets.psnr(truth, truth) == 120
    assert sets.plain_ssim(truth, image) == pytest.approx(structural_similarity(truth, image, channel_axis=2))
    volumes = [np.pad(each, 5, mode="edge").astype(float) for each in (truth, image)]
    expected = structural_similarity(*volumes, data_range=255, gaussian_weights=True, use_sample_covariance=False)
    assert sets.volume_ssim(truth, image) == pytest.approx(expected, abs=1e-9)
    assert sets.interpolation_error(picture(10), picture(13)) == 3
    gray = [np.repeat(each[..., :1], 3, axis=2) for each in (truth, image)]
    lumas = [16 + 219 / 255 * each[..., 0] for each in gray]
    expected = structural_similarity(*lumas, data_range=np.ptp(lumas[1]))
    assert sets.luma_ssim(*gray) == pytest.approx(expected, abs=1e-6)


def test_means_are_over_frames_or_over_clips_first(sets):
    """DAVIS has the mean of its clips, others that of all frames."""
    rows = [("a", {"psnr": 10.0}), ("a", {"psnr": 20.0}), ("b", {"psnr": 30.0})]
    assert sets.PublishedSet("frames", [], {}).mean(rows) == {"psnr": 20}
    assert sets.PublishedSet("clips", [], {}, per_clip=True).mean(rows) == {"psnr": 22.5}


def test_a_quick_look_takes_samples_from_everywhere(monkeypatch):
    """As many as asked for, evenly; all of them if there are no more."""
    monkeypatch.syspath_prepend(BENCHMARKS)
    spread = importlib.import_module("quality").spread
    assert spread(range(9), 3) == [1, 4, 7]
    assert spread(range(9), None) == spread(range(9), 9) == spread(range(9), 99) == range(9)


def test_quality_prints_the_row_of_a_set(tmp_path):
    """Methods of a set as a table in Markdown, with the figures that the set has, and as JSON."""
    save_middlebury(tmp_path / "middlebury")
    save_x_test(tmp_path / "x")
    words = [BENCHMARKS / "quality.py", tmp_path / "middlebury", tmp_path / "x", "--methods", "blend,nearest"]
    run = [sys.executable, *words, "--json", tmp_path / "out.json"]
    lines = subprocess.run(run, capture_output=True, text=True, check=True).stdout.splitlines()
    assert lines[0] == "| set | method | frames | PSNR, dB | SSIM | SSIM of luma | IE | CPU, ms |"
    assert lines[2].startswith("| Middlebury | `blend` | 1 | 120.00 | 1.0000 |  | 0.00 |")
    assert [line.split(" | ")[:3] for line in lines[3:]] == [
        ["| Middlebury", "`nearest`", "1"],
        *(["| X-TEST 2K", f"`{name}`", "7"] for name in ("blend", "nearest")),
        *(["| X-TEST 4K", f"`{name}`", "7"] for name in ("blend", "nearest")),
    ]
    assert json.loads((tmp_path / "out.json").read_text())["sets"][1]["ie"] == 1
