"""A film that is converted in parts, as the tasks of a simulation: what they cost, and how many bytes they move."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Literal

from simulation import Phase, Task

CHUNK_FRAMES = 240
"""Output frames that the encoder makes in one go, as in `fpsboost.io.video.chunks`; the tests compare."""

Access = Literal["index", "before", "whole", "decoded"]
"""How a part finds its first source frame.

`index`: an index tells, in the file's header (mp4, mov) or kept beside the parts, as the list of a Matroska file is;
only packets from the keyframe before the part are read. `before`: all packets before the part are read. `whole`: all
packets of the file are read. `decoded`: all frames before the part are decoded.
"""


@dataclass(frozen=True)
class Costs:
    """CPU seconds of one process with one thread on an undisturbed core.

    Attributes
    ----------
    compiling : float
        To compile the kernels, where no cache has them.
    starting : float
        From the start of the process to its first frame, with cached kernels, and after its last frame to its end.
    opening : float
        To open the source.
    indexing : float
        A source frame whose packet is read but not decoded, to learn its time.
    self_test : float
        To make the frame by which machines are compared.
    decoding : float
        A source frame.
    motion : float
        A pair of source frames.
    synthesis : float
        A frame that is made.
    encoding : float
        An output frame.
    rest : float
        An output frame: whatever a conversion takes beyond all of these.
    part : float
        A part, beyond what a whole conversion takes: its manifest, hashes, its folder.
    joining : float
        A `join` of no frames.
    joining_frame, joining_byte : float
        An output frame and a byte of it.
    slowdown : tuple of float
        CPU time with 1, 2 ... such processes on the machine at once over that with one.
    variation : float
        Standard deviation over mean of the cost of a chunk, which differs from scene to scene.
    """

    compiling: float = 0.0
    starting: float = 0.0
    opening: float = 0.0
    indexing: float = 0.0
    self_test: float = 0.0
    decoding: float = 0.0
    motion: float = 0.0
    synthesis: float = 0.0
    encoding: float = 0.0
    rest: float = 0.0
    part: float = 0.0
    joining: float = 0.0
    joining_frame: float = 0.0
    joining_byte: float = 0.0
    slowdown: tuple[float, ...] = (1.0,)
    variation: float = 0.0

    def frames(self, outputs: float, factor: Fraction) -> float:
        """Return the cost of so many output frames."""
        sources = outputs / float(factor)
        made = outputs - sources
        stages = sources * (self.decoding + self.motion) + made * self.synthesis
        return stages + outputs * (self.encoding + self.rest)


@dataclass(frozen=True)
class Film:
    """A film, and how it is stored.

    Attributes
    ----------
    source_frames : int
    rate, factor : Fraction
        Source frames per second, and output frames per source frame.
    source_bits, result_bits, sound_bits : float
        Per second.
    keyframe_interval : int
        Source frames from one keyframe to the next.
    access : Access
    passes : int
        How often `join` reads the parts from the storage: for their hashes, and for their packets.
    sound_apart : bool
        Whether sound is read without the pictures between (mp4, mov).
    rewrites : bool
        Whether the finished file is written once more, so that its index comes first (mp4, mov).
    """

    source_frames: int = 172_800
    rate: Fraction = Fraction(24)
    factor: Fraction = Fraction(2)
    source_bits: float = 50e6
    result_bits: float = 60e6
    sound_bits: float = 0.6e6
    keyframe_interval: int = 48
    access: Access = "index"
    passes: int = 2
    sound_apart: bool = True
    rewrites: bool = True

    @property
    def outputs(self) -> int:
        """Number of output frames."""
        return round(self.source_frames * self.factor)

    @property
    def chunks(self) -> int:
        """Number of chunks of the result, which is the largest number of parts."""
        return -(-self.outputs // CHUNK_FRAMES)

    @property
    def seconds(self) -> float:
        """Length."""
        return float(self.source_frames / self.rate)

    @property
    def source_bytes(self) -> float:
        """Size of the source, with its sound."""
        return (self.source_bits + self.sound_bits) / 8 * self.seconds

    @property
    def result_bytes(self) -> float:
        """Size of the result's video."""
        return self.result_bits / 8 * self.seconds

    def parts(self, count: int) -> list[range]:
        """Return the output frames of each part, as `fpsboost.parts` cuts them: whole chunks."""
        borders = [self.chunks * number // count * CHUNK_FRAMES for number in range(count)]
        return [range(*each) for each in zip(borders, [*borders[1:], self.outputs], strict=True)]


@dataclass(frozen=True)
class Work:
    """What is simulated.

    Attributes
    ----------
    tasks : list of Task
        A part each.
    join : list of Phase
    """

    tasks: list[Task] = field(default_factory=list)
    join: list[Phase] = field(default_factory=list)


def work_of(
    film: Film, costs: Costs, parts: int, *, process_per_part: bool = True, programs: float = 0.0, seed: int = 0
) -> Work:
    """Return the work of a film.

    Parameters
    ----------
    film : Film
    costs : Costs
    parts : int
        1 to `film.chunks`.
    process_per_part : bool
        Whether every part begins with the start of a process, as ``--chunk`` does. Otherwise workers start once; that
        is a matter of the cluster.
    programs : float
        Bytes that a starting process reads from the storage.
    seed : int
        Of the chunks' costs.

    Returns
    -------
    Work
    """
    costs_vary = random.Random(seed)
    source_byte = film.source_bytes / film.source_frames
    result_byte = film.result_bytes / film.outputs
    tasks = []
    for outputs in film.parts(parts):
        begin = math.floor(outputs.start / film.factor)
        decoded, read = _lead_in(film, begin)
        cpu = costs.opening + costs.self_test + costs.part + decoded * costs.decoding + read * costs.indexing
        # the pairs before and after bend the paths of the part's own
        cpu += ((outputs.start > 0) + (outputs.stop < film.outputs)) * costs.motion
        cpu += process_per_part * costs.starting
        lead_in = Phase(cpu, read * source_byte + process_per_part * programs)
        chunks = []
        for first in range(outputs.start, outputs.stop, CHUNK_FRAMES):
            frames = min(CHUNK_FRAMES, outputs.stop - first)
            varied = costs.frames(frames, film.factor) * _varied(costs_vary, costs.variation)
            chunks.append(Phase(varied, frames / float(film.factor) * source_byte, frames * result_byte))
        tasks.append(Task(len(outputs), lead_in, tuple(chunks)))
    return Work(tasks, _join(film, costs))


def _lead_in(film: Film, begin: int) -> tuple[float, float]:
    """Return how many source frames are decoded and read before the part that begins at a frame, in the mean."""
    if not begin:
        return 0.0, float(film.source_frames) if film.access == "whole" else 0.0
    from_keyframe = min(begin, film.keyframe_interval / 2 + 2)
    reads = {"index": from_keyframe, "before": begin, "whole": film.source_frames + from_keyframe, "decoded": begin}
    return (begin if film.access == "decoded" else from_keyframe), float(reads[film.access])


def _varied(random: random.Random, variation: float) -> float:
    """Return a factor of mean 1 with a log-normal distribution."""
    width = math.sqrt(math.log1p(variation**2))
    return random.lognormvariate(-(width**2) / 2, width) if width else 1.0


def _join(film: Film, costs: Costs) -> list[Phase]:
    """Return the phases of putting all parts together, nothing of which is in the memory of the machine."""
    sound = film.sound_bits / 8 * film.seconds
    cpu = costs.joining + film.outputs * costs.joining_frame + film.result_bytes * costs.joining_byte
    checks = [Phase(cpu / film.passes, film.result_bytes)] * (film.passes - 1)
    source = sound if film.sound_apart else film.source_bytes
    muxing = Phase(cpu / film.passes, film.result_bytes + source, film.result_bytes + sound)
    rewriting = [Phase(0.0, muxing.written, muxing.written)] if film.rewrites else []
    return [*checks, muxing, *rewriting]
