"""How far an arm throws the vehicle that carries it, and how much station keeping and feed-forward save.

    python -m examples.rov [--out DIR]

The two-link arm on a small ROV (config/models/rov_arm.toml) swings through config/experiments/arms/rov_swing.toml: with
idle thrusters, with station keeping, and with station keeping that adds the wrench which the arm's demanded motion
takes, whole or 30 % too small. Then all that at three times the pace, where the arm does not follow its demand.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.model_file import read_model
from arm_model.motion import Motion
from arm_model.moving_base import rotations
from arm_model.rigid_body.kinematics import forward
from arm_model.simulation.simulation import simulate
from experiment import Experiment, demand_of, read_experiment

CONFIG = Path(__file__).resolve().parent.parent / "config"
RATE = 100.0  # rows/s
FAST = 3.0


def with_station(arm: Arm, feedforward: float | None) -> Arm:
    """The arm whose base keeps its station with this share of feed-forward; None: with idle thrusters."""
    assert arm.floating is not None
    assert arm.floating.controller is not None
    station = None if feedforward is None else replace(arm.floating.controller, feedforward=feedforward)
    return replace(arm, floating=replace(arm.floating, controller=station))


def paced(asked: Experiment, pace: float) -> Experiment:
    """The experiment with ``pace`` times the speed and its square times the acceleration."""
    return asked.model_copy(
        update={
            "full_speed": [pace * one for one in asked.full_speed],
            "full_acceleration": [pace**2 * one for one in asked.full_acceleration],
        }
    )


def run(arm: Arm, asked: Experiment) -> Motion:
    """The experiment, simulated."""
    demand = demand_of(asked)
    return simulate(arm, demand, duration=demand.duration, rate=RATE)


def runs(arm: Arm, asked: Experiment) -> dict[str, Motion]:
    """By what the thrusters do."""
    kinds = {"idle thrusters": None, "station keeping": 0.0, "feed-forward 70 %": 0.7, "feed-forward": 1.0}
    return {name: run(with_station(arm, share), asked) for name, share in kinds.items()}


def tool_error(arm: Arm, motion: Motion) -> Array:
    """(R,) m between the tool and where the same joint angles put it on a base that stands at its first pose."""
    assert motion.base is not None
    turn, tool = rotations(motion.base.attitude), forward(arm, motion.q)[:, :3, 3]
    moved = motion.base.position + np.einsum("rij,rj->ri", turn, tool)
    still = motion.base.position[0] + tool @ turn[0].T
    return np.asarray(np.linalg.norm(moved - still, axis=1))


def turned(motion: Motion) -> Array:
    """(R,) rad by which the base has turned from its first attitude."""
    assert motion.base is not None
    first, now = rotations(motion.base.attitude[:1])[0], rotations(motion.base.attitude)
    trace = np.einsum("ij,rij->r", first, now)
    return np.asarray(np.arccos(np.clip((trace - 1) / 2, -1.0, 1.0)))


def figures(arm: Arm, motion: Motion) -> dict[str, float]:
    """Largest and rms throw of the base (mm, degrees), tool error (mm), and largest demanded thrust (N)."""
    assert motion.base is not None
    thrown = 1e3 * np.linalg.norm(motion.base.position - motion.base.position[0], axis=1)
    angle, tool = np.degrees(turned(motion)), 1e3 * tool_error(arm, motion)
    found = {
        "base_largest_mm": thrown.max(),
        "base_rms_mm": np.sqrt((thrown**2).mean()),
        "turn_largest_deg": angle.max(),
        "tool_largest_mm": tool.max(),
        "tool_rms_mm": np.sqrt((tool**2).mean()),
        "thrust_largest_N": np.abs(motion.base.demand).max(initial=0.0),
    }
    return {name: round(float(value), 2) for name, value in found.items()}


def draw(arm: Arm, done: dict[str, Motion], path: Path) -> None:
    """Throw of base and tool, and the thrust of the thruster that works hardest."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 2, figsize=(11, 6.5), sharex=True, layout="constrained")
    for name, motion in done.items():
        base = motion.base
        assert base is not None
        thrown = np.linalg.norm(base.position - base.position[0], axis=1)
        axes[0, 0].plot(motion.t, 1e3 * thrown, label=name)
        axes[0, 1].plot(motion.t, np.degrees(turned(motion)))
        axes[1, 0].plot(motion.t, 1e3 * tool_error(arm, motion))
        axes[1, 1].plot(motion.t, np.abs(base.demand).max(axis=1))
    labels = ("base moved, mm", "base turned, degrees", "tool off, mm", "largest demand of a thruster, N")
    for axis, label, lowest in zip(axes.flat, labels, (0.1, 0.03, 0.3, None)):
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
        if lowest is not None:  # from 400 mm to 3: on one linear axis, what feed-forward leaves is a line at zero
            axis.set_yscale("log")
            axis.set_ylim(bottom=lowest)
            axis.yaxis.set_major_formatter("{x:g}")
    figure.legend(
        *axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=len(done), fontsize="small"
    )
    for axis in axes[1]:
        axis.set_xlabel("t, s")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("rov"), help="folder for the pictures")
    out: Path = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    import matplotlib

    matplotlib.use("agg")
    arm = read_model(CONFIG / "models/rov_arm.toml")
    asked = read_experiment(CONFIG / "experiments/arms/rov_swing.toml")
    done = {"swing": runs(arm, asked), "fast": runs(arm, paced(asked, FAST))}
    for name, one in done.items():
        draw(arm, one, out / f"{name}.png")
    results = {pace: {name: figures(arm, motion) for name, motion in one.items()} for pace, one in done.items()}
    print(json.dumps(results, indent=2))
    print(*(out / f"{name}.png" for name in done))


if __name__ == "__main__":
    main()
