"""What `fpsboost probe` finds out about a clip, as data, on the terminal and as JSON."""

import json
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from fpsboost import InputError, OptionError, convert
from fpsboost.cli.probe import facts, read_probe
from fpsboost.probing import probe
from support.animation_truth import disc, write_animation
from support.held_frames import CADENCES, encode, held, pan
from support.video_truth import QUARTER_TURN, png, spoil_packets, turntable, write_clip


def test_a_plain_clip(tmp_path):
    """Size, times and what a conversion would do, which is what a conversion does."""
    clip = write_clip(tmp_path / "in.mp4", times=range(12), time_base=Fraction(1001, 24000))
    found = probe(str(clip))
    assert (found.width, found.height, found.frames, found.declared_frames) == (64, 48, 12, 12)
    assert (found.exact_rate, found.varies) == ("24000/1001", False)
    assert found.shortest == found.median == found.longest == pytest.approx(1001 / 24000)
    assert (found.start, found.duration) == (0, pytest.approx(12 * 1001 / 24000))
    assert (found.duplicates, found.cuts, found.interlaced, found.remarks) == (0, [], 0, [])
    summary = convert(str(clip), str(tmp_path / "out.mp4"), method="nearest")
    assert found.conversion.frames == summary.frames_out
    assert found.conversion.rate == pytest.approx(48000 / 1001)
    assert (found.conversion.refused, found.conversion.remarks) == (None, summary.remarks)


@pytest.mark.parametrize(("frames", "loops"), [(12, True), (7, False), (2, False)])
def test_a_loop_is_offered(tmp_path, frames, loops):
    """Of a whole turn of a turntable; not of a part, whose last frame and first one differ more, nor of two frames."""
    clip = write_animation(tmp_path / "in.gif", turntable(12)[:frames])
    assert ("loop" in facts(probe(str(clip)))) == loops


def test_every_stream_is_listed(tmp_path):
    """Number, kind, codec, language, and whether an .mp4 holds it."""
    subtitles = [(0, 200, b"Hello")]
    clip = write_clip(tmp_path / "in.mkv", sound="aac", subtitles=subtitles, second_video=True, cover=png())
    found = probe(str(clip))
    kinds = {stream.kind: stream for stream in found.streams}
    assert [stream.kind for stream in found.streams].count("video") == 2
    assert [stream.carries_over for stream in found.streams if stream.kind == "video"] == [True, False]
    sound = kinds["audio"]
    assert (sound.codec, sound.language, sound.details) == ("aac", "fra", "48000 Hz, stereo")
    assert (sound.carries_over, kinds["cover"].codec, kinds["subtitle"].codec) == (True, "png", "subrip")
    assert any("more than one video stream" in remark for remark in found.remarks)


def test_what_is_refused_or_lost_is_said_beforehand(tmp_path):
    """In the words of the conversion itself, and nothing is left behind by asking."""
    clip = write_clip(tmp_path / "in.mkv", times=range(4), codec="ffv1", pixel_format="yuv444p16le")
    found = probe(str(clip))
    summary = convert(str(clip), str(tmp_path / "out.mp4"), method="nearest")
    assert found.conversion.refused is None
    assert "has less depth" in summary.remarks[0]
    assert found.conversion.remarks == [summary.remarks[0].about(str(tmp_path / "out.mp4"), "out.mp4").expected]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in.mkv", "out.mp4"]


def test_how_pictures_are_to_be_shown(tmp_path):
    """Rotation, pixel shape, colour tags and range."""
    tags = {"colorspace": 1, "color_primaries": 9, "color_trc": 16, "color_range": 2}
    clip = write_clip(tmp_path / "in.mp4", matrix=QUARTER_TURN, sample_aspect_ratio=Fraction(4, 3), **tags)
    look = probe(str(clip)).look
    assert look is not None
    assert (look.rotation, look.pixel_aspect, look.full_range) == (90, "4:3", True)
    assert (look.matrix, look.primaries, look.transfer) == ("bt709", "bt2020", "pq")


@pytest.mark.parametrize(("times", "varies"), [((0, 3, 4, 9, 10, 16), True), ((0, 4, 8, 12, 16, 20), False)])
def test_whether_the_rate_varies(tmp_path, times, varies):
    """Told from the times of the frames and not from the header."""
    found = probe(str(write_clip(tmp_path / "in.mp4", times=times, time_base=Fraction(1, 100))))
    assert found.varies is varies
    gaps = np.diff(times) / 100
    assert (found.shortest, found.median, found.longest) == pytest.approx((gaps.min(), np.median(gaps), gaps.max()))


def test_duplicates_and_cuts(tmp_path):
    """As many as a conversion finds, and when."""
    frames = held([2, 2, 3, 2, 2], lambda first: pan(1.5 * first, seed=1 if first < 7 else 2))
    clip = encode(tmp_path / "in.mp4", [frame.image for frame in frames], 10)
    found, summary = probe(str(clip)), convert(str(clip), str(tmp_path / "out.mp4"), method="blend")
    assert (found.duplicates, summary.duplicates) == (4, 4)  # those before the cut stay
    assert found.cuts == pytest.approx([7 / 24])


def test_interlaced_frames_are_counted(tmp_path):
    """By the flag on each of them."""
    options = {"x264-params": "tff=1"}
    assert probe(str(write_clip(tmp_path / "in.mp4", times=range(6), size=(64, 64), options=options))).interlaced == 6


def test_damage_is_told(tmp_path):
    """In the source's own words."""
    clip = write_clip(tmp_path / "in.mp4", times=range(20))
    spoil_packets(clip, [7])
    assert any("damaged" in remark for remark in probe(str(clip)).remarks)


def test_images(tmp_path, save_images):
    """A folder and a pattern, with and without a rate."""
    save_images(tmp_path / "in", count=5)
    found = probe(str(tmp_path / "in"))
    assert (found.frames, found.streams, found.look, found.conversion.frames) == (5, [], None, 9)
    timed = probe(str(tmp_path / "in" / "shot_####.png"), Fraction(12))
    assert (timed.rate, timed.duration) == (12, pytest.approx(5 / 12))


def test_what_cannot_be_read(tmp_path):
    """Is an error that names it."""
    (tmp_path / "in.mp4").write_bytes(b"nothing" * 100)
    with pytest.raises(InputError, match=r"in\.mp4"):
        probe(str(tmp_path / "in.mp4"))
    with pytest.raises(OptionError, match="`input_fps`"):
        probe(str(write_clip(tmp_path / "good.mp4")), Fraction(24))


def test_the_terminal(fpsboost_, tmp_path):
    """Names and values, no line longer than 80 characters."""
    write_clip(tmp_path / "in.mp4", sound="aac", second_video=True, title="A title")
    result = fpsboost_("probe", "in.mp4")
    assert (result.code, result.err) == (0, "")
    lines = result.out.splitlines()
    assert max(map(len, lines)) <= 80
    words = ("in.mp4", "64x48", "h264", "aac", "fra", "25 fps", "constant", "40 / 40 / 40 ms", "20 frames at 50 fps")
    assert [word for word in words if word not in result.out] == []
    (tmp_path / "no.mp4").write_bytes(b"nothing" * 100)
    refused = fpsboost_("probe", "no.mp4", "--json")
    assert (refused.code, refused.out, len(refused.lines)) == (1, "", 1)


def test_json(fpsboost_, tmp_path):
    """Nothing else on standard output, and the same as the library says."""
    encode(tmp_path / "in.mp4", [frame.image for frame in held(CADENCES["threes"])], 18)
    result = fpsboost_("probe", "in.mp4", "--json")
    assert (result.code, result.err) == (0, "")
    data = json.loads(result.out)
    assert read_probe(result.out) == probe(str(Path("in.mp4")))
    assert (data["duplicates"], data["frames"], data["streams"][0]["codec"]) == (10, 16, "h264")


def test_a_conversion_says_how_many_duplicates(fpsboost_, tmp_path):
    """In its line, and nothing about them where they are kept or where there are none."""
    encode(tmp_path / "in.mp4", [frame.image for frame in held(CADENCES["twos"])], 18)
    said = fpsboost_("in.mp4", "out.mp4", "-m", "blend").err
    assert "15 -> 30 frames, 7 duplicate frames in" in said
    assert "duplicate" not in fpsboost_("in.mp4", "kept.mp4", "-m", "blend", "--duplicates", "keep").err


@pytest.mark.parametrize("name", ["in.gif", "in.apng", "in.webp", "in.mp4"])
@pytest.mark.parametrize("place", [0, 2, 5])
def test_one_long_frame_does_not_change_the_rate(tmp_path, name, place):
    """The usual interval is the rate, and the rate varies, also where the last frame is the long one."""
    delays, path = [200 if number == place else 4 for number in range(6)], tmp_path / name
    if name == "in.mp4":
        write_clip(path, times=[sum(delays[:k]) for k in range(6)], end=sum(delays), time_base=Fraction(1, 100))
    else:
        write_animation(path, [disc(index) for index in range(6)], [10 * delay for delay in delays])
    found = probe(str(path))
    assert (found.rate, found.varies, found.longest) == (25, True, 2)
    assert found.duration == pytest.approx(2.2)


@pytest.mark.parametrize("name", ["in.gif", "in.apng", "in.webp"])
def test_animations(tmp_path, name):
    """As many frames as a conversion to an .mp4 writes, at its rate."""
    animation = write_animation(tmp_path / name, [disc(index) for index in range(6)], 4 * [40] + 2 * [100])
    found = probe(str(animation))
    summary = convert(str(animation), str(tmp_path / "out.mp4"), method="nearest")
    assert (found.frames, found.streams, found.look, found.conversion.refused) == (6, [], None, None)
    assert found.conversion.frames == summary.frames_out
    assert found.duration == pytest.approx(0.36)
    assert convert(str(animation), str(tmp_path / "same.mp4"), duplicates="drop").frames_out == 6
