"""What channels of motion vectors mean: by their names, by comparing frames, and as the user says."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest

from fpsboost.errors import InputError, OptionError
from fpsboost.io.images.encoder import encode_image
from fpsboost.render import StoredVectors, VectorConvention, conventions
from fpsboost.render.fitting import RenderedPair, fit_convention, fit_vectors
from fpsboost.render.folder import VectorFolder, find_vector_channels
from support.exr_truth import write_exr
from support.truth import waves
from support.vector_truth import constant, save_flows, save_translation

SIZE = 48, 64
MEANINGS = [StoredVectors(*each) for each in product(("forward", "backward"), (1, -1), (1, -1))]


def zooming(number: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A picture that grows and moves, and its vectors to the previous and to the next frame, y down."""
    y, x = np.mgrid[: SIZE[0], : SIZE[1]].astype(np.float32)
    places = np.stack([x, y], axis=-1) - np.array([20, 10], np.float32)
    zoom = 1.06**number
    picture = waves(places[..., 0].astype(float) / zoom, places[..., 1].astype(float) / zoom)
    return picture.astype(np.float32), places * np.float32(1 / 1.06 - 1), places * np.float32(0.06)


def stored(number: int, convention: VectorConvention) -> np.ndarray:
    """The vectors of a frame as a renderer of this convention stores them."""
    _, backward, forward = zooming(number)
    ways = {"backward": backward, "forward": forward}
    return np.dstack([pair.read(ways[pair.direction]) for pair in convention.pairs])


@pytest.mark.parametrize(
    ("names", "channels", "convention"),
    [
        (["X", "Y", "Z", "W"], ["X", "Y", "Z", "W"], "blender"),
        (["V.Vector.W", "V.Vector.X", "V.Vector.Y", "V.Vector.Z", "V.Combined.R"], list("XYZW"), "blender"),
        (["R", "forward.u", "forward.v", "backward.u", "backward.v"], ["forward.u", "forward.v"], "nuke"),
        (["R", "G", "B", "motionvector.R", "motionvector.G"], ["motionvector.R", "motionvector.G"], "forward-up"),
        (["velocity.X", "velocity.Y", "velocity.Z"], ["velocity.X", "velocity.Y"], "forward-up"),
    ],
)
def test_channels_are_found_by_their_names(names, channels, convention):
    """Layers of Blender, of Nuke, and those with two channels that are named after motion."""
    found, name = find_vector_channels(names)
    assert name == convention
    assert [each.rpartition(".")[2] for each in found[: len(channels)]] == [
        each.rpartition(".")[2] for each in channels
    ]


def test_colours_are_no_vectors_unless_the_user_says_so():
    """R, G and B alone are a picture; with a convention they may be vectors."""
    assert find_vector_channels(["R", "G", "B"]) is None
    assert find_vector_channels(["R", "G", "B"], of_any_layer=True) == (["R", "G"], "forward-up")


@pytest.mark.parametrize("truth", [VectorConvention((meaning,)) for meaning in MEANINGS])
@pytest.mark.parametrize("distance", [1, 2])
def test_two_channels_are_understood_by_comparing_frames(truth, distance):
    """Whatever the signs, the vectors found lead where the picture moves."""
    pair = RenderedPair(
        zooming(1)[0], zooming(1 + distance)[0], stored(1, truth), stored(1 + distance, truth), distance
    )
    fit = fit_convention([pair], conventions["forward-up"])
    assert fit.error < 0.3 * fit.still_error
    _, forward = fit.convention.read(stored(1, truth))
    assert np.abs(forward - zooming(1)[2]).mean() < 0.3


@pytest.mark.parametrize("place", range(8))
def test_four_channels_are_understood_by_comparing_frames(place):
    """Directions and signs of both pairs of channels are found, as long as one leads back and the other on."""
    first = MEANINGS[place]
    second = next(each for each in MEANINGS[::-1] if each.direction != first.direction)
    truth = VectorConvention((first, second))
    pair = RenderedPair(zooming(1)[0], zooming(2)[0], stored(1, truth), stored(2, truth), 1)
    found = fit_convention([pair], conventions["blender"]).convention.read(stored(1, truth))
    assert (np.abs(np.subtract(found, zooming(1)[1:])).mean(axis=(1, 2, 3)) < 0.3).all()


@pytest.mark.parametrize("name", ["blender", "nuke", "forward-up"])
def test_still_frames_decide_nothing(name):
    """The usual convention of the channels stays, and also where noise decides between equals."""
    random, count = np.random.default_rng(1), 2 * len(conventions[name].pairs)
    still, none = zooming(1)[0], np.zeros((*SIZE, count), np.float32)
    noisy = still + random.normal(0, 0.02, still.shape).astype(np.float32)
    assert (
        fit_convention([RenderedPair(still, noisy, none, none, 1)], conventions[name]).convention == conventions[name]
    )


def save_clip(folder: Path, numbers: range, step: int, truth: VectorConvention, names: str) -> None:
    """Rendered frames, every `step`-th, and the vectors of all."""
    frames, vectors = folder / "frames", folder / "vectors"
    for path in (frames, vectors):
        path.mkdir(parents=True)
    for number in numbers:
        channels = stored(number, truth)
        planes = {name: channels[..., place] for place, name in enumerate(names.split())}
        write_exr(vectors / f"{number:04d}.exr", planes, half=False)
        if (number - numbers[0]) % step == 0:
            path = frames / f"{number:04d}.png"
            path.write_bytes(encode_image(path, np.rint(zooming(number)[0] * 255).astype(np.uint8)))


def test_what_was_found_is_said_and_can_be_given(tmp_path, fpsboost_):
    """Vectors to the next frame with y down: found, said, and with the option neither searched nor said."""
    save_clip(tmp_path, range(1, 6), 2, conventions["forward-down"], "velocity.R velocity.G")
    said = fpsboost_("frames", "a", "--vectors", "vectors").err
    assert "the first and second channel lead to the next frame, right and down" in said
    assert "--vectors-as" in said
    given = fpsboost_("frames", "b", "--vectors", "vectors", "--vectors-as", "forward-down")
    assert (given.code, "channel" in given.err) == (0, False)
    for number in range(1, 6):
        one, other = (tmp_path / name / f"{number:04d}.png" for name in "ab")
        assert one.read_bytes() == other.read_bytes()


def test_vectors_of_other_units_are_said(tmp_path):
    """Vectors that do not connect the frames under any convention are used, and a sentence says so."""
    folder = VectorFolder(save_translation(tmp_path, 2, SIZE, 9, 9))
    picture = zooming(1)[0]
    fitted = fit_vectors(folder, [((0, picture), (1, picture))])
    assert len(fitted.remarks) == 1
    assert "agree less than without any motion" in fitted.remarks[0]


def test_flow_files_have_one_convention(tmp_path):
    """None is searched, and none can be given."""
    save_flows(tmp_path, "a", constant(*SIZE, 1, 0), constant(*SIZE, 1, 0))
    folder = VectorFolder(tmp_path)
    assert fit_vectors(folder, []) is folder
    with pytest.raises(OptionError, match=r"\.flo files, which have one convention"):
        VectorFolder(tmp_path, convention="nuke")


@pytest.mark.parametrize(
    ("convention", "error", "said"),
    [
        ("forward-up", InputError, "4 channels of motion, and the vector convention 2"),
        ("sideways", OptionError, "`convention` must be one of auto, "),
    ],
)
def test_conventions_that_do_not_apply_are_named(tmp_path, convention, error, said):
    """Of another number of channels, or unknown."""
    save_translation(tmp_path, 2, SIZE, 1, 0)
    with pytest.raises(error, match=said):
        VectorFolder(tmp_path, convention=convention).at(0)
