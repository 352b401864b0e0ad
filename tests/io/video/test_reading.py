"""How a source is read: fields as frames, the right stream of several, sizes that change."""

import re
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import av.filter
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from fpsboost import DecodeOptions, Encoding, Frame, InputError, OptionError, convert
from fpsboost.io.opening import open_source
from fpsboost.io.video.source import VideoSource
from fpsboost.probing import probe
from support.video_truth import add_pictures, mux_in_order, pictures_of, png, read, scene, write_clip

pytestmark = [pytest.mark.filterwarnings("ignore:Cyclopts application invoked without tokens")]

FIELDS = DecodeOptions(deinterlace=True)
SCALE = DecodeOptions(size_change="scale")
FAST = Encoding(preset="ultrafast")
HEIGHT, WIDTH, STEP = 48, 64, 2


def moment(index: int) -> NDArray[np.uint8]:
    """A bar that moves on with every field."""
    luma = np.full((HEIGHT, WIDTH), 16, np.uint8)
    luma[:, 4 + STEP * index : 10 + STEP * index] = 200
    return luma


def place(frame: Frame) -> float:
    """Of the bar, in steps."""
    bright = frame.image[..., 1].astype(float) - frame.image[..., 1].min()
    return float((bright.sum(axis=0) @ np.arange(WIDTH) / bright.sum() - 6.5) / STEP)


def white(frame: Frame) -> NDArray[np.float64]:
    """The image with 1 for white."""
    return frame.image / np.iinfo(frame.image.dtype).max


def write_fields(
    path: Path,
    orders: Sequence[str],
    codec: str = "ffv1",
    options: dict[str, str] | None = None,
    times: Sequence[int] | None = None,
) -> Path:
    """Write a clip of 25 frames per second, flagged ``tff``, ``bff`` or ``prog`` one by one."""
    with av.open(str(path), "w") as output:
        stream = output.add_stream(codec, rate=25, width=WIDTH, height=HEIGHT)
        stream.pix_fmt, stream.options = "yuv420p", options or {}
        stream.time_base = stream.codec_context.time_base = Fraction(1, 25)
        for index, (order, time) in enumerate(zip(orders, times or range(len(orders)), strict=True)):
            luma, late = moment(2 * index), moment(2 * index + 1)
            if order != "prog":
                rows = slice(1, None, 2) if order == "tff" else slice(0, None, 2)
                luma[rows] = late[rows]
            planes = np.concatenate([luma, np.full((HEIGHT // 2, WIDTH), 128, np.uint8)])
            picture = flagged(av.VideoFrame.from_ndarray(planes, format="yuv420p"), order)
            picture.pts, picture.time_base, picture.duration = time, Fraction(1, 25), 1
            output.mux(stream.encode(picture))
        output.mux(stream.encode(None))
    return path


def flagged(picture: av.VideoFrame, order: str) -> av.VideoFrame:
    graph = av.filter.Graph()
    entry = graph.add_buffer(width=WIDTH, height=HEIGHT, format=picture.format, time_base=Fraction(1, 25))
    graph.link_nodes(entry, graph.add("setfield", order), graph.add("buffersink")).configure()
    graph.vpush(picture)
    return graph.vpull()


# ------------------------------------------------------------------------------------------------------- deinterlacing


@pytest.mark.parametrize("order", ["tff", "bff"])
@pytest.mark.parametrize("codec", ["ffv1", "libx264"])
def test_each_field_becomes_a_frame_at_its_own_time(tmp_path, codec, order):
    """Fifty moments a second out of 25 pictures, each later than the one before, in the order that is flagged."""
    options = {"crf": "0", "preset": "ultrafast", "x264-params": f"{order}=1"} if codec == "libx264" else {}
    clip = write_fields(tmp_path / "in.mp4" if options else tmp_path / "in.avi", [order] * 6, codec, options)
    with VideoSource(clip, decoding=FIELDS) as source:
        assert (source.info.rate, source.info.frame_count) == (50, 12)
        frames = list(source)
        assert all((frame.time / source.info.time_base).denominator == 1 for frame in frames)
    assert [place(frame) for frame in frames] == pytest.approx(range(12), abs=0.05)
    assert [frame.time for frame in frames] == [Fraction(k, 50) for k in range(12)]
    assert {frame.duration for frame in frames} == {Fraction(1, 50)}
    assert not any(frame.original.interlaced_frame for frame in frames)
    assert source.remarks == []


@pytest.mark.parametrize(
    ("name", "times", "moments"),
    [("in.mkv", [0, 1, 4, 5], [0, 0.5, 1, 2.5, 4, 4.5, 5, 5.5]), ("in.avi", [0], [0, 0.5])],
    ids=["uneven", "single"],
)
def test_fields_lie_halfway_between_pictures(tmp_path, name, times, moments):
    """Also at a variable rate; with no neighbour to tell the interval, a picture's own duration does."""
    frames, remarks = read(write_fields(tmp_path / name, ["tff"] * len(times), times=times), FIELDS)
    assert [float(frame.time) * 25 for frame in frames] == pytest.approx(moments)
    assert remarks == []


@pytest.mark.parametrize(
    ("orders", "places", "which"),
    [
        (["prog"] * 4, [0, 0, 2, 2, 4, 4, 6, 6], "no frame"),
        (["prog", "tff", "tff", "prog"], [0, 0, 2, 3, 4, 5, 6, 6], "only 2 of 4 frames"),
    ],
)
def test_pictures_that_are_not_flagged_are_made_into_two_as_well(tmp_path, orders, places, which):
    """So that the rate is even; and it is said, for all of them and for some."""
    frames, remarks = read(write_fields(tmp_path / "in.mkv", orders), FIELDS)
    assert [place(frame) for frame in frames] == pytest.approx(places, abs=0.05)
    assert remarks[0].endswith(f" flags {which} as interlaced; every frame was made into two all the same.")


@pytest.mark.parametrize(
    ("orders", "which"),
    [(["prog", "prog", "tff", "bff", "prog"], " in 2 of 5 frames"), (["tff"] * 3, ""), (["prog"] * 3, None)],
)
def test_interlaced_frames_are_named_wherever_they_are(tmp_path, orders, which):
    """Also when the first one is none, with their number; and what to do."""
    clip = write_fields(tmp_path / "in.mkv", orders)
    said = f"{clip} is interlaced{which} and its fields were taken as whole pictures; pass `deinterlace=True`"
    assert [remark.partition(" for smooth")[0] for remark in read(clip)[1]] == [said] * (which is not None)


def test_formats_that_the_filter_does_not_know_keep_their_colours(tmp_path):
    """Deep colour with alpha, and full range, come out with the colours that they went in with."""
    for pixel_format, more in (("yuva444p12le", {}), ("yuv444p12le", {"color_range": 2}), ("bgra", {})):
        clip = write_clip(
            tmp_path / f"{pixel_format}.mkv", codec="ffv1", pixel_format=pixel_format, rate=Fraction(25), **more
        )
        with VideoSource(clip) as plain, VideoSource(clip, decoding=FIELDS) as fields:
            tags = [(each.traits.tagged_color_space, each.traits.color_range) for each in (plain, fields)]
            pairs = zip(list(plain), list(fields)[::2], strict=True)
            errors = [np.abs(white(b) - white(a)).mean() for a, b in pairs]
        assert pixel_format == "bgra" or tags[0] == tags[1]
        assert max(errors) < 0.01


def test_what_cannot_be_deinterlaced(tmp_path):
    """Pictures of a line or two have no fields, and a sentence says so."""
    clip = write_clip(tmp_path / "in.mkv", codec="ffv1", size=(2, 64), rate=Fraction(25))
    with pytest.raises(InputError, match=r"in\.mkv holds pictures of 64x2 yuv420p, which cannot be deinterlaced"):
        read(clip, FIELDS)


def test_a_deinterlaced_conversion(tmp_path):
    """Length, rate and moments of the output, and nothing flagged in it."""
    clip = write_fields(tmp_path / "in.mkv", ["bff"] * 6)
    summary = convert(str(clip), str(tmp_path / "out.mp4"), method="nearest", decoding=FIELDS, encoding=FAST)
    assert (summary.frames_in, summary.frames_out, summary.remarks) == (12, 24, [])
    pictures = pictures_of(tmp_path / "out.mp4")
    assert not any(picture.interlaced_frame for picture in pictures)
    assert [picture.pts * picture.time_base for picture in pictures] == [Fraction(k, 100) for k in range(24)]


# ---------------------------------------------------------------------------------------------------------- the streams


def write_two(path: Path, sizes: Sequence[tuple[int, int]], default: int | None = None) -> Path:
    """Write a clip with several videos of 4 frames (height, width), of which one may be flagged as the default."""
    with av.open(str(path), "w") as output:
        packets = []
        for number, size in enumerate(sizes):
            stream, its_packets = add_pictures(output, 4, codec="ffv1", size=size)
            stream.disposition = 1 if number == default else 0
            packets += its_packets
        mux_in_order(output, packets)
    return path


@pytest.mark.parametrize(
    ("sizes", "default", "taken"),
    [
        (((32, 32), (64, 64)), None, 1),
        (((64, 64), (32, 32)), None, 0),
        (((64, 64), (32, 32)), 1, 1),
        (((32, 32), (32, 32)), None, 0),
    ],
)
def test_of_several_videos_the_best_is_read(tmp_path, sizes, default, taken):
    """The one flagged as default, then the largest, then the first; the others are said to be left out."""
    clip = write_two(tmp_path / "in.mkv", sizes, default)
    with VideoSource(clip) as source:
        assert (source.file.stream_index, (source.info.height, source.info.width)) == (taken, sizes[taken])
        other = 1 - taken
        height, width = sizes[other]
        assert f"stream {taken} (ffv1 " in source.remarks[0]
        assert f"left out: stream {other} (ffv1 {width}x{height})" in source.remarks[0]


@pytest.mark.parametrize("alpha_first", [False, True])
def test_a_sequence_is_read_and_not_the_still_picture_beside_it(tmp_path, alpha_first):
    """As in an animated AVIF: a larger still by default, then colours and alpha, which is said to be left out."""
    clip = tmp_path / "in.mov"
    kinds = [(1, 96, "yuv420p"), (4, 64, "gray"), (4, 64, "yuv420p")]
    with av.open(str(clip), "w") as output:
        packets = []
        for count, width, kind in kinds if alpha_first else [kinds[0], kinds[2], kinds[1]]:
            # of one frame with B-frames, x265 gives decoding times from memory that it never wrote
            options = {"x265-params": "log-level=error:pools=none:frame-threads=1:bframes=0"}
            how = {"codec": "libx265", "pixel_format": kind, "options": options}
            packets += add_pictures(output, count, size=(48, width), **how)[1]
        mux_in_order(output, packets)
    colours = 2 if alpha_first else 1
    with VideoSource(clip) as source:
        assert (source.file.stream_index, len(list(source))) == (colours, 4)
        assert "left out: stream 0 (hevc 96x48, one frame)" in source.remarks[0]
        assert f"stream {3 - colours} (hevc" in source.remarks[0]


def test_a_stream_can_be_chosen(tmp_path):
    """By its number in the file."""
    clip = write_two(tmp_path / "in.mkv", ((32, 32), (64, 64)))
    with VideoSource(clip, decoding=DecodeOptions(stream=0)) as source:
        assert (source.info.width, len(list(source))) == (32, 4)
    summary = convert(
        str(clip), str(tmp_path / "out.mp4"), method="nearest", decoding=DecodeOptions(stream=0), encoding=FAST
    )
    assert "left out: stream 1" in summary.remarks[0]
    assert pictures_of(tmp_path / "out.mp4")[0].width == 32


@pytest.mark.parametrize("wanted", [1, 3, 9])
def test_a_wrong_stream_lists_the_videos(tmp_path, wanted):
    """Sound, cover and no stream at all are none."""
    clip = write_clip(tmp_path / "in.mkv", sound="aac", cover=png())
    with pytest.raises(OptionError, match=rf"`stream={wanted}` is no video stream of .*; choose one of 0 \(h264 64x48"):
        VideoSource(clip, decoding=DecodeOptions(stream=wanted))


# ---------------------------------------------------------------------------------------------------------- their sizes


def changing(folder: Path, *parts: dict, options: dict[str, str] | None = None) -> Path:
    """One stream of several parts, five frames each; where options of the encoder are given, a pause between them."""
    data = []
    step = 8 if options else 5
    options = options or {"preset": "ultrafast", "bf": "0"}
    for number, part in enumerate(parts):
        name = folder / f"part{number}.ts"
        times = range(step * number, step * number + 5)
        data.append(write_clip(name, times=times, options=options, **part).read_bytes())
    clip = folder / "in.ts"
    clip.write_bytes(b"".join(data))
    return clip


def test_a_change_of_size_stops_or_scales(tmp_path):
    """It stops with a sentence that says what to pass, or makes all like the first and counts them."""
    clip = changing(tmp_path, {"size": (48, 64)}, {"size": (96, 128)})
    with pytest.raises(InputError, match=r"from 64x48 yuv420p to 128x96 yuv420p at frame 5; convert it with `siz"):
        read(clip)
    assert "convert it with `size_change='scale'`" in probe(str(clip)).conversion.refused
    frames, remarks = read(clip, SCALE)
    assert {frame.image.shape for frame in frames} == {(48, 64, 3)}
    assert "changes from 64x48 yuv420p to 128x96 yuv420p at frame 5; 5 frames were made like the first" in remarks[-1]
    assert all(a.time < b.time for a, b in pairwise(frames))
    assert {(frame.original.width, frame.original.format.name) for frame in frames} == {(64, "yuv420p")}
    small = np.asarray(frames[-1].image, float)
    assert np.abs(small - scene(4, 96, 128).reshape(48, 2, 64, 2, 3).mean(axis=(1, 3))).mean() < 4


@pytest.mark.parametrize(
    "later",
    [
        {"pixel_format": "yuv444p10le"},
        {"pixel_format": "yuvj444p", "color_range": 2},
        {"size": (72, 96), "colorspace": 1, "color_range": 1},
    ],
    ids=["deep", "full range", "other matrix"],
)
def test_later_pictures_keep_their_colours(tmp_path, later):
    """Depth, range and matrix become the first one's, and the colours stay what they were."""
    frames, remarks = read(changing(tmp_path, {"colorspace": 5, "color_range": 1}, later), SCALE)
    assert "made like the first" in remarks[-1]
    assert {(frame.image.shape, frame.image.dtype.name) for frame in frames} == {((48, 64, 3), "uint8")}
    last = frames[-1]
    truth = scene(4, *later.get("size", (48, 64)))
    assert np.abs(last.image.mean(axis=(0, 1)) - truth.mean(axis=(0, 1))).max() < 2.5
    assert last.original.color_range == frames[0].original.color_range
    assert last.original.colorspace == frames[0].original.colorspace


def test_a_range_that_changes_is_always_converted(tmp_path):
    """Nobody need ask for it, since no size changes: frames after it look like those before."""
    clip = changing(tmp_path, {"colorspace": 5, "color_range": 1}, {"pixel_format": "yuvj420p", "color_range": 2})
    frames, remarks = read(clip)
    assert "changes its colour matrix or range at frame 5; 5 frames were converted to the first's" in remarks[-1]
    assert {frame.original.color_range for frame in frames} == {1}
    difference = frames[9].image.astype(float) - frames[4].image
    assert np.abs(difference).mean() < 3
    assert np.abs(difference.mean(axis=(0, 1))).max() < 0.7


@pytest.mark.parametrize("options", [{"bf": "0"}, {"bf": "3", "b-adapt": "0"}], ids=["in order", "reordered"])
@pytest.mark.parametrize(
    ("first", "later", "change", "shown"),
    [
        (
            {"sample_aspect_ratio": Fraction(16, 15)},
            {"sample_aspect_ratio": Fraction(64, 45)},
            "from 64x48 yuv420p with pixels of 16:15 to 64x48 yuv420p with pixels of 64:45 at frame 5",
            (36, 64),
        ),
        (
            {"sample_aspect_ratio": Fraction(4, 3)},
            {},
            "from 64x48 yuv420p with pixels of 4:3 to 64x48 yuv420p with pixels of 1:1 at frame 5",
            (48, 48),
        ),
        ({}, {"size": (96, 64)}, "from 64x48 yuv420p to 64x96 yuv420p at frame 5", (48, 32)),
    ],
    ids=["wider pixels", "narrower pixels", "higher"],
)
def test_another_shape_is_not_squeezed(tmp_path, first, later, change, shown, options):
    """Pictures of another shape, by their size or their pixels', stop, or are scaled with black beside them."""
    clip = changing(tmp_path, first, later, options={"preset": "ultrafast", **options})
    with pytest.raises(InputError, match=re.escape(change)):
        read(clip)
    frames, remarks = read(clip, SCALE)
    assert f"changes {change}; 5 frames were made like the first" in remarks[-1]
    assert {frame.image.shape for frame in frames} == {(48, 64, 3)}
    assert np.abs(frames[4].image - scene(4).astype(float)).mean() < 12
    height, width = shown
    top, left = (48 - height) // 2, (64 - width) // 2
    truth = cv2.resize(scene(4, *later.get("size", (48, 64))), (width, height), interpolation=cv2.INTER_AREA)
    for frame in frames[5:]:
        part = frame.image[top : top + height, left : left + width]
        beside = frame.image.astype(float).sum() - part.astype(float).sum()
        assert beside / max(1, frame.image.size - part.size) < 3
    assert np.abs(part - truth.astype(float)).mean() < 12
    assert {frame.original.color_range for frame in frames} == {frames[0].original.color_range}


@pytest.mark.parametrize(
    ("later", "change", "stops"),
    [
        ({"color_trc": 16}, "from transfer bt709, primaries bt709 to transfer pq, primaries bt709 at frame 5", True),
        ({"color_primaries": 9}, "primaries bt709 to transfer bt709, primaries bt2020 at frame 5", True),
        ({"color_trc": 6}, "to transfer smpte170m, primaries bt709 at frame 5", False),
        ({"color_primaries": 5}, "to transfer bt709, primaries bt470bg at frame 5", False),
        ({"color_trc": 2}, "to transfer untagged, primaries bt709 at frame 5", False),
    ],
)
def test_colours_that_change_are_said(tmp_path, later, change, stops):
    """HDR or wide colours within ordinary ones stop, or keep their numbers if asked; what looks alike is remarked."""
    first = {"color_trc": 1, "color_primaries": 1}
    clip = changing(tmp_path, first, {**first, **later})
    if stops:
        with pytest.raises(InputError, match=re.escape(change)):
            read(clip)
    frames, remarks = read(clip, SCALE if stops else DecodeOptions())
    assert f"{change}; 5 frames kept the numbers they have." in remarks[-1]
    assert {(frame.original.color_trc, frame.original.color_primaries) for frame in frames} == {(1, 1)}


def test_sizes_that_change_can_be_deinterlaced(tmp_path):
    """Fields become frames before anything is scaled, and none is lost at the change."""
    clip = changing(tmp_path, {"size": (48, 64)}, {"size": (96, 128)})
    plain, _ = read(clip, SCALE)
    frames, _ = read(clip, DecodeOptions(deinterlace=True, size_change="scale"))
    assert len(frames) == 2 * len(plain)
    assert {frame.image.shape for frame in frames} == {(48, 64, 3)}


# --------------------------------------------------------------------------------------------------- where it is given


def test_options_that_mean_nothing_are_refused(tmp_path, save_images):
    """Images and pipes have neither fields nor streams, and a sentence says so."""
    save_images(tmp_path / "in", count=2)
    for decoding, option in (
        (FIELDS, "`deinterlace`"),
        (SCALE, "`size_change`"),
        (DecodeOptions(stream=0), "`stream`"),
    ):
        with pytest.raises(OptionError, match=rf"{option} is for video files and not for .*in, which holds images"):
            open_source(str(tmp_path / "in"), decoding=replace(decoding, input_fps=24))
        with pytest.raises(OptionError, match=rf"{option} is for video files and not for standard input"):
            open_source("-", decoding=decoding)


def test_the_command_line(fpsboost_, tmp_path):
    """Every option arrives."""
    write_fields(tmp_path / "in.mkv", ["tff"] * 4)
    cheap = ("-m", "nearest", "--preset", "ultrafast", "-y")
    assert "8 -> 16 frames" in fpsboost_("in.mkv", "out.mp4", "--deinterlace", *cheap).err
    refused = fpsboost_("in.mkv", "out.mp4", "--stream", "3", *cheap)
    assert (refused.code, len(refused.lines)) == (2, 1)
    assert "--stream 3 is no video stream of in.mkv; choose one of 0 (ffv1 64x48)." in refused.err
    changing(tmp_path, {"size": (48, 64)}, {"size": (96, 128)})
    assert fpsboost_("in.ts", "out.mp4", *cheap).code == 1
    assert fpsboost_("in.ts", "out.mp4", "--size-change", "scale", *cheap).code == 0
    assert "--deinterlace makes two of each" in fpsboost_("probe", "in.mkv").out
    assert fpsboost_("probe", "in.mkv", "--stream", "7").code == 2
