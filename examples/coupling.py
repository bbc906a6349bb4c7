"""One joint at a time, the others not blocked: the result that M.

Abderrahim's thesis (section 5.3, table 5.2) had to reject, and why.

    python -m examples.coupling [--out DIR]

A Puma is simulated in closed loop: joints 1 to 3 each on its own, the others held by their servos; and all together.
The motor-link pair of every joint is fitted to both; the second gives wrong inertia and friction, negative friction
among it. The diagnosis takes the torque of the other links, by the model, out of the torque first: it is what the pair
could not explain, and without it the values return. The whole arm identified from the same run needs none of that.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from arm_model.description import Arm
from arm_model.model_file import read_model
from arm_model.parameters import parameter
from armscope.commands.simulate import command as simulate
from daq.recording import Recording, open_recording
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table
from experiment import Experiment, write_experiment
from identification.methods.coupling import Coupling, coupling_at
from identification.methods.inverse_dynamics import identify
from identification.regression.problem import motion_of

MODEL = Path(__file__).resolve().parent.parent / "config/models/puma560.toml"
START = [0.0, -0.4, -0.9, 0.0, 0.5, 0.0]
FULL = {"full_speed": [1.43, 1.29, 2.13, 3.98, 4.21, 3.98], "full_acceleration": [6.0, 5.0, 8.0, 15.0, 15.0, 15.0]}
JOINTS = (1, 2, 3)
NOISE = 0.01  # A
NAMES = ("inertia", "viscous", "coulomb_positive", "coulomb_negative")


def alone(joint: int) -> Experiment:
    """One joint there and back at three speeds, the others at rest."""
    segments: list[dict[str, Any]] = [{"type": "hold", "duration": 0.5}]
    for speed in (0.3, 0.6, 1.0):
        segments += [{"type": "drive", "joint": joint, "by": by, "speed": speed} for by in (0.8, -1.2, 0.4)]
    return Experiment.model_validate({"name": f"joint {joint} alone", "start": START, **FULL, "segment": segments})


def together(seed: int) -> Experiment:
    """All joints at once, in a finite Fourier series."""
    rng = np.random.default_rng(seed)
    shape = rng.normal(size=(2, 6, 3)) / np.arange(1, 4)
    shape *= (np.array([0.7, 0.5, 0.7, 0.8, 0.6, 0.8]) / np.abs(shape).sum(axis=(0, 2)))[:, None]
    segment = {"type": "fourier", "duration": 12.0, "fundamental": 0.17, "fade": 1.0}
    table = {"name": f"all joints {seed}", "start": START, **FULL}
    moving = {**segment, "sine": shape[0].tolist(), "cosine": shape[1].tolist()}
    return Experiment.model_validate({**table, "segment": [{"type": "hold", "duration": 0.5}, moving]})


def recorded(arm: Arm, experiment: Experiment, folder: Path) -> Recording:
    """The model's closed loop on an experiment, through a file.

    Angles in steps of the encoders, currents with a Hall transducer's noise.
    """
    name = experiment.name.replace(" ", "_")
    write_experiment(folder / f"{name}.toml", experiment)
    simulate(model=MODEL, experiment=folder / f"{name}.toml", out=folder / f"{name}.mcap")
    exact = open_recording(folder / f"{name}.mcap")
    step = np.array([2 * np.pi / (4 * (joint.encoder_lines or 250) * joint.ratio) for joint in arm.joints])
    noisy = exact.i + np.random.default_rng(0).normal(0.0, NOISE, exact.i.shape)
    measured = folder / f"{name}_measured.mcap"
    write_table(measured, exact.t, {"q": np.round(exact.q / step) * step, "i": noisy}, Attachments())
    return open_recording(measured)


def true_value(arm: Arm, joint: int, name: str) -> float:
    """N m, N m s/rad of the model; the inertia that a joint moves depends on the pose: NaN."""
    return float("nan") if name == "inertia" else parameter(arm, f"joint{joint}.{name}")


def main(out: Path) -> dict[str, Any]:
    """Runs, fits and prints; returns the figures."""
    arm = read_model(MODEL)
    held = {j: coupling_at(arm, motion_of(recorded(arm, alone(j), out), arm)[0], j, gravity=j > 1) for j in JOINTS}
    runs = [recorded(arm, together(seed), out) for seed in (1, 2)]
    moving = {j: coupling_at(arm, motion_of(runs[0], arm)[0], j, gravity=j > 1) for j in JOINTS}
    whole = identify(runs, arm, friction="asymmetric")
    figures = {f"joint{j}": _of_joint(arm, j, held[j], moving[j], whole.arm) for j in JOINTS}
    _print(figures)
    for j in JOINTS:
        print(moving[j].sentence())
    (out / "coupling.json").write_text(json.dumps(figures, indent=2) + "\n")
    return figures


def _of_joint(arm: Arm, joint: int, held: Coupling, moving: Coupling, identified: Arm) -> dict[str, Any]:
    table = {
        name: {
            "true": true_value(arm, joint, name),
            "others at rest": held.as_fitted.value(name),
            "others moving": moving.as_fitted.value(name),
            "coupling taken out": moving.without.value(name),
            "whole arm": true_value(identified, joint, name),
        }
        for name in NAMES
    }
    return {"values": table, "coupling_share": moving.share, "coupling_rms_by_joint": moving.by_joint}


def _print(figures: dict[str, Any]) -> None:
    columns = ("true", "others at rest", "others moving", "coupling taken out", "whole arm")
    print(f"{'':26}" + "".join(f"{name:>20}" for name in columns))
    for joint, found in figures.items():
        for name, row in found["values"].items():
            print(f"{joint + '.' + name:26}" + "".join(f"{row[column]:20.3f}" for column in columns))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="folder for the recordings and coupling.json; default: none is kept")
    chosen = parser.parse_args().out
    if chosen is None:
        with tempfile.TemporaryDirectory() as temporary:
            main(Path(temporary))
    else:
        chosen.mkdir(parents=True, exist_ok=True)
        main(chosen)
