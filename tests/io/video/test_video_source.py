"""VideoSource: exact times, honest remarks, and colours that survive the way to BGR and back."""

from fractions import Fraction
from io import BytesIO
from itertools import pairwise, product

import av
import numpy as np
import pytest
from av.video.reformatter import VideoReformatter
from PIL import ExifTags, Image

from fpsboost import InputError
from fpsboost.io.video.source import VideoSource
from fpsboost.io.video.ycc import from_bgr, to_bgr, turned_upright
from fpsboost.media.pixels import chroma_location_of
from support.video_truth import (
    QUARTER_TURN,
    bytes_of,
    copy_packets,
    pictures_of,
    read,
    samples_of,
    scene,
    spoil_packets,
    tone,
    write_clip,
)


@pytest.mark.parametrize("suffix", [".mp4", ".mov"])
def test_times_are_exact_ticks(tmp_path, suffix):
    """23.976 frames per second stay multiples of 1001/24000, without any rounding."""
    clip = write_clip(tmp_path / f"in{suffix}", time_base=Fraction(1001, 24000))
    with VideoSource(clip) as source:
        frames = list(source)
        assert source.info.rate == Fraction(24000, 1001)
        assert source.info.frame_count == 10
        assert (source.info.height, source.info.width) == (48, 64)
        assert source.remarks == []
        with pytest.raises(InputError, match="only once"):
            iter(source)
    assert [frame.time for frame in frames] == [k * Fraction(1001, 24000) for k in range(10)]
    assert {frame.duration for frame in frames} == {Fraction(1001, 24000)}


def test_variable_times_and_durations(tmp_path):
    """Uneven frames keep their times, and each lasts until the next; the last one until the end of the stream."""
    times = [0, 3, 4, 9, 10, 16]
    frames, _ = read(write_clip(tmp_path / "in.mp4", times=times, end=20, time_base=Fraction(1, 100)))
    assert [frame.time for frame in frames] == [Fraction(t, 100) for t in times]
    assert [a.time + a.duration for a in frames[:-1]] == [b.time for b in frames[1:]]
    options = {"preset": "ultrafast", "crf": "0", "bf": "0"}
    clip = write_clip(
        tmp_path / "end.mp4", times=range(8), end=10, time_base=Fraction(1, 25), rate=Fraction(25), options=options
    )
    frames, _ = read(clip)
    assert frames[-1].time + frames[-1].duration == Fraction(10, 25)
    frames, remarks = read(write_clip(tmp_path / "late.mp4", times=range(50, 60)))
    assert frames[0].time == 2
    assert frames[-1].time + frames[-1].duration == Fraction(60, 25)
    assert remarks == []


def test_traits(tmp_path):
    """Orientation, pixel shape and colour tags are read, and reading them loses no frame."""
    tags = {"sample_aspect_ratio": Fraction(4, 3), "colorspace": 1, "color_range": 2, "color_primaries": 9}
    clip = write_clip(tmp_path / "in.mp4", matrix=QUARTER_TURN, **tags, color_trc=16)
    with VideoSource(clip) as source:
        traits = source.traits
        assert len(list(source)) == 10
    assert traits.display_matrix == QUARTER_TURN
    assert traits.sample_aspect_ratio == Fraction(4, 3)
    assert (traits.color_space, traits.color_range, traits.color_primaries, traits.color_transfer) == (1, 2, 9, 16)
    assert traits.full_range
    assert traits.chroma_location == "left"


def test_exif_turns_the_pictures_of_a_camera(tmp_path):
    """The rotation is known also where PyAV has no name for EXIF, and so tells nothing of a picture's side data."""
    exif, jpeg = Image.Exif(), BytesIO()
    exif[ExifTags.Base.Orientation] = 6
    Image.fromarray(scene(0)).save(jpeg, "JPEG", exif=exif)
    with av.open(str(tmp_path / "in.avi"), "w") as output:
        stream = output.add_mux_stream("mjpeg", rate=25, width=64, height=48)
        packet = av.Packet(jpeg.getvalue())
        packet.stream, packet.pts, packet.dts, packet.time_base = stream, 0, 0, Fraction(1, 25)
        output.mux(packet)
    with VideoSource(tmp_path / "in.avi") as source:
        assert source.traits.display_matrix == QUARTER_TURN


def test_untagged_colour_goes_by_height(tmp_path):
    """Without a tag, 720 lines and more are BT.709, fewer BT.601."""
    for height, expected in ((48, 6), (720, 1)):
        clip = write_clip(tmp_path / f"{height}.mp4", times=[0, 1], size=(height, 64))
        with VideoSource(clip) as source:
            assert source.traits.color_space == expected


def test_damaged_packets_are_skipped_and_counted(tmp_path, capfd):
    """Nonsense in the middle costs a few frames, is reported, and prints nothing; of nothing else, it is an error."""
    clip = write_clip(tmp_path / "in.mp4", times=range(40), options={"preset": "ultrafast", "g": "10"})
    spoil_packets(clip, [12, 13, 25])
    frames, remarks = read(clip)
    assert 30 <= len(frames) < 40
    assert all(a.time < b.time for a, b in pairwise(frames))
    assert "in.mp4 is damaged: " in remarks[0]
    assert "could not be decoded" in remarks[0]
    assert f"{len(frames)} frames could be read." in remarks[0]
    assert capfd.readouterr() == ("", "")
    clip = write_clip(tmp_path / "in.mp4", options={"preset": "ultrafast", "g": "1"})
    spoil_packets(clip, range(10))
    with pytest.raises(InputError, match="no frame that can be decoded"):
        read(clip)


@pytest.mark.parametrize(
    ("suffix", "start", "of_all"),
    [(".mkv", 0, ""), (".mkv", 1000, ""), (".flv", 0, ""), (".flv", 1000, ""), (".mp4", 0, " of 100")],
)
def test_truncated_file_is_read_and_reported(tmp_path, suffix, start, of_all):
    """Half a file yields half of the frames, of as many as an index lists, and a remark, wherever its clock starts."""
    fast = {"preset": "ultrafast", "g": "5", "bf": "0"}
    whole = write_clip(tmp_path / "whole.mp4", times=range(start, start + 100), options=fast)
    clip = copy_packets(whole, tmp_path / f"in{suffix}", **{"movflags": "faststart"} if suffix == ".mp4" else {})
    data = clip.read_bytes()
    clip.write_bytes(data[: len(data) // 2])
    frames, remarks = read(clip)
    assert 30 < len(frames) < 70
    end = f"{float(frames[-1].time + frames[-1].duration):.1f} s of the 4.0 s its header promises"
    assert remarks[-1] == f"{clip} ends after {end}; {len(frames)} frames{of_all} could be read."


def test_sound_that_outlasts_the_video_is_no_truncation(tmp_path):
    """A file as long as its longest stream is whole."""
    _, remarks = read(write_clip(tmp_path / "in.mkv", sound="aac", sound_seconds=3))
    assert remarks == []


def test_repeated_time_is_dropped_with_a_remark(tmp_path):
    """A frame that is shown no later than the one before it is left out."""

    def repeat_one(number: int, packet: av.Packet) -> None:
        packet.pts = packet.dts = (0, 40, 40, 80)[number]

    whole = write_clip(tmp_path / "whole.mkv", times=range(4), codec="ffv1")
    frames, remarks = read(copy_packets(whole, tmp_path / "in.mkv", repeat_one))
    assert [frame.time for frame in frames] == [0, Fraction(40, 1000), Fraction(80, 1000)]
    assert "1 frame no later" in remarks[0]


def test_what_cannot_be_opened(tmp_path):
    """A missing file, a folder, text, emptiness and pure sound each get their sentence."""
    text = tmp_path / "notes.txt"
    text.write_text("hello\n" * 100)
    empty = tmp_path / "empty.mp4"
    empty.touch()
    sound = tmp_path / "sound.wav"
    with av.open(str(sound), "w") as output:
        output.mux(tone(output.add_stream("pcm_s16le", rate=48000)))
    for path, sentence in (
        (tmp_path / "none.mp4", "does not exist"),
        (tmp_path, "is a folder"),
        (text, "not a video file|is a text file"),
        (empty, "not a video file"),
        (sound, "has no video stream"),
    ):
        with pytest.raises(InputError, match=sentence):
            VideoSource(path)


@pytest.mark.parametrize("pixel_format", ["yuv420p", "yuv422p", "yuv444p", "yuv420p10le", "yuv444p10le"])
@pytest.mark.parametrize("color_space", [1, 5, 9])
@pytest.mark.parametrize("full_range", [False, True])
def test_colour_round_trip_has_no_drift(pixel_format, color_space, full_range):
    """BGR and back leaves every plane's mean where it was, to 0.15 of a level, and each sample within few levels."""
    picture = from_bgr(scene(0, 240, 320), pixel_format, color_space, full_range)
    picture.colorspace, picture.color_range = color_space, 2 if full_range else 1
    back = from_bgr(to_bgr(picture), pixel_format, color_space, full_range, chroma_location=_location(picture))
    for before, after in zip(samples_of(picture), samples_of(back), strict=True):
        difference = after.astype(float) - before
        assert abs(difference.mean()) < 0.15
        assert np.abs(difference).max() <= 3


def _location(picture: av.VideoFrame) -> str:
    return chroma_location_of(picture, VideoReformatter())


@pytest.mark.parametrize("full_range", [False, True])
@pytest.mark.parametrize("bits", [8, 10])
def test_colours_are_the_standards_numbers(full_range, bits):
    """White, black and pure red have the code values that the standard gives them, and come back whole."""
    image = np.zeros((16, 48, 3), np.uint8 if bits == 8 else np.uint16)
    top = np.iinfo(image.dtype).max
    image[:, 16:32], image[:, 32:, 2] = top, top
    picture = from_bgr(image, "yuv444p" if bits == 8 else "yuv444p10le", 1, full_range)
    picture.colorspace, picture.color_range = 1, 2 if full_range else 1
    unit, most = 2 ** (bits - 8), 2**bits - 1
    luma, blue, red = (plane[8] for plane in samples_of(picture))
    black, white = (0, most) if full_range else (16 * unit, 235 * unit)
    assert (luma[8], luma[24]) == (black, white)
    assert luma[40] == round(black + 0.2126 * (white - black))
    assert blue[8] == blue[24] == red[24] == 128 * unit
    assert red[40] == (most if full_range else 240 * unit)
    assert np.abs(to_bgr(picture).astype(float) - image).max() <= top / most * 1.6


@pytest.mark.parametrize("location", ["left", "center", "topleft"])
def test_chroma_stays_in_place(location):
    """A coloured edge is where it was, to a quarter of a pixel, wherever chroma samples sit."""
    columns = np.arange(64)
    image = np.full((64, 64, 3), 128, np.uint8)
    image[..., 2] = np.rint(128 + 60 / (1 + np.exp(-(columns - 31.5) / 3)))
    picture = from_bgr(image, "yuv420p", 1, False, chroma_location=location)
    picture.colorspace, picture.color_range = 1, 1
    assert _location(picture) == location
    back = to_bgr(picture)[20:40, :, 2].mean(axis=0) - 128
    assert abs(np.interp(30, back, columns) - np.interp(30, image[0, :, 2] - 128.0, columns)) < 0.25


def test_decoded_picture_is_not_written_into(tmp_path):
    """Finding the chroma location leaves even a picture of the probe's own size untouched."""
    clip = write_clip(tmp_path / "in.mp4", size=(32, 32), pixel_format="yuv444p")
    pure = bytes_of(pictures_of(clip)[0])
    with VideoSource(clip) as source:
        original = next(iter(source)).original
        assert isinstance(original, av.VideoFrame)
        assert bytes_of(original) == pure


QUARTER_TURNS_AND_FLIPS = [
    (a, b, c, d) for a, b, c, d in product((-1, 0, 1), repeat=4) if abs(a * d - b * c) == 1 and a * b + c * d == 0
]


@pytest.mark.parametrize("turn", QUARTER_TURNS_AND_FLIPS, ids=str)
def test_upright_pixels_land_where_the_display_matrix_sends_them(turn):
    """Every quarter turn and flip moves (x, y) to (a x + c y, b x + d y), shifted back into the picture."""
    a, b, c, d = turn
    image = np.arange(2 * 3, dtype=np.uint8).reshape(2, 3, 1)
    rounding = [1 - abs(each) for each in turn]  # what a sine or cosine in fixed point leaves
    a16, b16, c16, d16 = ((each << 16) + off for each, off in zip(turn, rounding, strict=True))
    assert turned_upright(image, None) is image
    turned = turned_upright(image, (a16, b16, 0, c16, d16, 0, 0, 0, 1 << 30))
    places = {int(image[y, x, 0]): (a * x + c * y, b * x + d * y) for y in range(2) for x in range(3)}
    left, top = (min(place[axis] for place in places.values()) for axis in range(2))
    for value, (x, y) in places.items():
        assert turned[y - top, x - left, 0] == value
