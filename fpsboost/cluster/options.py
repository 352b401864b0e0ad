"""Options for where the parts of a conversion are made."""

from __future__ import annotations

import re
from dataclasses import dataclass

from fpsboost.errors import OptionError
from fpsboost.options import option

LOCAL = "local"


@dataclass(frozen=True)
class ClusterOptions:
    """Where the parts of a conversion are made; by default in threads of one process.

    Parameters
    ----------
    cluster : str, optional
        Address of a Dask scheduler, ``tls://host:port`` or ``tcp://host:port``, or ``local`` for workers on this
        machine, one per core. Certificates are those of Dask's configuration.
    processes : int, optional
        Number of processes on this machine, without Dask.

    Raises
    ------
    OptionError
        Both are given, or one is invalid.

    Examples
    --------
    >>> ClusterOptions("tls://scheduler:8786").cluster
    'tls://scheduler:8786'
    """

    cluster: str | None = option(
        None,
        "Convert on Dask workers: tls://HOST:PORT, or local.",
        metavar="ADDRESS",
    )
    processes: int | None = option(None, "Convert in N processes; else in threads of one.")

    def __post_init__(self) -> None:
        if self.cluster is not None and self.processes is not None:
            raise OptionError(
                "`cluster` and `processes` both say who makes the parts of a conversion; give one of them."
            )
        if self.cluster is not None and self.cluster != LOCAL and not re.match(r"(tcp|tls)://[^/]+:\d+$", self.cluster):
            raise OptionError(
                f"`cluster` must be local, or the address of a scheduler such as tls://host:8786, not {self.cluster}."
            )
        if self.processes is not None and self.processes < 1:
            raise OptionError(f"`processes` must be at least 1, not {self.processes}.")
