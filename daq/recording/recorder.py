"""The recorder: row blocks go in, a crash-safe MCAP file comes out, and every row is accounted for.

``append`` only queues. A thread of its own writes a chunk every ``chunk_seconds`` and waits until the disk has it, so
that a killed process or a power cut costs no more than the last chunk. What does not fit into the queue, or what the
disk refuses, is a loss with a reason in the ledger, never an exception in the sampler.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from arm_io import DeviceFault
from daq.acquisition.ledger import LedgerSummary, Loss, LossReason
from daq.acquisition.rows import Rows
from daq.recording.mcap_file.writer import Progress, as_json
from daq.recording.messages.row_format import POSE_COLUMNS, Layout, format_of
from daq.recording.messages.viewers import Viewers
from daq.recording.parts import Attachments, Derivatives, finish_file, open_file, write_chunk, write_pictures

CHUNK_BYTES = 1 << 20
"""Before compression, at most: what fits into a processor's cache is written and read fastest."""


def rows_layout(
    joints: Sequence[str],
    *,
    counters: Sequence[str] = (),
    inputs: Sequence[str] = (),
    tracker: bool = False,
    demand: bool = False,
    effort: Sequence[float] = (),
    extra: Sequence[str] = (),
) -> Layout:
    """The layout of a recording of ``Rows``.

    joints, counters, inputs  names
    tracker, demand           whether the rows have points, and reference positions

    effort  (J,) joint torque per motor ampere, N m/A (N/A), where it is known: fills the effort in /joint_states
    extra   names of further columns
    """
    everyone = tuple(range(1, len(joints) + 1))
    signals = {"q": everyone, "i": everyone} | ({"qref": everyone} if demand else {})
    points = "tracker" if tracker else ""
    return Layout(
        tuple(joints),
        signals,
        True,
        tuple(counters),
        tuple(inputs),
        points,
        tuple(effort),
        tuple(extra),
        pose=set(POSE_COLUMNS) <= set(extra),
    )


class Recorder:
    """One recording in the making.

    live  True: rows that find the queue full are lost, and counted; False: ``append`` waits (for simulations, which
          can)
    """

    def __init__(
        self,
        path: str | Path,
        layout: Layout,
        attachments: Attachments,
        *,
        live: bool = True,
        chunk_seconds: float = 0.2,
        queue_rows: int = 200_000,
    ) -> None:
        self.layout = layout
        self._live, self._chunk_seconds, self._queue_rows = live, chunk_seconds, queue_rows
        self._format = format_of(layout.to_json())
        self._file = open_file(
            path, self._format, attachments.files(), live=True, viewers=attachments.chain is not None
        )
        chain = attachments.chain
        self._viewers = None if chain is None else Viewers(self._format, chain, layout.joints)
        self._chunk_rows = max(1, CHUNK_BYTES // len(self._format.template))
        self._derive = Derivatives(layout)
        self._change = threading.Condition()
        self._queue: deque[Rows] = deque()
        self._queued = 0
        self._oldest = 0.0  # monotonic time at which the oldest row in the queue came
        self._closing = False
        self._failure: BaseException | None = None
        self._progress = Progress()
        self._recorded = 0
        self._losses: list[Loss] = []
        self._ledger: LedgerSummary | None = None
        self._writer = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._writer.start()

    @property
    def recorded(self) -> int:
        """Rows in the file so far."""
        return self._recorded

    @property
    def lost(self) -> int:
        """Rows lost between ``append`` and the disk so far."""
        return sum(loss.rows for loss in self._losses)

    def append(self, rows: Rows) -> None:
        """Queues a block; its arrays must not be changed afterwards. Raises only what is a bug in the recorder."""
        if not len(rows):
            return
        with self._change:
            if self._failure is not None:
                raise self._failure
            if self._closing:
                raise RuntimeError("rows came after the recording was finished")
            while not self._live and self._queued and self._queued + len(rows) > self._queue_rows:
                self._change.wait()
            self._note(rows)
            if self._queued + len(rows) > self._queue_rows and self._queued:
                self._lose(rows.number, LossReason.QUEUE_FULL, f"{self._queue_rows} rows were waiting for the disk")
                return
            if not self._queued:
                self._oldest = time.monotonic()
            self._queue.append(rows)
            self._queued += len(rows)
            self._change.notify_all()

    def discard(self) -> None:
        """Removes the file; for a recording that was armed and never started."""
        with self._change:
            self._closing = True
            self._change.notify_all()
        self._writer.join()
        self._file.abandon()

    def finish(
        self, *, triggers: int | None = None, losses: Sequence[Loss] = (), closing: dict | None = None
    ) -> LedgerSummary:
        """Writes what is queued, the ledger and the summary, and gives the file its name.

        A second call does nothing and returns the same ledger.

        triggers  edges that the clock made (default: rows appended plus ``losses``); losses  those before the rows were
                  made
        closing   how the run ended, with what notes and clocks: becomes the attachment ``run.json``
        DeviceFault: the disk refused the end of the file; all recorded rows stay readable in ``RUN.mcap.active``.
        """
        if self._ledger is not None:
            return self._ledger
        with self._change:
            self._closing = True
            self._change.notify_all()
        self._writer.join()
        if self._failure is not None:
            self._file.close()
            raise self._failure
        ledger = self.balance(triggers, losses)
        try:
            if closing is not None:
                self._file.attach("run.json", "application/json", as_json(closing))
            finish_file(self._file, ledger)
        except OSError as error:
            self._file.close()
            raise DeviceFault(
                "disk",
                f"{error.strerror} at the end of {self._file.path}: {self._recorded} rows are safe in "
                f"{self._file.active}, {ledger.lost} are lost; make room and run 'armscope recover'",
            ) from None
        self._ledger = ledger
        return ledger

    def balance(self, triggers: int | None, losses: Sequence[Loss]) -> LedgerSummary:
        """The ledger so far, with the rows that the disk refused; arguments as of ``finish``."""
        latched = self._progress.rows
        before = sum(loss.rows for loss in losses)
        merged = sorted([*losses, *self._losses], key=lambda loss: loss.first)
        return LedgerSummary(latched + before if triggers is None else triggers, latched, self._recorded, tuple(merged))

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, *_: object) -> None:
        if not self._closing:
            self.finish()

    def _note(self, rows: Rows) -> None:
        """Writes the progress into the file, so that the missing rows are known after a crash."""
        first = self._progress.first if self._progress.rows else int(rows.number[0])
        count = self._progress.rows + len(rows)
        self._progress = Progress(count, first, int(rows.number[-1]), int(rows.wall_ns[-1]))
        with contextlib.suppress(OSError):  # the rows go to the same disk, and their loss is counted
            self._file.progress(self._progress)

    def _run(self) -> None:
        try:
            while blocks := self._take():
                self._write(blocks)
        except BaseException as error:
            with self._change:
                self._failure = error
                self._queue.clear()
                self._queued = 0
                self._change.notify_all()

    def _take(self) -> list[Rows]:
        """Waits for the next chunk's worth of blocks; an empty list is the end."""
        with self._change:
            enough = min(self._chunk_rows, self._queue_rows // 2)
            while not self._closing and self._queued < enough:
                due = self._oldest + self._chunk_seconds - time.monotonic() if self._queued else None
                if due is not None and due <= 0:
                    break
                self._change.wait(due)
            blocks = list(self._queue)
            self._queue.clear()
            self._queued = 0
            self._change.notify_all()
        return blocks

    def _write(self, blocks: list[Rows]) -> None:
        columns = _columns(blocks, self.layout)
        poses: list[NDArray[np.float64]] = []
        for start in range(0, len(columns["number"]), self._chunk_rows):
            piece = {name: values[start : start + self._chunk_rows] for name, values in columns.items()}
            piece |= self._derive(piece)
            poses += [piece["base_pose"]] if self.layout.pose else []
            try:
                write_chunk(self._file, self._format, piece)
                self._recorded += len(piece["number"])
            except OSError as error:
                with self._change:
                    self._lose(piece["number"], LossReason.DISK, str(error.strerror))
        if self._viewers is not None:
            with contextlib.suppress(OSError):  # lost rows are counted above; pictures are not data
                pose = np.concatenate(poses) if self.layout.pose else None
                for content in self._viewers.contents(columns["q"], columns["wall_ns"], pose):
                    write_pictures(self._file, content)
        # a disk that fails to sync fails at the end of the file too, which is reported
        with contextlib.suppress(OSError):
            self._file.sync()

    def _lose(self, numbers: NDArray[np.int64], reason: LossReason, detail: str) -> None:
        for run in np.split(numbers, np.flatnonzero(np.diff(numbers) != 1) + 1):
            last = self._losses[-1] if self._losses else None
            if last and (last.reason, last.detail, last.first + last.rows) == (reason, detail, run[0]):
                self._losses[-1] = Loss(last.first, last.rows + len(run), reason, detail)
            else:
                self._losses.append(Loss(int(run[0]), len(run), reason, detail))


def _columns(blocks: list[Rows], layout: Layout) -> dict[str, NDArray]:
    """The blocks one after the other, under the names that the columns have in the file.

    A block without reference positions or points has NaN there.
    """
    names = {"points": "xyz"}
    required = {"qref": "qref" in layout.signals, "points": bool(layout.points)}
    columns = {}
    if layout.extra:
        further = [np.column_stack([block.extra[name] for name in layout.extra]) for block in blocks]
        columns["extra"] = np.concatenate(further)
    for name in (name for name in Rows.__dataclass_fields__ if name != "extra"):
        pieces = [getattr(block, name) for block in blocks]
        if required.get(name, True):
            width = 3 if name == "points" else len(layout.joints)
            pieces = [np.full((len(b), width), np.nan) if p is None else p for p, b in zip(pieces, blocks)]
            columns[names.get(name, name)] = np.concatenate(pieces)
        elif any(piece is not None for piece in pieces):
            raise ValueError(f"rows have {name}, for which the recording has no column")
    return columns
