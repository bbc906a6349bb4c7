"""The workers of a fleet: processes of this machine, or any Dask cluster by the address of its scheduler."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from arm_io import InputError
from arm_io.optional import optional

if TYPE_CHECKING:
    from distributed import Client

EXTRA = "fleet"
PATIENCE = 60.0
"""s, maximum time to wait for a scheduler or for its first worker."""


@dataclass(frozen=True)
class Cluster:
    """Workers on which tasks run.

    scheduler  tcp://HOST:PORT of a running scheduler; None: workers of this machine
    workers    number of processes of this machine; each runs one task at a time
    patience   s to wait for a scheduler that does not answer
    """

    scheduler: str | None = None
    workers: int = 1
    patience: float = PATIENCE

    @contextmanager
    def client(self) -> Iterator[Client]:
        """A connected client. InputError if there is no scheduler, or if it has no worker."""
        distributed = optional("distributed", EXTRA, "armscope fleet")
        if self.scheduler is None:
            with _local(self.workers) as address, distributed.Client(address, set_as_default=False) as client:
                yield client
            return
        with _silent():
            client = _connected(self.scheduler, self.patience)
            try:
                if not client.scheduler_info(n_workers=-1)["workers"]:
                    _await_worker(client, self.scheduler, self.patience)
                yield client
            finally:
                # A scheduler that is gone does not answer to a farewell.
                client.close(timeout=2)


@contextmanager
def _local(workers: int) -> Iterator[str]:
    import dask
    from distributed import LocalCluster

    with (
        # Each task is bounded by its own process (``tasks.bounded``); a nanny that kills the worker would take
        # results with it that are still to be fetched.
        dask.config.set({"distributed.worker.memory.terminate": False, "distributed.worker.memory.pause": False}),
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            memory_limit=0,
            # A port of its own on loopback: without it Dask takes 8787, and warns where that is taken.
            dashboard_address="127.0.0.1:0",
            silence_logs=50,
        ) as cluster,
    ):
        yield cluster.scheduler_address


@contextmanager
def _silent() -> Iterator[None]:
    """Disables Dask's log: loss of a scheduler is reported in a sentence, not by the traceback of its client."""
    log = logging.getLogger("distributed.client")
    before, log.disabled = log.disabled, True
    try:
        yield
    finally:
        log.disabled = before


def _connected(address: str, patience: float) -> Client:
    from distributed import Client

    until = time.monotonic() + patience
    while True:
        try:
            return Client(address, timeout=max(1.0, min(5.0, patience)), set_as_default=False)
        except (OSError, TimeoutError) as error:
            if time.monotonic() >= until:
                reason = str(error).partition("\n")[0]
                raise InputError(address, f"no scheduler answers ({reason}); start 'dask scheduler'") from None
        except ValueError as error:
            raise InputError(address, f"is no address of a scheduler: {error}; must be tcp://HOST:PORT") from None


def _await_worker(client: Client, address: str, patience: float) -> None:
    try:
        client.wait_for_workers(1, timeout=patience)
    except TimeoutError:
        raise InputError(address, f"has no worker after {patience:g} s; start 'dask worker {address}'") from None
