"""Where a calibration begins.

The pose of the tracker, the circles of single-joint sweeps, and the better of two starting points.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from identification.kinematics.circle_points.axes import circle_point_model
from identification.kinematics.circle_points.circle_point import LEAST_ARC, LEAST_POINTS, Circle
from identification.kinematics.circle_points.sweeps import circles_of
from identification.kinematics.data.points import Points
from identification.kinematics.data.runs import Run, aligned
from identification.kinematics.estimation.map_estimation import residuals
from identification.kinematics.models.chain import Chain, position, target_steps, xyz_ypr
from identification.kinematics.models.parameters import Parameters, Target, Trust, base_pose, is_target, parameters_of

WRONG_FRAME = 0.1
"""m: median distance of the points in a stated tracker frame from which that frame is wrong, if a fitted one leaves
less than a quarter of it."""


def place_tracker(
    arm: Arm, points: Points, targets: Sequence[Target], frame_known: bool, warnings: list[str]
) -> tuple[bool, Array]:
    """Whether the tracker's frame can be taken as known, and the values (values,) rad, m of the chain to begin from."""
    points = points.where(~points.oriented)
    parameters = parameters_of(arm, targets, frame_known=frame_known, trust=Trust())
    chain = parameters.chain
    at = position(chain, points.q, points.target)
    pose = aligned(at, points.xyz)
    as_given = float(np.median(np.linalg.norm(points.xyz - at, axis=1)))
    laid_over = float(np.median(np.linalg.norm(points.xyz - at @ pose[:3, :3].T - pose[:3, 3], axis=1)))
    if frame_known and as_given > WRONG_FRAME and laid_over < as_given / 4:
        frame_known = False
        warnings.append(
            f"the median distance of the points from the model is {1e3 * as_given:.0f} mm in the stated tracker frame "
            f"and {1e3 * laid_over:.1f} mm after a fit of the frame: the frame was taken as unknown and estimated"
        )
    if frame_known:
        return True, chain.values
    correction = np.linalg.inv(np.array(arm.base)) @ pose @ base_pose(chain)
    place = dict(zip(("x", "y", "z", "yaw", "pitch", "roll"), xyz_ypr(correction), strict=True))
    values = [place[s.name[5:]] if s.name.startswith("base.") else s.value for s in chain.steps]
    return False, np.array(values)


def best_circles(runs: Sequence[Run]) -> tuple[list[Circle], list[str]]:
    """The best circle of every joint that was swept alone, last joint first, and why other sweeps gave none."""
    best: dict[int, Circle] = {}
    refused: list[str] = []
    for run in (run for run in runs if run.target == 0 and not run.lever):
        found, reasons = circles_of(run.q, run.xyz, window=2 if run.still else 50)
        refused += [f"{run.name}: {reason}" for reason in reasons]
        for circle in found:
            if circle.joint not in best or circle.std_centre < best[circle.joint].std_centre:
                best[circle.joint] = circle
    return [best[j] for j in sorted(best, reverse=True)], refused


def values_from_circles(arm: Arm, circles: Sequence[Circle], nominal: Chain) -> Array | None:
    """(values,) rad, m of the chain by circle-point analysis; None without circles or for an unsupported convention."""
    if not circles or any(j.convention != "standard" for j in arm.joints):
        return None
    values = circle_point_model(circles, one_target(nominal))
    return np.concatenate((values, nominal.values[len(values) :]))


def why_no_circles(arm: Arm, target: Target, runs: Sequence[Run], refused: Sequence[str], found: bool) -> str:
    """Why circle-point analysis gives no model of the arm, and what it needs; "": it gives one."""
    if not any(run.target == 0 and not run.lever for run in runs):
        return "the first target was not tracked in any fitted run"
    if not found:
        longest = np.degrees(max(_alone(run.q[run.usable]) for run in runs))
        seen = f"{len(refused)} sweeps gave no circle ({refused[0]})" if refused else (
            f"no joint was swept alone (at most {longest:.3g} degrees while the others were at rest; "
            f"{np.degrees(LEAST_ARC):.0f} are needed)"
        )  # fmt: skip
        return f"{seen}; each joint must be moved alone, with at least {LEAST_POINTS} points on its circle"
    if other := next((j for j, joint in enumerate(arm.joints, 1) if joint.convention != "standard"), None):
        return f"joint {other} has convention {arm.joints[other - 1].convention!r}; it needs standard D-H parameters"
    if not target.given:
        return (
            "the position of the target is not known; give --target, because the zero of the last swept joint follows "
            "from it"
        )
    return ""


def _alone(q: Array) -> float:
    """rad: the longest way between neighbouring rows q (N, n) on which one joint alone moves."""
    if len(q) < 2:
        return 0.0
    step = np.abs(np.diff(q, axis=0))
    order = np.sort(step, axis=1)
    others = order[:, -2] if q.shape[1] > 1 else np.zeros(len(step))
    moving = np.where(others <= 0.1 * order[:, -1], step.argmax(axis=1), -1)
    ways, way = [0.0], 0.0
    for k, joint in enumerate(moving):
        way = 0.0 if joint < 0 else step[k, joint] + (way if k and moving[k - 1] == joint else 0.0)
        ways.append(way)
    return float(max(ways))


def with_nominal_target(parameters: Parameters, values: Array) -> Array:
    """(v,) the values with the target at its nominal place, which circle-point analysis alone assumes."""
    values, nominal = values.copy(), parameters.chain.values
    for k, name in enumerate(parameters.chain.names):
        if is_target(name):
            values[k] = nominal[k]
    return values


def one_target(chain: Chain) -> Chain:
    """The chain to the position of the first target, which is then called ``target``."""
    first = [k for k, s in enumerate(chain.steps) if is_target(s.name)][:3]
    ends = target_steps("target", [chain.steps[k].value for k in first])
    return Chain((*chain.steps[: first[0]], *ends))


def best_start(parameters: Parameters, points: Points, nominal: Array, circles: Array | None) -> Array:
    """(v,) the nominal values or those from circles, whichever has the smaller median distance to the points."""
    starts = [nominal] if circles is None else [nominal, with_nominal_target(parameters, circles)]
    plain = points.where(~points.oriented).deflected(None)
    off = [float(np.median(np.linalg.norm(residuals(parameters, s, np.zeros(0), plain), axis=1))) for s in starts]
    return starts[int(np.argmin(off))]
