"""How long a film takes on many workers, and what it costs to be wrong: ``python benchmarks/scale.py COMMAND``.

`measure` says what each stage of a conversion costs on this machine, `simulate` what W workers take for a film, `table`
where that stops to pay and which assumptions matter, and `check` how far the prediction is from real runs.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from statistics import mean
from typing import Any

from film_parts import CHUNK_FRAMES, Costs, Film, Work, work_of
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from simulation import SPENT, Cluster, Interruptions, Outcome, Phase, Task, simulate

from fpsboost.errors import FpsboostError, OptionError

WORKERS = tuple(2**power for power in range(11))
PARTS_PER_WORKER = 4
PAYS = 0.5
"""A doubling of the workers pays while those that are added work at least this well: half as fast as the first."""

SEEDS = 5
"""Simulations whose mean counts where anything is left to chance."""

HOUR = 3600.0


@dataclass(frozen=True)
class Scenario:
    """Everything that a prediction is made of.

    Attributes
    ----------
    film : Film
    costs : Costs
    cluster : Cluster
        Its number of workers and its start are set for each prediction.
    parts_per_worker : float
        Parts for each worker, as far as there are chunks.
    parts : int or None
        Number of parts, whatever the number of workers.
    process_per_part : bool
        See `film_parts.work_of`.
    cold : bool
        Whether every worker compiles the kernels.
    programs : float
        Bytes of programs that a starting process reads from the storage.
    """

    film: Film
    costs: Costs
    cluster: Cluster
    parts_per_worker: float = PARTS_PER_WORKER
    parts: int | None = None
    process_per_part: bool = True
    cold: bool = False
    programs: float = 0.0

    def parts_for(self, workers: int) -> int:
        """Return the number of parts that so many workers get."""
        wanted = round(workers * self.parts_per_worker) if self.parts is None else self.parts
        return max(1, min(self.film.chunks, wanted))

    @property
    def has_chance(self) -> bool:
        """Whether anything is left to chance."""
        cluster = self.cluster
        lost = min(cluster.failures.mean_time, cluster.preemptions.mean_time) < float("inf")
        return lost or cluster.straggler_share > 0 or self.costs.variation > 0


@dataclass(frozen=True)
class Prediction:
    """What a number of workers takes, as means over simulations; times in seconds.

    Attributes
    ----------
    workers, parts : int
    wall : float
    shares : dict of str to float
        Shares of the workers' time by `SPENT`.
    interruptions : float
    read, written : float
        Bytes.
    """

    workers: int
    parts: int
    wall: float
    shares: dict[str, float]
    interruptions: float
    read: float
    written: float

    @property
    def core_hours(self) -> float:
        """Time of all workers until the result is complete."""
        return self.workers * self.wall / HOUR

    @property
    def used_core_hours(self) -> float:
        """Core hours without those of idle or absent workers, and with one worker during the join."""
        busy = 1 - sum(self.shares[name] for name in ("idle", "absent", "join"))
        return self.core_hours * (busy + self.shares["join"] / self.workers)

    @property
    def limit(self) -> str:
        """What takes the largest share of the workers' time besides computing; computing where that is most of it."""
        if self.shares["computing"] > 0.5:
            return "computing"
        return max((name for name in SPENT if name != "computing"), key=self.shares.__getitem__)


def predict(scenario: Scenario, workers: int) -> Prediction:
    """Return what a number of workers takes."""
    parts = scenario.parts_for(workers)
    film, costs = scenario.film, scenario.costs
    compiling = costs.compiling if scenario.cold else 0.0
    start = Phase(compiling) if scenario.process_per_part else Phase(compiling + costs.starting, scenario.programs)
    cluster = replace(scenario.cluster, workers=workers, start=start)
    outcomes: list[Outcome] = []
    for seed in range(SEEDS if scenario.has_chance else 1):
        work = work_of(
            *(film, costs, parts),
            process_per_part=scenario.process_per_part,
            programs=scenario.programs,
            seed=seed,
        )
        outcomes.append(simulate(work.tasks, cluster, join=work.join, seed=seed, patience=patience(work, workers)))
    wall = mean(outcome.wall for outcome in outcomes)
    whole = sum(sum(outcome.spent.values()) for outcome in outcomes)
    shares = {name: sum(outcome.spent[name] for outcome in outcomes) / whole for name in SPENT}
    return Prediction(
        *(workers, parts, wall, shares),
        interruptions=mean(outcome.interruptions for outcome in outcomes),
        read=mean(outcome.read for outcome in outcomes),
        written=mean(outcome.written for outcome in outcomes),
    )


def patience(work: Work, workers: int) -> float:
    """Return the time after which a job is given up: many times what it takes."""
    whole = sum(phase.cpu + phase.moved / 1e6 for task in work.tasks for phase in task.phases)
    longest = max(sum(phase.cpu + phase.moved / 1e6 for phase in task.phases) for task in work.tasks)
    return 30 * (whole / workers + longest) + HOUR


def gains(predictions: Sequence[Prediction]) -> list[float | None]:
    """Return how well the workers work that each doubling adds: 1 if it halves the time, 0 if it saves none."""
    return [None, *(one.wall / two.wall - 1 for one, two in pairwise(predictions))]


def last_that_pays(predictions: Sequence[Prediction]) -> int:
    """Return the number of workers up to which every doubling pays."""
    for prediction, gain in zip(predictions, gains(predictions), strict=True):
        if gain is not None and gain < PAYS:
            return prediction.workers // 2
    return predictions[-1].workers


def scaling_table(title: str, scenario: Scenario, predictions: Sequence[Prediction]) -> Table:
    """Return a table of predictions by number of workers."""
    headings = ("workers", "parts", "hours", "speed-up", "efficiency", "added", "core h", "join, h", "limit", "shares")
    table = Table(title=escape(title), title_justify="left")
    for heading in headings:
        table.add_column(heading, justify="left" if heading in ("limit", "shares") else "right", no_wrap=True)
    best = last_that_pays(predictions)
    for prediction, gain in zip(predictions, gains(predictions), strict=True):
        speed_up = predictions[0].wall / prediction.wall * predictions[0].workers
        others = sorted(((share, name) for name, share in prediction.shares.items()), reverse=True)
        table.add_row(
            str(prediction.workers),
            str(prediction.parts),
            f"{prediction.wall / HOUR:.2f}",
            f"{speed_up:.1f}",
            f"{speed_up / prediction.workers:.0%}",
            "" if gain is None else f"{gain:.0%}",
            f"{prediction.used_core_hours:.0f}",
            f"{prediction.shares['join'] * prediction.wall / HOUR:.2f}",
            prediction.limit,
            ", ".join(f"{name} {share:.0%}" for share, name in others if share >= 0.03 and name != "computing"),
            style="bold" if prediction.workers == best else "",
        )
    return table


def sensitivities(scenario: Scenario) -> dict[str, Scenario]:
    """Return scenarios in which one assumption is another one, by what is; the first one is right."""
    cluster, film = scenario.cluster, scenario.film

    def on(**changes: Any) -> Scenario:
        return replace(scenario, cluster=replace(cluster, **changes))

    def failing(hours: float, **changes: Any) -> Scenario:
        return on(failures=Interruptions(hours * HOUR, absence=120), **changes)

    wrong = {
        "as assumed": scenario,
        "storage half as fast": on(bandwidth=cluster.bandwidth / 2),
        "storage a tenth as fast": on(bandwidth=cluster.bandwidth / 10),
        "one in 20 workers 3 times slower": on(straggler_share=0.05, straggler_slowness=3.0),
        "workers fail every 10 h": failing(10),
        "workers fail every hour": failing(1),
        "the same, chunks kept (--resume)": failing(1, resumes=True),
        "a third of the workers taken back every 2 h": on(
            preemptions=Interruptions(2 * HOUR, share=1 / 3, absence=600)
        ),
        "kernels compiled by every worker": replace(scenario, cold=True),
        "compiled by every process": replace(
            scenario, costs=replace(scenario.costs, starting=scenario.costs.starting + scenario.costs.compiling)
        ),
        "programs on the storage, 0.5 GB a process": replace(scenario, programs=0.5e9),
        "one part a worker": replace(scenario, parts_per_worker=1),
        "two parts a worker": replace(scenario, parts_per_worker=2),
        "one chunk a part": replace(scenario, parts=film.chunks),
        "an index tells where a part begins": replace(scenario, film=replace(film, access="index")),
        "all packets before a part are read": replace(scenario, film=replace(film, access="before")),
        "all packets are read for each part": replace(scenario, film=replace(film, access="whole")),
        "everything before a part is decoded": replace(scenario, film=replace(film, access="decoded")),
        "join on a machine with 10 times the link": on(join_link=10 * cluster.link),
        "join reads the parts once": replace(scenario, film=replace(film, passes=1)),
        "the same, and writes its result once": replace(scenario, film=replace(film, passes=1, rewrites=False)),
        "workers arrive one by one, 10 s apart": on(arrival=10.0),
        "scenes' costs vary twice as much": replace(
            scenario, costs=replace(scenario.costs, variation=2 * scenario.costs.variation)
        ),
    }
    return {name: each for name, each in wrong.items() if each is scenario or each != scenario}


def sensitivity_table(title: str, scenario: Scenario, workers: Sequence[int]) -> tuple[Table, dict[str, Any]]:
    """Return a table of what wrong assumptions cost, and its figures."""
    table = Table(title=escape(title), title_justify="left")
    table.add_column("assumption", no_wrap=True)
    for count in workers:
        table.add_column(f"{count} workers", justify="right", no_wrap=True)
        table.add_column("limit", no_wrap=True)
    figures: dict[str, Any] = {}
    right = {count: predict(scenario, count) for count in workers}
    for name, wrong in sensitivities(scenario).items():
        predictions = {count: predict(wrong, count) for count in workers}
        figures[name] = {str(count): described(each) for count, each in predictions.items()}
        cells: list[str] = []
        for count, each in predictions.items():
            cells += [_change(each.wall, right[count].wall, is_first=wrong is scenario), each.limit]
        table.add_row(name, *cells)
    return table, figures


def _change(wall: float, right: float, *, is_first: bool) -> str:
    if wall == float("inf"):
        return "no end"
    return f"{wall / HOUR:.2f} h" if is_first else f"{wall / right - 1:+.0%}".replace("-0%", "+0%")


def described(prediction: Prediction) -> dict[str, Any]:
    """Return a prediction as plain data."""
    return {**asdict(prediction), "core_hours": prediction.used_core_hours, "limit": prediction.limit}


# --- costs in files


def load_costs(path: Path) -> dict[str, dict[str, Costs]]:
    """Return costs by size and by ``method preset``.

    Raises
    ------
    OptionError
        The file holds none.
    """
    try:
        stored = json.loads(path.read_text())["costs"]
        return {
            size: {name: Costs(**{**each, "slowdown": tuple(each["slowdown"])}) for name, each in by_name.items()}
            for size, by_name in stored.items()
        }
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise OptionError(f"{path} holds no costs ({error}); make it by scale.py measure.") from None


def chosen_costs(path: Path, size: str, name: str) -> Costs:
    """Return the costs of one size, method and preset.

    Raises
    ------
    OptionError
        The file does not hold them.
    """
    costs = load_costs(path)
    if name not in costs.get(size, {}):
        known = "; ".join(f"{each} {name}" for each, by_name in costs.items() for name in by_name)
        raise OptionError(f"{path} has no costs of {size} {name}; it has those of {known}.")
    return costs[size][name]


def cost_table(costs: dict[str, dict[str, Costs]]) -> Table:
    """Return a table of costs, a column for each size, method and preset."""
    table = Table(title="CPU seconds of one process with one thread", title_justify="left")
    rows: dict[str, Callable[[Costs], str]] = {
        "decoding a source frame": lambda each: f"{each.decoding:.4f}",
        "motion of a pair": lambda each: f"{each.motion:.4f}",
        "synthesis of a frame": lambda each: f"{each.synthesis:.4f}",
        "encoding an output frame": lambda each: f"{each.encoding:.4f}",
        "the rest of an output frame": lambda each: f"{each.rest:+.4f}",
        "an output frame in all, factor 2": lambda each: f"{each.frames(1, Fraction(2)):.4f}",
        "deviation between sections": lambda each: f"{each.variation:.0%}",
        "start, kernels cached": lambda each: f"{each.starting:.2f}",
        "compiling kernels": lambda each: f"{each.compiling:.1f}",
        "opening": lambda each: f"{each.opening:.3f}",
        "reading a packet": lambda each: f"{each.indexing:.6f}",
        "self-test": lambda each: f"{each.self_test:.3f}",
        "a part": lambda each: f"{each.part:.2f}",
        "join": lambda each: f"{each.joining:.2f}",
        "join, an output frame": lambda each: f"{each.joining_frame:.6f}",
        "join, a GB": lambda each: f"{each.joining_byte * 1e9:.2f}",
        "slowdown, 1, 2 ... at once": lambda each: " ".join(f"{value:.2f}" for value in each.slowdown),
    }
    table.add_column("stage", no_wrap=True)
    for size, by_name in costs.items():
        for name in by_name:
            table.add_column(f"{size} {name}", justify="right")
    for heading, show in rows.items():
        table.add_row(heading, *(show(each) for by_name in costs.values() for each in by_name.values()))
    return table


# --- commands


def run_measure(console: Console, arguments: argparse.Namespace) -> dict[str, Any]:
    """Measure the costs of clips, and add them to a file."""
    from part_costs import machine, material_of, measure_compiling, measure_methods, measure_parts  # noqa: PLC0415
    from scoring import one_thread  # noqa: PLC0415

    one_thread()
    materials = [material_of(clip, arguments.sections) for clip in arguments.clips]
    methods, presets = arguments.methods.split(","), arguments.presets.split(",")
    before = load_costs(arguments.output) if arguments.output.exists() else {}
    console.print("compiling, parts and joining")
    shared = measure_parts(arguments.rounds)
    compiling = {method: measure_compiling(materials[0], method) for method in methods}
    for material in materials:
        measured = measure_methods(material, methods, presets, arguments.rounds, console.print)
        for name, each in measured.items():
            costs = replace(
                each,
                compiling=compiling[name.split()[0]],
                part=shared.part,
                joining=shared.joining,
                joining_frame=shared.joining_frame,
                joining_byte=shared.joining_byte,
            )
            before.setdefault(material.size, {})[name] = costs
        figures = {
            "machine": machine(),
            "costs": {size: {name: asdict(each) for name, each in by.items()} for size, by in before.items()},
        }
        arguments.output.write_text(json.dumps(figures, indent=1) + "\n")
    console.print(cost_table(before))
    return figures


def scenario_of(arguments: argparse.Namespace, costs: Costs) -> Scenario:
    """Return the scenario that the options describe."""
    film = Film(
        source_frames=round(arguments.minutes * 60 * arguments.rate),
        rate=arguments.rate,
        factor=arguments.factor,
        source_bits=arguments.source_mbit * 1e6,
        result_bits=arguments.result_mbit * 1e6,
        access=arguments.access,
        sound_apart=not arguments.matroska,
        rewrites=not arguments.matroska,
    )
    cluster = Cluster(
        1,
        per_machine=arguments.per_machine,
        slowdown=costs.slowdown,
        bandwidth=arguments.bandwidth * 1e6,
        link=arguments.link * 1e6,
        join_link=None if arguments.join_link is None else arguments.join_link * 1e6,
        straggler_share=arguments.straggler_share,
        straggler_slowness=arguments.straggler_slowness,
        failures=Interruptions(arguments.failure_hours * HOUR, absence=arguments.absence),
        preemptions=Interruptions(
            arguments.preemption_hours * HOUR, share=arguments.preemption_share, absence=arguments.absence
        ),
        resumes=arguments.resume,
    )
    return Scenario(
        *(film, costs, cluster),
        parts_per_worker=arguments.parts_per_worker,
        parts=arguments.parts,
        process_per_part=not arguments.long_lived,
        cold=arguments.cold,
        programs=arguments.programs * 1e6,
    )


def said_of(arguments: argparse.Namespace, name: str) -> str:
    """Return what a table is of."""
    return f"{arguments.minutes:g} minutes of {arguments.size} at {arguments.rate}, times {arguments.factor}: {name}"


def run_simulate(console: Console, arguments: argparse.Namespace) -> dict[str, Any]:
    """Predict one number of workers."""
    scenario = scenario_of(arguments, chosen_costs(arguments.costs, arguments.size, arguments.name))
    prediction = predict(scenario, arguments.workers)
    table = Table(title=escape(said_of(arguments, arguments.name)), title_justify="left", show_header=False)
    table.add_column(no_wrap=True)
    table.add_column(justify="right")
    rows = {
        "workers": f"{prediction.workers}",
        "parts": f"{prediction.parts}",
        "hours": f"{prediction.wall / HOUR:.2f}",
        "core hours": f"{prediction.used_core_hours:.1f}",
        "limit": prediction.limit,
        "workers lost": f"{prediction.interruptions:.1f}",
        "GB read": f"{prediction.read / 1e9:.1f}",
        "GB written": f"{prediction.written / 1e9:.1f}",
        **{f"share {name}": f"{share:.1%}" for name, share in prediction.shares.items()},
    }
    for name, value in rows.items():
        table.add_row(name, value)
    console.print(table)
    return described(prediction)


def run_table(console: Console, arguments: argparse.Namespace) -> dict[str, Any]:
    """Predict all numbers of workers for all methods and presets, and what wrong assumptions cost."""
    by_name = load_costs(arguments.costs).get(arguments.size, {})
    names = [name for name in by_name if not arguments.names or name in arguments.names]
    if not names:
        raise OptionError(f"{arguments.costs} has no costs of {arguments.size} that are asked for.")
    tables: list[Table] = []
    figures: dict[str, Any] = {}
    summary = Table(title="In short", title_justify="left")
    for heading in ("method, preset", "1 worker, h", "core h", "pays up to", "hours there", "limit beyond", "1024, h"):
        summary.add_column(heading, justify="left" if heading.startswith(("method", "limit")) else "right")
    for name in names:
        scenario = scenario_of(arguments, by_name[name])
        predictions = [predict(scenario, count) for count in WORKERS]
        best = last_that_pays(predictions)
        there = next(each for each in predictions if each.workers == best)
        beyond = next((each for each in predictions if each.workers == 2 * best), there)
        losses = {key: beyond.shares[key] for key in SPENT if key != "computing"}
        summary.add_row(
            name,
            f"{predictions[0].wall / HOUR:.1f}",
            f"{predictions[0].used_core_hours:.0f}",
            f"{best}",
            f"{there.wall / HOUR:.2f}",
            max(losses, key=losses.__getitem__),
            f"{predictions[-1].wall / HOUR:.2f}",
        )
        tables.append(scaling_table(said_of(arguments, name), scenario, predictions))
        table, wrong = sensitivity_table(f"What it costs to be wrong: {name}", scenario, arguments.workers)
        tables.append(table)
        figures[name] = {
            "predictions": [described(each) for each in predictions],
            "pays_up_to": best,
            "sensitivity": wrong,
        }
    for table in [summary, *tables]:
        console.print(as_markdown(table) if arguments.markdown else table)
        console.print()
    console.print(escape(footnote(arguments)), highlight=False)
    return figures


def footnote(arguments: argparse.Namespace) -> str:
    """Return what the tables assume."""
    return (
        f"Source {arguments.source_mbit:g} Mbit/s, result {arguments.result_mbit:g} Mbit/s; storage "
        f"{arguments.bandwidth:g} MB/s in all and {arguments.link:g} MB/s a worker; {arguments.per_machine} workers of "
        f"one core a machine; {arguments.parts_per_worker:g} parts a worker, at most one a chunk of {CHUNK_FRAMES} "
        "frames. added: how well the workers work that the last doubling adds; it pays from "
        f"{PAYS:.0%} (bold: the last that does). limit: what takes most of the workers' time, if it is not computing."
    )


def as_markdown(table: Table) -> str:
    """Return a table as Markdown."""

    def row(cells: Iterable[str]) -> str:
        return f"| {' | '.join(cells)} |"

    rows = list(zip(*([str(cell) for cell in column.cells] for column in table.columns), strict=True))
    lines = [row(str(column.header) for column in table.columns), row("---" for _ in table.columns), *map(row, rows)]
    return f"\n{table.title}\n\n" + "\n".join(lines)


@dataclass
class Run:
    """A real run in parts.

    Attributes
    ----------
    wall : float
        Seconds, with everything else that ran on this machine.
    own : float
        Seconds that the same queue takes with workers that are not disturbed: by the CPU time of each command.
    foreign : float
        Cores that other programs took meanwhile.
    join : float
        CPU seconds of the last command.
    parts : list of float
        CPU seconds of the others.
    """

    wall: float
    own: float
    foreign: float
    join: float
    parts: list[float]


def run_check(console: Console, arguments: argparse.Namespace) -> dict[str, Any]:
    """Compare real runs with 1, 2 ... workers of this machine to their prediction."""
    from part_costs import material_of  # noqa: PLC0415

    material = material_of(arguments.clip, 1)
    costs = chosen_costs(arguments.costs, material.size, arguments.name)
    film = replace(clip_film(arguments.clip, material.frames), access=arguments.access)
    if arguments.parts > film.chunks:
        raise OptionError(f"{arguments.clip} makes {film.chunks} chunks; give at most as many parts.")
    method, preset = arguments.name.split()
    options = ["--method", method, "--preset", preset, "--threads", "1"]
    table = Table(title=escape(f"{arguments.clip}, {arguments.name}, {arguments.parts} parts"), title_justify="left")
    for heading in (
        *("workers", "predicted, s", "own time, s", "off", "wall, s", "off", "faster, predicted", "by own time"),
        *("parts, CPU s", "pre- dicted", "join, CPU s", "pre- dicted", "others' cores"),
    ):
        table.add_column(heading, justify="right")
    figures: dict[str, Any] = {}
    runs: dict[int, list[Run]] = {count: [] for count in arguments.workers}
    for _ in range(arguments.rounds):
        for count in arguments.workers:
            runs[count].append(real_run(arguments.clip, options, film.parts(arguments.parts), count))
    first: tuple[float, float] | None = None
    for count in arguments.workers:
        best = min(runs[count], key=lambda run: run.own)
        work = work_of(film, replace(costs, variation=0.0), arguments.parts)
        cluster = Cluster(count, per_machine=count, slowdown=costs.slowdown)
        outcome = simulate(work.tasks, cluster, join=work.join)
        first = first or (outcome.wall, best.own)
        row = {
            "predicted": outcome.wall,
            "own": best.own,
            "wall": best.wall,
            "own_off": outcome.wall / best.own - 1,
            "wall_off": outcome.wall / best.wall - 1,
            "join": best.join,
            "join_predicted": outcome.wall - outcome.made,
            "parts": sum(best.parts),
            "parts_predicted": outcome.spent["computing"] + outcome.spent["slowed down"],
            "foreign_cores": best.foreign,
            "all_own": [run.own for run in runs[count]],
            "all_wall": [run.wall for run in runs[count]],
        }
        figures[str(count)] = row
        table.add_row(
            str(count),
            *(f"{row['predicted']:.1f}", f"{best.own:.1f}", f"{row['own_off']:+.0%}", f"{best.wall:.1f}"),
            *(f"{row['wall_off']:+.0%}", f"{first[0] / outcome.wall:.2f}", f"{first[1] / best.own:.2f}"),
            *(f"{row['parts']:.1f}", f"{row['parts_predicted']:.1f}", f"{best.join:.1f}"),
            *(f"{row['join_predicted']:.1f}", f"{best.foreign:.1f}"),
        )
    console.print(table)
    console.print(
        "own time: what the same queue takes with workers that nothing else disturbs, by the CPU time of each command. "
        "wall: with everything else that ran on this machine."
    )
    return figures


def clip_film(clip: str, frames: int) -> Film:
    """Return a clip as a film; that its result is about as large hardly matters where files stay in memory."""
    bits = os.path.getsize(clip) * 8 / float(frames / Film.rate)
    return Film(frames, source_bits=bits, result_bits=bits, sound_bits=0.0)


def real_run(clip: str, options: Sequence[str], parts: Sequence[range], workers: int) -> Run:
    """Convert a clip in parts by several workers, each on its own core, and join the parts.

    Parameters
    ----------
    clip : str
    options : sequence of str
    parts : list of range
        Output frames of each; the largest is taken first.
    workers : int
    """
    from part_costs import Command  # noqa: PLC0415

    folder = tempfile.mkdtemp()
    running: dict[int, tuple[int, int, Command]] = {}
    try:
        output = str(Path(folder, "out.mp4"))
        largest_first = sorted(range(len(parts)), key=lambda place: -len(parts[place]))
        left = list(largest_first)
        idle = list(range(workers))
        seconds: dict[int, float] = {}
        begin, busy = time.perf_counter(), busy_seconds()
        while left or running:
            while left and idle:
                core = idle.pop(0)
                place = left.pop(0)
                command = Command([clip, output, *options, "--chunk", f"{place + 1}/{len(parts)}"], core)
                running[command.pid] = core, place, command
            pid = os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOWAIT).si_pid
            core, place, command = running.pop(pid)
            seconds[place] = command.wait().cpu
            idle.append(core)
        join = Command(["join", output, f"{output}.parts"]).wait()
        wall = time.perf_counter() - begin
        foreign = (busy_seconds() - busy - sum(seconds.values()) - join.cpu) / wall
        tasks = [Task(len(part), Phase(seconds[place]), ()) for place, part in enumerate(parts)]
        own = simulate(tasks, Cluster(workers), join=[Phase(join.cpu)]).wall
        return Run(wall, own, foreign, join.cpu, list(seconds.values()))
    finally:
        for _, _, command in running.values():  # the others, when one has failed
            command.stop()
        shutil.rmtree(folder)


def busy_seconds() -> float:
    """Return the CPU seconds that all programs of this machine have taken since it was started."""
    user, nice, system = map(int, Path("/proc/stat").read_text().splitlines()[0].split()[1:4])
    return (user + nice + system) / os.sysconf("SC_CLK_TCK")


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    root = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = root.add_subparsers(dest="command", required=True)

    measure = commands.add_parser("measure", help="what each stage costs on this machine")
    measure.add_argument("clips", nargs="+", metavar="CLIP", help="videos, one of each size")
    measure.add_argument("--methods", default="nlm,nlm-fast,blend")
    measure.add_argument("--presets", default="veryfast,medium")
    measure.add_argument("--sections", type=int, default=4, help="places of a clip that are measured")
    measure.add_argument("--rounds", type=int, default=3, help="of commands in turn")
    measure.add_argument("--output", type=Path, default=Path("costs.json"), help="where costs are kept, and added to")

    one = commands.add_parser("simulate", help="what one number of workers takes")
    one.add_argument("--workers", type=int, default=64)
    one.add_argument("--name", default="nlm medium", help="method and preset")
    add_scenario(one)

    table = commands.add_parser("table", help="1 to 1024 workers, and what it costs to be wrong")
    table.add_argument("names", nargs="*", metavar="'METHOD PRESET'", help="all that were measured by default")
    table.add_argument("--workers", type=int, nargs="+", default=[16, 128, 512], help="for wrong assumptions")
    table.add_argument("--markdown", action="store_true")
    table.add_argument("--svg", type=Path, help="the tables as a picture")
    add_scenario(table)

    check = commands.add_parser("check", help="real runs on this machine, against their prediction")
    check.add_argument("clip")
    check.add_argument("--name", default="nlm veryfast", help="method and preset")
    check.add_argument("--parts", type=int, default=8)
    check.add_argument("--workers", type=int, nargs="+", default=[1, 2, 4])
    check.add_argument("--rounds", type=int, default=2)
    check.add_argument("--costs", type=Path, default=Path("costs.json"))
    check.add_argument("--access", choices=["index", "before", "whole", "decoded"], default="index")
    for command in (measure, one, table, check):
        command.add_argument("--json", type=Path, help="keep the figures")
    return root


def add_scenario(command: argparse.ArgumentParser) -> None:
    """Add the options of a scenario."""
    add = command.add_argument
    infinite = float("inf")
    add("--costs", type=Path, default=Path("costs.json"), help="made by measure")
    add("--size", default="3840x2160")
    add("--minutes", type=float, default=120)
    add("--rate", type=Fraction, default=Fraction(24), help="source frames per second")
    add("--factor", type=Fraction, default=Fraction(2))
    add("--source-mbit", type=float, default=50, help="bit rate of the source, Mbit/s")
    add("--result-mbit", type=float, default=60, help="bit rate of the result, Mbit/s")
    add("--access", choices=["index", "before", "whole", "decoded"], default="index", help="see film_parts.Access")
    add("--matroska", action="store_true", help="not mp4: the join reads all of the source, and writes once")
    add("--bandwidth", type=float, default=500, help="of the storage, MB/s")
    add("--link", type=float, default=125, help="of a worker, MB/s")
    add("--join-link", type=float, help="of the worker that joins, MB/s; that of a worker by default")
    add("--per-machine", type=int, default=4, help="workers on a machine")
    add("--parts-per-worker", type=float, default=PARTS_PER_WORKER)
    add("--parts", type=int, help="their number instead")
    add("--long-lived", action="store_true", help="workers start once and not for every part")
    add("--cold", action="store_true", help="every worker compiles the kernels")
    add("--programs", type=float, default=0, help="read from the storage by a starting process, MB")
    add("--straggler-share", type=float, default=0)
    add("--straggler-slowness", type=float, default=3)
    add("--failure-hours", type=float, default=infinite, help="mean time to failure of a worker")
    add("--preemption-hours", type=float, default=infinite, help="mean time between preemptions")
    add("--preemption-share", type=float, default=0, help="of the workers that each takes")
    add("--absence", type=float, default=120, help="seconds until a lost worker is replaced")
    add("--resume", action="store_true", help="chunks of a lost worker's part are kept")


def main() -> None:
    """Run one of the commands."""
    arguments = parser().parse_args()
    runs = {"measure": run_measure, "simulate": run_simulate, "table": run_table, "check": run_check}
    svg = getattr(arguments, "svg", None)
    console = Console(width=max(Console().width, 132), record=svg is not None)
    try:
        if arguments.command in ("measure", "check") and sys.platform != "linux":
            raise OptionError(f"{arguments.command} pins processes to cores, which only Linux lets a program do.")
        figures = runs[arguments.command](console, arguments)
    except FpsboostError as error:
        raise SystemExit(str(error)) from error
    if svg:
        console.save_svg(str(svg), title="scale.py table")
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
