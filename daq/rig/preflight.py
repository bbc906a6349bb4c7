"""What is checked before anything moves: the plan against the devices, the motion against the rig's limits."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from arm_clearance import Chain, check_clearance
from arm_io import InputError, counted
from arm_io.types import Array
from daq.rig.rig_file import Rig
from drivers.protocols import Device, Identity, Latched, Plan, PositionTracker
from experiment import STEP, Demand, Excess, Experiment, Kind, demand_of, excesses

ROUNDING, RELATIVE = 1e-9, 1e-6
"""rad (m) of a position, and parts of a speed or acceleration, by which a limit may be passed."""
ChainReader = Callable[[Path], Chain]
"""Reads the links of the arm in a model file: daq itself does not know models (docs/architecture.md)."""


def chain_of(rig: Rig, read_chain: ChainReader | None) -> Chain | None:
    """The links of a rig's arm: to keep clear of a ``[space]``, and for viewers.

    InputError where the rig has a space, and its model cannot be read or has another number of joints; without a space
    None then.
    """
    if rig.model_path is None or read_chain is None:
        return None
    try:
        chain = read_chain(rig.model_path)
    except InputError:
        if rig.space is None:
            return None
        raise
    if len(chain) != rig.joints:
        if rig.space is None:
            return None
        raise InputError(rig.name, f"space: the rig has {counted(rig.joints, 'joint')}, its model {len(chain)}")
    return chain


def check_plan(rig: Rig, devices: Mapping[str, Device], identities: Mapping[str, Identity], plan: Plan) -> list[str]:
    """What the rig's devices cannot do of a plan: one sentence each, with the remedy; empty if nothing."""
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
                        f"{name} samples at most {limit:g} times per second, not {plan.rate:g}; lower the rate"
                    )
    return problems


def _check_memory(name: str, memory: int, plan: Plan) -> list[str]:
    if plan.rows is not None and plan.rows <= memory:
        return []
    seconds = memory / plan.rate
    if plan.rows is None:
        return [
            f"the memory of {name} has {memory} samples, {seconds:g} s at {plan.rate:g} rows/s: give the run a duration"
        ]
    rate = memory / (plan.rows / plan.rate)
    return [
        f"the memory of {name} has {memory} samples, the run makes {plan.rows}: "
        f"lower the rate to {np.floor(rate):g} rows/s, or shorten the run to {seconds:g} s"
    ]


def check_motion(rig: Rig, experiment: Experiment, chain: Chain | None = None) -> list[str]:
    """Where an experiment asks for more than the rig's limits and its space allow, one sentence each.

    Its demand is looked at every ``STEP`` s. ``chain``: the links of the arm; a rig with a ``[space]`` needs them.
    """
    if len(experiment.start) != rig.joints:
        return [f"the experiment is for {counted(len(experiment.start), 'joint')}, the rig has {rig.joints}"]
    demand, limits = demand_of(experiment), rig.limits
    low, high = (None, None) if limits.position is None else np.array(limits.position).T
    speed, acceleration = (None if some is None else np.array(some) for some in (limits.speed, limits.acceleration))
    violations = excesses(
        demand,
        low=None if low is None else low - ROUNDING,
        high=None if high is None else high + ROUNDING,
        speed=None if speed is None else speed * (1 + RELATIVE),
        acceleration=None if acceleration is None else acceleration * (1 + RELATIVE),
    )
    problems = _away_from_start(rig, experiment, demand(np.zeros(1))[0], speed) + [
        _sentence(rig, one) for one in violations
    ]
    # not checked further: a refused motion may be endless
    return problems or _check_space(rig, demand, chain)


def _check_space(rig: Rig, demand: Demand, chain: Chain | None) -> list[str]:
    if rig.space is None:
        return []
    if chain is None:
        return ["the rig file has a [space], and this program was not given the arm's links to check it"]
    return check_clearance(demand, chain, rig.space)


def _away_from_start(rig: Rig, experiment: Experiment, first: Array, speed: Array | None) -> list[str]:
    """Joints whose first demand is not the start pose: a table of positions may begin anywhere."""
    if speed is None:
        return []
    jump = np.abs(first - np.array(experiment.start))
    most = speed * (1 + RELATIVE) * STEP
    return [
        f"the reference of joint {joint + 1} jumps by {jump[joint]:.4g} {rig.joint[joint].unit} from the start pose; "
        "begin the motion at 'start'"
        for joint in np.flatnonzero(~(jump <= most)).tolist()
    ]


def _sentence(rig: Rig, excess: Excess) -> str:
    joint, limits, value = excess.joint, rig.limits, excess.value
    unit = rig.joint[joint - 1].unit
    if excess.kind in (Kind.LOW, Kind.HIGH):
        within = (
            ""
            if limits.position is None
            else "; its limits in the rig file are {:g} to {:g} ".format(*limits.position[joint - 1]) + unit
        )
        return f"joint {joint} reaches {value:.4g} {unit}{within}"
    if excess.kind is Kind.SPEED:
        return f"joint {joint} moves at up to {value:.4g} {unit}/s" + (
            "" if limits.speed is None else f"; its limit is {limits.speed[joint - 1]:g} {unit}/s"
        )
    limit = "" if limits.acceleration is None else f"; its limit is {limits.acceleration[joint - 1]:g} {unit}/s2"
    return f"joint {joint} accelerates at up to {value:.4g} {unit}/s2{limit}"
