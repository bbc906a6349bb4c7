"""A motion in the formats that other controllers run: trajectory_msgs/JointTrajectory, CSV and URScript."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from arm_io import InputError, check_file, whole_file
from arm_io.types import Array
from experiment.demand import Demand

ENDINGS = (".yaml", ".yml", ".json", ".csv", ".script")
MOST_POINTS = 2_000_000
"""Points of a file at most: half an hour at 1 kHz."""
_STEP = 1e-4
"""s either way over which the velocity is the difference quotient."""
_UR_JOINTS = 6


def check_trajectory(path: Path, joints: int) -> None:
    """InputError where the ending names no format, the format has no place for so many joints, or no file can be."""
    if path.suffix.lower() not in ENDINGS:
        raise InputError(path, f"the name of a trajectory must end in {', '.join(ENDINGS)}")
    if path.suffix.lower() == ".script" and joints != _UR_JOINTS:
        raise InputError(
            path, f"URScript is for arms of {_UR_JOINTS} joints, this one has {joints}; write .yaml or .csv"
        )
    check_file(path)


def write_trajectory(path: Path, demand: Demand, joints: Sequence[str], rate: float) -> int:
    """Writes a motion as points, ``rate`` per second from t = 0 to its end; returns their number.

    .yaml, .json  trajectory_msgs/JointTrajectory: positions rad (m) and velocities rad/s (m/s) of the named joints
    .csv          t, qref1, qref2, .. in s and rad (m)
    .script       URScript: a slow movej to the start, then one servoj per point; ``rate`` must be that of the robot
    InputError as ``check_trajectory``, and where there would be more than ``MOST_POINTS``.
    """
    check_trajectory(path, len(joints))
    if demand.duration * rate > MOST_POINTS:
        raise InputError(path, f"would have {demand.duration * rate:.3g} points; at most {MOST_POINTS} are written")
    t = np.append(np.arange(0.0, demand.duration, 1.0 / rate), demand.duration)
    if len(t) > 1 and t[-1] - t[-2] < 0.5 / rate:
        t = np.delete(t, -2)
    q = demand(t)
    match path.suffix.lower():
        case ".csv":
            lines = _csv(t, q)
        case ".script":
            lines = _urscript(q, rate)
        case ".json":
            lines = iter([json.dumps(_message(t, q, _velocity(demand, t), joints), indent=1), ""])
        case _:
            lines = _yaml(t, q, _velocity(demand, t), joints)
    with whole_file(path) as file:
        file.writelines(f"{line}\n" for line in lines)
    return len(t)


def _velocity(demand: Demand, t: Array) -> Array:
    """(n, J) rad/s (m/s), 0 at both ends."""
    early, late = np.maximum(t - _STEP, 0.0), np.minimum(t + _STEP, demand.duration)
    velocity: Array = (demand(late) - demand(early)) / np.maximum(late - early, _STEP)[:, None]
    velocity[[0, -1]] = 0.0
    return velocity


def _message(t: Array, q: Array, velocity: Array, joints: Sequence[str]) -> dict[str, object]:
    points = [
        {"positions": position, "velocities": speed, "time_from_start": _duration(time)}
        for time, position, speed in zip(t.tolist(), q.tolist(), velocity.tolist())
    ]
    return {"joint_names": list(joints), "points": points}


def _duration(t: float) -> dict[str, int]:
    sec, nanosec = divmod(round(t * 1e9), 10**9)
    return {"sec": sec, "nanosec": nanosec}


def _yaml(t: Array, q: Array, velocity: Array, joints: Sequence[str]) -> Iterator[str]:
    yield f"joint_names: {json.dumps(list(joints))}"
    yield "points:"
    for time, position, speed in zip(t.tolist(), q.tolist(), velocity.tolist()):
        duration = _duration(time)
        yield f"- time_from_start: {{sec: {duration['sec']}, nanosec: {duration['nanosec']}}}"
        yield f"  positions: {json.dumps(position)}"
        yield f"  velocities: {json.dumps(speed)}"


def _csv(t: Array, q: Array) -> Iterator[str]:
    yield ",".join(["t", *(f"qref{joint + 1}" for joint in range(q.shape[1]))])
    for row in np.column_stack([t, q]).tolist():
        yield ",".join(map(repr, row))


def _urscript(q: Array, rate: float) -> Iterator[str]:
    yield "def armscope_motion():"
    yield f"  movej({_vector(q[0])}, a=0.5, v=0.25)"
    yield "  sleep(1.0)"
    for row in q:
        yield f"  servoj({_vector(row)}, t={1.0 / rate:.6g}, lookahead_time=0.03, gain=300)"
    yield "  stopj(1.0)"
    yield "end"
    yield "armscope_motion()"


def _vector(row: Array) -> str:
    return f"[{', '.join(f'{value:.9f}' for value in row.tolist())}]"
