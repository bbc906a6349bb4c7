"""The two-link underwater arm of M. Abderrahim, "Modelling of Robotic Manipulators", PhD thesis, Glasgow, chapter 7.

    python -m examples.underwater [--out DIR]

Free: 1 N m on joint 1 from 0 to 1 s and on joint 2 from 5 to 6 s; in air, with drag only, with added mass only, with
both. The water is in the model file (config/models/underwater.toml), and all runs are the compiled engine's.
Controlled: the arm folds and turns, with computed torque that knows nothing of the water, with the same and disturbance
decoupling, and with computed torque that has the water in its model; once with drives strong enough for it, once with
drives that are not: there the demand is slowed as well.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from arm_io.types import Array
from arm_model.control.computed_torque import ComputedTorque, Reference
from arm_model.control.momentum_observer import MomentumObserver
from arm_model.control.time_scaling import TimeScaling
from arm_model.control.torque_control import Run, TorqueController, controlled
from arm_model.description import Arm, Joint
from arm_model.model_file import read_model
from arm_model.motion import Motion
from arm_model.simulation.simulation import simulate

MODEL = Path(__file__).resolve().parent.parent / "config/models/underwater.toml"
LENGTHS = (1.0, 1.0)  # m
STEP = 0.02  # s between two calls of a controller
STRONG, WEAK = (20.0, 6.0), (12.0, 4.0)  # N m
TARGET, MOVE = np.array([1.2, -1.0]), 4.0  # rad, s
DURATION = 6.0  # s
FREQUENCY, BANDWIDTH = 4.0, 15.0  # rad/s of the error, 1/s of the observer


def around(arm: Arm, *, drag: bool, added_mass: bool) -> Arm:
    """The arm with only these forces of the water."""

    def kept(joint: Joint) -> Joint:
        assert joint.cylinder is not None
        cylinder = replace(
            joint.cylinder,
            drag_coefficient=joint.cylinder.drag_coefficient * drag,
            added_mass_coefficient=joint.cylinder.added_mass_coefficient * added_mass,
        )
        return replace(joint, cylinder=cylinder)

    return replace(arm, joints=tuple(kept(joint) for joint in arm.joints))


def free(arm: Arm) -> dict[str, Motion]:
    """The pushed arm, 10 s, by what surrounds it."""
    arms = {
        "in air": around(arm, drag=False, added_mass=False),
        "drag only": around(arm, drag=True, added_mass=False),
        "added mass only": around(arm, drag=False, added_mass=True),
        "drag and added mass": arm,
    }
    return {name: simulate(one, push, duration=10.0, rate=50.0, start=np.zeros(2)) for name, one in arms.items()}


def push(t: Array) -> Array:
    """(k, 2) N m; the drives of this arm have no gear and 1 N m/A."""
    return np.column_stack([t < 1.0 - 1e-9, (t >= 5.0 - 1e-9) & (t < 6.0 - 1e-9)]).astype(float)


def demand(t: float) -> Reference:
    """From rest to TARGET in MOVE s, with continuous acceleration, and staying there."""
    s = min(t / MOVE, 1.0)
    return Reference(
        TARGET * (10 * s**3 - 15 * s**4 + 6 * s**5),
        TARGET * (30 * s**2 - 60 * s**3 + 30 * s**4) / MOVE,
        TARGET * (60 * s - 180 * s**2 + 120 * s**3) / MOVE**2,
    )


def under_control(arm: Arm, limits: tuple[float, float]) -> dict[str, Run]:
    """The arm in water, DURATION s, by its controller; all have the same limits (N m), gains and sampling."""
    limited = replace(arm, joints=tuple(replace(joint, torque_limit=limit) for joint, limit in zip(arm.joints, limits)))
    dry = ComputedTorque(around(limited, drag=False, added_mass=False), FREQUENCY)
    controllers: dict[str, TorqueController] = {
        "computed torque, dry model": dry,
        "with momentum observer": MomentumObserver(dry, bandwidth=BANDWIDTH, period=STEP),
        "computed torque, wet model": ComputedTorque(limited, FREQUENCY),
    }
    runs = {
        name: controlled(limited, controller, demand, duration=DURATION, period=STEP)
        for name, controller in controllers.items()
    }
    decoupled = MomentumObserver(dry, bandwidth=BANDWIDTH, period=STEP)
    slowed = TimeScaling(decoupled, demand, np.array(limits), period=STEP)
    run = controlled(limited, slowed, demand, duration=DURATION, period=STEP)
    # it is judged by the demand at the pace that the limits left it
    runs["momentum observer and time scaling"] = replace(run, demand=np.array(slowed.reference))
    return runs


def draw_free(runs: dict[str, Motion], path: Path) -> None:
    """Angles, rates, and where the flow across link 2 turns round."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(3, 2, figsize=(11, 8), sharex=True, layout="constrained")
    for name, run in runs.items():
        for j in range(2):
            axes[0, j].plot(run.t, np.degrees(run.q[:, j]), label=name)
            axes[1, j].plot(run.t, run.qd[:, j])
        with np.errstate(divide="ignore", invalid="ignore"):  # q1' l1 cos q2 + (q1' + q2') l = 0 there
            place = -run.qd[:, 0] * LENGTHS[0] * np.cos(run.q[:, 1]) / (run.qd[:, 0] + run.qd[:, 1])
        axes[2, 1].plot(run.t, np.where((place > 0) & (place < LENGTHS[1]), place, np.nan))
    push_shown = next(iter(runs.values()))
    for j in range(2):
        axes[0, j].set(title=f"joint {j + 1}", ylabel="angle, deg")
        axes[1, j].set(ylabel="rate, rad/s")
        axes[2, 0].plot(push_shown.t, push_shown.torque[:, j], label=f"joint {j + 1}", drawstyle="steps-post")
    axes[2, 0].set(ylabel="torque, N m", xlabel="t, s")
    axes[2, 1].set(ylabel="flow across link 2 turns\nat, m from joint 2", xlabel="t, s", ylim=(0, LENGTHS[1]))
    axes[0, 0].legend()
    axes[2, 0].legend()
    _save(figure, axes, path)


def draw_controlled(runs: dict[str, Run], limits: tuple[float, float], path: Path) -> None:
    """Angles and what was demanded, errors, and torques with their limits."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(3, 2, figsize=(11, 8), sharex=True, layout="constrained")
    wanted = next(iter(runs.values()))
    for j in range(2):
        axes[0, j].plot(wanted.t, np.degrees(wanted.demand[:, j]), "k--", label="demanded", zorder=3)
        for number, (name, run) in enumerate(runs.items()):
            # the later ones are thinner: where two agree, both are seen
            width = 2.8 - 0.6 * number
            axes[0, j].plot(run.t, np.degrees(run.q[:, j]), label=name, lw=width)
            axes[1, j].plot(run.t, np.degrees(run.demand[:, j] - run.q[:, j]), lw=width)
            axes[2, j].plot(run.t, run.torque[:, j], drawstyle="steps-post", lw=width)
        for side in (-1, 1):
            axes[2, j].axhline(side * limits[j], color="grey", linestyle=":")
        axes[0, j].set(title=f"joint {j + 1}", ylabel="angle, deg")
        axes[1, j].set(ylabel="demanded less reached, deg")
        axes[2, j].set(ylabel="torque and limits, N m", xlabel="t, s")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=5, fontsize="small")
    _save(figure, axes, path)


def _save(figure: Any, axes: Any, path: Path) -> None:
    for one in axes.flat:
        one.grid(alpha=0.3)
    figure.savefig(path, dpi=110)


def free_figures(runs: dict[str, Motion]) -> dict[str, list[float]]:
    """Angles at the end, degrees."""
    return {name: np.degrees(run.q[-1]).round(2).tolist() for name, run in runs.items()}


def control_figures(runs: dict[str, Run]) -> dict[str, dict[str, list[float]]]:
    """Demanded less reached by joint: root mean square, largest and last, degrees."""
    errors = {name: np.abs(np.degrees(run.demand - run.q)) for name, run in runs.items()}
    return {
        "rms_deg": {name: np.sqrt((error**2).mean(axis=0)).round(3).tolist() for name, error in errors.items()},
        "largest_deg": {name: error.max(axis=0).round(3).tolist() for name, error in errors.items()},
        "last_deg": {name: error[-1].round(4).tolist() for name, error in errors.items()},
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("underwater"), help="folder for the pictures")
    out: Path = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    import matplotlib

    matplotlib.use("agg")
    arm = read_model(MODEL)
    loose, strong, weak = free(arm), under_control(arm, STRONG), under_control(arm, WEAK)
    draw_free(loose, out / "free.png")
    draw_controlled(strong, STRONG, out / "controlled.png")
    draw_controlled(weak, WEAK, out / "limited.png")
    results = {
        "free_end_deg": free_figures(loose),
        "controlled": control_figures(strong),
        "limited": control_figures(weak),
    }
    print(json.dumps(results, indent=2))
    print(*(out / f"{name}.png" for name in ("free", "controlled", "limited")))


if __name__ == "__main__":
    main()
