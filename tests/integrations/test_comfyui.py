"""The node for ComfyUI under integrations/comfyui, in a host that does what ComfyUI does with it."""

import json
import re
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

import fpsboost
from fpsboost import __version__
from support import comfyui_host as host
from support.video_truth import scene

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "integrations" / "comfyui"
NAME = "FpsboostFrameInterpolation"

Run = Callable[..., tuple[NDArray[Any], NDArray[Any]]]


@pytest.fixture(scope="module")
def nodes() -> dict[str, type]:
    """The nodes that a workflow may use, ours from its folder."""
    return {**host.load_folder(FOLDER), "LoadBatch": host.LoadBatch}


@pytest.fixture
def run(nodes: dict[str, type], monkeypatch: pytest.MonkeyPatch) -> Run:
    """A function that runs the node on RGB images, and returns what comes out as arrays."""

    def run_node(images: Any, **inputs: Any) -> tuple[NDArray[Any], NDArray[Any]]:
        batch = host.ArrayTensor(np.asarray(images)) if isinstance(images, list | np.ndarray) else images
        monkeypatch.setattr(host.LoadBatch, "batch", batch)
        made = host.run(workflow(**inputs), "2", nodes)
        return made[0].numpy(), made[1].numpy()

    return run_node


def workflow(**inputs: Any) -> host.Workflow:
    """A workflow that loads a batch and makes the images between, with all values that the host fills in."""
    values = {"multiplier": 2, "method": "nlm-fast", "scene_cuts": "repeat", "duplicates": "interpolate"}
    ours = {"images": ["1", 0], **values, **inputs}
    return {"1": {"class_type": "LoadBatch", "inputs": {}}, "2": {"class_type": NAME, "inputs": ours}}


def batch(count: int, step: int = 1) -> NDArray[np.float32]:
    """Consecutive RGB images of a picture that moves, (count, 48, 64, 3)."""
    return np.stack([scene(number * step)[..., ::-1] / np.float32(255) for number in range(count)]).astype(np.float32)


def other_scene(count: int) -> NDArray[np.float32]:
    """Consecutive RGB images that have nothing in common with those of `batch`."""
    noise = np.random.default_rng(1).random((12, 16, 3)).astype(np.float32)
    picture = cv2.resize(noise, (64, 48), interpolation=cv2.INTER_CUBIC).clip(0, 1)
    return np.stack([np.roll(picture, 2 * number, axis=1) for number in range(count)])


@pytest.mark.parametrize("multiplier", [2, 3])
def test_images_between_are_those_of_the_library(run, multiplier):
    """Original images pass to the bit with confidence 1, the others are what fpsboost.stream makes, in RGB."""
    images = batch(4)
    made, confidence = run(images, multiplier=multiplier)
    assert made.shape == (3 * multiplier + 1, 48, 64, 3)
    assert made.dtype == confidence.dtype == np.float32
    np.testing.assert_array_equal(made[::multiplier], images)
    np.testing.assert_array_equal(confidence[::multiplier], 1)
    bgr = [np.ascontiguousarray(image[..., ::-1]) for image in images]
    wanted = list(fpsboost.stream(bgr, factor=multiplier, method="nlm-fast"))[: len(made)]
    np.testing.assert_array_equal(made, np.stack(wanted)[..., ::-1])
    looped, _ = run(images, multiplier=multiplier, loop=True)
    np.testing.assert_array_equal(
        looped, fpsboost.interpolate_clip(images, 24, factor=multiplier, loop=True, method="nlm-fast")[0]
    )
    between = confidence[1::multiplier]
    assert between.min() >= 0
    assert 0.5 < between.mean() < 1


def test_a_single_image_and_alpha_stay_as_they_are(run):
    """One image gives one as in ComfyUI's own node; four channels come out as four, in the order they came in."""
    made, confidence = run(batch(1))
    np.testing.assert_array_equal(made, batch(1))
    np.testing.assert_array_equal(confidence, np.ones((1, 48, 64)))
    images = np.concatenate([batch(3), np.full((3, 48, 64, 1), 0.5, np.float32)], axis=3)
    made, _ = run(images)
    np.testing.assert_array_equal(made[::2], images)
    np.testing.assert_allclose(made[..., 3], 0.5, atol=1e-3)


def test_scene_cuts(run):
    """Nothing is made across a cut: the nearer image is repeated with confidence 0, unless it is to be one scene."""
    images = np.concatenate([batch(4), other_scene(4)])
    made, confidence = run(images, multiplier=3)
    np.testing.assert_array_equal(made[[10, 11]], images[[3, 4]])
    assert confidence[[10, 11]].max() == 0
    assert confidence[8].mean() > 0.5
    one_scene, _ = run(images, multiplier=3, scene_cuts="one scene")
    assert np.abs(one_scene[10] - images[3]).mean() > 0.01
    blended, _ = run(images, scene_cuts="blend")
    np.testing.assert_allclose(blended[7], (images[3] + images[4]) / 2, atol=0.01)


def test_duplicates(run):
    """An image that repeats the one before is replaced by one made for its time, or kept."""
    images = batch(8, step=2)
    images[3] = images[2]
    made, _ = run(images)
    assert np.abs(made[6] - images[3]).mean() > 0.01
    kept, _ = run(images, duplicates="keep")
    np.testing.assert_array_equal(kept[::2], images)


@pytest.mark.parametrize("shape", [(0, 48, 64, 3), (48, 64, 3), (2, 48, 64, 1)])
def test_bad_input_is_one_sentence(run, shape):
    """What is no batch of RGB images is refused with a sentence that names the input."""
    with pytest.raises(fpsboost.InputError, match=r"^`images` must have [^\n]*; connect a batch of images\.$"):
        run(np.zeros(shape, np.float32))


def test_a_result_beyond_the_memory_is_refused(run, nodes, monkeypatch):
    """Before anything is allocated, with a sentence that says what to do."""
    module = sys.modules[nodes[NAME].__module__]
    monkeypatch.setattr(module, "MemoryLimit", lambda: fpsboost.MemoryLimit(100_000))
    with pytest.raises(fpsboost.InputError, match=r"4 images of 64x48 become 7, .*; take a smaller `multiplier`"):
        run(batch(4))


def test_progress_and_cancelling(run, monkeypatch):
    """The host's bar is moved image by image, and its exception ends the run when it is cancelled."""
    comfy = host.Comfy()
    for name, module in comfy.modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    run(batch(4), method="blend")
    assert comfy.progress == [(number, 7) for number in range(1, 8)]
    comfy.progress.clear()
    comfy.cancel_at = 2
    with pytest.raises(host.InterruptProcessingException):
        run(batch(4), method="blend")
    assert len(comfy.progress) == 2


def test_everything_is_explained(nodes):
    """The node, each of its inputs and each of its outputs has a text, and defaults are valid."""
    node = nodes[NAME]
    assert node.DESCRIPTION
    assert len(node.OUTPUT_TOOLTIPS) == len(node.RETURN_NAMES) == len(node.RETURN_TYPES)
    inputs = {name: each for group in node.INPUT_TYPES().values() for name, each in group.items()}
    assert all(config["tooltip"] for _, config in inputs.values())
    defaults = {name: config["default"] for name, (_, config) in inputs.items() if "default" in config}
    assert host.invalid_inputs(workflow(**defaults), nodes) == []


def test_the_workflow_of_the_documentation(nodes):
    """It fits the node, and the nodes of ComfyUI that it names, as far as they are declared here."""
    found = re.search(r"```json\n(.*?)```", (ROOT / "docs" / "comfyui.md").read_text(), re.DOTALL)
    assert found is not None
    core = {
        "LoadVideo": host.declared({}, "VIDEO"),
        "GetVideoComponents": host.declared({"video": ("VIDEO",)}, "IMAGE", "AUDIO", "FLOAT"),
        "CreateVideo": host.declared({"images": ("IMAGE",), "fps": ("FLOAT",)}, "VIDEO"),
        "SaveVideo": host.declared({"video": ("VIDEO",)}),
    }
    assert host.invalid_inputs(json.loads(found[1]), {**nodes, **core}) == []


def test_the_registrys_metadata():
    """It has the fields that the registry requires, and the version and licence of the package."""
    about = tomllib.loads((FOLDER / "pyproject.toml").read_text())
    assert about["project"]["version"] == __version__
    assert about["project"]["license"]["text"] == "BSD-3-Clause"
    assert about["project"]["dependencies"] == [f"fpsboost>={__version__}"]
    assert about["tool"]["comfy"].keys() >= {"PublisherId", "DisplayName"}


def test_batches_of_torch(run):
    """The same comes out of torch's tensors, in inference mode as ComfyUI runs nodes, and of half floats."""
    torch = pytest.importorskip("torch", reason="torch is not installed; ComfyUI brings it")
    images = batch(3)
    wanted, _ = run(images)
    with torch.inference_mode():
        made, confidence = run(torch.from_numpy(images))
        half, _ = run(torch.from_numpy(images).half())
    np.testing.assert_array_equal(made, wanted)
    assert confidence.shape == made.shape[:3]
    assert half.dtype == np.float32
    np.testing.assert_allclose(half, wanted, atol=0.02)
