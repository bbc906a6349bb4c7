"""Identification, diagnosis and calibration of recordings, each in a separate process at low priority."""

from __future__ import annotations

import multiprocessing
import os
import secrets
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from arm_io import DeviceFault, InputError, make_folder
from arm_io.progress import Progress, Step

Table = dict[str, Any]
MOST_KEPT = 50
"""Analyses that are remembered; results in folders stay."""
NICE = 15
"""Niceness of an analysis: a daemon that records on the same machine comes first."""


@dataclass(frozen=True, kw_only=True)
class Analysis:
    """An analysis of recordings that the page offers.

    run  a function of a module: (recordings, held-out ones, model, folder for results, progress) -> one sentence on
         the result. It writes report.html into the folder
    """

    name: str
    title: str
    help: str
    needs_points: bool
    run: Callable[[Sequence[Path], Sequence[Path], Path, Path, Progress], str]


@dataclass
class Job:
    """One analysis of some recordings.

    state  waiting, working, done, failed or stopped
    says   the current step, or how it ended; share: completed share of that step, 0 to 1; None: not known
    """

    id: str
    analysis: Analysis
    recordings: list[Path]
    held_out: list[Path]
    out: Path
    state: str = "waiting"
    says: str = "waiting"
    share: float | None = None
    begun: float = field(default_factory=time.monotonic)
    seconds: float = 0.0

    def as_table(self) -> Table:
        """The job as plain data for the page; ``report``: its address, once there is one."""
        working = self.state in ("waiting", "working")
        return {
            "id": self.id,
            "title": self.analysis.title,
            "recordings": [path.name for path in self.recordings],
            "held_out": [path.name for path in self.held_out],
            "state": self.state,
            "says": self.says,
            "share": self.share if working else None,
            "seconds": time.monotonic() - self.begun if working else self.seconds,
            "folder": str(self.out),
            "report": f"/reports/{self.id}" if self.state == "done" and self.report.is_file() else None,
        }

    @property
    def report(self) -> Path:
        return self.out / "report.html"


class Analyses:
    """The jobs of a page; one runs at a time, in the order in which they were begun."""

    def __init__(self, known: Sequence[Analysis], model: Path | None, folder: Path) -> None:
        self.known = {analysis.name: analysis for analysis in known}
        self._model, self._folder = model, folder
        self._jobs: dict[str, Job] = {}
        self._lock = threading.Lock()
        self._process: Any = None

    def list(self) -> list[Table]:
        """All jobs, newest first."""
        with self._lock:
            return [job.as_table() for job in reversed(self._jobs.values())]

    def begin(self, name: str, recordings: Sequence[Path], held_out: Sequence[Path]) -> Table:
        """Starts a new job. InputError: no such analysis, no model, or an analysis is running."""
        if name not in self.known:
            raise InputError(name, f"is no analysis; there are {', '.join(self.known)}")
        if self._model is None:
            raise InputError("rig", "names no model; an analysis needs a model")
        with self._lock:
            if any(job.state in ("waiting", "working") for job in self._jobs.values()):
                raise InputError(name, "another analysis is running; stop it, or wait for its end")
            # The id is the only way to the report, which is opened without a token in its address.
            job = Job(secrets.token_urlsafe(18), self.known[name], list(recordings), list(held_out), Path())
            job.out = self._folder / f"{recordings[0].stem}_{name}_{time.strftime('%H%M%S')}"
            self._jobs[job.id] = job
            for old in list(self._jobs)[:-MOST_KEPT]:
                del self._jobs[old]
        threading.Thread(target=self._work, args=(job,), name=name, daemon=True).start()
        return job.as_table()

    def stop(self, job_id: str) -> None:
        """Ends a running job."""
        with self._lock:
            job = self._jobs.get(job_id)
            if job is not None and job.state in ("waiting", "working"):
                job.state, job.says = "stopped", "stopped by command"
                if self._process is not None:
                    self._process.terminate()

    def close(self) -> None:
        """Ends all running jobs."""
        for job in list(self._jobs.values()):
            self.stop(job.id)

    def holds(self, job_id: str) -> bool:
        """Whether there is a job with that id."""
        return job_id in self._jobs

    def report(self, job_id: str) -> Path:
        """Path of the report of a job. InputError: there is none."""
        job = self._jobs.get(job_id)
        if job is None or not job.report.is_file():
            raise InputError("report", "there is none of that name")
        return job.report

    def _work(self, job: Job) -> None:
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe(duplex=False)
        arguments = (job.analysis.run, job.recordings, job.held_out, self._model, job.out, theirs)
        process = context.Process(target=_in_child, args=arguments, daemon=True)
        with self._lock:
            if job.state != "waiting":
                return
            job.state, self._process = "working", process
            process.start()
        theirs.close()
        kind, text = "failed", "ended without a result"
        try:
            while True:
                kind, text, job.share = ours.recv()
                if kind == "working":
                    job.says = text
        except (EOFError, OSError):
            process.join()
        except Exception as error:
            # A job that nobody follows would be under way for ever, and no other could begin.
            process.terminate()
            kind, text = "failed", f"a bug: {type(error).__name__}: {error}"
        with self._lock:
            self._process = None
            job.seconds = time.monotonic() - job.begun
            if job.state == "working":
                job.state, job.says = ("failed", "ended without a result") if kind == "working" else (kind, text)


def _in_child(
    run: Callable[[Sequence[Path], Sequence[Path], Path, Path, Progress], str],
    recordings: Sequence[Path],
    held_out: Sequence[Path],
    model: Path,
    out: Path,
    results: Connection,
) -> None:
    """Runs an analysis; sends ("working", step, share) per step, then "done" with a sentence or "failed" and why."""

    def progress(step: str) -> None:
        share = step.done / step.of if isinstance(step, Step) and step.of else None
        results.send(("working", str(step), share))

    os.nice(NICE)
    try:
        make_folder(out)
        results.send(("done", run(recordings, held_out, model, out, progress), None))
    except (InputError, DeviceFault) as error:
        results.send(("failed", str(error), None))
    except Exception as error:
        traceback.print_exc()
        results.send(("failed", f"a bug: {type(error).__name__}: {error}", None))
