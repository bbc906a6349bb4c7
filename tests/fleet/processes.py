"""A scheduler and workers of Dask as processes of their own, which tests may kill."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import psutil

from tests.ports import free_port

ROOT = Path(__file__).parents[2]
OTHER_CODE = Path(__file__).with_name("other_code.py")


@dataclass
class Processes:
    """Ended with ``stop``; the address stays the same when the scheduler is started again."""

    folder: Path
    port: int = field(default_factory=free_port)
    scheduler: subprocess.Popen | None = None
    workers: list[subprocess.Popen] = field(default_factory=list)

    @property
    def address(self) -> str:
        return f"tcp://127.0.0.1:{self.port}"

    def start_scheduler(self) -> None:
        arguments = ["--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard", "--no-show"]
        self.scheduler = self._started("dask_scheduler", arguments)

    def start_worker(self, *, preload: Path | None = None) -> subprocess.Popen:
        """Under a nanny, which starts a killed one again."""
        arguments = [self.address, "--nthreads", "1", "--no-dashboard", "--local-directory", str(self.folder)]
        arguments += [] if preload is None else ["--preload", str(preload)]
        worker = self._started("dask_worker", arguments)
        self.workers.append(worker)
        return worker

    def kill_scheduler(self) -> None:
        """SIGKILL; its workers end by themselves or here."""
        assert self.scheduler is not None
        self.scheduler.kill()
        self.scheduler.wait()
        for worker in self.workers:
            _kill_all(worker)
        self.workers.clear()

    def stop(self) -> None:
        for process in [*self.workers, *([self.scheduler] if self.scheduler else [])]:
            _kill_all(process)

    def _started(self, module: str, arguments: list[str]) -> subprocess.Popen:
        environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
        with open(self.folder / "dask.log", "a") as log:
            return subprocess.Popen(
                [sys.executable, "-m", f"distributed.cli.{module}", *arguments],
                cwd=ROOT,
                env=environment,
                stdout=log,
                stderr=log,
            )


def _kill_all(process: subprocess.Popen) -> None:
    with suppress(psutil.NoSuchProcess):
        for child in psutil.Process(process.pid).children(recursive=True):
            with suppress(psutil.NoSuchProcess):
                child.kill()
    process.kill()
    process.wait()


def kill_worker(worker: subprocess.Popen) -> bool:
    """SIGKILL to the process that runs tasks, not to its nanny; False while there is none."""
    for child in psutil.Process(worker.pid).children():
        if "spawn_main" in " ".join(child.cmdline()):
            os.kill(child.pid, signal.SIGKILL)
            return True
    return False


def wait_for(path: Path, lines: int, seconds: float = 120.0) -> None:
    """Until a file has so many lines."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        if path.exists() and len(path.read_text().splitlines()) >= lines:
            return
        time.sleep(0.05)
    raise AssertionError(f"{path} has fewer than {lines} lines after {seconds} s")
