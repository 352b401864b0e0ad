"""The model of scale: its simulation against what is known of schedules, and its tasks against the film they are of."""

from __future__ import annotations

import importlib
import json
import math
import sys
from dataclasses import asdict
from fractions import Fraction
from pathlib import Path
from statistics import mean, pstdev
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fpsboost.io.part import Part
from fpsboost.io.video.chunks import CHUNK_FRAMES
from fpsboost.method_table import methods
from fpsboost.parts.making import outputs_of

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(scope="module")
def model() -> ModuleType:
    """The simulation."""
    return _module("simulation")


@pytest.fixture(scope="module")
def film_parts() -> ModuleType:
    """The film's tasks."""
    return _module("film_parts")


@pytest.fixture(scope="module")
def scale() -> ModuleType:
    """The program."""
    return _module("scale")


def _module(name: str) -> ModuleType:
    sys.path.insert(0, str(BENCHMARKS))
    try:
        return importlib.import_module(name)
    finally:
        sys.path.remove(str(BENCHMARKS))


seconds = st.floats(0, 100).filter(lambda value: value == 0 or value > 1e-3)
sizes_of_bytes = st.sampled_from([0.0, 1e3, 5e6, 1e8])


@st.composite
def jobs(draw: st.DrawFn) -> list[Any]:
    """Draw tasks whose size says what they cost or does not."""
    model = _module("simulation")
    phases = st.builds(model.Phase, seconds, sizes_of_bytes, sizes_of_bytes)
    chunks = st.lists(phases, max_size=4).map(tuple)
    return draw(st.lists(st.builds(model.Task, seconds, phases, chunks, phases), min_size=1, max_size=12))


def cost(task: Any) -> float:
    """Return the CPU seconds of a task."""
    return math.fsum(phase.cpu for phase in task.phases)


@given(jobs=jobs())
def test_one_worker_takes_the_sum_of_all_costs(model: ModuleType, jobs: list[Any]) -> None:
    """Start-up, tasks and join one after the other, computing and moving side by side within a phase."""
    cluster = model.Cluster(1, bandwidth=1e7, link=2e6, start=model.Phase(3, 4e6))
    join = [model.Phase(1, 1e7, 1e6), model.Phase(2)]
    outcome = model.simulate(jobs, cluster, join=join)
    phases = [cluster.start, *(phase for task in jobs for phase in task.phases), *join]
    assert outcome.wall == pytest.approx(math.fsum(max(each.cpu, each.moved / 2e6) for each in phases))
    assert outcome.read == pytest.approx(sum(each.read for each in phases))
    assert outcome.written == pytest.approx(sum(each.written for each in phases))


@given(jobs=jobs(), workers=st.integers(1, 9))
def test_many_workers_keep_the_bounds_of_list_scheduling(model: ModuleType, jobs: list[Any], workers: int) -> None:
    """Between the larger of the mean load and the longest task, and Graham's bound."""
    costs = [cost(task) for task in jobs]
    wall = model.simulate(jobs, model.Cluster(workers)).wall
    assert wall >= max(sum(costs) / workers, *costs, 0) * (1 - 1e-9)
    assert wall <= (sum(costs) / workers + (1 - 1 / workers) * max(costs)) * (1 + 1e-9)


@settings(deadline=None)
@given(
    jobs=jobs(),
    workers=st.integers(1, 6),
    seed=st.integers(0, 1000),
    resumes=st.booleans(),
    mean_time=st.sampled_from([100.0, 400.0, math.inf]),
)
def test_time_is_conserved(
    model: ModuleType, jobs: list[Any], workers: int, seed: int, resumes: bool, mean_time: float
) -> None:
    """What workers spend on all things is their number times the wall time, and useful work is done once."""
    cluster = model.Cluster(
        workers,
        per_machine=2,
        slowdown=(1.0, 1.3),
        bandwidth=2e7,
        link=1e7,
        start=model.Phase(2, 1e6),
        arrival=1.5,
        straggler_share=0.3,
        straggler_slowness=2.0,
        failures=model.Interruptions(mean_time, absence=7),
        preemptions=model.Interruptions(300, share=0.5, absence=3),
        resumes=resumes,
    )
    outcome = model.simulate(jobs, cluster, join=[model.Phase(1, 1e6)], seed=seed, patience=1e5)
    if outcome.wall == math.inf:  # a task that is longer than most workers last
        return
    assert sum(outcome.spent.values()) == pytest.approx(workers * outcome.wall)
    assert min(outcome.spent.values()) >= -1e-6
    needed = sum(map(cost, jobs))
    if resumes:
        assert outcome.spent["computing"] >= needed * (1 - 1e-9)
    else:
        assert outcome.spent["computing"] == pytest.approx(needed)
    again = model.simulate(jobs, cluster, join=[model.Phase(1, 1e6)], seed=seed, patience=1e5)
    assert again == outcome


@given(jobs=jobs(), workers=st.integers(1, 6))
def test_more_bandwidth_than_is_needed_changes_nothing(model: ModuleType, jobs: list[Any], workers: int) -> None:
    """A storage beyond all demand is as good as an infinite one, and a finite one serves no more than it can."""
    free = model.simulate(jobs, model.Cluster(workers)).wall
    assert model.simulate(jobs, model.Cluster(workers, bandwidth=1e18)).wall == pytest.approx(free, rel=1e-6, abs=1e-6)
    narrow = model.simulate(jobs, model.Cluster(workers, bandwidth=1e6))
    moved = sum(phase.moved for task in jobs for phase in task.phases)
    assert narrow.wall >= moved / 1e6 * (1 - 1e-9)


def test_shared_flows_end_when_processor_sharing_says(model: ModuleType) -> None:
    """Three flows that begin one after the other end at the times worked out by hand."""
    resource = model.SharedResource(lambda flows: 1 / flows)
    resource.add(0.0, 1, 4.0)
    resource.add(2.0, 2, 1.0)  # the first has 2 left; both at 1/2
    resource.add(3.0, 3, 9.0)  # 1.5 and 0.5 left; all at 1/3
    assert resource.next_end() == pytest.approx(4.5)
    assert resource.end_next(4.5) == 2
    assert resource.next_end() == pytest.approx(6.5)  # 1 left at 1/2
    resource.remove(5.5, 3)
    assert resource.next_end() == pytest.approx(6.0)  # 0.5 left, alone
    assert resource.end_next(6.0) == 1
    assert resource.next_end() == math.inf


def test_the_last_step_has_the_storage_to_itself(model: ModuleType) -> None:
    """Its bytes move at the speed of the narrower of its link and the storage."""
    task, join = model.Task(1, model.Phase(0), (model.Phase(10),)), [model.Phase(1, 4e6, 4e6)]
    walls = [
        model.simulate([task], model.Cluster(1, bandwidth=4e6, link=1e6, join_link=join_link), join=join).wall
        for join_link in (None, 2e6, 9e6)
    ]
    assert walls == pytest.approx([18, 14, 12])


def test_workers_of_a_machine_slow_each_other_down(model: ModuleType) -> None:
    """Two of a machine take the time that the curve says; on two machines they do not."""
    tasks = [model.Task(1, model.Phase(0), (model.Phase(10),))] * 2
    together = model.simulate(tasks, model.Cluster(2, per_machine=2, slowdown=(1, 1.4)))
    assert together.wall == pytest.approx(14)
    assert together.spent["slowed down"] == pytest.approx(8)
    assert model.simulate(tasks, model.Cluster(2, slowdown=(1, 1.4))).wall == pytest.approx(10)


def test_a_straggler_holds_up_the_end(model: ModuleType) -> None:
    """A worker that is three times slower finishes its task last, and the others wait."""
    tasks = [model.Task(1, model.Phase(0), (model.Phase(10),))] * 4
    outcome = model.simulate(tasks, model.Cluster(4, straggler_share=1.0, straggler_slowness=3.0))
    assert outcome.wall == pytest.approx(30)
    assert outcome.spent["slowed down"] == pytest.approx(80)


def test_interruptions_lengthen_a_job_in_the_mean(model: ModuleType) -> None:
    """The more often workers are lost the longer it takes, and less where finished chunks are kept."""
    tasks = [model.Task(8, model.Phase(1), (model.Phase(10),) * 8)] * 12

    def wall(mean_time: float, resumes: bool = False) -> float:
        cluster = model.Cluster(4, failures=model.Interruptions(mean_time, absence=5), resumes=resumes)
        return mean(model.simulate(tasks, cluster, seed=seed).wall for seed in range(40))

    assert wall(math.inf) < wall(3000) < wall(300) < wall(100)
    assert wall(math.inf) < wall(100, resumes=True) < wall(100)


def test_the_mean_time_of_a_task_on_failing_workers_is_known(model: ModuleType) -> None:
    """A task of length t, done again from its beginning, takes (m + r)(exp(t/m) - 1) in the mean."""
    lasts, absence, length = 50.0, 5.0, 40.0
    cluster = model.Cluster(1, failures=model.Interruptions(lasts, absence=absence))
    task = model.Task(1, model.Phase(0), (model.Phase(length),))
    measured = mean(model.simulate([task], cluster, seed=seed).wall for seed in range(4000))
    assert measured == pytest.approx((lasts + absence) * math.expm1(length / lasts), rel=0.06)


def test_a_job_that_cannot_end_is_given_up(model: ModuleType) -> None:
    """A task far longer than workers last has no end, which is said by an infinite time."""
    task = model.Task(1, model.Phase(0), (model.Phase(1e6),))
    cluster = model.Cluster(2, failures=model.Interruptions(10))
    assert model.simulate([task], cluster, patience=1e4).wall == math.inf


def test_a_preemption_takes_its_share_at_once(model: ModuleType) -> None:
    """Half of eight workers are lost at each."""
    task = model.Task(1, model.Phase(0), (model.Phase(100),))
    cluster = model.Cluster(8, preemptions=model.Interruptions(60, share=0.5, absence=1e5))
    outcome = model.simulate([task] * 8, cluster, seed=1)
    assert outcome.interruptions in (4, 6, 7, 8)
    assert outcome.repeated == outcome.interruptions


def test_idle_workers_take_what_a_lost_one_leaves(model: ModuleType) -> None:
    """The task of a lost worker does not wait for another one to begin."""
    task = model.Task(1, model.Phase(0), (model.Phase(100),))
    walls = [
        model.simulate([task], model.Cluster(40, failures=model.Interruptions(200, absence=1e6)), seed=seed).wall
        for seed in range(5)
    ]
    assert max(walls) < 1e6


def test_a_film_is_cut_as_its_parts_are(film_parts: ModuleType) -> None:
    """The parts of the model are those of `fpsboost.parts`, whatever their number."""
    assert film_parts.CHUNK_FRAMES == CHUNK_FRAMES
    film = film_parts.Film(source_frames=5000)
    for count in (1, 2, 7, film.chunks):
        cut = [outputs_of(Part(number, count), film.outputs, CHUNK_FRAMES) for number in range(1, count + 1)]
        stops = [film.outputs if each.stop is None else each.stop for each in cut]
        assert film.parts(count) == [range(each.first, stop) for each, stop in zip(cut, stops, strict=True)]


@given(parts=st.integers(1, 42), factor=st.sampled_from([Fraction(2), Fraction(5, 2), Fraction(4)]))
def test_the_work_of_a_film_hangs_on_its_parts_by_their_beginnings_alone(
    film_parts: ModuleType, parts: int, factor: Fraction
) -> None:
    """Chunks cost and move the same however they are put into parts; every part has its lead-in."""
    film = film_parts.Film(source_frames=5000, factor=factor, rewrites=False, passes=1)
    costs = film_parts.Costs(decoding=0.01, motion=0.5, synthesis=0.3, encoding=0.1, rest=0.02, starting=2, part=0.2)
    work = film_parts.work_of(film, costs, parts)
    chunks = [chunk for task in work.tasks for chunk in task.chunks]
    assert len(work.tasks) == parts
    assert len(chunks) == film.chunks
    assert sum(each.cpu for each in chunks) == pytest.approx(costs.frames(film.outputs, factor))
    assert sum(each.read for each in chunks) == pytest.approx(film.source_bytes)
    assert sum(each.written for each in chunks) == pytest.approx(film.result_bytes)
    assert all(task.lead_in.cpu >= 2.2 for task in work.tasks)
    assert work.join[0].read == pytest.approx(film.result_bytes + film.sound_bits / 8 * film.seconds)


def test_what_a_part_reads_hangs_on_the_container(film_parts: ModuleType) -> None:
    """An index in the header spares most reading; without any, everything before a part is read and decoded."""
    read, cpu = {}, {}
    for access in ("index", "before", "whole", "decoded"):
        film = film_parts.Film(source_frames=20_000, access=access)
        work = film_parts.work_of(film, film_parts.Costs(decoding=0.01), 10)
        read[access] = sum(task.lead_in.read for task in work.tasks) / film.source_bytes
        cpu[access] = sum(task.lead_in.cpu for task in work.tasks)
    assert read["index"] < 0.02
    assert read["before"] == read["decoded"] == pytest.approx(4.5, rel=0.05)
    assert read["whole"] == pytest.approx(10, rel=0.05)
    assert cpu["decoded"] > 10 * cpu["before"] == 10 * cpu["index"]


def test_chunks_vary_around_their_cost(film_parts: ModuleType) -> None:
    """The costs of chunks have the mean and the deviation that are given, the same for the same seed."""
    film = film_parts.Film(source_frames=480_000)
    costs = film_parts.Costs(encoding=1.0, variation=0.3)
    chunks = [task.chunks[0].cpu for task in film_parts.work_of(film, costs, film.chunks, seed=3).tasks]
    assert mean(chunks) == pytest.approx(CHUNK_FRAMES, rel=0.03)
    assert pstdev(chunks) / mean(chunks) == pytest.approx(0.3, rel=0.05)
    again = film_parts.work_of(film, costs, film.chunks, seed=3)
    assert chunks == [task.chunks[0].cpu for task in again.tasks]


def test_workers_that_do_not_pay_are_found(film_parts: ModuleType, scale: ModuleType) -> None:
    """With a join as long as the parts of eight workers, the step from eight to sixteen gains a third, and no more."""
    film = film_parts.Film(source_frames=120 * 1024)
    costs = film_parts.Costs(encoding=1.0, joining=film.outputs / 8)
    scenario = scale.Scenario(film, costs, scale.Cluster(1))
    predictions = [scale.predict(scenario, workers) for workers in (1, 2, 4, 8, 16, 32)]
    assert scale.gains(predictions)[4] == pytest.approx(1 / 3, rel=0.01)
    assert scale.last_that_pays(predictions) == 8
    assert predictions[0].limit == "computing"
    assert predictions[-1].limit == "join"
    assert [each.used_core_hours for each in predictions] == pytest.approx([film.outputs * 1.125 / 3600] * 6, rel=1e-3)


def test_the_sensitivities_change_one_thing_each(film_parts: ModuleType, scale: ModuleType) -> None:
    """Every wrong assumption differs from the right one, and none makes the film faster but what leaves steps out."""
    costs = film_parts.Costs(
        encoding=0.5, starting=2.0, compiling=60.0, motion=0.5, decoding=0.01, variation=0.1, slowdown=(1.0, 1.1)
    )
    film = film_parts.Film(source_frames=9600)
    scenario = scale.Scenario(film, costs, scale.Cluster(1, per_machine=2, bandwidth=5e8, link=1e8))
    wrong = scale.sensitivities(scenario)
    assert len({repr(each) for each in wrong.values()}) == len(wrong)
    right = scale.predict(scenario, 8).wall
    walls = {name: scale.predict(each, 8).wall for name, each in wrong.items()}
    saved = {name for name, wall in walls.items() if wall < right * 0.98}
    assert saved == {"join on a machine with 10 times the link", "the same, and writes its result once"}
    assert walls["join reads the parts once"] < right


def test_the_tables_are_written(film_parts: ModuleType, scale: ModuleType, tmp_path: Path) -> None:
    """`table` and `simulate` take the costs that `measure` keeps."""
    path = tmp_path / "costs.json"
    costs = asdict(film_parts.Costs(encoding=0.5, starting=2.0))
    path.write_text(json.dumps({"costs": {"640x360": {"nlm fast": costs}}}))
    options = ["--costs", str(path), "--size", "640x360", "--minutes", "5", "--json", str(tmp_path / "out.json")]
    with pytest.MonkeyPatch.context() as patch:
        for command in (["table", "--workers", "4", "--markdown"], ["simulate", "--name", "nlm fast"]):
            patch.setattr(sys, "argv", ["scale.py", *command, *options])
            scale.main()
    assert json.loads((tmp_path / "out.json").read_text())["workers"] == 64


def test_what_is_timed_is_what_a_conversion_makes() -> None:
    """A frame between every two, after the first of them, as `make_between` makes them."""
    part_costs, scoring = _module("part_costs"), _module("scoring")
    random = np.random.default_rng(0)
    frames = [random.integers(0, 256, (40, 60, 3), np.uint8) for _ in range(4)]
    interpolator = methods["blend"]
    making = part_costs.time_making(interpolator, frames)
    made = list(scoring.make_between(interpolator, frames))
    for shown, expected in zip(making.shown, [frames[0], made[0], frames[1], made[1], frames[2], made[2]], strict=True):
        np.testing.assert_array_equal(shown, expected)
    assert min(making.motion, making.synthesis) >= 0
