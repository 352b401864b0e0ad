"""Alpha of videos: kept where the output can hold it, said where it cannot."""

from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

import fpsboost
from fpsboost import DecodeOptions, Encoding
from fpsboost.io.images.files import read_image
from fpsboost.io.video.source import VideoSource
from fpsboost.io.video.ycc import from_bgr, to_bgr
from fpsboost.media.pixels import SMPTE170M
from fpsboost.probing import probe
from fpsboost.timing.position import Position, Trim
from support.animation_truth import disc, write_animation
from support.conversion_options import grouped
from support.video_truth import bytes_of

VP9 = {"auto-alt-ref": "0", "lossless": "1", "cpu-used": "8", "deadline": "realtime"}
VP8 = {"auto-alt-ref": "0", "crf": "4", "b": "2000000", "deadline": "realtime", "cpu-used": "8"}

# suffix, encoder, pixel format, options, levels of 255 by which it may be off
kinds = {
    "ffv1 yuva": (".mkv", "ffv1", "yuva444p", {}, 2),
    "ffv1 10 bit": (".mkv", "ffv1", "yuva444p10le", {}, 1),
    "ffv1 bgra": (".mkv", "ffv1", "bgra", {}, 0),
    "ffv1 gbrap12": (".mkv", "ffv1", "gbrap12le", {}, 1),
    "qtrle": (".mov", "qtrle", "argb", {}, 0),
    "png": (".mov", "png", "rgba", {}, 0),
    "prores": (".mov", "prores_ks", "yuva444p10le", {}, 6),
    "vp9": (".webm", "libvpx-vp9", "yuva420p", VP9, 2),
    "vp8": (".mkv", "libvpx", "yuva420p", VP8, 12),
}


def write_clip(path: Path, codec: str, pixel_format: str, options: dict[str, str]) -> Path:
    """A disc of one colour, with soft edges, that moves over transparency of the same colour."""
    with av.open(str(path), "w") as output:
        video = output.add_stream(codec, rate=10, width=64, height=48)
        video.pix_fmt, video.options = pixel_format, dict(options)
        for index in range(3):
            picture = from_bgr(cloud(index), pixel_format, SMPTE170M, False)
            picture.pts, picture.time_base = index, Fraction(1, 10)
            output.mux(video.encode(picture))
        output.mux(video.encode(None))
    return path


def cloud(index: int) -> np.ndarray:
    image = disc(index)
    image[..., :3] = (40, 120, 240)  # subsampled chroma must not mix colours
    return image


def says_alpha(remark: str) -> bool:
    return "alpha channel" in remark or "transparent parts" in remark


@pytest.fixture(params=kinds)
def clip(request, tmp_path) -> tuple[Path, int]:
    suffix, codec, pixel_format, options, tolerance = kinds[request.param]
    return write_clip(tmp_path / f"in{suffix}", codec, pixel_format, options), tolerance


def test_alpha_is_read(clip):
    """Every kind of video with alpha gives BGRA, as deep as it is."""
    path, tolerance = clip
    with VideoSource(path, keeps_alpha=True) as source:
        frames = list(source)
    assert [float(frame.time) for frame in frames] == [0, 0.1, 0.2]
    for index, frame in enumerate(frames):
        image = frame.image.astype(float) * 255 / np.iinfo(frame.image.dtype).max
        assert image.shape == (48, 64, 4)
        assert np.abs(image - cloud(index)).max() <= tolerance + 0.5
    assert source.remarks == []


def test_alpha_that_is_left_out_is_said(clip, tmp_path):
    """H.264 has no alpha: a remark says so and names what keeps it, as a probe does before; colours stay."""
    path, _ = clip
    summary = fpsboost.convert(str(path), str(tmp_path / "out.mp4"), method="blend")
    (remark,) = [remark for remark in summary.remarks if says_alpha(remark)]
    assert f"in{path.suffix} has an alpha channel, which was left out" in remark
    assert "prores_ks" in remark
    assert remark.replace("was left out", "would be left out") in probe(str(path)).remarks
    with VideoSource(path) as source:
        assert next(iter(source)).image.shape == (48, 64, 3)


@pytest.mark.parametrize("target", ["frames", "out_####.tif", "out.apng", "out.webp"])
def test_alpha_goes_into_images(clip, tmp_path, target):
    """Folders, patterns and animations keep it."""
    path, tolerance = clip
    summary = fpsboost.convert(str(path), str(tmp_path / target), method="blend")
    assert not [remark for remark in summary.remarks if says_alpha(remark)]
    if "apng" in target or "webp" in target:
        image = cv2.imread(str(tmp_path / target), cv2.IMREAD_UNCHANGED)
    else:
        name = "out_0001.tif" if "out" in target else "frames/000001.png"
        image = read_image(tmp_path / name)  # OpenCV multiplies colours of TIFF by alpha that is said to be straight
    difference = np.abs(image.astype(float) * 255 / np.iinfo(image.dtype).max - cloud(0))
    if "webp" in target:  # which has no colours under full transparency
        difference[cloud(0)[..., 3] == 0, :3] = 0
    assert difference.max() <= tolerance + 1


outputs = {
    "prores": ("out.mov", Encoding(codec="prores_ks"), "yuva444p", 6),
    "ffv1": ("out.mkv", Encoding(codec="ffv1"), None, 2),
    "qtrle": ("out.mov", Encoding(codec="qtrle"), "argb", 2),
    "png": ("out.mov", Encoding(codec="png"), "rgba", 2),
    "webm": ("out.webm", Encoding(preset="8", crf=10), "yuva420p", 30),
    "vp9 in mkv": ("out.mkv", Encoding(codec="vp9", preset="8", lossless=True), "yuva420p", 2),
}


@pytest.mark.parametrize("kind", outputs)
@pytest.mark.parametrize("source", ["video", "animation", "images", "float images"])
def test_videos_that_keep_alpha(tmp_path, kind, source):
    """From videos, animations and images, where the encoder and the container offer it; made frames too."""
    name, encoding, pixel_format, tolerance = outputs[kind]
    path, options = tmp_path / "in", {}
    if source == "video":
        path = write_clip(tmp_path / "in.mkv", "ffv1", "yuva444p", {})
    elif source == "animation":
        path = write_animation(tmp_path / "in.png", [cloud(index) for index in range(3)], 100)
    else:
        path.mkdir()
        options = {"input_fps": 10}
        for index in range(3):
            image = cloud(index)
            if source == "float images":
                image = image.astype(np.float32) / 255
                image[..., :3] *= image[..., 3:]
            suffix = "tif" if source == "float images" else "png"
            (path / f"{index}.{suffix}").write_bytes(cv2.imencode(f".{suffix}", image)[1].tobytes())
    summary = fpsboost.convert(str(path), str(tmp_path / name), method="blend", encoding=encoding, **grouped(**options))
    assert not [remark for remark in summary.remarks if says_alpha(remark)]
    with VideoSource(tmp_path / name, keeps_alpha=True) as written:
        frames = list(written)
        assert pixel_format is None or written.traits.pixel_format.startswith(pixel_format)
    assert len(frames) == 6
    for index, frame in enumerate(frames[:-1]):
        image = frame.image.astype(float) * 255 / np.iinfo(frame.image.dtype).max
        truth = (cloud(index // 2).astype(float) + cloud((index + 1) // 2)) / 2
        visible = truth[..., 3] > 64
        if source == "float images":  # black where nothing is seen, and few samples of colour
            visible = cv2.erode(visible.astype(np.uint8), np.ones((7, 7))) > 0
        assert np.abs(image[..., 3] - truth[..., 3]).max() <= tolerance + 2
        assert np.abs(image[visible] - truth[visible]).max() <= tolerance + 2


def test_originals_reach_the_encoder_untouched(tmp_path):
    """Where the pixel formats agree, a picture passes with its alpha, sample by sample."""
    path = write_clip(tmp_path / "in.mkv", "ffv1", "yuva420p10le", {})
    fpsboost.convert(str(path), str(tmp_path / "out.mkv"), method="blend", encoding=Encoding(codec="ffv1"))
    with av.open(str(path)) as before, av.open(str(tmp_path / "out.mkv")) as after:
        originals, pictures = list(before.decode(video=0)), list(after.decode(video=0))[::2]
    for original, picture in zip(originals, pictures, strict=True):
        assert picture.format.name == "yuva420p10le"
        assert bytes_of(picture) == bytes_of(original)


@pytest.mark.parametrize("pixel_format", ["yuva420p", "yuva444p", "yuva444p10le", "yuva422p12le", "gbrap", "bgra"])
@pytest.mark.parametrize("full_range", [False, True])
def test_alpha_there_and_back(pixel_format, full_range):
    """Every level of alpha comes back from every format, whatever the range of its colours."""
    image = np.full((16, 16, 4), 90, np.uint8)
    image[..., 3] = np.arange(256).reshape(16, 16)
    picture = from_bgr(image, pixel_format, SMPTE170M, full_range)
    back = to_bgr(picture, keeps_alpha=True)
    assert picture.format.name == pixel_format
    alpha = back[..., 3] if back.dtype == np.uint8 else np.rint(back[..., 3] / 257)
    assert np.array_equal(alpha, image[..., 3])


def test_lost_alpha_is_said_once(tmp_path):
    """Also where the file is read from several places."""
    clip = write_clip(tmp_path / "in.webm", "libvpx-vp9", "yuva420p", VP9)
    part = Trim(Position.parse("0.1", "--start"))
    summary = fpsboost.convert(
        str(clip), str(tmp_path / "out.mp4"), method="nearest", decoding=DecodeOptions(trim=part)
    )
    assert len([remark for remark in summary.remarks if says_alpha(remark)]) == 1


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("name", ["out.mp4", "out.mov", "out.mkv"])
def test_images_with_alpha_become_videos_without(tmp_path, kind, name):
    """Of any depth, with the encoder that is chosen for it; that alpha is lost is said."""
    (tmp_path / "in").mkdir()
    suffix = ".tif" if kind is np.float32 else ".png"
    white = 1 if kind is np.float32 else np.iinfo(kind).max
    for index in range(2):
        image = (cloud(index).astype(float) / 255 * white).astype(kind)
        (tmp_path / "in" / f"{index}{suffix}").write_bytes(cv2.imencode(suffix, image)[1].tobytes())
    source, output = str(tmp_path / "in"), str(tmp_path / name)
    summary = fpsboost.convert(
        source, output, method="nearest", encoding=Encoding(preset="ultrafast"), **grouped(input_fps=10)
    )
    assert len([remark for remark in summary.remarks if says_alpha(remark)]) == 1
    with VideoSource(tmp_path / name) as written:
        assert len(list(written)) == 4
