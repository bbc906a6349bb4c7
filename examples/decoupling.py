"""The disturbance-decoupling controller of M. Abderrahim's thesis (sections 7.5 and 7.6) on its underwater arm.

    python -m examples.decoupling [--out DIR]

Both joints get a step of their reference at once, each smoothed by its own tracking model. The arm is the model file's
(config/models/underwater.toml): masses 2 kg, lengths 1 m, water. Drawn: positions and torques with the first limits
(figures 7.12, 7.13), torques with the tighter limits (7.14, 7.15), angles with and without them (7.16, 7.17). Tabled:
the same paths under computed torque and under the momentum observer, and all of them in water that has 30 % more or
less drag and added mass than the models say. The size of the step is ours; the thesis's is not known.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from arm_io.types import Array
from arm_model.control.compensator import Compensator
from arm_model.control.computed_torque import ComputedTorque, Reference
from arm_model.control.decoupling import DecouplingLoop, DisturbanceDecoupling
from arm_model.control.linear_model import second_order
from arm_model.control.momentum_observer import MomentumObserver
from arm_model.control.torque_control import Run, TorqueController, controlled
from arm_model.description import Arm, Joint
from arm_model.model_file import read_model
from arm_model.rigid_body.hydrodynamics import dry

MODEL = Path(__file__).resolve().parent.parent / "config/models/underwater.toml"
PERIOD, SLOW_PERIOD = 0.002, 0.02  # s between two calls: of the decoupling loops, of the controllers with a model
DURATION = 15.0  # s
STEP = np.radians([45.0, 22.5])
FIRST, TIGHT, NONE = (10.0, 20.0), (4.0, 10.0), (1e3, 1e3)  # N m
TRACKING = (second_order(0.25, 1.0), second_order(1.0, 2.0))
FREQUENCY, BANDWIDTH = 5.0, 15.0  # rad/s, 1/s: of computed torque and of the momentum observer


def loops() -> tuple[DecouplingLoop, DecouplingLoop]:
    """The thesis's values; p(s) = (s + 5)^2 and (s + 6)^2, as fast as the regulation filters."""
    first = Compensator({"x": "v", "v": "-4*v - v^3 + 0.02*u"}, output="x")
    second = Compensator({"x": "v", "v": "-v - v^3 + 0.02*u"}, output="x")
    return (
        DecouplingLoop(TRACKING[0], first, second_order(25.0, 10.0), gains=(25.0, 10.0)),
        DecouplingLoop(TRACKING[1], second, second_order(36.0, 12.0), gains=(36.0, 12.0)),
    )


def step(t: float) -> Reference:
    """What the decoupling controller gets."""
    return Reference(STEP, np.zeros(2), np.zeros(2))


def smooth(t: float | Array) -> Reference:
    """The step's path through the tracking models, both critically damped, with its derivatives."""
    w = np.sqrt([model.b[1] for model in TRACKING])
    wt = np.multiply.outer(t, w)
    decay = np.exp(-wt)
    return Reference(STEP * (1 - (1 + wt) * decay), STEP * w * wt * decay, STEP * w**2 * (1 - wt) * decay)


def in_water(arm: Arm, share: float) -> Arm:
    """The arm with drag and added mass ``share`` times the model's."""

    def changed(joint: Joint) -> Joint:
        assert joint.cylinder is not None
        drag, mass = joint.cylinder.drag_coefficient, joint.cylinder.added_mass_coefficient
        return replace(
            joint, cylinder=replace(joint.cylinder, drag_coefficient=share * drag, added_mass_coefficient=share * mass)
        )

    return replace(arm, joints=tuple(changed(joint) for joint in arm.joints))


def run(arm: Arm, name: str, limits: tuple[float, float], *, water: float = 1.0) -> Run:
    """One controller by ``name``; its model is ``arm``, the arm that moves is in ``water`` times that water."""
    limited = replace(arm, joints=tuple(replace(joint, torque_limit=limit) for joint, limit in zip(arm.joints, limits)))
    ideal = DisturbanceDecoupling(loops(), period=PERIOD, start=np.zeros(2))
    dry_torque = ComputedTorque(dry(limited), FREQUENCY)
    controller: TorqueController = {
        "decoupling": ideal,
        "computed torque, dry model": dry_torque,
        "momentum observer, dry model": MomentumObserver(dry_torque, bandwidth=BANDWIDTH, period=SLOW_PERIOD),
        "computed torque, model with water": ComputedTorque(limited, FREQUENCY),
    }[name]
    demand, period = (step, PERIOD) if controller is ideal else (smooth, SLOW_PERIOD)
    moving = in_water(limited, water)
    done = controlled(moving, controller, demand, duration=DURATION, period=period, start=np.zeros(2))
    return replace(done, demand=smooth(done.t).q)


NAMES = (
    "decoupling",
    "computed torque, dry model",
    "momentum observer, dry model",
    "computed torque, model with water",
)


def figures(done: Run) -> dict[str, list[float]]:
    """Tracking error (rms, largest, last) in degrees and largest torque in N m, per joint."""
    error = np.abs(np.degrees(done.demand - done.q))
    return {
        "rms_deg": np.sqrt((error**2).mean(axis=0)).round(3).tolist(),
        "largest_deg": error.max(axis=0).round(3).tolist(),
        "last_deg": error[-1].round(4).tolist(),
        "torque_Nm": np.abs(done.torque).max(axis=0).round(2).tolist(),
    }


def draw_tracking(done: Run, path: Path) -> None:
    """Figures 7.12 and 7.13: tracking model's and arm's angles, and the torques."""
    figure, axes = _axes()
    for j in range(2):
        axes[0, j].plot(done.t, np.degrees(done.demand[:, j]), "k--", label="tracking model", zorder=3)
        axes[0, j].plot(done.t, np.degrees(done.q[:, j]), label="arm")
        axes[0, j].set(title=f"joint {j + 1}", ylabel="angle, deg")
        axes[1, j].plot(done.t, done.torque[:, j], label=f"limit {FIRST[j]:g} N m")
        axes[1, j].set(ylabel="torque, N m")
    _save(figure, axes, path)


def draw_limits(free: Run, tight: Run, path: Path) -> None:
    """Figures 7.14 to 7.17: torques and angles with and without the tighter limits."""
    figure, axes = _axes()
    for j in range(2):
        for done, name in ((free, "without limit"), (tight, f"limit {TIGHT[j]:g} N m")):
            axes[0, j].plot(done.t, np.degrees(done.q[:, j]), label=name)
            axes[1, j].plot(done.t, done.torque[:, j], label=name)
        axes[0, j].set(title=f"joint {j + 1}", ylabel="angle, deg")
        axes[1, j].set(ylabel="torque, N m")
    _save(figure, axes, path)


def _axes() -> tuple[Any, Any]:
    import matplotlib.pyplot as plt

    return plt.subplots(2, 2, figsize=(11, 6), sharex=True, layout="constrained")


def _save(figure: Any, axes: Any, path: Path) -> None:
    for one in axes.flat:
        one.grid(alpha=0.3)
        one.legend()
    for one in axes[-1]:
        one.set_xlabel("t, s")
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("decoupling"), help="folder for the pictures")
    out: Path = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    import matplotlib

    matplotlib.use("agg")
    arm = read_model(MODEL)
    first, free, tight = (run(arm, "decoupling", limits) for limits in (FIRST, NONE, TIGHT))
    draw_tracking(first, out / "tracking.png")
    draw_limits(free, tight, out / "limits.png")
    apart = np.abs(np.degrees(free.q - tight.q))
    results = {
        "first_limits": {name: figures(run(arm, name, FIRST)) for name in NAMES},
        "tighter_limits": {name: figures(run(arm, name, TIGHT)) for name in NAMES},
        "angles_apart_by_the_tighter_limits_deg": {
            "largest": apart.max(axis=0).round(3).tolist(),
            "last": apart[-1].round(5).tolist(),
        },
        "water_off_by": {
            f"{share - 1:+.0%}": {name: figures(run(arm, name, FIRST, water=share))["rms_deg"] for name in NAMES}
            for share in (0.7, 1.3)
        },
    }
    print(json.dumps(results, indent=2))
    print(*(out / f"{name}.png" for name in ("tracking", "limits")))


if __name__ == "__main__":
    main()
