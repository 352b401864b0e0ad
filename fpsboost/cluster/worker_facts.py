"""Comparison of a worker with the client: the same programs, the same input, the same bits."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping

from fpsboost.errors import ClusterError
from fpsboost.parts.making import facts_of, program_facts
from fpsboost.parts.manifest import first_difference
from fpsboost.preparation import ConversionJob, opened_clip, prepare
from fpsboost.run_options import RunOptions


def job_facts(job: ConversionJob) -> dict[str, str]:
    """Return everything that must be the same wherever parts of a job are made; see `fpsboost.parts.making.facts_of`.

    Raises
    ------
    InputError
        The input cannot be read here.
    """
    run = RunOptions()
    with opened_clip(job, run) as clip:
        return facts_of(job, run, clip, prepare(job, run, clip))


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
    if difference in ("self test", "first frame"):
        raise ClusterError(
            f"The worker at {place} calculates other pixels than the client; leave it out, or give all machines "
            "processors and libraries of one kind."
        )
    if difference is not None:
        raise ClusterError(f"The worker at {place} differs from the client in the {difference}; make them the same.")
