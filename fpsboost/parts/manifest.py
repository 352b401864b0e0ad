"""Manifest of a part: the job that it belongs to, its files, and the facts by which it is joined with the others.

Facts are the input files and the options of a job as text, by which a later run and other machines tell whether they
would do the same. One fact is a digest of in-between frames, by which two machines find out whether they compute the
same bits. Processors differ in the instructions that a library such as OpenCV chooses for them, and with them in how
results are rounded. The frames are made of random integers, so that at least the input is the same everywhere.
"""

import hashlib
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, is_dataclass
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any, Protocol, Self, get_args, get_origin, get_type_hints, runtime_checkable

import cv2
import numpy as np
from numpy.typing import NDArray

from fpsboost import __version__
from fpsboost.contracts import Summary
from fpsboost.edits import OpenedClip
from fpsboost.errors import InputError, explained
from fpsboost.frame_cache import FrameCache
from fpsboost.image import SAMPLE_BITS, view
from fpsboost.interpolator import Interpolator
from fpsboost.io.video.decode_options import DecodeOptions
from fpsboost.io.video.encode_options import Encoding
from fpsboost.layered import FrameImage
from fpsboost.media import Window, pyav_version, write_safely
from fpsboost.preparation import ConversionJob, Preparation, open_whole, prepared
from fpsboost.remarks import Remarks
from fpsboost.run_options import Part, RunOptions
from fpsboost.timing.options import Timing

MANIFEST_NAME = "part.json"
"""Name of the manifest in the folder of a part."""
FORMAT = 5  # version of the manifest's fields
IDENTIFYING_BYTES = 1 << 16  # bytes at the beginning and at the end of a file that identify it together with its size


@dataclass(frozen=True)
class StoredFile:
    """File of a part: name, size in bytes, and SHA-256 of its content in hexadecimal digits."""

    name: str
    size: int
    sha256: str


@dataclass(frozen=True)
class Manifest:
    """Description of a finished part, in a file beside its frames."""

    part: Part
    """Number of the part, and number of parts."""
    input: str
    """Absolute path of the input."""
    output: str
    """Path of the output of the whole conversion."""
    timing: Timing
    """Options of the job for the timing."""
    decoding: DecodeOptions
    """Options of the job for reading the input."""
    encoding: Encoding
    """Options of the job for writing the output."""
    facts: dict[str, str]
    """Facts that must be the same for all parts, by their names; see `facts_of`."""
    first: int
    """Number of the part's first frame in the output, counted from 0."""
    summary: Summary
    """Summary of the part, without times; frames read are all source frames from the clip's first one on."""
    counts_frames: bool
    """Whether the numbers of the source's frames influence the output, so that parts must agree on them at their
    boundaries."""
    window: Window | None
    """Part of the source that the output covers, for what is copied beside the frames."""
    files: list[StoredFile]
    """Files of the part in the order of the output."""

    def write(self, folder: Path) -> None:
        """Write the manifest into a folder, as JSON."""
        values = {"format": FORMAT, **asdict(self)}
        values["summary"]["remarks"] = [remark.data for remark in self.summary.remarks]
        write_safely(folder / MANIFEST_NAME, json.dumps(values, indent=1, default=_plain).encode())

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read the manifest of a part.

        Raises
        ------
        InputError
            It cannot be read, is damaged, or was written by another version of fpsboost.
        """
        advice = "make this part again"
        with explained(InputError, "read", folder / MANIFEST_NAME, advice):
            data = (folder / MANIFEST_NAME).read_bytes()
        try:
            values = json.loads(data)
            if values.pop("format") != FORMAT:
                raise InputError(f"{folder} was made by another version of fpsboost; {advice}.")
            manifest: Self = from_json(cls, values)
        except (ValueError, TypeError, KeyError, AttributeError):
            raise InputError(f"{folder / MANIFEST_NAME} is damaged; {advice}.") from None
        return manifest


def stored(path: Path) -> StoredFile:
    """Return name, size and hash of a file, by which its content is recognized."""
    with path.open("rb") as file:
        return StoredFile(path.name, path.stat().st_size, hashlib.file_digest(file, "sha256").hexdigest())


def first_difference(facts: Mapping[str, str], others: Mapping[str, str]) -> str | None:
    """Return the name of the first fact that differs, as words; None if none does."""
    different = (key for key in [*facts, *others] if facts.get(key) != others.get(key))
    return next((key.rpartition(".")[2].replace("_", " ") for key in different), None)


@runtime_checkable
class ReadsFiles(Protocol):
    """Contract: option that refers to files whose content determines the output."""

    @property
    def files(self) -> Sequence[Path]:
        """All files."""


def fingerprint_files(files: Iterable[Path]) -> str:
    """Return a digest of names, sizes and modification times, which changes if a file is replaced."""
    listed = json.dumps([(file.name, file.stat().st_size, file.stat().st_mtime_ns) for file in files])
    return hashlib.sha256(listed.encode()).hexdigest()


def fingerprint_options(
    state_of: Callable[[Iterable[Path]], str] = fingerprint_files, /, **values: Any
) -> dict[str, str]:
    """Return the options of a job as text: the fields of dataclasses one by one, everything else by `str`.

    Options that read files contribute the state of the files, too, by `fingerprint_files` or another function.
    """
    facts: dict[str, str] = {}
    for name, value in values.items():
        if isinstance(value, ReadsFiles):
            facts[f"{name}_files"] = state_of(value.files)
        if is_dataclass(value):
            facts[name] = type(value).__name__
            parts = {f"{name}.{field.name}": getattr(value, field.name) for field in fields(value)}
            facts |= fingerprint_options(state_of, **parts)
        else:
            facts[name] = str(value)
    return facts


def identify_files(files: Iterable[Path]) -> str:
    """Return a digest of sizes, beginnings and ends, which are the same for copies of the files on other machines."""
    digest = hashlib.sha256()
    for path in files:
        with path.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            digest.update(f"{size}\n".encode())
            for begin in (0, max(0, size - IDENTIFYING_BYTES)):
                file.seek(begin)
                digest.update(file.read(IDENTIFYING_BYTES))
    return digest.hexdigest()


def program_facts() -> dict[str, str]:
    """Return the versions that must be the same for the same result."""
    libraries = f"PyAV {pyav_version()}, OpenCV {cv2.__version__}"
    return {"fpsboost": f"fpsboost {__version__}", "libraries": libraries}


def input_identity(clip: OpenedClip) -> str:
    """Return the identity of a clip's files; see `identify_files`."""
    with explained(InputError, "read", clip.whole.info.name, "check that it is still there"):
        return identify_files(clip.whole.stream_info.files)


def facts_of(ready: Preparation) -> dict[str, str]:
    """Return the facts that must be the same wherever parts of a job are computed, by their names.

    These are the content of the input (by size, beginning and end), all options, the versions of the programs, and
    digests of the first frame and of interpolated ones, by which machines find out whether they decode and compute
    alike.
    """
    job = ready.job
    with open_whole(job, ready.run, ready.target) as whole:
        image = next(iter(whole)).image
    with explained(InputError, "read", ready.clip.whole.info.name, "check that it is still there"):
        return fingerprint_options(
            identify_files,
            **program_facts(),
            first_frame=digest_of(image),
            self_test=self_test(ready.interpolator, image),
            input=input_identity(ready.clip),
            output_type=ready.target.file_type,
            timing=job.timing,
            method=job.method,
            decoding=job.decoding,
            encoding=job.encoding,
        )


def job_facts(job: ConversionJob) -> dict[str, str]:
    """Return `facts_of` a job that is not open yet."""
    with prepared(job, RunOptions()) as ready:
        return facts_of(ready)


def _plain(value: Any) -> Any:
    """Return a value that JSON lacks as one that it has: text for fractions and paths, a list for a set."""
    return list(value) if isinstance(value, set) else str(value)


def from_json(kind: Any, value: Any) -> Any:
    """Return the object of a type that a manifest has stored.

    The type is a dataclass, Fraction, str, int, float, bool, a list, set, tuple or dict of these, or a union of one
    with None, in which further types are those that an option may be given as. Raises `KeyError`, `TypeError` or
    `ValueError` for data of another form.

    Examples
    --------
    >>> from fpsboost import Position
    >>> from_json(Position, {"value": "181/2", "is_frame": False})
    Position(value=Fraction(181, 2), is_frame=False)
    """
    kinds = get_args(kind)
    if value is None:
        return None
    if kind is Fraction:
        return Fraction(value)
    if kind is Remarks:
        return Remarks.from_json(value)
    if type(None) in kinds:
        return from_json(kinds[0], value)
    if is_dataclass(kind):
        hints = get_type_hints(kind)
        return kind(**{name: from_json(hints[name], item) for name, item in value.items()})  # type: ignore[operator]
    return _collection(get_origin(kind), kinds, value)


def _collection(kind: Any, kinds: Any, value: Any) -> Any:
    """Return a dict, list, set or tuple whose items have the types `kinds`; any other value unchanged."""
    if kind is dict:
        return {kinds[0](key): from_json(kinds[1], item) for key, item in value.items()}
    if kind in (list, set):
        return kind(from_json(kinds[0], item) for item in value)
    if kind is tuple:
        kinds = kinds[:1] * len(value) if kinds[-1] is Ellipsis else kinds
        return tuple(from_json(each, item) for each, item in zip(kinds, value, strict=True))
    return value


SIZE = (48, 480)
"""Height and width of the frames, pixels: long enough for a pyramid with all kinds of levels."""

TIMES = (0.25, 0.5)
"""Times of the interpolated frames, of which the second one is computed from results of the first."""
FRAMES = 4
"""Frames of the clip: a pair, and one frame on each side of it."""

OBJECT = (20, 96)
"""Height and width of the object that moves in front, pixels."""


def self_test(interpolator: Interpolator, image: FrameImage) -> str:
    """Return a digest of frames that an interpolator generates of a small constructed clip.

    A texture with coarse and fine structure moves by two and a half pixels per frame, and in front of it an object in
    the other direction. A renderer's motion vectors are not used.

    Parameters
    ----------
    interpolator : Interpolator
        Method of the job.
    image : array, YCbCrImage or LayeredImage
        Any frame of the clip to convert; only its type, channels and layers matter.

    Returns
    -------
    str
        SHA-256 in hexadecimal digits, the same wherever the same frames are computed.
    """
    bare = interpolator.without_vectors()
    frames = [FrameCache(view(image).filled(samples)) for samples in _moving_samples()]
    before, pair, after = (bare.pair(*two) for two in pairwise(frames))
    return digest_of(*(image for image, _ in bare.images(pair.between(before, after), TIMES)))


def digest_of(*images: FrameImage) -> str:
    """Return a digest of images: SHA-256 in hexadecimal digits."""
    digest = hashlib.sha256()
    for image in images:
        for plane in view(image).arrays():
            digest.update(f"{plane.dtype} {plane.shape} ".encode())
            digest.update(plane.tobytes())
    return digest.hexdigest()


def _moving_samples() -> Iterator[NDArray[np.int64]]:
    """Yield the frames as samples of four channels, (H, W, 4), from 0 to 2**16 - 1."""
    height, width = SIZE
    random = np.random.default_rng(0)
    behind = _texture(random, height, width + 5 * FRAMES)
    in_front = _texture(random, *OBJECT)
    for number in range(FRAMES):
        frame = behind[:, 5 * number : 2 * width + 5 * number].reshape(height, width, 2, 4).sum(axis=2) // 2
        top = 12 + number
        left = 160 + 4 * number
        frame[top : top + OBJECT[0], left : left + OBJECT[1]] = in_front[:, ::2]
        yield frame


def _texture(random: np.random.Generator, height: int, width: int) -> NDArray[np.int64]:
    """Return samples of twice the width: half of each is a plain patch of 8 x 8 pixels, the rest noise."""
    coarse = random.integers(0, 1 << SAMPLE_BITS, (-(-height // 8), -(-width // 8), 4))
    patches = coarse.repeat(8, axis=0).repeat(16, axis=1)[:height, : 2 * width]
    return (patches + random.integers(0, 1 << SAMPLE_BITS, patches.shape)) // 2
