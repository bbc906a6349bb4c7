"""The states of an acquisition, and every way in which one can end."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class State(StrEnum):
    """idle -> armed -> running -> done or fault; ``armed`` may go back to idle."""

    IDLE = "idle"
    ARMED = "armed"
    RUNNING = "running"
    DONE = "done"
    FAULT = "fault"


NEXT = {
    State.IDLE: {State.ARMED},
    State.ARMED: {State.RUNNING, State.IDLE, State.FAULT},
    State.RUNNING: {State.DONE, State.FAULT},
    State.DONE: set(),
    State.FAULT: set(),
}


class End(StrEnum):
    """Every way in which an acquisition ends; each with a sentence in ``SENTENCES``."""

    MOTION_DONE = "motion_done"
    ROWS_DONE = "rows_done"
    STOPPED = "stopped"
    TERMINATED = "terminated"
    NO_TRIGGER = "no_trigger"
    TRIGGER_STOPPED = "trigger_stopped"
    TRACKER_FULL = "tracker_full"
    DEVICE_LOST = "device_lost"
    DEVICE_SILENT = "device_silent"
    NO_ANSWER = "no_answer"
    LIMIT = "limit"
    WATCHDOG = "watchdog"
    RECORDER = "recorder"
    ABANDONED = "abandoned"


SENTENCES = {
    End.MOTION_DONE: "the motion has ended",
    End.ROWS_DONE: "the requested number of rows was recorded",
    End.STOPPED: "stopped by command",
    End.TERMINATED: "the program received a signal to end",
    End.NO_TRIGGER: "no edge came on the trigger line after the start; check its wiring and that the tracker is on",
    End.TRIGGER_STOPPED: "no more edges came on the trigger line during the run",
    End.TRACKER_FULL: "the tracker's memory is full and it makes no more edges",
    End.DEVICE_LOST: "a device failed or was unplugged",
    End.DEVICE_SILENT: "a device stopped making rows although the trigger line continues",
    End.NO_ANSWER: "a device did not answer in time, and the watchdog brought the outputs to their safe state",
    End.LIMIT: "the arm exceeded a limit",
    End.WATCHDOG: "the sampler was not served in time and the watchdog brought the outputs to their safe state",
    End.RECORDER: "the recorder could not continue",
    End.ABANDONED: "the consumer stopped reading",
}

FAULTS = {
    End.NO_TRIGGER,
    End.TRIGGER_STOPPED,
    End.DEVICE_LOST,
    End.DEVICE_SILENT,
    End.NO_ANSWER,
    End.LIMIT,
    End.WATCHDOG,
    End.RECORDER,
}


@dataclass(frozen=True)
class Ending:
    """How an acquisition ended. ``detail`` names the device, the joint, the person's word."""

    reason: End
    detail: str = ""

    @property
    def state(self) -> State:
        """DONE or FAULT."""
        return State.FAULT if self.reason in FAULTS else State.DONE

    def __str__(self) -> str:
        sentence = SENTENCES[self.reason]
        return f"{sentence} ({self.detail})" if self.detail else sentence
