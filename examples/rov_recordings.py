"""Recordings of an arm on a small ROV in a test tank, simulated with the errors of their instruments.

    python -m examples.rov_recordings [--out DIR] [--change NAME=VALUE ...]

Thrusters are driven by sums of sines on top of station keeping, while the arm moves: two runs of 90 s, fit.mcap and
held_out.mcap, 50 rows/s. Instruments: pose by a tracker and a compass (2 mm, 0.1 degrees), velocity by a Doppler log
(3 mm/s), rates by gyroscopes (0.1 degrees/s), encoders and currents as the model has them. ``--change`` alters the ROV
behind the model's back: thruster3.gain=0.6, base.linear_drag_surge=30, arm.payload=0.5 (kg at the tool).

    armscope identify rov/fit.mcap --held-out rov/held_out.mcap --model config/models/rov_arm.toml --out rov/base
    armscope diagnose --fit rov/fit.mcap --held-out rov/held_out.mcap --model config/models/rov_arm.toml --out rov/why
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model import Arm, Motion, read_model, with_parameters, write_model
from arm_model.sensing import recorded
from arm_model.simulation import simulate
from daq.recording import Attachments, write_table
from daq.recording.provenance import provenance

MODEL = Path(__file__).resolve().parent.parent / "config/models/rov_arm.toml"
RATE, DURATION = 50.0, 90.0  # rows/s, s
THRUST = 6.0  # N of each thruster's sines together
PAYLOAD = "arm.payload"
POSITION, ATTITUDE, VELOCITY, SPIN = 2e-3, np.radians(0.1), 3e-3, np.radians(0.1)  # m, rad, m/s, rad/s


def changed(arm: Arm, changes: Mapping[str, float]) -> Arm:
    """The arm and its base with other parameters; ``arm.payload`` kg at the origin of the last link's frame."""
    arm = with_parameters(arm, {name: value for name, value in changes.items() if name != PAYLOAD})
    if PAYLOAD not in changes:
        return arm
    return arm.with_effect("payload", mass=changes[PAYLOAD], x=0.0, y=0.0, z=0.0)


def excitation(arm: Arm, seed: int) -> Array:
    """(ticks, n + thrusters): demands of the joints, rad, and of the thrusters, N, at the servos' ticks."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, DURATION + 1.0, arm.servo_period)
    fade = np.clip(t / 5.0, 0.0, 1.0)

    def sines(count: int, amplitude: float, low: float, high: float) -> Array:
        waves = [(rng.uniform(low, high), rng.uniform(0, 2 * np.pi)) for _ in range(count)]
        return fade * amplitude * sum(np.sin(2 * np.pi * f * t + p) for f, p in waves) / np.sqrt(count)

    joints = [sines(3, 0.6, 0.05, 0.2) for _ in range(len(arm))]
    thrusters = [sines(4, THRUST, 0.02, 0.3) for _ in range(arm.thrusters)]
    return np.column_stack([*joints, *thrusters])


def move(arm: Arm, seed: int) -> Motion:
    """One run, simulated."""
    demands = excitation(arm, seed)

    def demand(t: Array) -> Array:
        return demands[np.clip(np.rint(t / arm.servo_period).astype(int), 0, len(demands) - 1)]

    return simulate(arm, demand, duration=DURATION, rate=RATE)


def write(path: Path, arm: Arm, motion: Motion, model: str, seed: int) -> None:
    """A recording of the run, through its instruments."""
    assert motion.base is not None
    rng = np.random.default_rng(seed + 100)
    rows = len(motion.t)
    half = rng.normal(0, ATTITUDE / 2, (rows, 3))
    w, v = motion.base.attitude[:, :1], motion.base.attitude[:, 1:]
    turned = np.concatenate([w - (v * half).sum(axis=1, keepdims=True), v + w * half + np.cross(v, half)], axis=1)
    noise = rng.normal(size=(rows, 6)) * np.repeat([VELOCITY, SPIN], 3)
    seen = replace(
        motion.base,
        position=motion.base.position + rng.normal(0, POSITION, (rows, 3)),
        attitude=turned / np.linalg.norm(turned, axis=1, keepdims=True),
        velocity=motion.base.velocity + noise,
    )
    readings = recorded(arm, motion)
    signals = {"q": readings.q, "i": readings.current, "qref": motion.demand}
    attachments = Attachments(model=model, provenance=provenance("simulated", source={"seed": seed}))
    write_table(path, motion.t, signals, attachments, extra=seen.columns())


def recordings(out: Path, changes: Mapping[str, float]) -> list[Path]:
    """fit.mcap and held_out.mcap of a ROV that differs from its model by ``changes``."""
    out.mkdir(parents=True, exist_ok=True)
    arm = read_model(MODEL)
    real = changed(arm, changes)
    paths = [out / "fit.mcap", out / "held_out.mcap"]
    for seed, path in enumerate(paths, 1):
        write(path, real, move(real, seed), MODEL.read_text(encoding="utf-8"), seed)
    write_model(out / "truth.toml", real)
    return paths


def changes_of(texts: list[str]) -> dict[str, float]:
    """NAME=VALUE, each."""
    found = {}
    for text in texts:
        name, _, value = text.partition("=")
        try:
            found[name] = float(value)
        except ValueError:
            raise InputError("--change", f"is {text!r}; expected NAME=VALUE, as thruster3.gain=0.6") from None
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("rov"), help="folder for the recordings")
    parser.add_argument("--change", action="append", default=[], metavar="NAME=VALUE", help="may be repeated")
    given = parser.parse_args()
    print(*recordings(given.out, changes_of(given.change)))


if __name__ == "__main__":
    main()
