"""The experiment that would tell the members of a group apart, as a file that ``record`` runs.

Chosen by what separates the members physically (``Effect.confused_with``): standing still with the drives off shows what is the
instrument's own; a known mass shows what is payload; everything else is given reversals at a ladder of speeds over the joint's range.
"""

from __future__ import annotations

import numpy as np

from diagnosis.diagnose import Cause, Diagnosis
from experiment import Experiment

INSTRUMENT = {"current_offset", "mains_hum"}
MASS = {"payload", "torque_constant", "current_gain", "link_inertia"}
SPEEDS = (0.05, 0.1, 0.25, 0.5, 1.0)


def separating_experiment(cause: Cause, result: Diagnosis) -> Experiment:
    """An experiment for the group of a cause, within the joint limits of the model and the region the recordings used."""
    members = {effect for effect, _ in cause.group}
    name = f"separate {', '.join(sorted(members))}" + (f" at joint {cause.joint}" if cause.joint else "")
    setup: dict[str, object] = {}
    joint = cause.joint or cause.felt_at
    if members & INSTRUMENT:
        segments: list[dict[str, object]] = [{"type": "hold", "duration": 5.0}]
        setup = {"drives_off": True, "instruction": "switch the drives off and let the brakes hold the arm"}
    else:
        if members & MASS:
            setup = {
                "payload": {"mass": 2.0, "com": [0.0, 0.0, 0.05]},
                "instruction": "bolt a known mass of 2 kg to the flange; correct its mass and centre in this file",
            }
        segments = _ladder(result, joint)
    speed = np.array([max(float(np.abs(run.v[:, j]).max()) for run in result.fit) for j in range(len(result.arm))])
    brisk = np.array([max(float(np.abs(run.a[:, j]).max()) for run in result.fit) for j in range(len(result.arm))])
    table = {
        "name": name,
        "description": cause.separate_by or "reversals at a ladder of speeds",
        "start": result.fit[0].q[0].tolist(),
        "full_speed": np.maximum(speed, 0.1).tolist(),
        "full_acceleration": np.maximum(brisk, 0.5).tolist(),
        "setup": setup,
        "segment": segments,
    }
    return Experiment.model_validate(table)


def _ladder(result: Diagnosis, joint: int) -> list[dict[str, object]]:
    low = min(float(run.q[:, joint - 1].min()) for run in result.fit)
    high = max(float(run.q[:, joint - 1].max()) for run in result.fit)
    segments: list[dict[str, object]] = [{"type": "hold", "duration": 0.5}]
    for speed in SPEEDS:
        far = low + (high - low) * min(1.0, 4 * speed)  # slow steps are short ones
        segments += [
            {"type": "drive", "joint": joint, "to": low, "speed": max(speed, 0.25)},
            {"type": "drive", "joint": joint, "to": far, "speed": speed},
            {"type": "drive", "joint": joint, "to": low, "speed": speed},
        ]
    return [*segments, {"type": "hold", "duration": 0.5}]
