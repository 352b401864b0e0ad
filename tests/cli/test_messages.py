"""What is printed of names that hold more than letters: everything to be seen, nothing for the terminal to obey."""

import os
import re
import shlex

import pytest

from fpsboost.cli.messages import literal
from support.video_truth import write_clip

pytestmark = pytest.mark.skipif(os.name == "nt", reason="Windows has no such names")

NAME = "a\x1b[31m\n\u202eb"
SEEN = r"a\x1b[31m\n\u202eb"
OBEYED = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
CHEAP = ("--method", "nearest")


@pytest.mark.parametrize(
    ("arguments", "code", "times"),
    [
        ("{0}.mp4 {0}.mkv", 0, 1),
        ("{0}.mp4 {0}.mkv --verbose", 0, 3),
        ("{0}.mp4 there{0}.mkv", 1, 1),
        ("{0}.mp4 there{0}.mkv --resume", 0, 1),
        ("{0}.mp4 none{0}.mp4 out/", 1, 3),
        ("none{0}.mp4 out.mp4", 1, 1),
        ("{0}.mp4 out.mp4 --crf {0}", 2, 1),
        ("{0}.mp4 out.mp4 --method {0}", 2, 1),
        ("{0}.mp4 out.mp4 --{0}", 2, 1),
        ("probe {0}.mp4", 0, 1),
        ("compare {0}.mp4 --methods nearest", 0, 1),
        ("compare {0}.mp4 --methods {0}", 2, 1),
    ],
)
def test_control_characters_in_names_are_seen(fpsboost_, tmp_path, arguments, code, times):
    """Summaries, notes, errors and tables write them out, and each message stays on its line."""
    write_clip(tmp_path / f"{NAME}.mp4", times=range(3))
    (tmp_path / f"there{NAME}.mkv").touch()
    words = [word.format(NAME) for word in shlex.split(arguments)]
    method = CHEAP if words[0] != "probe" and not {"--method", "--methods"} & set(words) else ()
    result = fpsboost_(*words, *method)
    said = result.out + result.err
    assert result.code == code, said
    assert not OBEYED.search(said)
    assert said.count(SEEN) == times
    assert not re.search(r"^\\u202eb|a\\x1b\[31m$", said, re.MULTILINE)


def test_verbose_shows_a_traceback(fpsboost_):
    """Someone who looks for a fault gets all of it, with the same sentence and exit code, and controls escaped."""
    result = fpsboost_("none\x1b[31m.mp4", "out.mp4", "--verbose")
    assert (result.code, result.out) == (1, "")
    assert "Traceback" in result.err
    assert result.lines[-1].startswith("fpsboost: none")
    assert "\x1b" not in result.err
    assert result.err.count(r"none\x1b[31m.mp4 does not exist") == 2


def test_names_that_are_no_text(fpsboost_, tmp_path):
    """Bytes that no encoding knows are seen as well, on standard output too."""
    name = os.fsdecode(b"\xff.mp4")
    try:
        write_clip(tmp_path / "in.mp4", times=range(3)).rename(tmp_path / name)
    except OSError:
        pytest.skip("this disk takes no such names")
    result = fpsboost_("probe", name)
    assert result.code == 0
    assert result.out.startswith(r"\udcff.mp4")


@pytest.mark.parametrize("text", ["Zoë 映画", "👩\u200d🚀", "नी\u200cला", "a\\nb", "\u00a0", "e\u0301"])
def test_what_is_only_text_stays(text):
    """Other scripts, joined emoji, accents and backslashes are printed as they are."""
    assert literal(text) == text
