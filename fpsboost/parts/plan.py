"""Plan of the parts of a conversion: how many there are, and how much work each is."""

from __future__ import annotations

from dataclasses import dataclass

from fpsboost.errors import OptionError
from fpsboost.io import RandomAccess
from fpsboost.io.part import MAX_PARTS, Part
from fpsboost.io.video.chunks import CHUNK_FRAMES
from fpsboost.parts.making import count_outputs, outputs_of
from fpsboost.preparation import ConversionJob, OpenedClip, Preparation


@dataclass(frozen=True)
class PlannedPart:
    """Part that is to be made.

    Attributes
    ----------
    part : Part
    frames : int
        Output frames, as far as their number is known beforehand.
    cost : float
        Work relative to other parts of the same job.
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
    times = source.frame_times() if isinstance(source, RandomAccess) else None
    total = count_outputs(job, clip, ready, times)
    if total is None or not clip.whole.stream_info.files:
        raise OptionError(f"{source.info.name} does not say how many frames it holds; convert it in one run.")
    unit = CHUNK_FRAMES if ready.target.kind == "video" else 1
    count = max(1, min(count, -(-total // unit), MAX_PARTS))
    planned = []
    for part in (Part(number, count) for number in range(1, count + 1)):
        outputs = outputs_of(part, total, unit)
        frames = (total if outputs.stop is None else outputs.stop) - outputs.first
        planned.append(PlannedPart(part, frames, float(frames)))
    return planned
