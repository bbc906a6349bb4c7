"""Why a run ends: motion or rows are done, the trigger or a device has fallen silent, or it was stopped."""

from __future__ import annotations

import threading

from arm_io import DeviceFault
from daq.acquisition.device_stream import Stream
from daq.acquisition.join import Join
from daq.acquisition.readers import Intake
from daq.acquisition.states import End, Ending
from daq.rig.bench import Bench
from drivers.protocols import Plan, PositionTracker, Reconnecting

PATIENCE = 0.5
"""s without a trigger, or that a device may lag behind the others, before it counts as gone."""


class EndWatch:
    """Judges after every reading of the devices whether a run ends; the first reason counts.

    moves  whether the run has a motion: where a controller moves the arm, that says when the run is done
    """

    def __init__(self, bench: Bench, plan: Plan, *, moves: bool) -> None:
        self._bench, self._plan, self._moves = bench, plan, moves
        self._ending: Ending | None = None
        self._newest_ns = 0
        self._lock = threading.Lock()

    def begin(self, host_ns: int) -> None:
        """The start signal is out: from here on, edges are awaited."""
        self._newest_ns = host_ns

    def stop(self, ending: Ending) -> None:
        """Ends the run; from any thread."""
        with self._lock:
            self._ending = self._ending or ending

    def judge(self, asked_ns: int, intake: Intake, join: Join) -> Ending | None:
        """Why the run ends, or None. The devices were last asked at host ns ``asked_ns``."""
        clock = intake.clock
        if clock.ready is not None:
            self._newest_ns = max(self._newest_ns, int(clock.ready["host"][-1]))
        if self._seeks(clock):
            self._newest_ns = asked_ns
        found = (
            self._ending
            or self._tripped()
            or self._done(clock.newest)
            or self._quiet(clock.newest, asked_ns)
            or self._silent(intake, join)
        )
        if found is not None:
            self.stop(found)
        return self._ending

    def _tripped(self) -> Ending | None:
        guard = self._bench.guard
        if guard.tripped is None:
            return None
        return Ending(End.WATCHDOG if guard.silent is None else End.NO_ANSWER, guard.tripped)

    def _done(self, newest: int) -> Ending | None:
        """The motion has ended, or as many rows are made as were asked for."""
        controller = self._bench.guard.controller
        if not self._moves or controller is None:
            return Ending(End.ROWS_DONE) if self._plan.rows is not None and newest + 1 >= self._plan.rows else None
        try:
            return Ending(End.MOTION_DONE) if controller.finished() else None
        except DeviceFault as fault:
            return Ending(End.DEVICE_LOST, str(fault))

    def _quiet(self, newest: int, asked_ns: int) -> Ending | None:
        """There are no edges any more."""
        if asked_ns - self._newest_ns <= max(PATIENCE, 20 / self._plan.rate) * 1e9:
            return None
        if newest < 0:
            return Ending(End.NO_TRIGGER)
        for name, device in self._bench.devices.items():
            if isinstance(device, PositionTracker) and newest + 1 == device.memory:
                return Ending(End.TRACKER_FULL, f"{name}, {device.memory} samples")
        return Ending(End.TRIGGER_STOPPED, f"after trigger {newest}")

    def _silent(self, intake: Intake, join: Join) -> Ending | None:
        """Devices stopped making rows though edges continue: the join waits for them no longer."""
        most = PATIENCE * self._plan.rate + 2
        required = [stream for stream in intake.others if stream.required and not self._seeks(stream)]
        silent = [stream.name for stream in required if intake.clock.newest - stream.newest > most]
        for name in silent:
            join.lose_device(name, "stopped making rows")
        return Ending(End.DEVICE_SILENT, silent[0]) if silent else None

    def _seeks(self, stream: Stream) -> bool:
        """Whether its device has lost its connection and tries to reconnect; it then returns or raises DeviceFault."""
        device = self._bench.devices[stream.name]
        return isinstance(device, Reconnecting) and device.seeking
