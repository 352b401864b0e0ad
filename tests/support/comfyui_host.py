"""A host that stands for ComfyUI: it loads folders of nodes, checks a workflow, and runs it, the way ComfyUI does."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

Workflow = dict[str, dict[str, Any]]
"""What ComfyUI exports as API format: nodes by number, inputs as values or as [number, output]."""


class ArrayTensor:
    """As much of torch's Tensor as the node uses, around an array."""

    def __init__(self, array: NDArray[Any]) -> None:
        self.array = array
        self.shape = array.shape

    def __getitem__(self, index: int) -> "ArrayTensor":
        return ArrayTensor(self.array[index])

    def cpu(self) -> "ArrayTensor":
        return self

    def float(self) -> "ArrayTensor":
        return ArrayTensor(self.array.astype(np.float32, copy=False))

    def numpy(self) -> NDArray[Any]:
        return self.array

    def new_empty(self, size: tuple[int, ...]) -> "ArrayTensor":
        return ArrayTensor(np.full(size, np.nan, self.array.dtype))  # what is not written shows


class InterruptProcessingException(Exception):  # noqa: N818 (ComfyUI's name)
    """What ComfyUI raises in a node when its run is cancelled."""


class Comfy:
    """The modules of ComfyUI that nodes may import, and what was asked of them.

    `cancel_at` is the number of the progress report after which the run is cancelled.
    """

    def __init__(self, cancel_at: int | None = None) -> None:
        self.progress: list[tuple[int, int]] = []
        self.cancel_at = cancel_at
        host = self

        class ProgressBar:
            def __init__(self, total: int) -> None:
                self.total = total

            def update_absolute(self, value: int, total: int | None = None, preview: Any = None) -> None:
                host.progress.append((value, self.total))

        comfy, utils, management = (ModuleType(f"comfy{name}") for name in ("", ".utils", ".model_management"))
        utils.ProgressBar = ProgressBar
        management.throw_exception_if_processing_interrupted = self._check
        self.modules = {module.__name__: module for module in (comfy, utils, management)}

    def _check(self) -> None:
        if self.cancel_at is not None and len(self.progress) >= self.cancel_at:
            raise InterruptProcessingException


class LoadBatch:
    """Node that hands a batch on, as one that loads a video does."""

    batch: Any = None
    RETURN_TYPES = ("IMAGE",)
    FUNCTION = "load"

    @classmethod
    def INPUT_TYPES(cls) -> dict[str, Any]:  # noqa: N802 (the same)
        return {"required": {}}

    def load(self) -> tuple[Any]:
        return (self.batch,)


def declared(required: dict[str, tuple[str]], *outputs: str) -> type:
    """Return a node that has inputs and outputs, and cannot be run."""
    types = {"INPUT_TYPES": staticmethod(lambda: {"required": required}), "RETURN_TYPES": outputs}
    return type("Declared", (), types)


def load_folder(folder: Path) -> dict[str, type]:
    """Import a folder of custom nodes, and return its nodes by name."""
    name = str(folder).replace(".", "_x_")
    spec = importlib.util.spec_from_file_location(name, folder / "__init__.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    assert set(module.NODE_DISPLAY_NAME_MAPPINGS) == set(module.NODE_CLASS_MAPPINGS)
    return dict(module.NODE_CLASS_MAPPINGS)


def invalid_inputs(workflow: Workflow, nodes: dict[str, type]) -> list[str]:
    """Return what ComfyUI would refuse before it runs anything: missing inputs, wrong types, values out of range."""
    return [
        f"{number}.{name}: {fault}"
        for number, node in workflow.items()
        for group, inputs in nodes[node["class_type"]].INPUT_TYPES().items()
        for name, (kind, *further) in inputs.items()
        if group == "required" or name in node["inputs"]
        for fault in [_fault(node["inputs"], name, kind, further[0] if further else {}, workflow, nodes)]
        if fault
    ]


def _fault(
    inputs: dict[str, Any], name: str, kind: Any, config: dict[str, Any], workflow: Workflow, nodes: dict[str, type]
) -> str | None:
    if name not in inputs:
        return "missing"
    value = inputs[name]
    if isinstance(value, list):
        number, output = value
        given = nodes[workflow[number]["class_type"]].RETURN_TYPES[output]
        return None if given == kind else f"{given} != {kind}"
    if isinstance(kind, list):
        return None if value in kind else f"{value} not in list"
    if kind == "INT" and not config["min"] <= int(value) <= config["max"]:
        return "out of range"
    return None


def run(workflow: Workflow, number: str, nodes: dict[str, type]) -> tuple[Any, ...]:
    """Check a workflow and return the outputs of a node; the nodes before it are run first."""
    assert invalid_inputs(workflow, nodes) == []
    return _outputs(workflow, number, nodes)


def _outputs(workflow: Workflow, number: str, nodes: dict[str, type]) -> tuple[Any, ...]:
    node = nodes[workflow[number]["class_type"]]
    values = {
        name: _outputs(workflow, value[0], nodes)[value[1]] if isinstance(value, list) else value
        for name, value in workflow[number]["inputs"].items()
    }
    outputs = getattr(node(), node.FUNCTION)(**values)
    assert len(outputs) == len(node.RETURN_TYPES)
    return outputs
