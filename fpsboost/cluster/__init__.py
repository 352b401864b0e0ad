"""Conversions whose parts are made by the workers of a Dask cluster, on many machines or on this one."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from distributed import Client

    from fpsboost import ConversionJob, RunOptions, Summary


def convert(job: ConversionJob, client: Client, *, run: RunOptions | None = None) -> Summary:
    """Convert a clip on the workers of a Dask cluster; the output is that of one process.

    Workers need the versions of this process, and the input under the same path. If they see the folder of the output,
    they write parts there; otherwise parts are copied, in pieces of 16 MiB, to where this is called. A part whose
    worker dies is made again.

    Parameters
    ----------
    job : ConversionJob
    client : distributed.Client
        Synchronous; it stays open.
    run : RunOptions, optional
        `threads` is what each worker may use; by default its own number.

    Returns
    -------
    Summary

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
