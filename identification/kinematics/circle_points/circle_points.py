"""Circle-point analysis of a calibration's runs: the circles of its sweeps, and the arm that follows from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from identification.kinematics.circle_points.axes import circle_point_model
from identification.kinematics.circle_points.circle_point import LEAST_ARC, LEAST_POINTS, Circle
from identification.kinematics.circle_points.sweeps import circles_of
from identification.kinematics.data.runs import Run
from identification.kinematics.models.chain import Chain, target_steps
from identification.kinematics.models.parameters import Target, is_target


@dataclass(frozen=True, kw_only=True)
class CirclePoints:
    """What the sweeps of single joints show.

    circles  the best one of every joint that was swept alone, last joint first
    refused  why other sweeps gave none
    values   (values,) rad, m of the chain, or None
    why_not  why they are no model of the arm; "": they are one
    """

    circles: tuple[Circle, ...]
    refused: tuple[str, ...]
    values: Array | None
    why_not: str


def circle_points(arm: Arm, target: Target, runs: Sequence[Run], nominal: Chain) -> CirclePoints:
    """Circle-point analysis of runs; ``target`` is the first, of which the circles are."""
    circles, refused = _best_circles(runs)
    return CirclePoints(
        circles=tuple(circles),
        refused=tuple(refused),
        values=_values(arm, circles, nominal),
        why_not=_why_not(arm, target, runs, refused, found=bool(circles)),
    )


def _best_circles(runs: Sequence[Run]) -> tuple[list[Circle], list[str]]:
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


def _values(arm: Arm, circles: Sequence[Circle], nominal: Chain) -> Array | None:
    """(values,) rad, m of the chain by circle-point analysis; None without circles or for an unsupported convention."""
    if not circles or any(j.convention != "standard" for j in arm.joints):
        return None
    values = circle_point_model(circles, _one_target(nominal))
    return np.concatenate((values, nominal.values[len(values) :]))


def _why_not(arm: Arm, target: Target, runs: Sequence[Run], refused: Sequence[str], found: bool) -> str:
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


def _one_target(chain: Chain) -> Chain:
    """The chain to the position of the first target, which is then called ``target``."""
    first = [k for k, s in enumerate(chain.steps) if is_target(s.name)][:3]
    ends = target_steps("target", [chain.steps[k].value for k in first])
    return Chain((*chain.steps[: first[0]], *ends))
