"""Choice of who makes a conversion: threads of this process, several processes, or a Dask cluster."""

from __future__ import annotations

import re

from fpsboost.cluster.options import LOCAL, ClusterOptions
from fpsboost.conversion import convert_job
from fpsboost.errors import OptionError
from fpsboost.io.memory_limit import MemoryLimit
from fpsboost.observer import Summary
from fpsboost.preparation import ConversionJob, opened_clip
from fpsboost.run_options import RunOptions
from fpsboost.threads import available_cores


def convert_where(where: ClusterOptions, job: ConversionJob, run: RunOptions) -> Summary:
    """Convert a clip where options say; the output is the same everywhere.

    Parameters
    ----------
    where : ClusterOptions
    job : ConversionJob
    run : RunOptions

    Returns
    -------
    Summary

    Raises
    ------
    OptionError
        Dask is not installed.
    FpsboostError
        See `fpsboost.conversion.convert` and `fpsboost.cluster.conversion.convert_in_parts`.
    """
    if where.processes is not None:
        from fpsboost.cluster.local_processes import convert_in_processes  # noqa: PLC0415 (only if it is used)

        return convert_in_processes(job, where.processes, run=run)
    if where.cluster is None:
        return convert_job(job, run)
    try:
        from fpsboost.cluster import dask_engine  # noqa: PLC0415 (Dask need not be installed)
    except ImportError as error:
        raise OptionError("`cluster` needs Dask; install it with: pip install 'fpsboost[cluster]'.") from error
    if where.cluster == LOCAL:
        with dask_engine.local_client(_affordable_workers(job, run)) as client:
            return dask_engine.convert(job, client, run=run)
    with dask_engine.remote_client(where.cluster) as client:
        summary = dask_engine.convert(job, client, run=run)
    if re.match(r"tcp://(?!localhost:|127\.|\[::1\])", where.cluster):
        summary.remarks.append(
            f"The connection to {where.cluster} was not encrypted, and who reaches that port can run programs on the "
            "workers; use tls:// with the certificates of Dask's configuration."
        )
    return summary


def _affordable_workers(job: ConversionJob, run: RunOptions) -> int:
    """Return the number of workers with one thread that this machine has cores and memory for."""
    with opened_clip(job, run) as clip:
        info, images = clip.source.info, clip.whole.stream_info.images
    planes = 0 if images is None else images.planes
    return (run.limit or MemoryLimit()).affordable_processes(info.width, info.height, available_cores(), planes)
