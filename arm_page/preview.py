"""Preview of an experiment: which joints move, how far and how fast, and checks of the rig's limits and space."""

from __future__ import annotations

from typing import Any

import numpy as np

from arm_clearance import Chain, in_words, left_out, nearest, pairs_of
from arm_io.types import Array
from daq.rig import Rig, check_motion
from experiment import FELT, STEP, Demand, Experiment, demand_of

Table = dict[str, Any]
MOST_LOOKS = 20_000
"""Maximum number of instants at which the extremes of a motion are evaluated; long motions are sampled coarsely."""
DRAWN = 600
"""Number of poses of the motion that the page draws."""
MOVES = 1e-6
"""rad (m): a joint that stays within this of its start does not move."""


def preview_of(experiment: Experiment, rig: Rig, chain: Chain | None) -> Table:
    """Preview for a person, before the arm moves; ``problems``: reasons why it would be refused, empty if it would not.

    The daemon checks again, in the same way, when it is asked to arm.
    """
    demand, setup = demand_of(experiment), experiment.setup
    rate = experiment.rate or (rig.trigger.rate if rig.trigger is not None else None)
    table: Table = {
        "name": experiment.name,
        "description": experiment.description,
        "instruction": setup.instruction,
        "drives_off": setup.drives_off,
        "payload": None if setup.payload is None else setup.payload.mass,
        "duration": demand.duration,
        "rate": rate,
        "rows": None if rate is None else max(round(demand.duration * rate), 1),
        "start": list(experiment.start),
        "problems": check_motion(rig, experiment, chain),
        "clearance": [],
        "joints": [],
        "poses": {"t": [], "q": []},
    }
    if len(experiment.start) != rig.joints:
        return table
    table["joints"] = _joints(demand, experiment, rig)
    times = np.linspace(0.0, demand.duration, min(DRAWN, max(2, round(demand.duration / 0.02))))
    table["poses"] = {"t": np.round(times, 4).tolist(), "q": np.round(demand(times), 5).tolist()}
    if chain is not None and rig.space is not None and not table["problems"]:
        pairs = pairs_of(chain, rig.space)
        found = nearest(demand, pairs)
        table["clearance"] = ([] if found is None else [in_words(found)]) + left_out(pairs)
    return table


def _joints(demand: Demand, experiment: Experiment, rig: Rig) -> list[Table]:
    """Per joint: range of position, highest speed and acceleration, and its limits; null where there is no limit."""
    low, high, speed, acceleration = _extremes(demand)
    limits, start = rig.limits, np.array(experiment.start)
    return [
        {
            "joint": j + 1,
            "moves": bool(max(high[j] - start[j], start[j] - low[j]) > MOVES),
            "low": low[j],
            "high": high[j],
            "speed": speed[j],
            "acceleration": acceleration[j],
            "limits": {
                "position": None if limits.position is None else list(limits.position[j]),
                "speed": None if limits.speed is None else limits.speed[j],
                "acceleration": None if limits.acceleration is None else limits.acceleration[j],
            },
        }
        for j in range(rig.joints)
    ]


def _extremes(demand: Demand) -> tuple[list[float], list[float], list[float], list[float]]:
    """(J,) each: lowest and highest position, highest speed and acceleration.

    As the rig's checks see them (``experiment.STEP``, ``experiment.FELT``), at up to ``MOST_LOOKS`` instants.
    """
    count = int(min(MOST_LOOKS, max(2, demand.duration / STEP + 1)))
    times = np.linspace(0.0, demand.duration, count)
    q = demand(times)
    speed: Array = np.abs(demand(times + STEP) - q) / STEP
    bend: Array = np.abs(demand(times + 2 * FELT) - 2 * demand(times + FELT) + q) / FELT**2
    columns = (q.min(axis=0), q.max(axis=0), speed.max(axis=0), bend.max(axis=0))
    low, high, fast, hard = (np.round(column, 6).tolist() for column in columns)
    return low, high, fast, hard
