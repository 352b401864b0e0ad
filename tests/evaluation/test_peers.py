"""Other tools' frames: which image of a folder is which frame, and commands that make them."""

import shlex
import sys

import cv2
import numpy as np
import pytest

from fpsboost import DecodeOptions, InputError
from fpsboost.evaluation.hidden_frames import HoldOut
from fpsboost.evaluation.peers import find_frames, read_like, run_peer

HEIGHT, WIDTH = 20, 24

REPEATS = """
import os, shutil, sys
source, target, factor = sys.argv[1], sys.argv[2], int(sys.argv[3])
names = sorted(os.listdir(source))
for place in range((len(names) - 1) * factor + 1):
    name = names[place // factor]
    shutil.copy(os.path.join(source, name), os.path.join(target, f"{place:05d}" + os.path.splitext(name)[1]))
print("some words")
"""
"""A tool that repeats the frame before."""


def gray(number, dtype=np.uint8, channels=3):
    """A frame of a level that tells its number, with a dot that moves, so that none repeats another."""
    image = np.full((HEIGHT, WIDTH, channels), 10 * number, dtype)
    image[2 : 2 + 8, number : number + 8] += dtype(100)
    return image


def save(folder, numbers):
    """Images of these names, each showing the frame of a number."""
    folder.mkdir()
    for name, number in numbers.items():
        cv2.imwrite(str(folder / name), gray(number))
    return folder


@pytest.fixture
def clip(tmp_path):
    """Nine frames."""
    return str(save(tmp_path / "clip", {f"{number:04d}.png": number for number in range(9)}))


def command(program, *words):
    return shlex.join([sys.executable, "-S", "-c", program]) + f" {' '.join(words)}"


@pytest.mark.parametrize(
    ("names", "hold_out"),
    [
        pytest.param({f"out{k:03d}.png": k for k in range(9)}, HoldOut(), id="whole"),
        pytest.param({f"{k + 1:03d}.png": k for k in range(9)}, HoldOut(), id="whole, from 1"),
        pytest.param({f"{k:03d}.png": min(k, 8) for k in range(10)}, HoldOut(), id="whole, and the last twice"),
        pytest.param({f"{k}.png": k for k in range(2, 7)}, HoldOut(1, 2, 7), id="the range"),
        pytest.param({f"{k:02d}.png": k + 2 for k in range(5)}, HoldOut(1, 2, 7), id="the range, from 0"),
        pytest.param({f"{k + 1:02d}.png": k for k in range(9)}, HoldOut(1, 2, 7), id="the whole clip for a range"),
        pytest.param({"a.png": 1, "b.png": 3, "c.png": 5, "d.png": 7}, HoldOut(), id="hidden alone"),
        pytest.param({f"{k}.png": k for k in (3, 5, 7, 8, 12)}, HoldOut(1, 2, 7), id="numbers"),
        pytest.param({f"x{k}_v2.png": k for k in (1, 2, 4, 5, 11)}, HoldOut(2, 0, 7), id="numbers, two hidden at once"),
        pytest.param({f"{k}.png": k for k in range(11)}, HoldOut(2, 0, 9), id="whole, two hidden at once"),
    ],
)
def test_images_are_matched(tmp_path, clip, names, hold_out):
    """By position in a whole sequence, in order if they are the hidden ones, else by number; numbers by their value."""
    compared_method = find_frames("tool", save(tmp_path / "made", names), hold_out.intervals(clip))
    frames = list(compared_method.interpolate(hold_out.intervals(clip)))
    wanted = [hidden.number for interval in hold_out.intervals(clip) for hidden in interval.hidden]
    assert [frame.number for frame in frames] == wanted
    for frame in frames:
        np.testing.assert_array_equal(frame.image, gray(frame.number))
        assert np.isnan(frame.seconds)
    (last,) = compared_method.interpolate(hold_out.intervals(clip), [wanted[-1]])
    np.testing.assert_array_equal(last.image, gray(wanted[-1]))


def test_a_folder_that_does_not_fit_is_one_sentence(tmp_path, clip):
    """It names a frame that has no image, and says what would fit; so does an empty folder, and a missing one."""
    save(tmp_path / "made", {f"{k}.png": k for k in (1, 3, 6)})
    save(tmp_path / "empty", {})
    for name, said in (
        ("made", r"made has 3 images, but none for frame 5; .*\(9 images\).*\(4\)"),
        ("empty", "empty is empty"),
        ("nowhere", "nowhere does not exist"),
    ):
        with pytest.raises(InputError, match=said):
            find_frames("tool", tmp_path / name, HoldOut().intervals(clip))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_a_peer_gets_the_frames_without_loss(tmp_path, dtype, channels):
    """It repeats what it was given, bit by bit, 8 or 16 bits or float, gray, colour or with alpha."""
    rng = np.random.default_rng(1)
    white, suffix = (1, "tif") if dtype == np.float32 else (250, "png")
    images = [(rng.random((HEIGHT, WIDTH, channels)) * white).astype(dtype) for _ in range(3)]
    for folder in ("clip", "scratch"):
        (tmp_path / folder).mkdir()
    for number, image in enumerate(images):
        cv2.imwrite(str(tmp_path / "clip" / f"{number}.{suffix}"), image)
    intervals = list(HoldOut(duplicates="keep").intervals(str(tmp_path / "clip")))
    words = command(REPEATS, "{in}", "{out}", "{factor}")
    (frame,) = run_peer("repeats", words, intervals, tmp_path / "scratch").interpolate(intervals)
    assert frame.number == 1
    np.testing.assert_array_equal(frame.image, images[0])
    assert frame.seconds > 0
    assert frame.cpu_seconds >= 0


def test_a_peer_is_told_how_many_and_how_fast(tmp_path, clip):
    """Two of three frames are hidden: a third of the rate, three times as many; a folder may have a space in it."""
    program = "import sys; open(sys.argv[1], 'w').write(' '.join(sys.argv[4:]))\n" + REPEATS.replace(
        "sys.argv[1], sys.argv[2], int(sys.argv[3])", "sys.argv[2], sys.argv[3], int(sys.argv[4])"
    )
    (tmp_path / "a scratch").mkdir()
    words = shlex.quote(str(tmp_path / "told")), "{in}", "{out}", "{factor}", "{fps}", "{other}"
    hold_out = HoldOut(skip=2, decoding=DecodeOptions(input_fps=24))
    compared_method = run_peer("tool", command(program, *words), hold_out.intervals(clip), tmp_path / "a scratch")
    assert (tmp_path / "told").read_text() == "3 8 {other}"
    made = list(compared_method.interpolate(hold_out.intervals(clip)))
    assert [(each.number, int(each.image[-1, -1, 0])) for each in made] == [(1, 0), (2, 0), (4, 30), (5, 30)]


@pytest.mark.parametrize(
    ("program", "sentence"),
    [
        (
            "print('so far so good', flush=True); raise SystemExit('no model\\nfor this\\n\\n')",
            "peer tool failed with exit code 1: for this",
        ),
        ("raise SystemExit(3)", "peer tool failed with exit code 3: it printed nothing"),
        ("print('done')", r"peer tool made 0 images of 5, not 9 to 10; .* \(it printed: done\)"),
        ("import os; os.kill(os.getpid(), 9)", "peer tool failed with signal 9"),
        (None, "peer tool cannot be run .*no-such-program"),
    ],
)
def test_a_peer_that_fails_is_named_with_its_last_line(tmp_path, clip, program, sentence):
    """A code, a signal, another number of images, or no program."""
    (tmp_path / "scratch").mkdir()
    words = command(program, "{in}", "{out}") if program else "no-such-program {in} {out}"
    with pytest.raises(InputError, match=sentence):
        run_peer("tool", words, HoldOut().intervals(clip), tmp_path / "scratch")


@pytest.mark.parametrize(
    ("made", "like", "wanted"),
    [
        (np.full((4, 5, 3), 255, np.uint8), np.zeros((4, 5, 3), np.uint16), 65535),
        (np.full((4, 5, 3), 65535, np.uint16), np.zeros((4, 5, 1), np.uint8), 255),
        (np.full((4, 5, 1), 51, np.uint8), np.zeros((4, 5, 3), np.float32), 0.2),
        (np.full((4, 5, 3), 255, np.uint8), np.zeros((4, 5, 4), np.uint8), 255),
    ],
)
def test_images_become_like_the_clip(tmp_path, made, like, wanted):
    """Depths are scaled, gray and colour turned into each other, missing alpha is opaque."""
    cv2.imwrite(str(tmp_path / "made.png"), made)
    image = read_like(tmp_path / "made.png", like)
    assert (image.shape, image.dtype) == (like.shape, like.dtype)
    np.testing.assert_allclose(image, wanted, rtol=1e-3)
    with pytest.raises(InputError, match="5x4 pixels, and the clip has 6x4"):
        read_like(tmp_path / "made.png", np.zeros((4, 6, 3), np.uint8))


def test_the_command_scores_other_tools(fpsboost_, clip, tmp_path):
    """A folder and a command beside a method: both in the table, the page and its command, and nothing stays behind."""
    folder = save(tmp_path / "made", {f"{k}.png": k for k in (1, 3, 5, 7)})
    (tmp_path / "repeats.py").write_text(REPEATS)
    peer = shlex.join([sys.executable, "-S", str(tmp_path / "repeats.py")]) + " {in} {out} {factor}"
    others = ("--frames", f"known={folder}", "--peer", f"last={peer}")
    result = fpsboost_("compare", clip, "-m", "blend", *others, "--report", "page", "--json", "x.json")
    assert result.code == 0, result.err
    table = result.out.partition("where the errors are")[0]
    rows = {line.split()[1]: line for line in table.splitlines() if line.startswith("│")}
    assert "│ 120.00 │" in rows["known"]
    assert rows["known"].replace(" ", "").endswith("│-│")
    assert not rows["last"].endswith("- │")
    page = (tmp_path / "page" / "index.html").read_text()
    assert "<span>--frames</span> <span>known=" in page
    assert "compare" in page.partition("-m blend --frames")[0]


def test_the_command_ends_where_a_peer_fails(fpsboost_, clip, tmp_path, unchanged):
    """One sentence, exit code 1, nothing written, and no method was run before."""
    with unchanged(tmp_path):
        peer = f"bad={shlex.quote(sys.executable)} -c 1/0 {{in}} {{out}}"
        result = fpsboost_("compare", clip, "-m", "nlm", "--peer", peer, "--json", "x.json")
        assert (result.code, len(result.lines)) == (1, 1)
        assert "The peer bad failed with exit code 1: ZeroDivisionError" in result.err
