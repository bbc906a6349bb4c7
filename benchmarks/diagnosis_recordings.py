"""Makes the recordings that ``benchmarks.diagnosis`` measures with: an arm of any number of joints, with causes hidden.

``python -m benchmarks.diagnosis_recordings FOLDER MINUTES JOINTS CAUSES`` writes FOLDER/model.toml (the model, without
the causes), fit_*.mcap (two thirds of the minutes) and held_out_*.mcap.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from arm_io.types import Array
from arm_model import Arm, EffectTerm, read_model, write_model
from arm_model.sensing import recorded
from arm_model.simulation.simulation import simulate_at
from daq.recording.parts import Attachments
from daq.recording.tables.table import write_table

MODEL = Path(__file__).resolve().parent.parent / "config/models/puma560.toml"
RATE = 28.382 / 0.028
"""Rows/s: no simple ratio to the setpoints' 28 ms."""
LONGEST, FITTED = 10.0, 2 / 3
"""Minutes of one recording; share of the minutes that is fitted."""
NOISE = 0.01
"""A, one standard deviation."""
SWING = 0.35
"""Share of a joint's range that its motion covers to each side, where the speed allows it."""
LINES = 4
"""Sines in the motion of one joint."""
CAUSES = (
    EffectTerm("coulomb_friction", 2, {"coulomb": 8.0}),
    EffectTerm("current_offset", 1, {"offset": 0.15}),
    EffectTerm("viscous_friction", 1, {"viscous": 3.0}),
)
"""Well above the noise, at joints that every arm has."""


def main() -> None:
    """Writes the model and its recordings."""
    folder, minutes = Path(sys.argv[1]), float(sys.argv[2])
    joints, causes = int(sys.argv[3]), int(sys.argv[4])
    arm = chain(joints)
    write_model(folder / "model.toml", arm)
    worn = replace(arm, effects=(*arm.effects, *CAUSES[:causes]))
    random = np.random.default_rng(1)
    for part, share in (("fit", FITTED), ("held_out", 1 - FITTED)):
        count = math.ceil(share * minutes / LONGEST)
        for number in range(count):
            write(worn, folder / f"{part}_{number}.mcap", 60 * share * minutes / count, random)


def chain(joints: int) -> Arm:
    """The Puma without its last joints, or with more like its fifth; no coupling."""
    puma = read_model(MODEL)
    assert puma.controller is not None and puma.controller.natural_frequency and puma.controller.inertia_pose
    place = [k if k < 6 else 4 for k in range(joints)]
    control = replace(
        puma.controller,
        natural_frequency=tuple(puma.controller.natural_frequency[k] for k in place),
        inertia_pose=tuple(puma.controller.inertia_pose[k] for k in place),
    )
    return replace(puma, joints=tuple(puma.joints[k] for k in place), controller=control, coupling=())


def write(arm: Arm, path: Path, seconds: float, random: np.random.Generator) -> None:
    """One recording of the arm on a motion of its own."""
    times = np.arange(int(seconds * RATE)) / RATE
    motion = simulate_at(arm, demand(arm, random), times)
    shown = recorded(arm, motion)
    step = np.array([2 * np.pi / (4 * (joint.encoder_lines or 250) * joint.ratio) for joint in arm.joints])
    q = np.round(shown.q / np.abs(step)) * np.abs(step)
    current = shown.current + NOISE * random.standard_normal(shown.current.shape)
    write_table(path, motion.t, {"q": q, "i": current, "qref": motion.demand}, Attachments())


def demand(arm: Arm, random: np.random.Generator) -> Callable[[Array], Array]:
    """Sines of 0.05 to 0.5 Hz per joint round the middle of its range, at most half its speed."""
    frequency = random.uniform(0.05, 0.5, (len(arm), LINES))
    phase = random.uniform(0, 2 * np.pi, (len(arm), LINES))
    low, high = np.array([joint.limits or (-1.0, 1.0) for joint in arm.joints]).T
    speed = np.array([0.5 * (joint.motor_speed_limit or 100.0) / abs(joint.ratio) for joint in arm.joints])
    slope = 2 * np.pi * frequency.max(axis=1)
    size = np.minimum(SWING * (high - low), speed / slope) / LINES
    middle = (low + high) / 2

    def positions(at: Array) -> Array:
        turns = 2 * np.pi * frequency * at[:, None, None] + phase
        return middle + size * np.sum(np.sin(turns) - np.sin(phase), axis=-1) / 2

    return positions


if __name__ == "__main__":
    main()
