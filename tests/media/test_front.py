"""fpsboost.media: open, create and inspect keep a video whole without the rest of the package."""

import doctest
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import av
import pytest

from fpsboost import InputError, OutputError, media
from support.video_truth import write_clip

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
@pytest.mark.parametrize(("page", "count"), [("media.md", 13), ("generated.md", 33)])
def test_examples_of_the_pages(tmp_path, monkeypatch, page, count):
    """They run as they stand, and print what they show."""
    (tmp_path / "samples").symlink_to(ROOT / "samples")
    monkeypatch.chdir(tmp_path)
    results = doctest.testfile(str(ROOT / "docs" / page), module_relative=False)
    assert (results.failed, results.attempted) == (0, count)


def test_pictures_of_another_size_and_format_are_converted(tmp_path):
    """They become like those of the clip, at their own times."""
    write_clip(tmp_path / "in.mp4")
    with media.open(tmp_path / "in.mp4") as clip, media.create(tmp_path / "out.mp4", like=clip) as writer:
        for number, name in enumerate(("yuv420p", "rgb24", "yuv444p10le")):
            picture = av.VideoFrame(96, 32, name)
            writer.encode(picture, Fraction(number, 10), Fraction(1, 10))
    with media.open(tmp_path / "out.mp4") as clip:
        pictures = [(picture.width, picture.format.name, time) for picture, time, _ in clip.pictures()]
    assert pictures == [(clip.info.width, "yuv420p", Fraction(number, 10)) for number in range(3)]


def test_a_file_appears_whole_or_not_at_all(tmp_path):
    """An error in the block leaves nothing; an existing file stays, and so does the clip itself."""
    write_clip(tmp_path / "in.mp4")
    before = (tmp_path / "in.mp4").read_bytes()
    with media.open(tmp_path / "in.mp4") as clip:
        first = next(clip.pictures())
        with pytest.raises(TypeError), media.create(tmp_path / "out.mp4", like=clip) as writer:
            writer.encode(*first, "too many")
        with pytest.raises(OutputError, match="is the input itself"):
            media.create(tmp_path / "in.mp4", like=clip, overwrite=True)
        with pytest.raises(InputError, match="only once"):
            clip.pictures()
    assert [path.name for path in tmp_path.iterdir()] == ["in.mp4"]
    assert (tmp_path / "in.mp4").read_bytes() == before


@pytest.mark.slow
def test_nothing_else_of_the_package_is_loaded(tmp_path):
    """Reading and writing a video load modules of `fpsboost.media` alone."""
    write_clip(tmp_path / "in.mp4")
    script = (
        "import sys; from fpsboost import media; clip = media.open(sys.argv[1])\n"
        "with media.create(sys.argv[2], like=clip) as writer: [writer.encode(*each) for each in clip.pictures()]\n"
        "print(*sorted(name for name in sys.modules if name.startswith('fpsboost.') and 'media' not in name))"
    )
    command = [sys.executable, "-c", script, str(tmp_path / "in.mp4"), str(tmp_path / "out.mp4")]
    assert not subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
