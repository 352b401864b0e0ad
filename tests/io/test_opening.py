"""Which source and which sink a path stands for."""

from fractions import Fraction

import pytest

from fpsboost import DecodeOptions, InputError, OptionError
from fpsboost.io.animation.sink import AnimationSink
from fpsboost.io.animation.source import AnimationSource
from fpsboost.io.animation.writers import ANIMATION_SUFFIXES
from fpsboost.io.images.files import IMAGE_SUFFIXES
from fpsboost.io.images.sink import ImageSink
from fpsboost.io.images.source import ImageSource
from fpsboost.io.opening import ASSUMED_IMAGE_RATE, Target, TargetRequirements, open_source
from fpsboost.io.video.sink import VideoSink
from fpsboost.io.video.source import VideoSource
from fpsboost.media import VIDEO_SUFFIXES, OutputTiming
from support.animation_truth import write_animation
from support.conversion_options import open_output
from support.video_truth import scene, write_clip


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        *((f"out{suffix}", True) for suffix in VIDEO_SUFFIXES),
        *((f"OUT{suffix.upper()}", True) for suffix in VIDEO_SUFFIXES),
        *((f"out_####{suffix}", False) for suffix in IMAGE_SUFFIXES),
        *((f"out{suffix}", False) for suffix in ANIMATION_SUFFIXES),
        ("take #2.mp4", True),
        ("100%done.mkv", True),
        ("-x.mp4", True),
        ("frames", False),
        ("frames.v2/", False),
        ("take.1/frames", False),
        (".hidden", False),
    ],
)
def test_what_an_output_path_names(path, expected):
    """The ending decides between video and images, in capitals too; patterns and folders are images."""
    target = Target.parse(path)
    assert target.has_clock is expected
    assert (target.kind == "animation") is (path in {f"out{suffix}" for suffix in ANIMATION_SUFFIXES})


def test_a_folder_is_a_folder_whatever_its_name(tmp_path):
    """A folder that is there is taken for images even if it is called like a video."""
    (tmp_path / "clip.mp4").mkdir()
    assert Target.parse(str(tmp_path / "clip.mp4")).kind == "images"
    with pytest.raises(InputError, match="is empty"):
        open_source(str(tmp_path / "clip.mp4"), decoding=DecodeOptions(input_fps=Fraction(24)))


def test_what_is_no_output():
    """What cannot be written is an OptionError that lists what can; one image cannot hold a clip."""
    for name in ("out.avi", "out.txt", "out.mp4.bak", "shot_%d.xyz"):
        with pytest.raises(OptionError, match=rf"{name} has an ending .*\.mp4.*\.webm.*folder"):
            Target.parse(name)
    for suffix in {*IMAGE_SUFFIXES} - {*ANIMATION_SUFFIXES}:
        with pytest.raises(OptionError, match=rf"out{suffix} would be a single image; .* shot_####{suffix}"):
            Target.parse(f"out{suffix}")


@pytest.mark.parametrize("suffix", [".png", ".webp", ".tif", ".apng"])
def test_a_single_image_is_no_input(tmp_path, save_images, suffix):
    """One image is named, with what to give instead, also where the file could be an animation."""
    save_images(tmp_path, count=1)
    path = (tmp_path / "shot_0001.png").rename(tmp_path / f"one{suffix}")
    with pytest.raises(
        InputError,
        match=rf"one{suffix} is a single image; give two and a folder .*, the folder of a clip, or a pattern",
    ):
        open_source(str(path))


def test_rates_of_images(tmp_path, save_images):
    """Images play at the rate that is said; where only their order matters one is assumed, else it must be said.

    A video has its own.
    """
    save_images(tmp_path, count=2)
    for path in (tmp_path, tmp_path / "shot_####.png"):
        assert open_source(str(path), decoding=DecodeOptions(input_fps=Fraction(30))).info.rate == 30
        assert open_source(str(path)).info.rate == ASSUMED_IMAGE_RATE
        with pytest.raises(OptionError, match="`input_fps`"):
            open_source(str(path), requirements=TargetRequirements(needs_rate=True))

    clip = write_clip(tmp_path / "in.mp4", times=range(2))
    with pytest.raises(OptionError, match=r"`input_fps` is for images and raw streams; .*in\.mp4"):
        open_source(str(clip), decoding=DecodeOptions(input_fps=Fraction(24)))


def test_kinds_of_sources_and_sinks(tmp_path, save_images):
    """Videos and images each get their own class, on both sides."""
    save_images(tmp_path / "in", count=2)
    clip = write_clip(tmp_path / "in.mp4", times=range(2))
    timing = OutputTiming(Fraction(25), Fraction(1, 25))
    for path, kind in ((tmp_path / "in", ImageSource), (tmp_path / "in" / "shot_####.png", ImageSource)):
        assert isinstance(open_source(str(path), decoding=DecodeOptions(input_fps=Fraction(25))), kind)
    for name in ("in.gif", "in.png", "in.apng", "in.webp"):
        with open_source(str(write_animation(tmp_path / name, [scene(0), scene(1)]))) as source:
            assert isinstance(source, AnimationSource)
    kinds = {"out.mp4": VideoSink, "out": ImageSink, "out_%03d.jpg": ImageSink}
    kinds |= {"out.gif": AnimationSink, "OUT.APNG": AnimationSink, "out.webp": AnimationSink, "o_##.webp": ImageSink}
    with open_source(str(clip)) as source:
        assert isinstance(source, VideoSource)
        for name, kind in kinds.items():
            assert type(open_output(tmp_path / name, source, timing)) is kind


def test_an_empty_name_is_no_folder(tmp_path, monkeypatch, save_images):
    """An empty name, as an unset variable of a shell gives it, does not stand for the current folder."""
    save_images(tmp_path, count=2)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="is empty"):
        open_source("", decoding=DecodeOptions(input_fps=Fraction(24)))
    with pytest.raises(OptionError, match="is empty"):
        Target.parse("")


def test_a_bound_is_in_its_range():
    """The lowest frame rate of images that the message names is taken, and no lower one."""
    assert DecodeOptions(input_fps="0.001").input_fps == Fraction(1, 1000)
    with pytest.raises(OptionError, match=r"`input_fps` must be 0\.001 to 100000, not 1/1001"):
        DecodeOptions(input_fps=Fraction(1, 1001))
