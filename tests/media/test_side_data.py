"""What files say of their pictures beside the samples: applied, kept, or named where an output lacks it."""

import gc
import struct
from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from PIL import Image, ImageCms

from fpsboost import DecodeOptions, Encoding, InputError, convert, media
from fpsboost.io.video.source import VideoSource
from fpsboost.media import captions_of, plane_arrays
from fpsboost.media.side_data import described, is_ordinary, side_data_of
from fpsboost.probing import probe
from support.video_truth import copy_packets, pictures_of, scene, write_clip

CAPTIONS = bytes.fromhex("b500314741393403c1fffc942cff")
CAMERA = bytes(range(16)) + b"of a camera"


def box(name: bytes, payload: bytes) -> bytes:
    """A box of an MP4 file."""
    return struct.pack(">I4s", 8 + len(payload), name) + payload


def clean_aperture(width: int, height: int, right: Fraction, down: Fraction) -> bytes:
    """The box of a crop: its size, and how far its centre is off."""
    numbers = (width, 1, height, 1, right.numerator, right.denominator, down.numerator, down.denominator)
    return box(b"clap", struct.pack(">8i", *numbers))


def add_box(path: Path, addition: bytes) -> Path:
    """Add a box to the entry of the video's format in an MP4 whose index is at its end."""
    data = path.read_bytes()
    at, end = data.rindex(b"moov"), 0
    data = bytearray(data)
    for name in (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stsd", b"avc1"):
        at = data.index(name, at)
        size = struct.unpack_from(">I", data, at - 4)[0]
        end = at - 4 + size
        struct.pack_into(">I", data, at - 4, size + len(addition))
    data[end:end] = addition
    path.write_bytes(data)
    return path


def message(kind: int, payload: bytes) -> bytes:
    """Supplemental information (SEI) of H.264."""
    data = bytes([kind, len(payload)]) + payload + b"\x80"
    for end in b"\0\1\2\3":
        data = data.replace(b"\0\0" + bytes([end]), b"\0\0\3" + bytes([end]))
    return b"\0\0\0\1\6" + data


def rewrite(source: Path, path: Path, change: Callable[[bytes], bytes]) -> Path:
    """Copy the pictures of a clip at 25 frames per second, the data of each of them changed."""
    with av.open(str(source)) as file, av.open(str(path), "w") as output:
        stream = output.add_stream_from_template(file.streams.video[0])
        for number, packet in enumerate(packet for packet in file.demux() if packet.size):
            changed = av.Packet(change(bytes(packet)))
            changed.stream, changed.time_base, changed.pts, changed.dts = stream, Fraction(1, 25), number, number
            output.mux(changed)
    return path


def write_with_messages(path: Path, messages: Sequence[bytes]) -> Path:
    """A transport stream of H.264, two views side by side, with messages before every picture."""
    stereo = {"preset": "ultrafast", "x264-params": "frame-packing=3"}
    plain = write_clip(path.with_suffix(".h264"), times=range(4), options=stereo)
    return rewrite(plain, path, lambda data: b"".join([*messages, data]))


def remarks_of(source: Path, target: str, codec: str | None = None, **options: Any) -> str:
    """What a conversion says."""
    encoding = Encoding(codec=codec, preset="ultrafast" if codec in ("h264", "hevc") else None)
    return " ".join(convert(str(source), target, method="blend", encoding=encoding, **options).remarks)


def sides_of(path: Path) -> set[str]:
    """What the first picture of a file brings along."""
    return {kind for kind, _ in side_data_of(pictures_of(path)[0])}


# ---------------------------------------------------------------------------------------------------------------- crops


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv"])
@pytest.mark.parametrize(("pixel_format", "crop"), [("yuv420p", (8, 6, 24, 2)), ("yuv444p", (3, 5, 2, 1))])
def test_a_crop_is_applied_and_said(tmp_path, suffix, pixel_format, crop):
    """Pictures, originals in the output too, are those samples of the whole ones that the container shows."""
    left, top, right, bottom = crop
    size = 64 - left - right, 48 - top - bottom
    aperture = clean_aperture(*size, Fraction(left - right, 2), Fraction(top - bottom, 2))
    plain = write_clip(tmp_path / "plain.mp4", times=range(4), pixel_format=pixel_format)
    whole = [plane_arrays(picture) for picture in pictures_of(plain)]
    clip = add_box(plain, aperture)
    if suffix != ".mp4":
        clip = copy_packets(clip, tmp_path / f"in{suffix}")
    target = tmp_path / "out.mp4"
    summary = convert(str(clip), str(target), method="blend", encoding=Encoding(lossless=True, codec="h264"))
    written = [plane_arrays(picture) for picture in pictures_of(target)][::2]
    assert [planes[0].shape for planes in written] == [size[::-1]] * 4
    for planes, originals in zip(written, whole, strict=True):
        for plane, original in zip(planes, originals, strict=True):
            part = 64 // original.shape[1]
            rows, columns = slice(top // part, (48 - bottom) // part), slice(left // part, (64 - right) // part)
            assert np.array_equal(plane, original[rows, columns])
    assert f"shows {size[0]}x{size[1]} of its 64x48 pixels" in " ".join(summary.remarks)
    assert (probe(str(clip)).width, probe(str(clip)).height) == size


def smooth(index: int, height: int, width: int) -> np.ndarray:
    """A picture whose chroma changes slowly."""
    rows, columns = np.mgrid[0:height, 0:width]
    return np.stack([40 + 2 * columns, 60 + 3 * rows, 200 - columns - rows], axis=-1).astype(np.uint8)


@pytest.mark.parametrize("pixel_format", ["yuv420p", "yuv422p10le", "yuv411p", "yuva420p", "bgr0", "vp8"])
def test_an_odd_crop_moves_no_colour(tmp_path, pixel_format):
    """Luma is exact, and chroma stays where it was, though its samples lie elsewhere now."""
    clip = tmp_path / "in.mkv"
    codec, options = ("libvpx", {"crf": "4", "b": "0"}) if pixel_format == "vp8" else ("ffv1", {})
    pixel_format = pixel_format.replace("vp8", "yuv420p")
    write_clip(clip, times=range(2), pixel_format=pixel_format, codec=codec, options=options, picture=smooth)
    with VideoSource(clip) as source:
        whole = list(source)
    # two elements of its track become PixelCropLeft and PixelCropTop
    data = clip.read_bytes().replace(b"\x54\xb2\x81\4\x55\xee\x81\0", b"\x54\xcc\x81\7\x54\xbb\x81\5")
    clip.write_bytes(data.replace(b"\xe0\x8a\xb0", b"\xe0\x8e\xb0"))
    with VideoSource(clip) as source:
        frames = list(source)
    for frame, before in zip(frames, whole, strict=True):
        assert frame.original.format.name == pixel_format
        assert (frame.time, frame.duration) == (before.time, before.duration)
        if frame.original.format.is_planar:
            luma, original = (plane_arrays(picture)[0] for picture in (frame.original, before.original))
            assert np.array_equal(luma, original[5:, 7:])
        away = (frame.image - before.image[5:, 7:].astype(float))[6:-6, 8:-8] / 256 ** (frame.image.itemsize - 1)
        assert np.abs(away).mean() < 0.7
        assert np.abs(away.mean(axis=(0, 1))).max() < 0.3


@pytest.mark.parametrize("decode", [{}, {"deinterlace": True}])
def test_planes_of_a_crop(tmp_path, decode):
    """The size is known before the first frame, and frames have it, with fields made into frames too."""
    clip = add_box(write_clip(tmp_path / "in.mp4", times=range(4)), clean_aperture(40, 32, Fraction(4), Fraction(0)))
    with VideoSource(clip, decoding=DecodeOptions(**decode)) as source:
        assert (source.info.width, source.info.height) == (40, 32)
        frames = list(source)
    assert {frame.image.shape for frame in frames} == {(32, 40, 3)}
    assert np.abs(frames[0].image - scene(0)[8:40, 16:56].astype(float)).mean() < 3


# ---------------------------------------------------------------------------------------------------------- their words


@pytest.mark.parametrize(
    ("codec", "suffix", "lost", "kept"),
    [
        ("h264", ".mp4", "lost the user data of the camera or encoder of its source", {"A53_CC", "STEREO3D"}),
        ("hevc", ".mp4", "lost the stereo mode and the closed captions and the user data", set()),
        ("vp9", ".mkv", "lost the closed captions and the user data of the camera or encoder of its", {"STEREO3D"}),
    ],
)
def test_what_an_output_lacks_is_said(tmp_path, codec, suffix, lost, kept):
    """Captions, user data and stereo mode of the pictures are in the output, or in the sentence on what it lost."""
    clip = write_with_messages(tmp_path / "in.ts", [message(4, CAPTIONS), message(5, CAMERA)])
    assert {"A53_CC", "SEI_UNREGISTERED", "STEREO3D"} <= sides_of(clip)
    target = tmp_path / f"out{suffix}"
    said = remarks_of(clip, str(target), codec)
    assert lost in said
    assert ("has the stereo mode of its source in its H.264 stream" in said) == (codec == "h264")
    assert sides_of(target) - {"SEI_UNREGISTERED"} == kept
    assert "closed captions" in remarks_of(clip, f"{tmp_path}/out/")


def write_captions(path: Path, count: int = 24, first: int = 0, each: int = 1) -> Path:
    """A clip at 25 frames per second whose pictures, from the first on, carry their number in captions with padding.

    Every picture is shown in `each` frames.
    """
    plain = write_clip(
        path.with_suffix(".h264"),
        times=range(count),
        options={"preset": "ultrafast", "tune": "zerolatency"},
        picture=lambda index, height, width: scene(index // each, height, width),
    )
    numbers = iter(range(count))

    def change(data: bytes) -> bytes:
        number = next(numbers)
        entries = bytes([0xFC, 1 + number, 0x80]) + b"\xfa\0\0" * 19
        captions = message(4, b"\xb5\0\x31GA94\3" + bytes([0x40 | 20, 0xFF]) + entries + b"\xff")
        return captions * (number >= first) + data

    return rewrite(plain, path, change)


def captions_in(path: Path) -> list[tuple[Fraction, list[int]]]:
    """Time of every picture of a file, and the numbers in its captions."""
    found = []
    for picture in pictures_of(path):
        data = captions_of(picture)
        entries = [data[at : at + 3] for at in range(0, len(data), 3)]
        found.append((picture.pts * picture.time_base, [entry[1] - 1 for entry in entries if entry[0] & 4]))
    return found


@pytest.mark.parametrize(
    ("options", "speed"),
    [
        ({"factor": 1}, 1),
        ({"factor": 2}, 1),
        ({"factor": Fraction(3, 2)}, 1),
        ({"factor": Fraction(1, 7)}, 1),
        ({"fps": 30}, 1),
        ({"fps": 10, "shutter": 180}, 1),
        ({"speed": "2"}, 2),
        ({"speed": "0.5"}, 0.5),
        ({"retime": "0=0s 1s=0.2s 2s=0.2s 3s=0.92s"}, None),
        ({"replace": "5,6"}, 1),
        ({"duplicates": "drop"}, 1),
        ({"factor": 1, "decoding": DecodeOptions(deinterlace=True)}, 1),
    ],
    ids=str,
)
def test_captions_come_once_and_in_order(tmp_path, options, speed):
    """Every entry is on the first picture that is shown no earlier, whichever pictures are made, left out or held."""
    clip = write_captions(tmp_path / "in.ts", each=2 if "duplicates" in options else 1)
    target = tmp_path / "out.mp4"
    assert "lost" not in remarks_of(clip, str(target), "h264", **options)
    written = captions_in(target)
    assert [number for _, numbers in written for number in numbers] == list(range(24))
    for (before, _), (time, numbers) in pairwise(written[:-1]):
        assert speed is None or all(before < number / 25 / Fraction(speed) <= time + 0.001 for number in numbers)


def test_captions_of_a_copy(tmp_path):
    """Pictures that are written as they were read keep their captions, entry by entry."""
    clip = write_captions(tmp_path / "in.ts")
    with media.open(clip) as source, media.create(tmp_path / "out.mkv", like=source) as writer:
        for timed in source.pictures():
            writer.encode(*timed)
    before, after = ([captions_of(picture) for picture in pictures_of(path)] for path in (clip, tmp_path / "out.mkv"))
    assert after == before


@pytest.mark.parametrize(
    ("first", "options"),
    [(0, {"codec": "hevc"}), (3, {"codec": "vp9"}), (3, {"codec": "h264", "retime": "0=0.9s 1s=0s"})],
)
def test_captions_that_an_output_lacks_are_said(tmp_path, first, options):
    """All of them are lost and one sentence says so, if the first picture has none or if they play backwards, too."""
    clip = write_captions(tmp_path / ("in.ts" if "retime" not in options else "in.mp4"), first=first)
    target = tmp_path / "out.mp4"
    assert remarks_of(clip, str(target), **options).count("lost the closed captions of its source.") == 1
    assert not any(numbers for _, numbers in captions_in(target))


def exif(orientation: int) -> bytes:
    """A segment of JPEG with an orientation in EXIF."""
    data = b"Exif\0\0II*\0\x08\0\0\0" + struct.pack("<HHHIHHI", 1, 0x0112, 3, 1, orientation, 0, 0)
    return b"\xff\xe1" + struct.pack(">H", len(data) + 2) + data


@pytest.mark.parametrize(("orientation", "matrix"), [(2, (-65536, 65536)), (6, (0, 0)), (1, None)])
def test_a_type_without_a_name_hides_no_other(tmp_path, orientation, matrix):
    """Motion JPEG with EXIF is converted, turned and flipped as EXIF says, which is itself said to be lost."""
    plain = write_clip(tmp_path / "plain.avi", times=range(3), codec="mjpeg", pixel_format="yuvj420p", options={})
    clip = rewrite(plain, tmp_path / "in.avi", lambda data: data[:2] + exif(orientation) + data[2:])
    with VideoSource(clip) as source:
        found = source.traits.display_matrix
    assert (found and (found[0], found[4])) == matrix
    assert "lost the EXIF metadata of its source" in remarks_of(clip, str(tmp_path / "out.mp4"), "h264")
    assert probe(str(clip)).frames == 3


def test_the_profile_of_a_png_is_found(tmp_path):
    """Its name belongs to FFmpeg: PyAV, which would free it too, is not asked for it."""
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    Image.fromarray(scene(0)).save(tmp_path / "in.png", icc_profile=profile)
    assert "ICC_PROFILE" in sides_of(tmp_path / "in.png")
    gc.collect()  # else it would end the process at any time


@pytest.mark.parametrize(
    ("kind", "data", "said"),
    [
        ("STEREO3D", struct.pack("=9i", 0, *[0] * 8), False),  # flat
        ("STEREO3D", struct.pack("=9i", 2, *[0] * 8), True),
        ("SPHERICAL", struct.pack("=i", 4), False),  # rectilinear: ordinary pictures
        ("SPHERICAL", struct.pack("=i", 0), True),
        ("PANSCAN", struct.pack("=3i", 0, 64 * 16, 48 * 16), False),
        ("PANSCAN", struct.pack("=3i", 0, 48 * 16, 48 * 16), True),
        ("AFD", b"\x08", False),
        ("AFD", b"\x0a", True),
        ("GOP_TIMECODE", struct.pack("=q", 1 << 12), False),  # 00:00:00:00
        ("GOP_TIMECODE", struct.pack("=q", 1 << 12 | 5), True),
        ("SEI_UNREGISTERED", bytes.fromhex("dc45e9bde6d948b7962cd820d923eeef") + b"x264", False),
        ("MOTION_VECTORS", b"", False),
        ("UNKNOWN_40", b"", True),
    ],
)
def test_what_says_nothing_is_not_lost(kind, data, said):
    """What is so without it, and what an encoder makes anew, is no loss; a type that nobody knows may be one."""
    assert bool(described([(kind, data)], 64)) == said


# --------------------------------------------------------------------------------------------------------- Dolby Vision


@pytest.mark.parametrize(
    ("profile", "compatibility", "is_refused"),
    [(5, 0, True), (10, 0, True), (8, 1, False), (8, 4, False), (7, 0, False)],
)
@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
def test_dolby_vision_without_ordinary_colours_is_refused(tmp_path, profile, compatibility, is_refused, suffix):
    """It takes an option to convert it, and then a remark says that colours are wrong; `probe` says it beforehand."""
    configuration = bytes([1, 0, profile << 1, 0x35, compatibility << 4]).ljust(24, b"\0")
    clip = add_box(write_clip(tmp_path / "plain.mp4", times=range(3)), box(b"dvcC", configuration))
    if suffix != ".mp4":
        clip = copy_packets(clip, tmp_path / f"in{suffix}")
    if not is_refused:
        assert "Dolby Vision" not in remarks_of(clip, str(tmp_path / "out.mp4"), "h264")
        return
    with pytest.raises(InputError, match=r"is Dolby Vision whose colours .*pass `force_colours=True`"):
        remarks_of(clip, str(tmp_path / "out.mp4"), "h264")
    assert "is Dolby Vision whose colours only" in (probe(str(clip)).conversion.refused or "")
    forced = DecodeOptions(force_colours=True)
    assert "taken for ordinary ones: wrong" in remarks_of(clip, str(tmp_path / "out.mp4"), "h264", decoding=forced)


@pytest.mark.parametrize(("full_range", "is_refused"), [(1, True), (0, False)])
def test_a_stream_without_its_profile(full_range, is_refused):
    """The metadata of a picture tells profile 5 too: FFmpeg's AVDOVIMetadata, whose header begins at its offset."""
    header = bytes([2, 0, 18, 0, 0, 0, 0, 0, 23, 1, full_range])
    data = struct.pack("=6Q", 48, 72, 0, 0, 0, 0) + header.ljust(24, b"\0")
    assert is_ordinary({"DOVI_METADATA": data}, None) != is_refused
    assert is_ordinary({}, None)
