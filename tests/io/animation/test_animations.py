"""GIF, APNG and WebP: every picture as players show it, alpha, delays without drift, and how often it plays."""

from contextlib import suppress
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

import fpsboost
from fpsboost import ClipInfo, Frame, InputError, MemoryLimit, OutputError, Timing
from fpsboost.image import Image
from fpsboost.io.animation.sink import AnimationSink
from fpsboost.io.animation.source import AnimationSource
from fpsboost.io.animation.writers import GifWriter
from fpsboost.io.opening import open_source
from fpsboost.io.output import Output, StreamInfo
from fpsboost.media import OutputTiming
from support.animation_truth import disc, plays_of, read_animation, write_animation
from support.video_truth import pictures_of, scene, write_clip

RATE = Fraction(10)
SUFFIXES = (".gif", ".apng", ".webp")
EXACT = (".apng", ".webp")


def write(
    path: Path, images: list[Image], durations: list[Fraction] | None = None, *, plays: int = 0, rate: Fraction = RATE
) -> AnimationSink:
    """Write images through the sink."""
    durations = durations or [1 / rate] * len(images)
    height, width = images[0].shape[:2]
    info = ClipInfo("test", height, width, rate, 1 / rate, len(images))
    time = Fraction(3)  # a clip may begin at any time
    output = Output(str(path), info, OutputTiming(rate, 1 / rate), StreamInfo(plays=plays))
    with AnimationSink(output) as sink:
        for image, duration in zip(images, durations, strict=True):
            sink.write(Frame(image, time, duration))
            time += duration
    return sink


def read(path: Path) -> list[Frame]:
    with AnimationSource(str(path)) as source:
        return list(source)


@pytest.mark.parametrize("suffix", EXACT)
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_every_pixel_is_kept(tmp_path, suffix, channels):
    """APNG and WebP come back as they were written; WebP not the colours under full transparency."""
    images = [disc(index, hidden=77)[..., 4 - channels :] for index in range(5)]
    images[3] = images[2]  # a frame that repeats one is a frame all the same
    path = tmp_path / f"out{suffix}"
    assert write(path, images).remarks == []
    for image, frame in zip(images, read(path), strict=True):
        expected = image if channels > 1 else np.repeat(image, 3, axis=2)
        compared = expected[..., 3] > 0 if channels == 4 and suffix == ".webp" else np.full(expected.shape[:2], True)
        assert np.array_equal(frame.image[..., 3:], expected[..., 3:])
        assert np.array_equal(frame.image[compared], expected[compared])


def test_deep_apng(tmp_path):
    """16 bits with alpha go into an APNG; reading it takes 8 bits and says so."""
    images = [np.random.default_rng(index).integers(0, 65536, (12, 16, 4), dtype=np.uint16) for index in range(3)]
    write(tmp_path / "out.apng", images)
    with av.open(str(tmp_path / "out.apng"), format="apng") as file:
        for picture, image in zip(file.decode(video=0), images, strict=True):
            assert np.array_equal(picture.to_ndarray(), image[..., [2, 1, 0, 3]])
    with AnimationSource(str(tmp_path / "out.apng")) as source:
        assert all(np.array_equal(frame.image, image >> 8) for frame, image in zip(source, images, strict=True))
        assert "16 bits per channel" in source.remarks[0]


def test_deep_gray_apng(tmp_path):
    """Gray of 16 bits is read as dark and as bright as FFmpeg shows it."""
    path = write_clip(tmp_path / "in.apng", times=range(3), codec="apng", pixel_format="gray16be", container="apng")
    truth = [picture.to_ndarray(format="gray").astype(int) for picture in pictures_of(path)]
    assert all(np.abs(frame.image[..., 0] - gray).max() <= 1 for frame, gray in zip(read(path), truth, strict=True))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_depth_that_is_lost_is_said(tmp_path, suffix):
    """Float images are rounded to what the type holds, premultiplied alpha becomes straight, and a remark says so."""
    image = np.zeros((12, 16, 4), np.float32)
    image[:6] = (0.4, 0.2, 0.1, 1)
    image[3:6] = (2, np.nan, -1, 1)
    image[8:] = (0, 0, 0.5, 0.5)
    (remark,) = write(tmp_path / f"out{suffix}", [image, image]).remarks
    assert f"out{suffix} lost" in remark
    back = read(tmp_path / f"out{suffix}")[1].image.astype(float)
    assert np.abs(back[:3] - (102, 51, 25.5, 255)).max() < 1.1
    assert np.array_equal(back[3:6], np.broadcast_to([255, 0, 0, 255], back[3:6].shape))
    assert not back[6:8, :, 3].any()
    assert suffix == ".gif" or back[9, 0].tolist() == [0, 0, 255, 128]


def test_a_gif_of_few_colours_keeps_them(tmp_path):
    """What fits a palette comes back within a tenth of a level on average, also after a picture of more.

    Whatever hides under transparency, and at a width whose rows FFmpeg would pad.
    """
    rng = np.random.default_rng(1)
    images = []
    for index in range(4):
        palette = rng.integers(0, 256, (255, 3), dtype=np.uint8)
        image = np.full((48, 66, 4), 255, np.uint8)
        image[..., :3] = palette[np.arange(48 * 66).reshape(48, 66) % 255]
        hidden = rng.random((48, 66)) < 0.2
        image[hidden] = rng.integers(0, 256, (hidden.sum(), 4)) // (1, 1, 1, 2)
        images += [image, np.dstack([scene(index, 48, 66), image[..., 3]])]
    path = tmp_path / "out.gif"
    write(path, images)
    for number, (image, seen, frame) in enumerate(zip(images, read_animation(path), read(path), strict=True)):
        opaque = image[..., 3] > 127
        for back in (seen.image, frame.image):
            assert np.array_equal(back[..., 3] == 255, opaque)
            assert np.abs(back.astype(float) - image)[opaque][:, :3].mean() <= (4 if number % 2 else 0.1)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("plays", [0, 1, 5])
def test_how_often_it_plays(tmp_path, suffix, plays):
    """The number of times goes from file to file, although GIF counts repeats and the others plays."""
    path = tmp_path / f"in{suffix}"
    write(path, [scene(0), scene(1)], plays=plays)
    assert plays_of(path) == plays
    for other in SUFFIXES:
        fpsboost.convert(str(path), str(tmp_path / f"out{other}"), method="nearest")
        assert plays_of(tmp_path / f"out{other}") == plays


@pytest.mark.parametrize("kind", ["gif", "apng"])
@pytest.mark.parametrize("disposal", [0, 1, 2])
def test_composited_frames(tmp_path, kind, disposal):
    """Frames that are laid over others, and cleared or not afterwards, are what FFmpeg sees."""
    images = [disc(index) for index in range(4)]
    for image in images:
        image[..., 3] = np.where(image[..., 3] > 127, 255, 0)
    path = write_animation(tmp_path / f"in.{kind}", images, disposal=disposal, optimize=False)
    with av.open(str(path), format=kind) as file:
        truth = [picture.to_ndarray(format="bgra") for picture in file.decode(video=0)]
    for frame, image in zip(read(path), truth, strict=True):
        assert np.array_equal(frame.image[..., 3], image[..., 3])
        assert np.array_equal(frame.image[image[..., 3] > 0], image[image[..., 3] > 0])


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("colours", ["few", "many", "in turns"])
def test_opaque_frames_among_transparent_ones(tmp_path, suffix, colours):
    """Each frame takes the place of the one before, also where it is transparent and that one was not."""
    few, many = np.full((48, 64, 3), (10, 20, 30), np.uint8), scene(0)
    images = []
    for number, is_hole in enumerate([True, False, True, True, False]):
        image = many if colours == "many" or (colours == "in turns" and number % 3 == 1) else few
        image = np.dstack([image, np.full(image.shape[:2], 255, np.uint8)])
        if is_hole:
            image[2:6, 2:6, 3] = 0
        images.append(image)
    write(tmp_path / f"out{suffix}", images)
    for frame, image in zip(read(tmp_path / f"out{suffix}"), images, strict=True):
        assert np.array_equal(frame.image[..., 3], image[..., 3])
        assert np.abs(frame.image.astype(int) - image)[image[..., 3] > 0].mean() < 4


@pytest.mark.parametrize(
    ("suffix", "delays", "found"),
    [
        *((suffix, [20, 70, 500, 20], [20, 70, 500, 20]) for suffix in SUFFIXES),
        (".gif", [0, 10, 20, 20], [100, 100, 20, 20]),  # too short ones are a tenth of a second, as in every browser
    ],
)
def test_delays_are_read(tmp_path, suffix, delays, found):
    """Every frame comes at the sum of the delays before it; they tell the usual rate, clock, count and length."""
    path = write_animation(tmp_path / f"in{suffix}", [scene(index) for index in range(4)], delays)
    with AnimationSource(str(path)) as source:
        frames = list(source)
    assert [frame.time * 1000 for frame in frames] == [sum(found[:index]) for index in range(4)]
    assert [frame.duration * 1000 for frame in frames] == found
    assert (source.info.rate, source.info.frame_count) == (50, 4)
    assert source.info.duration == Fraction(sum(found), 1000)
    assert all((frame.time / source.info.time_base).denominator == 1 for frame in frames)


RATES = [(suffix, Fraction(text)) for suffix in (".gif", ".webp") for text in ("1001/24000", "1/48", "1/30")]
RATES += [(".apng", Fraction(text)) for text in ("1001/60000", "1/3", "1001/120000", "123457/90000")]


@pytest.mark.parametrize(("suffix", "delay"), RATES)
def test_delays_do_not_drift(tmp_path, suffix, delay):
    """Each frame starts within half a tick, up to the last; fractions of 16 bits are exact in an APNG.

    The last frame of an APNG is shown as long as the one before, and a remark says so.
    """
    images = [np.full((4, 4, 3), index, np.uint8) for index in range(50 if suffix == ".apng" else 200)]
    delays = [*[delay] * (len(images) - 1), 3 * delay]
    sink = write(tmp_path / f"out{suffix}", images, delays, rate=1 / delay)
    assert ("shows its last frame as long as" in "".join(sink.remarks)) == (suffix == ".apng")
    assert sink.remarks == [] or suffix == ".apng"
    tolerance = {".gif": Fraction(1, 200), ".webp": Fraction(1, 2000)}.get(suffix, 0)
    if suffix == ".apng" and max(delay.numerator, delay.denominator) > 65535:
        tolerance = 1e-7
    frames = read(tmp_path / f"out{suffix}")
    assert max(abs(frame.time - index * delay) for index, frame in enumerate(frames)) <= tolerance
    assert abs(frames[-1].duration - (1 if suffix == ".apng" else 3) * delay) <= 2 * tolerance


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_long_still_is_repeated(tmp_path, suffix):
    """A delay that is longer than the file can say becomes two frames, and nothing is cut off."""
    delay = Fraction({".gif": 700, ".apng": 70_000, ".webp": 17_000}[suffix])
    write(tmp_path / f"out{suffix}", [scene(0), scene(1)], [delay, Fraction(1)])
    times = [frame.time for frame in read(tmp_path / f"out{suffix}")]
    assert len(times) == 3
    assert times[2] == delay


def test_gif_ends_at_fifty_frames(tmp_path):
    """A rate that players of GIF slow down is refused, with what to do, before anything is made."""
    clip = write_clip(tmp_path / "in.mp4", times=range(4), time_base=Fraction(1, 30))
    with pytest.raises(OutputError, match=r"out\.gif cannot show 60 frames .* 50; use `fps=50` or less.*\.apng"):
        fpsboost.convert(str(clip), str(tmp_path / "out.gif"), factor=2)
    fpsboost.convert(str(clip), str(tmp_path / "out.gif"), method="blend", timing=Timing(fps=50))
    assert {seen.delay for seen in read_animation(tmp_path / "out.gif")} == {20}


@pytest.mark.parametrize(
    ("delays", "options", "expected"),
    [
        ([30] * 4, {}, [20] * 6),
        ([30] * 4, {"loop": True}, [20] * 6),
        ([30] * 4, {"keep_timing": True}, [20] * 6),
        ([20] * 4, {}, [20] * 4),
        ([16, 17, 17] * 2, {"retime": "0=0 0.1s=0.1s"}, [20] * 5),
        ([10] * 4, {"slow_motion": True}, [20] * 4),
        ([30, 30, 2000, 30], {}, [20, 20, 20, 1330, 680, 20]),
        ([40] * 4, {}, None),
    ],
    ids=str,
)
def test_nobody_asked_for_more_than_a_gif_can_show(tmp_path, delays, options, expected):
    """Without a rate, a GIF gets at most 50 frames per second, and a note says so; what takes less has none."""
    clip = write_animation(tmp_path / "in.webp", [disc(index) for index in range(len(delays))], delays)
    summary = fpsboost.convert(str(clip), str(tmp_path / "out.gif"), method="blend", **options)
    assert [seen.delay for seen in read_animation(tmp_path / "out.gif")] == (expected or [20] * 8)
    note = f"{tmp_path / 'out.gif'} has 50 frames per second, the most that .gif can show."
    assert (note in summary.remarks) == (expected is not None)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("loop", [False, True])
@pytest.mark.parametrize("place", [1, 5])
def test_a_long_frame_is_held(tmp_path, suffix, loop, place):
    """One of two seconds among those of a tenth: all frames of the animation are in a video of twice their usual rate.

    Nothing is made between the long frame and the next, in an animation neither, and a loop that ends with it says so.
    """
    levels, delays = list(range(0, 240, 40)), [2000 if number == place else 100 for number in range(6)]
    images = [np.full((16, 16, 3), level, np.uint8) for level in levels]
    path, out = write_animation(tmp_path / f"in{suffix}", images, delays), tmp_path / f"out{suffix}"
    ready = [(str(path), str(tmp_path / "out.mov")), (str(path), str(out))]
    video, again = (fpsboost.convert(*names, method="blend", loop=loop) for names in ready)
    shown = [int(np.rint(picture.to_ndarray(format="gray").mean())) for picture in pictures_of(tmp_path / "out.mov")]
    begin = [2 * sum(delays[:number]) // 100 for number in range(6)]
    assert len(shown) == 50
    assert [shown[number] for number in begin] == pytest.approx(levels, abs=3)
    assert shown[begin[place] : begin[place] + 40] == pytest.approx([levels[place]] * 40, abs=3)
    of_level = [seen.delay for seen in read_animation(out) if abs(int(seen.image[8, 8, 0]) - levels[place]) < 4]
    assert of_level == [1000, 1000]
    for summary in (video, again):
        assert any("holds its last frame, and so does its loop" in each for each in summary.remarks) == (
            loop and place == 5
        )
        assert any("shows nothing new for 2.0 s from 0.1 s on" in each for each in summary.remarks) == (place == 1)


@pytest.mark.parametrize(
    ("suffix", "delays", "found", "words"),
    [
        (".gif", [10, 1, 1, 10, 10], [10, 2, 2, 8, 10], "up to 20 ms late"),
        *((suffix, [1, 1], [1, 1], "10 ms and less, which browsers slow down") for suffix in EXACT),
    ],
)
def test_short_delays_are_said(tmp_path, suffix, delays, found, words):
    """What is too short for a GIF gets its shortest delay, and the next frames make up for it; others stay as they are.

    One remark says that frames come late, or that browsers take ten times as long for them.
    """
    durations = [Fraction(delay, 100) for delay in delays]
    images, rate = [scene(index) for index in range(len(delays))], Fraction(10 if suffix == ".gif" else 100)
    sink = write(tmp_path / f"out{suffix}", images, durations, rate=rate)
    assert [seen.delay for seen in read_animation(tmp_path / f"out{suffix}")] == [10 * delay for delay in found]
    (remark,) = sink.remarks
    assert words in remark


@pytest.mark.parametrize("source", SUFFIXES)
@pytest.mark.parametrize("target", SUFFIXES)
def test_between_animations(tmp_path, source, target):
    """Doubling keeps the delays' rhythm, the length and the alpha, from any of them to any other."""
    path = write_animation(tmp_path / f"in{source}", [disc(index) for index in range(3)], [100, 200, 40])
    fpsboost.convert(str(path), str(tmp_path / f"out{target}"), method="blend")
    seen = read_animation(tmp_path / f"out{target}")
    assert [each.delay for each in seen] == [50, 50, 100, 100, 20, 20]
    assert all(each.image[24, 20, 3] == 255 and each.image[0, 0, 3] == 0 for each in seen)


@pytest.mark.parametrize("hidden", [0, 255])
def test_no_fringes(tmp_path, hidden):
    """A made frame has the disc's colour up to its edge, whatever colour is hidden around it."""
    path = write_animation(tmp_path / "in.png", [disc(index, hidden) for index in range(4)], 100)
    fpsboost.convert(str(path), str(tmp_path / "out.apng"), method="nlm-fast")
    for seen in read_animation(tmp_path / "out.apng")[2:5]:
        visible = seen.image[..., 3] > 8
        assert np.abs(seen.image[visible][:, :3].astype(int) - (40, 120, 240)).max() <= 16
        assert 550 < (seen.image[..., 3] / 255).sum() < 750


def test_video_gets_white_where_it_sees_through(tmp_path):
    """A video holds no alpha: frames are laid over white, soft edges too, and a remark says so."""
    path = write_animation(tmp_path / "in.webp", [disc(index) for index in range(3)], 100)
    summary = fpsboost.convert(str(path), str(tmp_path / "out.mkv"), method="blend")
    (remark,) = [each for each in summary.remarks if "transparent" in each]
    assert "in.webp" in remark
    first = pictures_of(tmp_path / "out.mkv")[0].to_ndarray(format="bgr24")
    assert first[:4].min() > 245
    assert np.abs(first[24, 16].astype(int) - (40, 120, 240)).max() < 16


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_opaque_animations_have_no_alpha(tmp_path, suffix):
    """Where nothing can be seen through, frames are BGR and a video has nothing to say."""
    path = write_animation(tmp_path / f"in{suffix}", [scene(0), scene(1), scene(2)])
    assert read(path)[0].image.shape == (48, 64, 3)
    assert fpsboost.convert(str(path), str(tmp_path / "out.mp4"), method="blend").remarks == []


def test_videos_to_animation_say_what_is_lost(tmp_path):
    """Sound has no place in an animation."""
    clip = write_clip(tmp_path / "in.mkv", times=range(3), sound="aac")
    (remark,) = fpsboost.convert(str(clip), str(tmp_path / "out.webp"), method="blend").remarks
    assert "in.mkv has sound" in remark


@pytest.mark.parametrize("suffix", [".gif", ".apng"])
def test_a_truncated_animation(tmp_path, suffix):
    """What is whole is converted, and a remark says how much that was."""
    whole = write_animation(tmp_path / f"in{suffix}", [scene(index) for index in range(6)])
    path = tmp_path / f"cut{suffix}"
    path.write_bytes(whole.read_bytes()[: int(whole.stat().st_size * 0.7)])
    with AnimationSource(str(path)) as source:
        frames = list(source)
    assert 2 <= len(frames) < 6
    truth = read_animation(whole)
    assert all(np.array_equal(a.image, b.image[..., :3]) for a, b in zip(frames, truth, strict=False))
    assert [remark for remark in source.remarks if f"cut{suffix} is damaged or ends early" in remark]


@pytest.mark.parametrize(("suffix", "kept"), [(suffix, kept) for suffix in SUFFIXES for kept in (14, 60)])
def test_hardly_the_beginning_of_an_animation(tmp_path, suffix, kept):
    """A file that ends within its header is an InputError that names it."""
    path = write_animation(tmp_path / f"in{suffix}", [scene(index) for index in range(3)])
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(InputError, match=rf"in{suffix}"), open_source(str(path)) as source:
        list(source)


SMALL = MemoryLimit(500_000_000)  # nothing is learned from canvases of many millions of pixels, which take their time


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_flipped_bits(tmp_path, suffix):
    """Damage anywhere leads to frames or to a sentence, never to anything else."""
    whole = bytearray(write_animation(tmp_path / f"in{suffix}", [disc(index) for index in range(3)]).read_bytes())
    rng = np.random.default_rng(3)
    path = tmp_path / f"bad{suffix}"
    for _ in range(40):
        data = whole.copy()
        for place in rng.integers(0, len(data), 3):
            data[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(data)
        frames: list[Frame] = []
        with suppress(InputError), open_source(str(path), limit=SMALL) as source:
            frames += source
            assert frames


def test_options_for_video_are_refused(fpsboost_, tmp_path):
    """--crf and its like are for video; the message says what the output is."""
    write_animation(tmp_path / "in.gif", [scene(0), scene(1)])
    result = fpsboost_("in.gif", "out.webp", "--crf", 3, "--codec", "vp9")
    assert result.code == 2
    assert "out.webp will be an animation, which takes no --codec or --crf" in result.err


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_an_animation_that_cannot_be_read_back_is_not_published(tmp_path, monkeypatch, suffix):
    """It ends in a sentence and leaves nothing behind."""
    monkeypatch.setattr("fpsboost.io.animation.writers.AnimationWriter.finish", lambda self: self._file.truncate(20))
    with pytest.raises(OutputError, match=rf"out\{suffix} was not written because it cannot be read back; check"):
        write(tmp_path / f"out{suffix}", [scene(number) for number in range(3)])
    assert not list(tmp_path.iterdir())


def test_nothing_stays_where_the_muxer_cannot_be_opened(tmp_path, monkeypatch):
    """The hidden file is gone."""
    monkeypatch.setattr(GifWriter, "muxer", "none")
    with pytest.raises(ValueError, match="none"):
        write(tmp_path / "out.gif", [scene(0)])
    assert list(tmp_path.iterdir()) == []


def test_a_default_image_is_no_frame(tmp_path):
    """What an APNG shows where nothing moves is left out, if it is not part of the animation."""
    frames = read(write_animation(tmp_path / "in.png", list(map(scene, range(3))), [70, 200], default_image=True))
    assert [frame.duration for frame in frames] == [Fraction(7, 100), Fraction(1, 5)]
    assert np.array_equal(frames[0].image, scene(1))


def test_an_animated_jpeg_xl_is_refused(tmp_path):
    """By its name as an animation, not as a single image."""
    (tmp_path / "in.jxl").write_bytes(
        bytes.fromhex(  # of two gray frames
            "ff0a410403088a4b0208029209000018004b188b158201080292050044004b188b15c241014e240000000000000000"
        )
    )
    with pytest.raises(InputError, match=r"in\.jxl is an animated JPEG XL, which cannot be read; convert it to \.apng"):
        open_source(str(tmp_path / "in.jxl"))
