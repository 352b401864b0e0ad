"""Discrete-event simulation of workers that take the parts of a film from a queue and share machines and storage.

Nothing is measured here, and nothing of fpsboost is imported: tasks and a cluster in, times out. Equal arguments give
equal results.

A task is a sequence of phases. A phase computes, reads and writes at the same time, and ends when all of that is done.
The workers of a machine share its processor, and all workers share the storage, evenly (processor sharing): each has
its own limit, and together they have one. Tasks are taken largest first.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from heapq import heappop, heappush
from itertools import count


@dataclass(frozen=True)
class Phase:
    """A stretch of work.

    Attributes
    ----------
    cpu : float
        CPU seconds on an undisturbed core.
    read, written : float
        Bytes that move between worker and storage meanwhile.
    """

    cpu: float
    read: float = 0.0
    written: float = 0.0

    @property
    def moved(self) -> float:
        """Bytes read and written."""
        return self.read + self.written


@dataclass(frozen=True)
class Task:
    """A part of a film.

    Attributes
    ----------
    size : float
        What is known of its cost beforehand; the largest goes first.
    lead_in : Phase
        What comes before its first chunk, and again where it is done again.
    chunks : tuple of Phase
    closing : Phase
        What comes after its last chunk.
    """

    size: float
    lead_in: Phase
    chunks: tuple[Phase, ...]
    closing: Phase = Phase(0.0)

    @property
    def phases(self) -> tuple[Phase, ...]:
        """All phases in order."""
        return (self.lead_in, *self.chunks, self.closing)

    def after(self, chunks: int) -> Task:
        """Return what is left of the task when so many chunks are done."""
        return replace(self, chunks=self.chunks[chunks:])


@dataclass(frozen=True)
class Interruptions:
    """Loss of workers, at exponentially distributed times.

    Attributes
    ----------
    mean_time : float
        Mean seconds between two: of each worker if `share` is 0, else of the whole cluster.
    share : float
        Share of the workers that are lost at once, as when a provider takes its spare machines back.
    absence : float
        Seconds until another worker begins in its place.
    """

    mean_time: float = math.inf
    share: float = 0.0
    absence: float = 60.0


@dataclass(frozen=True)
class Cluster:
    """Workers and what they share.

    Attributes
    ----------
    workers : int
        Each has one core.
    per_machine : int
        Workers on a machine; the last one may have fewer.
    slowdown : tuple of float
        How many times as much CPU time the same work takes on a machine where 1, 2 ... workers compute at once; the
        last value goes on for more.
    bandwidth : float
        Bytes per second that the storage moves in all, in both directions together.
    link : float
        Bytes per second between one worker and the storage.
    join_link : float or None
        The same of the worker that does the last step; `link` by default.
    start : Phase
        What a worker does before its first task.
    arrival : float
        Seconds between the arrivals of two workers in the beginning.
    straggler_share, straggler_slowness : float
        Probability that a worker is slow, and how many times as slow.
    failures, preemptions : Interruptions
        Of single workers, and of a share of them.
    resumes : bool
        Whether a task goes on after the chunks that a lost worker has finished.
    """

    workers: int
    per_machine: int = 1
    slowdown: tuple[float, ...] = (1.0,)
    bandwidth: float = math.inf
    link: float = math.inf
    join_link: float | None = None
    start: Phase = Phase(0.0)
    arrival: float = 0.0
    straggler_share: float = 0.0
    straggler_slowness: float = 1.0
    failures: Interruptions = Interruptions()
    preemptions: Interruptions = Interruptions()
    resumes: bool = False


SPENT = ("computing", "slowed down", "reading", "writing", "start-up", "lost", "absent", "idle", "join")
"""On what the time of workers is spent.

`computing` is what the work takes on an undisturbed core; `slowed down` what it takes more, by other workers on the
machine or a slow worker; `reading` and `writing` are waiting for the storage when nothing is left to compute; `lost` is
work that is done again; `absent` is time between the loss of a worker and the next one's beginning; `idle` is waiting
for the end of other workers' tasks, and `join` for the last step.
"""


@dataclass(frozen=True)
class Outcome:
    """What became of a job.

    Attributes
    ----------
    wall : float
        Seconds until the result is complete; infinite if that was given up.
    made : float
        Seconds until all tasks were done.
    spent : dict of str to float
        Seconds of all workers by `SPENT`; the sum is the number of workers times `wall`.
    interruptions : int
        Workers that were lost.
    repeated : int
        Tasks that were interrupted.
    read, written : float
        Bytes, with those of work that was lost.
    """

    wall: float
    made: float
    spent: dict[str, float]
    interruptions: int = 0
    repeated: int = 0
    read: float = 0.0
    written: float = 0.0


class SharedResource:
    """Flows that progress at the same rate, which hangs on their number.

    Each flow ends when the common progress has grown by its amount. So only the number of flows changes the rate, and
    the next to end stands first in a heap.

    Parameters
    ----------
    rate : callable
        Progress per second of each of n flows.
    """

    def __init__(self, rate: Callable[[int], float]) -> None:
        self._rate = rate
        self._clock = self._progress = 0.0
        self._ends: list[tuple[float, int]] = []
        self._flowing: set[int] = set()
        self.version = 0
        """Grows whenever the next end may have changed."""

    def add(self, now: float, key: int, amount: float) -> None:
        """Begin a flow of some amount."""
        self._advance(now)
        self._flowing.add(key)
        heappush(self._ends, (self._progress + amount, key))
        self.version += 1

    def remove(self, now: float, key: int) -> None:
        """Stop a flow, if it has not ended."""
        if key in self._flowing:
            self._advance(now)
            self._flowing.remove(key)
            self.version += 1

    def next_end(self) -> float:
        """Return when the next flow ends if none begins before; infinite if there is none."""
        while self._ends and self._ends[0][1] not in self._flowing:
            heappop(self._ends)
        if not self._ends:
            return math.inf
        return self._clock + max(0.0, self._ends[0][0] - self._progress) / self._rate(len(self._flowing))

    def end_next(self, now: float) -> int:
        """End the flow whose time has come, and return its key."""
        progress, key = heappop(self._ends)
        self._clock, self._progress = now, progress
        self._flowing.remove(key)
        self.version += 1
        return key

    def _advance(self, now: float) -> None:
        if self._flowing:
            self._progress += (now - self._clock) * self._rate(len(self._flowing))
        self._clock = now


@dataclass(eq=False)
class _Worker:
    """State of the worker in one place; who is lost is replaced there.

    Attributes
    ----------
    machine : SharedResource
    life : int
        Number of workers that were lost in this place.
    slowness : float
    since : float
        When it was lost, became idle, or began its phase.
    state : str
        "absent", "starting", "working" or "idle".
    task : Task or None
        What it works on.
    phases : list of Phase
        What follows the current one, the last one first.
    phase : Phase or None
        The current one.
    flows : dict of int to SharedResource
        What the current phase waits for, by key.
    computed : float
        When its computing ended.
    spent : dict of str to float
        On its task.
    """

    machine: SharedResource
    life: int = 0
    slowness: float = 1.0
    since: float = 0.0
    state: str = "absent"
    task: Task | None = None
    phases: list[Phase] = field(default_factory=list)
    phase: Phase | None = None
    flows: dict[int, SharedResource] = field(default_factory=dict)
    computed: float = 0.0
    spent: dict[str, float] = field(default_factory=lambda: dict.fromkeys(SPENT, 0.0))

    @property
    def chunks_done(self) -> int:
        """Number of complete chunks of its task."""
        assert self.task is not None
        done = len(self.task.phases) - len(self.phases) - 1  # the lead-in is one of them, the current phase is not
        return max(0, min(done - 1, len(self.task.chunks)))


class _Simulation:
    """State of a simulation; see `simulate`."""

    def __init__(self, tasks: Sequence[Task], cluster: Cluster, seed: int) -> None:
        self.cluster, self.random = cluster, random.Random(seed)
        self.order = count()
        self.queue: list[tuple[float, int, Task]] = []
        for task in tasks:
            self.put(task)
        self.left = len(tasks)
        self.now = 0.0
        self.events: list[tuple[float, int, Callable[[], None]]] = []
        self.owners: dict[int, tuple[_Worker, bool]] = {}
        self.storage = SharedResource(lambda flows: min(cluster.link, cluster.bandwidth / flows))
        self.has_storage = min(cluster.link, cluster.bandwidth) < math.inf
        machines = [SharedResource(self.speed) for _ in range(-(-cluster.workers // cluster.per_machine))]
        self.workers = [_Worker(machines[place // cluster.per_machine]) for place in range(cluster.workers)]
        self.idle: list[_Worker] = []
        self.spent = dict.fromkeys(SPENT, 0.0)
        self.interruptions = self.repeated = 0
        self.read = self.written = 0.0

    def speed(self, flows: int) -> float:
        """Return the CPU seconds of undisturbed work that each of some computing workers of a machine does a second."""
        curve = self.cluster.slowdown
        return 1 / curve[min(flows, len(curve)) - 1]

    def put(self, task: Task) -> None:
        """Put a task into the queue; of equal ones the first to come goes first."""
        heappush(self.queue, (-task.size, next(self.order), task))

    def at(self, time: float, run: Callable[[], None]) -> None:
        """Plan an event."""
        if time < math.inf:
            heappush(self.events, (time, next(self.order), run))

    def run(self, patience: float) -> bool:
        """Run until all tasks are done; return whether they were before it had taken too long."""
        for place, worker in enumerate(self.workers):
            self.at(place * self.cluster.arrival, partial(self.arrive, worker))
        if self.cluster.preemptions.share:
            self.plan_preemption()
        while self.left:
            self.now, _, run = heappop(self.events)
            if self.now > patience:
                return False
            run()
        rest = {"absent": "absent", "starting": "start-up", "idle": "idle"}
        for worker in self.workers:
            self.spent[rest[worker.state]] += self.now - worker.since
        return True

    def arrive(self, worker: _Worker) -> None:
        """Begin a worker."""
        self.spent["absent"] += self.now - worker.since
        cluster = self.cluster
        is_slow = self.random.random() < cluster.straggler_share
        worker.slowness = cluster.straggler_slowness if is_slow else 1.0
        worker.state = "starting"
        if cluster.failures.mean_time < math.inf:
            lasts = self.random.expovariate(1 / cluster.failures.mean_time)
            self.at(self.now + lasts, partial(self.lose, worker, worker.life, cluster.failures))
        self.begin_phase(worker, cluster.start)

    def go_on(self, worker: _Worker) -> None:
        """Begin the next phase of a worker's task, or another task, or wait for one."""
        if worker.phases:
            self.begin_phase(worker, worker.phases.pop())
        elif self.queue:
            _, _, worker.task = heappop(self.queue)
            worker.state, worker.phases = "working", list(reversed(worker.task.phases))
            self.begin_phase(worker, worker.phases.pop())
        else:
            worker.state, worker.since = "idle", self.now
            self.idle.append(worker)

    def begin_phase(self, worker: _Worker, phase: Phase) -> None:
        """Begin to compute and to move bytes."""
        worker.phase, worker.since, worker.computed = phase, self.now, self.now
        self.begin_flow(worker, worker.machine, phase.cpu * worker.slowness, computes=True)
        if self.has_storage:
            self.begin_flow(worker, self.storage, phase.moved, computes=False)
        if not worker.flows:
            self.at(self.now, partial(self.end_phase, worker, phase))

    def begin_flow(self, worker: _Worker, resource: SharedResource, amount: float, *, computes: bool) -> None:
        """Begin a flow of a phase."""
        if amount > 0:
            key = next(self.order)
            self.owners[key] = worker, computes
            worker.flows[key] = resource
            resource.add(self.now, key, amount)
            self.plan_end(resource)

    def plan_end(self, resource: SharedResource) -> None:
        """Plan the event at which the next flow of a resource ends."""
        self.at(resource.next_end(), partial(self.end_flow, resource, resource.version))

    def end_flow(self, resource: SharedResource, version: int) -> None:
        """End a flow, unless others have begun or ended since that was planned."""
        if resource.version != version:
            return
        key = resource.end_next(self.now)
        self.plan_end(resource)
        worker, computes = self.owners.pop(key)
        del worker.flows[key]
        if computes:
            worker.computed = self.now
        if not worker.flows and worker.phase is not None:
            self.end_phase(worker, worker.phase)

    def end_phase(self, worker: _Worker, phase: Phase) -> None:
        """Account for a phase, and go on."""
        if worker.phase is not phase:  # lost at this very moment
            return
        worker.phase = None
        self.read += phase.read
        self.written += phase.written
        if worker.task is None:
            self.spent["start-up"] += self.now - worker.since
            return self.go_on(worker)
        waited = self.now - worker.computed
        reading = phase.read / phase.moved if phase.moved else 0.0
        worker.spent["computing"] += phase.cpu
        worker.spent["slowed down"] += worker.computed - worker.since - phase.cpu
        worker.spent["reading"] += waited * reading
        worker.spent["writing"] += waited * (1 - reading)
        if not worker.phases:
            worker.task = None
            self.left -= 1
            self.settle(worker)
            worker.state, worker.since = "idle", self.now
        return self.go_on(worker) if self.left else None

    def settle(self, worker: _Worker) -> None:
        """Add what a worker has spent on a task to the sum."""
        for name, seconds in worker.spent.items():
            self.spent[name] += seconds
        worker.spent = dict.fromkeys(SPENT, 0.0)

    def lose(self, worker: _Worker, life: int, cause: Interruptions) -> None:
        """Lose a worker: its task is done again, or goes on after what is complete."""
        if worker.life != life or worker.state == "absent":
            return
        self.interruptions += 1
        self.stop(worker)
        worker.life, worker.state, worker.since = worker.life + 1, "absent", self.now
        self.at(self.now + cause.absence, partial(self.arrive, worker))
        if self.queue and self.idle:
            waited = self.idle.pop()
            self.spent["idle"] += self.now - waited.since
            self.go_on(waited)

    def stop(self, worker: _Worker) -> None:
        """Stop what a worker does, and put its task back into the queue."""
        for key, resource in worker.flows.items():
            del self.owners[key]
            resource.remove(self.now, key)
            self.plan_end(resource)
        worker.flows = {}
        if worker.task is None:
            self.spent["idle" if worker.state == "idle" else "start-up"] += self.now - worker.since
            if worker.state == "idle":
                self.idle.remove(worker)
        else:
            self.repeated += 1
            kept = worker.chunks_done if self.cluster.resumes else 0
            if not kept:
                worker.spent = {**dict.fromkeys(SPENT, 0.0), "lost": sum(worker.spent.values())}
            worker.spent["lost"] += self.now - worker.since
            self.settle(worker)
            self.put(worker.task.after(kept))
        worker.task = worker.phase = None
        worker.phases = []

    def plan_preemption(self) -> None:
        """Plan the next loss of a share of the workers."""
        lasts = self.random.expovariate(1 / self.cluster.preemptions.mean_time)
        self.at(self.now + lasts, self.preempt)

    def preempt(self) -> None:
        """Lose a share of the workers at once."""
        preemptions = self.cluster.preemptions
        there = [worker for worker in self.workers if worker.state != "absent"]
        for worker in self.random.sample(there, round(preemptions.share * len(there))):
            self.lose(worker, worker.life, preemptions)
        self.plan_preemption()


def simulate(
    tasks: Sequence[Task],
    cluster: Cluster,
    *,
    join: Sequence[Phase] = (),
    seed: int = 0,
    patience: float = math.inf,
) -> Outcome:
    """Simulate a job.

    Parameters
    ----------
    tasks : sequence of Task
        At least one.
    cluster : Cluster
    join : sequence of Phase
        What one worker does when all tasks are done, with nobody beside it; it is not interrupted.
    seed : int
        Of everything that is left to chance.
    patience : float
        Seconds after which the job is given up.

    Returns
    -------
    Outcome

    Examples
    --------
    >>> task = Task(1, Phase(2), (Phase(10),))
    >>> simulate([task] * 4, Cluster(2)).wall
    24.0
    """
    simulation = _Simulation(tasks, cluster, seed)
    is_done = simulation.run(patience)
    made = simulation.now if is_done else math.inf
    speed = min(cluster.link if cluster.join_link is None else cluster.join_link, cluster.bandwidth)
    joining = sum(max(phase.cpu * cluster.slowdown[0], phase.moved / speed) for phase in join)
    simulation.spent["join"] = joining * cluster.workers
    return Outcome(
        wall=made + joining,
        made=made,
        spent=simulation.spent,
        interruptions=simulation.interruptions,
        repeated=simulation.repeated,
        read=simulation.read + sum(phase.read for phase in join),
        written=simulation.written + sum(phase.written for phase in join),
    )
