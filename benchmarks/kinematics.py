"""Kinematic calibration: noise floor on random arms, time, and pybotics on the same points.

    python -m benchmarks.kinematics [--json] [--pybotics PYTHON] [--arms N]

pybotics pins numpy < 2, so it runs in an environment of its own: PYTHON is that environment's interpreter (made by
``python -m venv E && E/bin/pip install pybotics``); without it its figures are left out. It knows modified D-H only and
minimises distances, so both calibrate the same Puma in modified D-H from the same 100 poses.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.model_file import read_model
from arm_model.rigid_body.kinematics import link_frames
from benchmarks.report import report
from identification.kinematics.data.points import Points
from identification.kinematics.estimation.map_estimation import fit
from identification.kinematics.models.chain import position
from identification.kinematics.models.parameters import Target, Trust, parameters_of

MODEL = Path(__file__).resolve().parent.parent / "config/models/puma560.toml"
TARGET = (0.05, 0.0, 0.10)
NOISE = 1e-4

PYBOTICS = """
import json, sys, time
import numpy as np, scipy.optimize
from pybotics.optimization import OptimizationHandler, optimize_accuracy
from pybotics.robot import Robot
from pybotics.tool import Tool
data = {k: np.array(v) for k, v in json.load(sys.stdin).items()}
robot = Robot.from_parameters(data["mdh"])
robot.tool.position = data["target"]
start = time.perf_counter()
masks = dict(kinematic_chain_mask=True, tool_mask=[True] * 3 + [False] * 3, world_mask=[True] * 6)
handler = OptimizationHandler(robot, **masks)
found = scipy.optimize.least_squares(fun=optimize_accuracy, x0=handler.generate_optimization_vector(),
                                     args=(handler, data["q"], data["xyz"]))
seconds = time.perf_counter() - start
handler.apply_optimization_vector(found.x)
at = np.array([handler.robot.fk(q)[:3, 3] for q in data["unseen"]])
print(json.dumps({"seconds": seconds, "at": at.tolist()}))
"""


def seen(arm: Arm, q: Array, target: Sequence[float] = TARGET) -> Array:
    """(N, 3) where the target is, by arm_model."""
    last = link_frames(arm, q)[:, -1]
    return last[:, :3, :3] @ np.array(target) + last[:, :3, 3]


def wrong(arm: Arm, generator: np.random.Generator, angle: float, length: float) -> Arm:
    """Random errors of every link (rad, m)."""
    joints = []
    for j, joint in enumerate(arm.joints):
        e, f = generator.normal(size=3) * angle, generator.normal(size=2) * length
        beta = e[2] if j == 1 else 0.0
        joints.append(
            replace(joint, theta=e[0], alpha=joint.alpha + e[1], beta=beta, a=joint.a + f[0], d=joint.d + f[1])
        )
    return replace(arm, joints=tuple(joints))


def random_poses(arm: Arm, count: int, generator: np.random.Generator) -> Array:
    low, high = np.array([j.limits for j in arm.joints]).T
    return generator.uniform(low, high, (count, len(arm)))


def rms(off: Array) -> float:
    return float(np.sqrt(np.mean(off**2)))


def noise_floor(arms: int) -> dict[str, float]:
    """How many random arms reach 1.1 sigma sqrt(1 + p / N) on held-out poses, and by how much they improve."""
    nominal, reached, improvement, excess = read_model(MODEL), 0, [], []
    for seed in range(arms):
        generator = np.random.default_rng(seed)
        true = wrong(nominal, generator, 0.02, 0.003)
        q, unseen = random_poses(nominal, 60, generator), random_poses(nominal, 300, generator)
        parameters = parameters_of(nominal, [Target(TARGET)], frame_known=True, trust=Trust())
        found = fit(parameters, Points(q, seen(true, q) + generator.normal(size=(60, 3)) * NOISE))
        measured = seen(true, unseen) + generator.normal(size=(300, 3)) * NOISE
        after = rms(measured - position(parameters.chain.at(found.values), unseen))
        reached += after <= 1.1 * NOISE * np.sqrt(1 + 27 / 180)
        improvement.append(1 - after / rms(measured - seen(nominal, unseen)))
        excess.append(after / (NOISE * np.sqrt(1 + 27 / 180)))
    return {
        "arms": arms,
        "arms_at_noise_floor": int(reached),
        "improvement_percent_median": 100 * float(np.median(improvement)),
        "improvement_percent_worst": 100 * float(np.min(improvement)),
        "held_out_rms_over_floor_median": float(np.median(excess)),
    }


def speed() -> dict[str, float]:
    """A calibration from 1000 poses of 6 joints: best of three."""
    nominal, generator = read_model(MODEL), np.random.default_rng(0)
    true = wrong(nominal, generator, 0.02, 0.003)
    q = random_poses(nominal, 1000, generator)
    points = Points(q, seen(true, q) + generator.normal(size=(1000, 3)) * NOISE)
    seconds = []
    for _ in range(3):
        start = time.perf_counter()
        fit(parameters_of(nominal, [Target(TARGET)], frame_known=True, trust=Trust()), points)
        seconds.append(time.perf_counter() - start)
    return {"seconds_1000_poses": min(seconds)}


def against_pybotics(python: str) -> dict[str, float]:
    """The same 100 points given to both: held-out rms (against the truth, no noise on it) and seconds."""
    nominal, generator = read_model(MODEL), np.random.default_rng(1)
    # In modified D-H: a and alpha move to the next row; the last pair is part of the tool there and zero here.
    standard = nominal.joints
    moved = [
        replace(
            j,
            convention="modified",
            alpha=0.0 if k == 0 else standard[k - 1].alpha,
            a=0.0 if k == 0 else standard[k - 1].a,
        )
        for k, j in enumerate(standard)
    ]
    nominal = replace(nominal, joints=tuple(moved))
    joints = []
    for j in nominal.joints:
        e, f = generator.normal(size=2) * 0.01, generator.normal(size=2) * 0.002
        joints.append(replace(j, theta=e[0], alpha=j.alpha + e[1], a=j.a + f[0], d=j.d + f[1]))
    true = replace(nominal, joints=tuple(joints))
    q, unseen = random_poses(nominal, 100, generator), random_poses(nominal, 500, generator)
    xyz, truth = seen(true, q) + generator.normal(size=(100, 3)) * NOISE, seen(true, unseen)
    start = time.perf_counter()
    parameters = parameters_of(nominal, [Target(TARGET, 0.005)], frame_known=True, trust=Trust())
    found = fit(parameters, Points(q, xyz))
    ours = {
        "seconds": time.perf_counter() - start,
        "rms": rms(position(parameters.chain.at(found.values), unseen) - truth),
    }
    # in mm and rad, as pybotics has it: the lengths then weigh like its angles in the optimiser's trust region
    mdh = np.array([[j.alpha, 1e3 * j.a, j.theta, 1e3 * j.d] for j in nominal.joints])
    data = {"mdh": mdh, "target": 1e3 * np.array(TARGET), "q": q, "xyz": 1e3 * xyz, "unseen": unseen}
    text = json.dumps({name: value.tolist() for name, value in data.items()})
    done = subprocess.run([python, "-c", PYBOTICS], input=text, capture_output=True, text=True, check=True)
    theirs = json.loads(done.stdout)
    their_rms = rms(1e-3 * np.array(theirs["at"]) - truth)
    return {
        "held_out_error_mm": 1e3 * ours["rms"],
        "pybotics_held_out_error_mm": 1e3 * their_rms,
        "held_out_error_vs_pybotics": ours["rms"] / their_rms,
        "seconds_100_poses": ours["seconds"],
        "pybotics_seconds_100_poses": theirs["seconds"],
        "seconds_vs_pybotics": ours["seconds"] / theirs["seconds"],
    }


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--json", action="store_true")
    options.add_argument("--pybotics", metavar="PYTHON")
    options.add_argument("--arms", type=int, default=100)
    given = options.parse_args()
    figures = noise_floor(given.arms) | speed()
    if given.pybotics:
        figures |= against_pybotics(given.pybotics)
    report(figures)


if __name__ == "__main__":
    main()
