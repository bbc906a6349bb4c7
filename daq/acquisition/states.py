"""The states of an acquisition, every way in which one can end, and what is checked before it begins."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from daq.rig.rig_file import Rig
from drivers.protocols import Device, Identity, Latched, Plan, PositionTracker
from experiment import Experiment, demand_of


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
    End.ROWS_DONE: "as many rows as were asked for have been made",
    End.STOPPED: "somebody stopped it",
    End.TERMINATED: "the program was told to end",
    End.NO_TRIGGER: "no edge came on the trigger line after the start; check its wiring and that the tracker is on",
    End.TRIGGER_STOPPED: "the trigger line went quiet in the middle of the run",
    End.TRACKER_FULL: "the tracker's memory is full and it makes no more edges",
    End.DEVICE_LOST: "a device failed or was unplugged",
    End.DEVICE_SILENT: "a device makes no rows any more though the trigger line goes on",
    End.NO_ANSWER: "a device kept the sampler waiting and the watchdog brought the outputs to their safe state",
    End.LIMIT: "the arm left its limits",
    End.WATCHDOG: "the sampler was not served in time and the watchdog brought the outputs to their safe state",
    End.RECORDER: "the recorder could not go on",
    End.ABANDONED: "nobody took the rows any more",
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


def check_plan(rig: Rig, devices: Mapping[str, Device], identities: Mapping[str, Identity], plan: Plan) -> list[str]:
    """What the rig's devices cannot do of a plan: one sentence each, with what would be right; empty when all is well."""
    problems = []
    for name, identity in identities.items():
        on_its_own_clock = isinstance(devices[name], PositionTracker) and plan.source != "tracker"
        if not isinstance(devices[name], Latched) or on_its_own_clock:
            continue
        if identity.max_rate is not None and plan.rate > identity.max_rate:
            problems.append(f"{name} latches at most {identity.max_rate:g} rows/s, not {plan.rate:g}; lower the rate")
        recalled = isinstance(devices[name], PositionTracker)
        if identity.memory is not None and not recalled:
            problems += _check_memory(name, identity.memory, plan)
    for name, device in devices.items():
        if isinstance(device, PositionTracker):
            limit = identities[name].max_rate
            if not isinstance(device, Latched):
                problems += _check_memory(name, device.memory, plan)
                if limit is not None and plan.rate > limit and rig.trigger and rig.trigger.source == "tracker":
                    problems.append(
                        f"{name} samples at most {limit:g} times a second, not {plan.rate:g}; lower the rate"
                    )
    return problems


def _check_memory(name: str, memory: int, plan: Plan) -> list[str]:
    if plan.rows is not None and plan.rows <= memory:
        return []
    seconds = memory / plan.rate
    if plan.rows is None:
        return [f"{name} holds {memory} samples, {seconds:g} s at {plan.rate:g} rows/s: say how long the run is"]
    rate = memory / (plan.rows / plan.rate)
    return [
        f"{name} holds {memory} samples, the run makes {plan.rows}: "
        f"lower the rate to {np.floor(rate):g} rows/s, or shorten the run to {seconds:g} s"
    ]


FELT = 0.02
"""s: an arm does not follow corners of a demand that are shorter; its acceleration is that between instants so far apart."""


def check_motion(rig: Rig, experiment: Experiment, step: float = 1e-3) -> list[str]:
    """Where an experiment asks for more than the rig's limits allow; its demand is looked at every ``step`` s."""
    if len(experiment.start) != rig.joints:
        return [f"the experiment is for {len(experiment.start)} joints, the rig has {rig.joints}"]
    demand = demand_of(experiment)
    q = demand(np.arange(0.0, demand.duration + step, step))
    problems = []
    if rig.limits.position is not None:
        for joint, (low, high) in enumerate(rig.limits.position, 1):
            reached = q[:, joint - 1]
            if not (low - 1e-9 <= reached.min() and reached.max() <= high + 1e-9):  # NaN is within no limits
                problems.append(
                    f"joint {joint} goes from {reached.min():.4g} to {reached.max():.4g}; "
                    f"its limits in the rig file are {low:g} to {high:g}"
                )
    if rig.limits.speed is not None and len(q) > 1:
        speed = np.abs(np.diff(q, axis=0)).max(axis=0) / step
        for joint, limit in enumerate(rig.limits.speed, 1):
            if not speed[joint - 1] <= limit * (1 + 1e-6):
                problems.append(f"joint {joint} moves at up to {speed[joint - 1]:.4g}/s; its limit is {limit:g}/s")
    apart = max(1, round(FELT / step))
    if rig.limits.acceleration is not None and len(q) > 2 * apart:
        bend = q[2 * apart :] - 2 * q[apart:-apart] + q[: -2 * apart]
        acceleration = np.abs(bend).max(axis=0) / (apart * step) ** 2
        for joint, limit in enumerate(rig.limits.acceleration, 1):
            if not acceleration[joint - 1] <= limit * (1 + 1e-6):
                problems.append(
                    f"joint {joint} accelerates at up to {acceleration[joint - 1]:.4g}/s2; its limit is {limit:g}/s2"
                )
    return problems
