"""How long a film takes on many workers: ``python benchmarks/scale.py`` prints the table of ``docs/farm.md``.

Workers take parts from a queue. A part starts a process, makes its chunks and writes them; its time is that of
computing, or of moving its bytes through the storage that all workers share, whichever is longer. When all parts are
there, one worker joins them. The film, the machines and the costs of a frame are the constants below. ``--cost`` gives
your own CPU seconds of a frame: those of ``benchmarks/speed.py threads --clip CLIP`` over the frames written.
"""

from __future__ import annotations

import argparse
import math
import random
from collections.abc import Iterator
from dataclasses import dataclass, replace
from heapq import heapify, heapreplace
from itertools import pairwise
from statistics import mean

FRAMES, CHUNK = 345_600, 240
"""Output frames of two hours at 24 frames per second, doubled, and those of a chunk."""

SOURCE_BYTES, RESULT_BYTES = 50e6 / 8 * 7200, 60e6 / 8 * 7200
COSTS = {"nlm --preset medium": 1.18, "nlm --preset veryfast": 0.95, "nlm-fast --preset veryfast": 0.655}
"""CPU seconds of an output frame of 3840x2160, four workers a machine; measured on an AMD EPYC (Zen 4)."""

WORKERS = (16, 128)
VARIATION = 0.1
"""Standard deviation of a chunk's cost over its mean: scenes differ."""

JOIN_PASSES = 5
"""Times that joining moves the result: read to verify, read and written as one file, read and written once more so that
its index comes first."""

SEEDS = 5
HOUR = 3600.0


@dataclass(frozen=True)
class Farm:
    """What a prediction assumes; times in seconds, speeds in bytes per second.

    Attributes
    ----------
    part_cost : float
        CPU time of a part beyond its frames: start, self-test, frames around it, manifest.
    link, storage : float
        Speed of the link of each worker, and of the storage that all share.
    parts_per_worker : float
    slow_share, slowness : float
        Share of the workers that are slower than others, and how many times.
    failure_interval, absence : float
        Mean time after which a worker is lost with the part that it makes, and until another one takes its place.
    arrival : float
        Time between the arrival of one worker and the next.
    """

    part_cost: float = 6.0
    link: float = 125e6
    storage: float = 500e6
    parts_per_worker: float = 4
    slow_share: float = 0.0
    slowness: float = 3.0
    failure_interval: float = math.inf
    absence: float = 120.0
    arrival: float = 0.0


def part_seconds(chunks: int, cost: float, workers: int, farm: Farm, chance: random.Random) -> float:
    """Return how long a worker of usual speed makes a part of so many chunks."""
    width = math.sqrt(math.log1p(VARIATION**2))
    computing = farm.part_cost + sum(
        cost * CHUNK * chance.lognormvariate(-(width**2) / 2, width) for _ in range(chunks)
    )
    moving = (SOURCE_BYTES + RESULT_BYTES) * chunks * CHUNK / FRAMES / min(farm.link, farm.storage / workers)
    return max(computing, moving)


def film_seconds(cost: float, workers: int, farm: Farm, seed: int = 0) -> float:
    """Return how long a film takes until it is joined.

    Examples
    --------
    >>> round(film_seconds(1.0, 1, Farm(part_cost=0)) / HOUR)
    97
    """
    chance = random.Random(seed)
    chunks = -(-FRAMES // CHUNK)
    parts = min(chunks, round(workers * farm.parts_per_worker))
    borders = [chunks * number // parts for number in range(parts + 1)]
    speeds = [farm.slowness if number < farm.slow_share * workers else 1.0 for number in range(workers)]
    chance.shuffle(speeds)
    free = [(number * farm.arrival, speed) for number, speed in enumerate(speeds)]
    heapify(free)
    end = 0.0
    for first, last in pairwise(borders):
        begin, speed = free[0]
        lasts = part_seconds(last - first, cost, workers, farm, chance) * speed
        while (lost_after := chance.expovariate(1) * farm.failure_interval) < lasts:
            heapreplace(free, (begin + lost_after + farm.absence, speed))
            begin, speed = free[0]
        heapreplace(free, (begin + lasts, speed))
        end = max(end, begin + lasts)
    return end + JOIN_PASSES * RESULT_BYTES / min(farm.link, farm.storage)


def predict(cost: float, workers: int, farm: Farm) -> float:
    """Return the mean of several simulations, hours."""
    return mean(film_seconds(cost, workers, farm, seed) for seed in range(SEEDS)) / HOUR


def rows(costs: dict[str, float], farm: Farm) -> Iterator[str]:
    """Yield the lines of the table."""
    yield "| | core hours | " + " | ".join(f"{workers} workers" for workers in WORKERS) + " |"
    yield "|---|---|" + "---|" * len(WORKERS)
    for name, cost in costs.items():
        hours = (f"{predict(cost, workers, farm):.1f} h" for workers in WORKERS)
        yield f"| `{name}` | {cost * FRAMES / HOUR:.0f} | {' | '.join(hours)} |"


def wrong_assumptions(cost: float, workers: int, farm: Farm) -> Iterator[str]:
    """Yield how much longer a film takes where one assumption does not hold."""
    usual = predict(cost, workers, farm)
    for name, changed in {
        "one worker in 20 three times slower": replace(farm, slow_share=0.05),
        "workers that fail every hour": replace(farm, failure_interval=HOUR),
        "storage a tenth as fast": replace(farm, storage=farm.storage / 10),
        "workers one by one every 10 s": replace(farm, arrival=10.0),
        "eight parts a worker": replace(farm, parts_per_worker=8),
        "one part a worker": replace(farm, parts_per_worker=1),
    }.items():
        yield f"{name}: {predict(cost, workers, changed) / usual - 1:+.0%}"


def main() -> None:
    """Print the table, and what wrong assumptions cost."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cost", type=float, help="CPU seconds of an output frame, instead of the measured ones")
    cost = parser.parse_args().cost
    costs = COSTS if cost is None else {"your own": cost}
    print("\n".join(rows(costs, Farm())))
    name = list(costs)[min(1, len(costs) - 1)]
    print(f"\n{name}, {WORKERS[-1]} workers, if one assumption is wrong:")
    print("\n".join(wrong_assumptions(costs[name], WORKERS[-1], Farm())))


if __name__ == "__main__":
    main()
