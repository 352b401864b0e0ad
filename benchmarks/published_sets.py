"""Test sets of the literature on frame interpolation: their folders as they are, and how papers score them.

A method gets what networks get: the two frames around the hidden ones (four of a septuplet), and no others. Frames are
scored as 8 bits, in all three colours and up to the border, and every sample counts, scene cuts too. Some papers score
frames that are not rounded (EMA-VFI's on SNU-FILM); rounding costs 0.02 dB at 35 dB.

The conventions are those of the public evaluations that most papers' tables were made with: ``benchmark/`` of
github.com/hzwer/ECCV2022-RIFE and of github.com/MCG-NJU/EMA-VFI, ``benchmark_xiph.py`` and ``benchmark_middlebury.py``
of github.com/sniklaus/softmax-splatting, ``main.py`` and ``utils.py`` of github.com/JihyongOh/XVFI, ``dataset/`` of
github.com/tarun005/FLAVR, and ``ldm/data/testsets.py`` of github.com/danier97/LDMVFI.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scoring import Clip, Figures, three_colours

from fpsboost.analysis.duplicates import SourceFrame
from fpsboost.errors import InputError
from fpsboost.evaluation.hidden_frames import HeldOutFrame, Interval
from fpsboost.evaluation.results import MIN_MSE, means
from fpsboost.frame import Frame
from fpsboost.frame_cache import SourcePosition
from fpsboost.image import Image
from fpsboost.io.images.files import read_image

RATE = 24
"""Frames a second that samples are said to have, since sets do not say."""

MIDDLEBURY = (
    *("Beanbags", "Dimetrodon", "DogDance", "Grove2", "Grove3", "Hydrangea"),
    *("MiniCooper", "RubberWhale", "Urban2", "Urban3", "Venus", "Walking"),
)
"""Names of the triplets of Middlebury's "other" set."""

XIPH = (
    "BoxingPractice",
    "Crosswalk",
    "DrivingPOV",
    "FoodMarket",
    "FoodMarket2",
    "RitualDance",
    "SquareAndTimelapse",
    "Tango",
)
"""Clips of the Xiph evaluation by Niklaus and Liu (Softmax Splatting, CVPR 2020)."""

XIPH_LAST = 98
"""Last hidden frame of each; they are counted from 1, and every even one is hidden."""

X_TEST_FRAMES = 33
"""Frames of a clip of X-TEST, the first and the last of which are shown."""

X_TEST_FACTOR = 8

Measure = Callable[[Image, Image], float]
"""Of the true image and the interpolated one."""


def psnr(truth: Image, image: Image) -> float:
    """Peak signal-to-noise ratio over all three colours, dB; at most 120."""
    error = float(np.square(truth.astype(np.float64) - image).mean()) / 255**2
    return float(-10 * np.log10(max(error, MIN_MSE)))


def interpolation_error(truth: Image, image: Image) -> float:
    """Mean absolute error, levels of 255: IE as papers have it on Middlebury's "other" set.

    That is what RIFE's ``benchmark/MiddleBury_Other.py`` computes, and DAIN's authors say so
    (github.com/baowenbo/DAIN, issues 16 and 27). The tables of vision.middlebury.edu have the root of the mean square
    instead (Baker et al. 2011), on the eight sequences whose truth is not public.
    """
    return float(np.abs(truth.astype(np.float64) - image).mean())


def volume_ssim(truth: Image, image: Image) -> float:
    """SSIM with a Gaussian window through height, width and colours: ``ssim_matlab`` of the evaluations.

    RIFE, EMA-VFI, FLAVR, LDMVFI and others share this function (``pytorch_msssim``): a window of 11 x 11 x 11 with
    a deviation of 1.5 moves over an image that is three pixels deep, and borders are continued by their last value.
    """
    weights = cv2.getGaussianKernel(11, 1.5).ravel()
    through_colours = np.zeros((3, 3))
    for colour in range(3):
        for offset, weight in enumerate(weights, start=-5):
            through_colours[colour, min(max(colour + offset, 0), 2)] += weight

    def smooth(values: NDArray[Any]) -> NDArray[Any]:
        blurred = cv2.GaussianBlur(values, (11, 11), 1.5, borderType=cv2.BORDER_REPLICATE)
        return np.asarray(cv2.transform(blurred, through_colours))

    x, y = truth.astype(np.float64) / 255, image.astype(np.float64) / 255
    mean_x, mean_y = smooth(x), smooth(y)
    both = mean_x * mean_y
    squares = mean_x**2 + mean_y**2
    variances = smooth(x * x + y * y) - squares
    covariance = smooth(x * y) - both
    c1, c2 = 0.01**2, 0.03**2
    return float(((2 * both + c1) * (2 * covariance + c2) / ((squares + c1) * (variances + c2))).mean())


def plain_ssim(truth: Image, image: Image) -> float:
    """SSIM as scikit-image has it by default, the mean over the colours: softmax splatting's evaluations."""
    return _structural_similarity(truth, image, channel_axis=2, data_range=255)


def luma_ssim(truth: Image, image: Image) -> float:
    """SSIM of luma (BT.601) as scikit-image has it, with the range of the interpolated one: XVFI's ``ssim_bgr``."""
    from skimage.color import rgb2ycbcr  # noqa: PLC0415 (it takes a second to import)

    luma, other = (rgb2ycbcr(each[..., ::-1])[..., 0] for each in (truth, image))
    return _structural_similarity(luma, other, data_range=max(float(np.ptp(other)), 1.0))


def _structural_similarity(truth: NDArray[Any], image: NDArray[Any], **options: Any) -> float:
    from skimage.metrics import structural_similarity  # noqa: PLC0415

    return float(structural_similarity(truth, image, **options))


def whole(image: Image) -> Image:
    """Return the image."""
    return image


def halved(image: Image) -> Image:
    """Return it at half the size, means of areas: "2K" of the Xiph and X-TEST evaluations.

    EMA-VFI keeps the fractions of X-TEST's means; here they are rounded, as those of Xiph are everywhere.
    """
    height, width = image.shape[:2]
    return np.asarray(cv2.resize(image, (width // 2, height // 2), interpolation=cv2.INTER_AREA))


def cropped(image: Image) -> Image:
    """Return the middle, half of the width and height: "4K" of the Xiph evaluation."""
    height, width = image.shape[:2]
    return np.ascontiguousarray(image[height // 4 : height - height // 4, width // 4 : width - width // 4])


class Sample(NamedTuple):
    """Frames that are shown, and hidden ones between them."""

    clip: str
    """The clip that it is from."""
    frames: Sequence[Path]
    """All of them in order."""
    step: int = 2
    """Every so many is shown, from the first one on."""
    scored: Sequence[int] = (0,)
    """Which of the hidden frames count."""


@dataclass(frozen=True)
class PublishedSet:
    """A row of a paper's table."""

    name: str
    samples: Sequence[Sample]
    measures: Mapping[str, Measure]
    """By the names of their columns."""
    view: Callable[[Image], Image] = whole
    """What is shown of a frame."""
    per_clip: bool = False
    """Whether figures are means over the clips of their means, rather than over all frames."""

    def read(self, sample: Sample) -> Clip:
        """Read the frames of a sample."""
        frames = list[SourceFrame]()
        for number, path in enumerate(sample.frames):
            image = self.view(three_colours(read_image(path)))
            if image.dtype != np.uint8 or (frames and image.shape != frames[0].frame.array.shape):
                raise InputError(
                    f"{path} has other pixels than frames of {self.name}, 8 bits and of one size; unpack the set again."
                )
            time = Fraction(number, RATE)
            frames.append(SourceFrame(Frame(image, time), None, Fraction(number), SourcePosition(number, time)))
        intervals = []
        for first in range(0, len(frames) - 1, sample.step):
            between = frames[first + 1 : first + sample.step]
            hidden = tuple(HeldOutFrame(each, Fraction(k, sample.step)) for k, each in enumerate(between, start=1))
            intervals.append(Interval(frames[first], frames[first + sample.step], hidden, (), is_known=True))
        return Clip(sample.clip, intervals, list(sample.scored), Fraction(RATE))

    def score(self, clip: Clip, images: Sequence[Image]) -> Figures:
        """Return the mean figures of the frames of a sample that count."""
        pairs = [(clip.hidden[index], images[index]) for index in clip.scored]
        return means([{name: each(*pair) for name, each in self.measures.items()} for pair in pairs])

    def mean(self, rows: Sequence[tuple[str, Figures]]) -> Figures:
        """Return the mean of figures of samples, each with its clip, as papers average them."""
        if not self.per_clip:
            return means([figures for _, figures in rows])
        by_clip = groupby(sorted(rows, key=lambda row: row[0]), key=lambda row: row[0])
        return means([means([figures for _, figures in group]) for _, group in by_clip])


def find_sets(folder: Path) -> list[PublishedSet]:
    """Return the sets that a folder, or one right below it, holds; none if it is another one."""
    if not folder.is_dir():
        return []
    for place in (folder, *sorted(each for each in folder.iterdir() if each.is_dir())):
        found = [each for layout in LAYOUTS for each in layout(place)]
        if found:
            return found
    return []


def vimeo(folder: Path) -> Iterator[PublishedSet]:
    """Vimeo90K (Xue et al. 2019): ``sequences/00001/0001/im1.png``, and a list of those to test.

    Of triplets the second is hidden (RIFE's ``Vimeo90K.py``); the archive of the test set alone calls the folder
    ``target``. Of septuplets 1, 3, 5 and 7 are shown, and 4 counts (FLAVR's ``vimeo90k_septuplet.py``).
    """
    sequences = next((folder / name for name in ("sequences", "target") if (folder / name).is_dir()), folder)
    for kind, count, scored in (("tri", 3, 0), ("sep", 7, 1)):
        listed = folder / f"{kind}_testlist.txt"
        if listed.is_file():
            samples = [
                Sample(name, [sequences / name / f"im{k}.png" for k in range(1, count + 1)], scored=(scored,))
                for name in listed.read_text(encoding="utf-8").split()
            ]
            name = "Vimeo90K" if kind == "tri" else "Vimeo90K septuplets"
            yield PublishedSet(name, samples, {"psnr": psnr, "ssim": volume_ssim})


def ucf101(folder: Path) -> Iterator[PublishedSet]:
    """UCF101 as Liu et al. chose it (DVF, ICCV 2017): ``1/frame_00.png``, ``frame_01_gt.png``, ``frame_02.png``.

    Whole frames count (RIFE's ``UCF101.py``), not only where DVF's masks say that something moves.
    """
    names = "frame_00.png", "frame_01_gt.png", "frame_02.png"
    found = [each.parent for each in sorted(folder.glob(f"*/{names[1]}"))]
    if found:
        samples = [Sample(each.name, [each / name for name in names]) for each in found]
        yield PublishedSet("UCF101", samples, {"psnr": psnr, "ssim": volume_ssim})


def snu_film(folder: Path) -> Iterator[PublishedSet]:
    """SNU-FILM (Choi et al. 2020): lists ``test-easy.txt`` to ``test-extreme.txt``, three paths a line.

    Paths begin where CAIN's code ran, ``data/SNU-FILM/test/...``; what does not exist below the folder is left away
    from their beginnings. Means are those of EMA-VFI's ``SNU_FILM.py``.
    """
    for level in ("easy", "medium", "hard", "extreme"):
        listed = folder / f"test-{level}.txt"
        if listed.is_file():
            lines = [line.split() for line in listed.read_text(encoding="utf-8").splitlines()]
            samples = [Sample(words[1], [_below(folder, word) for word in words]) for words in lines if len(words) == 3]
            yield PublishedSet(f"SNU-FILM {level}", samples, {"psnr": psnr, "ssim": volume_ssim})


def xiph(folder: Path) -> Iterator[PublishedSet]:
    """Xiph's clips of 4096x2160, frames ``BoxingPractice-001.png`` or ``BoxingPractice/001.png``, counted from 1.

    Every even frame to the 98th is hidden. "2K" is all of it at half the size, "4K" the middle at its own
    (``benchmark_xiph.py`` of softmax splatting; EMA-VFI's ``Xiph.py`` does the same). SSIM is scikit-image's.
    """
    samples = []
    for name in XIPH:
        form = next(
            (form for form in ("{}-{:03d}.png", "{}/{:03d}.png") if (folder / form.format(name, 1)).is_file()), ""
        )
        if form:
            hidden = [number for number in range(2, XIPH_LAST + 1, 2) if (folder / form.format(name, number)).is_file()]
            around = [[folder / form.format(name, number + k) for k in (-1, 0, 1)] for number in hidden]
            samples += [Sample(name, frames) for frames in around if frames[2].is_file()]
    if samples:
        for size, view in (("2K", halved), ("4K", cropped)):
            yield PublishedSet(f"Xiph {size}", samples, {"psnr": psnr, "ssim": plain_ssim}, view)


def x_test(folder: Path) -> Iterator[PublishedSet]:
    """X-TEST of X4K1000FPS (Sim et al. 2021): ``Type1/TEST01/0000.png`` to ``0032.png``, eight times the rate.

    Frames 0 and 32 are shown, 4, 8 ... 28 count. At its own size, XVFI's ``main.py`` has SSIM of luma; later papers,
    also at half the size, that of EMA-VFI's ``XTest_8X.py``.
    """
    step = (X_TEST_FRAMES - 1) // X_TEST_FACTOR
    samples = []
    for clip in sorted({each.parent for each in folder.glob("Type*/*/0000.png")}):
        frames = [clip / f"{number:04d}.png" for number in range(0, X_TEST_FRAMES, step)]
        samples.append(Sample(f"{clip.parent.name}/{clip.name}", frames, X_TEST_FACTOR, range(X_TEST_FACTOR - 1)))
    if samples:
        measures = {"psnr": psnr, "ssim": volume_ssim}
        yield PublishedSet("X-TEST 2K", samples, measures, halved)
        yield PublishedSet("X-TEST 4K", samples, {**measures, "ssim_y": luma_ssim})


def middlebury(folder: Path) -> Iterator[PublishedSet]:
    """Middlebury's "other" (Baker et al. 2011): ``other-data/NAME/frame10.png`` and ``frame11.png``.

    Their truth is ``other-gt-interp/NAME/frame10i11.png``. LDMVFI calls the folders ``input`` and ``gt``, and has
    triplets of DAVIS in the same form; softmax splatting puts all three into one. Papers report IE (RIFE's
    ``MiddleBury_Other.py``), or PSNR and SSIM (``benchmark_middlebury.py`` of softmax splatting).
    """
    for shown, hidden in (("other-data", "other-gt-interp"), ("input", "gt"), ("", "")):
        samples = []
        for truth in sorted((folder / hidden).glob("*/frame10i11.png")):
            place = folder / shown / truth.parent.name
            if (place / "frame10.png").is_file():
                samples.append(Sample(place.name, [place / "frame10.png", truth, place / "frame11.png"]))
        if samples and any(each.clip in MIDDLEBURY for each in samples):
            measures = {"psnr": psnr, "ssim": plain_ssim, "ie": interpolation_error}
            yield PublishedSet("Middlebury", samples, measures)
        elif samples:
            yield PublishedSet("DAVIS triplets", samples, {"psnr": psnr, "ssim": volume_ssim})


def davis(folder: Path) -> Iterator[PublishedSet]:
    """DAVIS 2017, its 90 clips at 480p: ``bear/00000.jpg``, or ``JPEGImages/480p/bear/00000.jpg``.

    Frames 3, 5, 7 ... are hidden, as far as three more follow, as methods of four frames need them; means over the
    frames of a clip, then over the clips (LDMVFI's ``Davis90_triplet``).
    """
    places = folder, folder / "480p", folder / "JPEGImages" / "480p"
    place = next((each for each in places if (each / "bear" / "00000.jpg").is_file()), None)
    if place:
        samples = []
        for clip in sorted(each for each in place.iterdir() if each.is_dir()):
            frames = [clip / f"{number:05d}.jpg" for number in range(len(list(clip.glob("*.jpg"))))]
            samples += [Sample(clip.name, frames[k - 1 : k + 2]) for k in range(3, len(frames) - 3, 2)]
        yield PublishedSet("DAVIS", samples, {"psnr": psnr, "ssim": volume_ssim}, per_clip=True)


LAYOUTS = (vimeo, ucf101, snu_film, xiph, x_test, middlebury, davis)
"""Each yields the sets that a folder holds."""


def _below(folder: Path, text: str) -> Path:
    """Return the path that a list names, without the beginning that does not exist below the folder."""
    parts = Path(text).parts
    candidates = [folder.joinpath(*parts[first:]) for first in range(len(parts))]
    return next((each for each in candidates if each.is_file()), candidates[0])
