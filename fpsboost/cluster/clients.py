"""Clients of Dask: of workers that are started on this machine, and of a scheduler elsewhere."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager

import dask
from distributed import Client, LocalCluster
from distributed.security import Security
from distributed.utils import silence_logging_cmgr

from fpsboost.cluster import ClusterError
from fpsboost.cluster.dask_engine import MAX_LOST_WORKERS

CONNECT_SECONDS = 10
"""Time limit of a connection to the scheduler, seconds."""


@contextmanager
def local_client(workers: int) -> Iterator[Client]:
    """Start a scheduler and workers with one thread each on this machine; stop them at the end."""
    settings = {
        "distributed.scheduler.allowed-failures": MAX_LOST_WORKERS,
        "distributed.worker.profile.enabled": False,  # takes a tenth of the time of Python code in threads
    }
    with (
        dask.config.set(settings),
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            memory_limit=0,  # the memory that a conversion needs is checked before it begins
            processes=True,
            dashboard_address="127.0.0.1:0",
            silence_logs=logging.CRITICAL,
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client


@contextmanager
def remote_client(address: str) -> Iterator[Client]:
    """Connect to a scheduler with the certificates of Dask's configuration.

    Raises `ClusterError` if it cannot be reached, or if ``tls://`` is given without certificates.
    """
    if address.startswith("tls://") and Security().get_connection_args("client").get("ssl_context") is None:
        raise ClusterError(
            f"{address} needs certificates, and Dask's configuration names none; set distributed.comm.tls.ca-file, and "
            "cert and key of distributed.comm.tls.client."
        )
    with silence_logging_cmgr(logging.CRITICAL):  # a lost scheduler is reported in one sentence by fpsboost
        try:
            client = Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
        except (OSError, TimeoutError, RuntimeError, ValueError) as error:
            raise ClusterError(f"There is no scheduler at {address} ({error}); check the address.") from error
        with client:
            yield client
