"""Where the cases of a suite run: processes of this machine, or the workers of a Dask scheduler."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager

from arm_fleet import Cluster
from arm_io.parallel import CORES


@contextmanager
def executor(workers: int | None, scheduler: str | None) -> Iterator[Executor]:
    """``workers`` processes; with ``scheduler`` (tcp://HOST:PORT) its workers, which run in a checkout like this one.

    InputError where no scheduler answers.
    """
    if scheduler is None:
        # processes share the cores among them
        os.environ.setdefault(CORES, "1")
        with ProcessPoolExecutor(workers) as pool:
            yield pool
        return
    with Cluster(scheduler).client() as client, client.get_executor(pure=False) as pool:
        yield pool
