"""Distances of our capsules beside those of coal and python-fcl: time per pair, and the largest difference.

    pip install coal python-fcl        # no dependency of ours
    python -m benchmarks.clearance_peers [--json]

Times are of the processor, the fastest of five. The poses of the peers are made before the clock starts;
``coal_pose_us`` is what one costs.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import coal
import fcl
import numpy as np

from arm_clearance.distances import segment_to_box, segment_to_segment
from benchmarks.report import report

PAIRS, TRIALS, COMPARED = 20_000, 5, 3000
RADIUS, HALF = 0.1, 0.3
"""m: of both capsules (1 m long), and half the edge of the box."""


def measure() -> dict[str, float]:
    places = np.random.default_rng(0).uniform(-1.0, 1.0, (PAIRS, 3))
    up = np.array([0.0, 0.0, 0.5])
    ends = np.tile(-up, (PAIRS, 1)), np.tile(up, (PAIRS, 1))
    figures: dict[str, float] = {}
    for name, ours, bodies in (
        ("capsules", lambda: segment_to_segment(*ends, places - up, places + up) - 2 * RADIUS, _CAPSULES),
        ("capsule_box", lambda: segment_to_box(*ends, places - HALF, places + HALF) - RADIUS, _BOXES),
    ):
        figures[f"{name}_us"] = _fastest(ours)
        expected = ours()[:COMPARED]
        for peer, (other, distances) in bodies.items():
            poses = [_POSES[peer](place) for place in places]
            figures[f"{name}_{peer}_us"] = _fastest(lambda d=distances, o=other, p=poses: d(o, p))  # type: ignore[misc]
            apart = expected > 1e-6
            found = np.array(distances(other, poses[:COMPARED]))
            figures[f"{name}_{peer}_differs_m"] = float(np.abs(found - expected)[apart].max())
    figures["coal_pose_us"] = _fastest(lambda: [_POSES["coal"](place) for place in places])
    return figures


def _by_coal(other: Any, poses: Sequence[Any]) -> list[float]:
    one, here = coal.Capsule(RADIUS, 1.0), coal.Transform3s.Identity()
    request, result, found = coal.DistanceRequest(), coal.DistanceResult(), []
    for pose in poses:
        result.clear()
        found.append(coal.distance(one, here, other, pose, request, result))
    return found


def _by_fcl(other: Any, poses: Sequence[Any]) -> list[float]:
    one, request = fcl.CollisionObject(fcl.Capsule(RADIUS, 1.0), fcl.Transform()), fcl.DistanceRequest()
    return [fcl.distance(one, fcl.CollisionObject(other, pose), request, fcl.DistanceResult()) for pose in poses]


_POSES: dict[str, Callable[[Any], Any]] = {
    "coal": lambda place: coal.Transform3s(np.eye(3), place),
    "fcl": lambda place: fcl.Transform(np.eye(3), place),
}
_CAPSULES = {"coal": (coal.Capsule(RADIUS, 1.0), _by_coal), "fcl": (fcl.Capsule(RADIUS, 1.0), _by_fcl)}
_BOXES = {"coal": (coal.Box(*[2 * HALF] * 3), _by_coal), "fcl": (fcl.Box(*[2 * HALF] * 3), _by_fcl)}


def _fastest(work: Callable[[], object]) -> float:
    """us per pair."""
    found = []
    for _ in range(TRIALS):
        began = time.process_time()
        work()
        found.append(time.process_time() - began)
    return 1e6 * min(found) / PAIRS


if __name__ == "__main__":
    report(measure())
