"""The AA300 of M. Abderrahim, "Modelling of Robotic Manipulators", PhD thesis, Glasgow, chapter 3, driven and animated.

    python -m examples.aa300 [--out DIR]

Its published masses and inertias (config/models/aa300.toml) under proportional-derivative control of each joint,
through hydraulic drives: a lag of 60 ms, and forces that fall to nothing at the speed of the whole flow. A demand
within the flow, the same three times as fast, and the slow one with the weight of the arm fed forward. Writes a
recording of each run with the model in it, a picture, and the animation.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from arm_model.control.computed_torque import Reference
from arm_model.control.hydraulic import HydraulicDrives, Hydraulics
from arm_model.control.proportional_derivative import tuned
from arm_model.control.torque_control import Run, controlled
from arm_model.description import Arm
from arm_model.model_file import read_model
from arm_model.system import inverse_dynamics
from armscope.cli import run as armscope
from daq.recording import Attachments, write_table

MODEL = Path(__file__).resolve().parent.parent / "config/models/aa300.toml"
START, TARGET = np.array([-0.9, 0.2, 0.3, 0.0]), np.array([0.9, 1.3, 0.7, 1.5])  # rad, rad, m, rad
SLOW, FAST = 9.0, 3.0  # s from START to TARGET
DURATION, PERIOD = 12.0, 0.005  # s
LAG = 0.06  # s of valve and oil: indicative
FREQUENCY = np.array([6.0, 6.0, 7.0, 9.0])  # rad/s of the servos: 1 / (2 LAG) is as fast as they can be


def demand(move: float, t: float) -> Reference:
    """From START to TARGET in ``move`` s with continuous acceleration, and staying there."""
    s, way = min(t / move, 1.0), TARGET - START
    return Reference(
        START + way * (10 * s**3 - 15 * s**4 + 6 * s**5),
        way * (30 * s**2 - 60 * s**3 + 30 * s**4) / move,
        way * (60 * s - 180 * s**2 + 120 * s**3) / move**2,
    )


def hydraulics_of(arm: Arm) -> Hydraulics:
    """Stall forces and free speeds are the torque limits and speed limits of the model."""
    speed = arm.joint_array("motor_speed_limit") / np.abs(arm.joint_array("gear"))
    return Hydraulics(arm.joint_array("torque_limit"), speed, LAG)


def driven(arm: Arm, move: float, *, weight: bool) -> Run:
    """The arm follows ``demand``; the drives hold its weight when it begins."""
    still = np.zeros((1, len(arm)))
    holding = inverse_dynamics(arm, START[None], still, still)[0]
    drives = HydraulicDrives(tuned(arm, START, FREQUENCY, weight=weight), hydraulics_of(arm), PERIOD, holding)
    return controlled(arm, drives, lambda t: demand(move, t), duration=DURATION, period=PERIOD, start=START)


def draw(runs: dict[str, Run], arm: Arm, path: Path) -> None:
    """A column per joint: position, demand less position, force, speed with the limits of the drives."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(15, 10), layout="constrained")
    axes = figure.subplots(4, len(arm), sharex=True)
    limits = hydraulics_of(arm)
    for j, joint in enumerate(arm.joints):
        unit, force = ("rad", "N m") if joint.revolute else ("m", "N")
        for number, (name, run) in enumerate(runs.items()):
            style = {"color": f"C{number}", "label": name}
            axes[0, j].plot(run.t, run.demand[:, j], color="0.7", linewidth=3)
            axes[0, j].plot(run.t, run.q[:, j], **style)
            axes[1, j].plot(run.t, run.demand[:, j] - run.q[:, j], **style)
            axes[2, j].plot(run.t, run.torque[:, j], **style)
            axes[3, j].plot(run.t, run.qd[:, j], **style)
        for row, bound in ((2, limits.stall[j]), (3, limits.free[j])):
            for side in (-1, 1):
                axes[row, j].axhline(side * bound, color="grey", linestyle=":")
        axes[0, j].set(title=joint.name, ylabel=f"position, {unit}")
        axes[1, j].set(ylabel=f"demand less position, {unit}")
        axes[2, j].set(ylabel=f"force of the drive, {force}")
        axes[3, j].set(ylabel=f"speed, {unit}/s", xlabel="t, s")
    for one in axes.flat:
        one.grid(alpha=0.3)
    axes[0, 0].legend(fontsize=8)
    figure.savefig(path, dpi=80)


def figures(runs: dict[str, Run]) -> dict[str, dict[str, list[float]]]:
    """Largest and last error of each joint, rad (m), and its highest speed over that of the whole flow."""
    free = hydraulics_of(read_model(MODEL)).free
    return {
        name: {
            "largest": np.abs(run.demand - run.q).max(axis=0).round(4).tolist(),
            "last": np.abs(run.demand - run.q)[-1].round(4).tolist(),
            "speed_over_flow": (np.abs(run.qd).max(axis=0) / free).round(3).tolist(),
        }
        for name, run in runs.items()
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("aa300"), help="folder for recordings and pictures")
    out: Path = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    arm = read_model(MODEL)
    runs = {
        "slow": driven(arm, SLOW, weight=False),
        "fast": driven(arm, FAST, weight=False),
        "slow, weight fed forward": driven(arm, SLOW, weight=True),
    }
    for name, run in zip(("slow", "fast", "weighed"), runs.values()):
        signals = {"q": run.q, "qref": run.demand, "i": run.torque}
        write_table(out / f"{name}.mcap", run.t, signals, Attachments(model=MODEL.read_text(encoding="utf-8")))
    draw(runs, arm, out / "driven.png")
    armscope(["plot", str(out / "fast.mcap"), "--animate", str(out / "fast.gif"), "--fps", "5", "--speed", "2"])
    print(json.dumps(figures(runs), indent=2))


if __name__ == "__main__":
    main()
