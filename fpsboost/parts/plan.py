"""Plan of the parts of a conversion: how many there are, and how much work each is."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from fpsboost.errors import OptionError
from fpsboost.io.part import MAX_PARTS, Part, part_folder
from fpsboost.io.video.chunks import CHUNK_FRAMES
from fpsboost.parts.making import count_outputs, frame_times, outputs_of
from fpsboost.preparation import ConversionJob, OpenedClip, Preparation
from fpsboost.timing.output_numbers import OutputNumbers


@dataclass(frozen=True)
class PlannedPart:
    """Part that is to be made.

    Attributes
    ----------
    part : Part
    frames : int
        Output frames, as far as their number is known beforehand.
    cost : float
        Work relative to other parts of the same job: frames to write and pairs of the source's frames to follow.
    """

    part: Part
    frames: int
    cost: float


def plan_parts(job: ConversionJob, clip: OpenedClip, ready: Preparation, count: int) -> list[PlannedPart]:
    """Plan the parts of a job.

    Parameters
    ----------
    job : ConversionJob
    clip : OpenedClip
        Not read yet.
    ready : Preparation
    count : int
        Number of parts; fewer if there are not as many chunks of a video, or images.

    Returns
    -------
    list of PlannedPart
        In order.

    Raises
    ------
    OptionError
        The input or the output cannot be cut into parts.
    """
    ready.target.check_parts()
    source = clip.source
    times = frame_times(clip, part_folder(ready.target.path, Part(1, 1)).parent)
    total = count_outputs(job, clip, ready, times)
    if total is None or not clip.whole.stream_info.files:
        raise OptionError(f"{source.info.name} does not say how many frames it holds; convert it in one run.")
    unit = CHUNK_FRAMES if ready.target.kind == "video" else 1
    count = max(1, min(count, -(-total // unit), MAX_PARTS))
    parts = [Part(number, count) for number in range(1, count + 1)]
    ranges = [outputs_of(part, total, unit) for part in parts]
    frames = [(total if outputs.stop is None else outputs.stop) - outputs.first for outputs in ranges]
    pairs = [0] * count
    if times:
        numbers = OutputNumbers(times, ready.base_schedule)
        begins = [*(numbers.source_frame(outputs.first) for outputs in ranges), len(times)]
        pairs = [after - begin for begin, after in pairwise(begins)]
    return [
        PlannedPart(part, of_part, of_part + float(of_source))
        for part, of_part, of_source in zip(parts, frames, pairs, strict=True)
    ]
