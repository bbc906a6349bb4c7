"""One recording: rows from the sampler go to the recorder and the publisher; the result says how it ended.

Used by the daemon and by an embedded ``record`` alike.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from arm_io import DeviceFault, InputError, read_text, toml_of
from daq.acquisition.acquisition import Acquisition
from daq.acquisition.states import End, State
from daq.recording.mcap_file.pages import ACTIVE
from daq.recording.parts import Attachments, ledger_table, loss_tables
from daq.recording.provenance import provenance
from daq.recording.recorder import Recorder, rows_layout
from daq.rig.bench import Bench
from daq.rig.rig_tables import JointTable
from daq.service.publisher import Publisher
from daq.service.row_block import columns_of
from drivers import SystemClock
from experiment import Experiment, demand_of, experiment_of

Table = dict[str, Any]
SHOWN_LOSSES = 8
"""Of a run that goes on; its file has them all."""


@dataclass(frozen=True)
class RecordingRequest:
    """What to record: an experiment as text (it is kept word for word) and the file to write."""

    experiment: Experiment
    text: str
    out: Path


def request_of(text: str, where: str, out: Path) -> RecordingRequest:
    """The request for an experiment in TOML; InputError names ``where`` it came from."""
    return RecordingRequest(experiment_of(toml_of(text, where), where), text, out)


class Run:
    """One recording in the making.

    ``arm``, then ``start``, then ``take`` (in a thread, if it must not block); ``stop`` any time.

    result  after ``take``: the table that ``record --json`` prints
    """

    def __init__(self, bench: Bench, rig_text: str, request: RecordingRequest, publisher: Publisher | None) -> None:
        self.request = request
        self.result: Table | None = None
        self._bench, self._rig_text, self._publisher = bench, rig_text, publisher
        self._acquisition = Acquisition(bench, request.experiment)
        self._recorder: Recorder | None = None

    def arm(self) -> None:
        """Checks all, brings the arm to the start and begins the file; after an error nothing is armed."""
        self._acquisition.arm()
        try:
            self._recorder = self._begin()
        except BaseException:
            self._acquisition.disarm()
            raise

    def disarm(self) -> None:
        """Back from armed; the empty file goes. Does nothing after the run has ended."""
        if self._acquisition.ending is not None:
            return
        self._acquisition.disarm()
        assert self._recorder is not None
        self._recorder.discard()

    def start(self) -> None:
        """Sets clock and arm going. After an error they do not; the file then holds no rows and says why."""
        if self._publisher is not None:
            self._publisher.begin()
        try:
            self._acquisition.start()
        except Exception as error:
            self.result = self._finish(str(error))
            raise

    def take(self, done: Callable[[], None] = lambda: None) -> Table:
        """Passes all rows to file and subscribers until the run has ended, and finishes the file.

        ``done`` is called then.
        """
        assert self._recorder is not None
        trouble = ""
        try:
            for rows in self._acquisition.rows():
                self._recorder.append(rows)
                if self._publisher is not None:
                    self._publisher.publish(columns_of(rows))
        except DeviceFault as fault:
            trouble = str(fault)
        except Exception as error:  # a bug, here or in a driver: the file is finished all the same, and says so
            trouble = f"{type(error).__name__}: {error}"
            raise
        finally:
            self.result = self._finish(trouble)
            done()
        return self.result

    def stop(self, reason: End = End.STOPPED, detail: str = "") -> None:
        """Ends the run with the rows so far; from any thread."""
        self._acquisition.stop(reason, detail)

    @property
    def state(self) -> State:
        """Of the acquisition."""
        return self._acquisition.state

    def progress(self) -> Table:
        """How far it is: rows made, recorded and lost so far, share of the expected rows (0..1, or None).

        ``losses``: the newest ``SHOWN_LOSSES`` of the sampler, as the ledger has them.
        """
        recorder, account = self._recorder, self._acquisition.ledger.summary()
        return {
            "experiment": self.request.experiment.name,
            "file": str(self.request.out),
            "rows": self._acquisition.rows_made,
            "recorded": recorder.recorded if recorder else 0,
            "lost": account.lost + (recorder.lost if recorder else 0),
            "losses": loss_tables(account.losses[-SHOWN_LOSSES:]),
            "progress": self._acquisition.progress,
        }

    def _begin(self) -> Recorder:
        bench, rig = self._bench, self._bench.rig
        model = read_text(rig.model_path) if rig.model_path is not None else None
        counters, inputs = bench.columns.names()
        controller = bench.guard.controller
        layout = rows_layout(
            [joint.name or f"joint{number}" for number, joint in enumerate(rig.joint, 1)],
            counters=counters,
            inputs=inputs,
            tracker=bench.columns.tracker is not None,
            demand=controller is not None and controller.demand(np.zeros(1)) is not None,
            effort=_torque_per_ampere(model, rig.joint),
            extra=[name for _, name in bench.columns.readings],
        )
        identities = {name: asdict(identity) for name, identity in bench.identities.items()}
        attachments = Attachments(
            rig=self._rig_text,
            model=model,
            experiment=self.request.text,
            calibration=bench.calibration.as_table(),
            provenance=provenance("measured", devices=identities, columns=bench.columns.as_table()),
            chain=bench.guard.chain,
        )
        return Recorder(
            self.request.out,
            layout,
            attachments,
            live=isinstance(bench.clock, SystemClock),
            chunk_seconds=rig.recording.chunk_seconds,
        )

    def _finish(self, trouble: str) -> Table:
        assert self._recorder is not None
        acquisition = self._acquisition
        if self._publisher is not None:
            self._publisher.finish()
        account = acquisition.ledger.summary()
        ending: Table = {"reason": str(End.DEVICE_LOST), "sentence": trouble, "fault": True}
        if not trouble and acquisition.ending is not None:
            ended = acquisition.ending
            ending = {"reason": str(ended.reason), "sentence": str(ended), "fault": ended.state is State.FAULT}
        closing = {
            "ending": ending,
            "missing": dict(acquisition.missing),
            "notes": acquisition.notes,
            "clocks": [fit.as_table() for fit in acquisition.clocks()] if acquisition.rows_made else [],
        }
        file = self.request.out
        try:
            ledger = self._recorder.finish(triggers=account.triggers, losses=account.losses, closing=closing)
        except DeviceFault as fault:
            file = file.with_name(file.name + ACTIVE)
            ledger = self._recorder.balance(account.triggers, account.losses)
            ending = {"reason": str(End.RECORDER), "sentence": str(fault), "fault": True}
        return {
            "schema": "armscope.record/1",
            "file": str(file),
            "experiment": self.request.experiment.name,
            "rig": self._bench.rig.name,
            "seconds": demand_of(self.request.experiment).duration,
            "rows": ledger.recorded,
            "ending": ending,
            "ledger": ledger_table(ledger),
            "missing": dict(acquisition.missing),
            "notes": acquisition.notes,
            "published": {"blocks": self._publisher.blocks, "rows": self._publisher.rows} if self._publisher else None,
        }


def _torque_per_ampere(model: str | None, joints: list[JointTable]) -> list[float]:
    """(J,) N m/A (N/A) abs(gear) x torque constant, from the model file; [] unless all joints have one.

    1 where the rig measures torques.
    """
    if all(joint.current is not None and joint.current.unit != "A" for joint in joints):
        return [1.0] * len(joints)
    try:
        constants = [float(joint["torque_constant"]) for joint in toml_of(model or "", "model").get("joint", [])]
    except (InputError, KeyError, TypeError, ValueError):
        return []
    return [k * abs(joint.gear) for k, joint in zip(constants, joints)] if len(constants) == len(joints) else []
