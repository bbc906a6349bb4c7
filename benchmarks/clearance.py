"""Distances of capsules and boxes over arrays, beside MuJoCo's, one pair per call; and a day's motion checked.

Run as ``python -m benchmarks.clearance [--json]``. Times are of the processor.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np

from arm_clearance import Box, Space, nearest, pairs_of
from arm_clearance.distances import segment_to_box, segment_to_segment
from arm_io import read_toml
from arm_model.collision import read_chain
from benchmarks.report import report
from experiment import demand_of, experiment_of

PAIRS, TRIALS = 50_000, 5
CONFIG = Path(__file__).resolve().parents[1] / "config"
SCENE = """<mujoco><worldbody><geom type="capsule" fromto="0 0 0 1 0 0" size=".1"/>
<geom type="capsule" fromto="0 1 0 1 1 1" size=".1"/><geom type="box" pos="0 0 3" size=".3 .3 .3"/>
</worldbody></mujoco>"""
SPACE = Space(floor=-0.7, box=[Box(name="table", low=(0.3, -0.5, -0.7), high=(0.8, 0.5, -0.1))])


def measure() -> dict[str, float]:
    p1, q1, p2, q2 = np.random.default_rng(0).uniform(-1.0, 1.0, (4, PAIRS, 3))
    low, high = np.minimum(p2, q2), np.maximum(p2, q2)
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)

    def one_by_one(other: int) -> None:
        for _ in range(PAIRS):
            mujoco.mj_geomDistance(model, data, 0, other, 10.0, None)

    per_pair: dict[str, Callable[[], object]] = {
        "capsules": lambda: segment_to_segment(p1, q1, p2, q2),
        "capsules_mujoco": lambda: one_by_one(1),
        "capsule_box": lambda: segment_to_box(p1, q1, low, high),
        "capsule_box_mujoco": lambda: one_by_one(2),
    }
    figures = {f"{name}_us": 1e6 * _fastest(work) / PAIRS for name, work in per_pair.items()}
    pairs = pairs_of(read_chain(CONFIG / "models/puma560.toml"), SPACE)
    table = read_toml(CONFIG / "experiments/excitation.toml")
    for name, times in (("minute", 3), ("day", 4115)):
        repeated = {"segment": [{"type": "repeat", "times": times, "segment": table["segment"]}]}
        demand = demand_of(experiment_of(table | repeated, name))
        figures[f"{name}_s"] = _fastest(lambda demand=demand: nearest(demand, pairs))  # type: ignore[misc]
    return figures | {"distances": float(len(pairs))}


def _fastest(work: Callable[[], object]) -> float:
    """S of the fastest of ``TRIALS``."""
    found = []
    for _ in range(TRIALS):
        began = time.process_time()
        work()
        found.append(time.process_time() - began)
    return min(found)


if __name__ == "__main__":
    report(measure())
