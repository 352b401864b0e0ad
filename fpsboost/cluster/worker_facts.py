"""Comparison of a worker with the client: the same programs, the same input, the same bits."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from importlib.metadata import version
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost.errors import ClusterError
from fpsboost.frame import FrameImage, as_array
from fpsboost.frame_cache import FrameCache
from fpsboost.interpolator import Interpolator
from fpsboost.parts.making import facts_of
from fpsboost.parts.manifest import first_difference
from fpsboost.preparation import ConversionJob, opened_clip, prepare
from fpsboost.run_options import RunOptions
from fpsboost.version import __version__
from fpsboost.ycbcr import YCbCrImage


def program_facts() -> dict[str, str]:
    """Return the versions that must be the same for the same result."""
    return {
        "fpsboost": f"fpsboost {__version__}",
        "libraries": f"PyAV {version('av')}, OpenCV {cv2.__version__}, numba {version('numba')}",
    }


def job_facts(job: ConversionJob) -> dict[str, str]:
    """Return everything that must be the same wherever parts of a job are made.

    Raises
    ------
    InputError
        The input cannot be read here.
    """
    run = RunOptions()
    with opened_clip(job, run) as clip:
        ready = prepare(job, run, clip)
        facts = {**facts_of(job, run, clip, ready), **program_facts()}
        return {**facts, "self_test": self_test(ready.interpolator, next(iter(clip.whole)).image)}


def self_test(interpolator: Interpolator, image: FrameImage) -> str:
    """Return a digest of an image and of a frame that is made of two small ones of its type.

    It differs between machines that do not decode or calculate the same.

    Parameters
    ----------
    interpolator : Interpolator
    image : (H, W, C) uint8, uint16 or float32, YCbCrImage or LayeredImage
    """
    bare, moved = replace(interpolator.without_vectors(), cuts=None), _texture_like(image, shift=4)
    made = bare.between(bare.pair(FrameCache(_texture_like(image, shift=0)), FrameCache(moved)), [0.5]).images
    digest = hashlib.sha256()
    for each in (image, *made):
        for plane in each.planes if isinstance(each, YCbCrImage) else [as_array(each)]:
            digest.update(np.ascontiguousarray(plane).tobytes())
    return digest.hexdigest()


def _texture_like(image: FrameImage, *, shift: int) -> FrameImage:
    """Return a small texture of the type of an image, moved by so many pixels; without layers."""
    height, width = 48, 96

    def plane(number: int, down: int, across: int) -> NDArray[Any]:
        random = np.random.default_rng(number)
        blocks = np.kron(random.integers(16, 236, (height // 8, width // 8)), np.ones((8, 8), np.int64))
        return np.ascontiguousarray(np.roll(blocks, shift, axis=1)[::down, ::across].astype(image.dtype))

    if isinstance(image, YCbCrImage):
        down, across = image.subsampling
        return replace(image, planes=(plane(0, 1, 1), plane(1, down, across), plane(2, down, across)))
    return np.dstack([plane(number, 1, 1) for number in range(image.shape[2])])


def job_key(facts: Mapping[str, str], output: str) -> str:
    """Return the name of a conversion to an output, which is the same in every process."""
    return hashlib.sha256(json.dumps([sorted(facts.items()), output]).encode()).hexdigest()[:16]


def check_programs(facts: Mapping[str, str], place: str) -> None:
    """Raise `ClusterError` unless this process runs the versions of the client, so that both read the same pickles.

    Parameters
    ----------
    facts : mapping of str to str
        Facts of the client.
    place : str
        Address of this worker.
    """
    for name, here in program_facts().items():
        if facts.get(name) != here:
            raise ClusterError(
                f"The worker at {place} has {here}, and the client {facts.get(name)}; install the same versions "
                "everywhere."
            )


def check_job(facts: Mapping[str, str], here: Mapping[str, str], place: str) -> None:
    """Raise `ClusterError` if a worker has another input than the client, or would make other pixels of it.

    Parameters
    ----------
    facts, here : mapping of str to str
        Facts of the client and of this worker.
    place : str
        Address of this worker.
    """
    difference = first_difference(facts, here)
    if difference == "input":
        raise ClusterError(f"The worker at {place} has another file under the input's name; copy the input there.")
    if difference == "self test":
        raise ClusterError(
            f"The worker at {place} calculates other pixels than the client; leave it out, or give all machines "
            "processors and libraries of one kind."
        )
    if difference is not None:
        raise ClusterError(f"The worker at {place} differs from the client in the {difference}; make them the same.")
