"""Conversions on the workers of a Dask cluster, on many machines or on this one.

>>> import fpsboost
>>> from distributed import Client  # doctest: +SKIP
>>> job = fpsboost.ConversionJob("in.mp4", "out.mp4", fpsboost.Timing(2), fpsboost.methods["nlm"])
>>> with Client("tls://scheduler:8786") as client:  # doctest: +SKIP
...     summary = fpsboost.cluster.convert(job, client)
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import fpsboost
from fpsboost.options import option
from fpsboost.threads import available_cores

if TYPE_CHECKING:
    from distributed import Client

LOCAL = "local"
"""Address that stands for workers on this machine."""


class ClusterError(fpsboost.FpsboostError):
    """Error for a cluster whose scheduler is out of reach, or whose workers die or are set up differently."""


@dataclass(frozen=True)
class ClusterOptions:
    """Place where the parts of a conversion are computed; by default in threads of one process.

    Parameters
    ----------
    cluster : str, optional
        Address of a Dask scheduler; ``local`` means workers on this machine, one per core.

    Raises
    ------
    OptionError
        The address has another form.
    """

    cluster: str | None = option(None, "Convert on Dask workers: tls://HOST:PORT, or local.", metavar="ADDRESS")

    def __post_init__(self) -> None:
        if self.cluster is not None and self.cluster != LOCAL and not re.match(r"(tcp|tls)://[^/]+:\d+$", self.cluster):
            raise fpsboost.OptionError(
                f"`cluster` must be local, or the address of a scheduler such as tls://host:8786, not {self.cluster}."
            )


def convert_where(where: ClusterOptions, job: fpsboost.ConversionJob, run: fpsboost.RunOptions) -> fpsboost.Summary:
    """Convert a clip in this process, on local workers or on a cluster, as options specify; the output is the same."""
    if where.cluster is None:
        return fpsboost.convert_job(job, run)
    try:
        from fpsboost.cluster import clients, dask_engine  # noqa: PLC0415
    except ImportError as error:
        raise fpsboost.OptionError("`cluster` needs Dask; install it with: pip install 'fpsboost[cluster]'.") from error
    if where.cluster == LOCAL:
        with clients.local_client(_affordable_workers(job, run)) as client:
            return dask_engine.convert(job, client, run=run)
    with clients.remote_client(where.cluster) as client:
        summary = dask_engine.convert(job, client, run=run)
    if re.match(r"tcp://(?!localhost:|127\.|\[::1\])", where.cluster):
        summary.remarks.add("not-encrypted", address=where.cluster)
    return summary


def _affordable_workers(job: fpsboost.ConversionJob, run: fpsboost.RunOptions) -> int:
    """Return the number of workers with one thread that the cores and the memory of this machine suffice for."""
    from fpsboost.preparation import memory_limit, opened_clip  # noqa: PLC0415 (--help does not wait for OpenCV)

    with opened_clip(job, run) as clip:
        info = clip.source.info
        images = clip.whole.stream_info.images
    planes = 0 if images is None else images.planes
    return memory_limit(job, run).affordable_processes(info.width, info.height, available_cores(), planes)


def convert(job: fpsboost.ConversionJob, client: Client, *, run: fpsboost.RunOptions | None = None) -> fpsboost.Summary:
    """Convert a clip on the workers of a Dask cluster; the output is that of one process.

    Workers need the versions of this process, and the input under the same path. If they have access to the folder of
    the output, they write parts there; otherwise parts are copied, in pieces of 16 MiB, to where this is called. A part
    whose worker dies is computed again.

    Parameters
    ----------
    job : ConversionJob
        The conversion; its paths are made absolute.
    client : distributed.Client
        Synchronous; it stays open.
    run : RunOptions, optional
        `threads` is the number of threads for each worker; by default its own number.

    Returns
    -------
    Summary
        Summary of the whole conversion, after the parts were joined and removed.

    Raises
    ------
    CompleteAlreadyError
        Another client has converted the same thing meanwhile.
    ClusterError
        The scheduler is gone, workers die all the time, or differ from this process.
    OptionError, InputError, OutputError
        See `fpsboost.errors`.

    Examples
    --------
    >>> convert(job, Client("tls://scheduler:8786"))  # doctest: +SKIP
    """
    from fpsboost.cluster import dask_engine  # noqa: PLC0415 (Dask need not be installed)

    return dask_engine.convert(job, client, run=run)
