"""The motions of a hidden-effect case: seven recordings of about 15 s, four to fit and three held out."""

from __future__ import annotations

import numpy as np

from experiment import Experiment

FULL_SPEED = [1.43, 1.29, 2.13, 3.98, 4.21, 3.98]
FULL_ACCELERATION = [6.0, 5.0, 8.0, 15.0, 15.0, 15.0]
HOME = [0.0, -0.4, -0.9, 0.0, 0.5, 0.0]


def _experiment(name: str, segments: list[dict]) -> Experiment:
    return Experiment.model_validate(
        {
            "name": name,
            "start": HOME,
            "full_speed": FULL_SPEED,
            "full_acceleration": FULL_ACCELERATION,
            "segment": [{"type": "hold", "duration": 0.5}, *segments, {"type": "hold", "duration": 0.5}],
        }
    )


def fourier(name: str, seed: int, fundamental: float, size: float, duration: float = 14.0) -> Experiment:
    """Random finite Fourier series in all six joints, five harmonics, scaled to ``size`` of each joint's comfortable range."""
    rng = np.random.default_rng(seed)
    reach = size * np.array([1.2, 0.7, 0.9, 1.0, 0.8, 1.2])
    shape = rng.normal(size=(2, 6, 5)) / np.arange(1, 6)
    shape *= (reach / np.abs(shape).sum(axis=(0, 2)))[:, None] * 1.6
    # no joint faster than its full speed, whatever the harmonics add up to
    w = 2 * np.pi * fundamental * np.arange(1, 6)
    phase = np.outer(np.linspace(0.0, 1.0 / fundamental, 500), w)
    speed = np.abs((np.cos(phase) * w) @ shape[0].T - (np.sin(phase) * w) @ shape[1].T).max(axis=0)
    shape *= np.minimum(1.0, np.array(FULL_SPEED) / speed)[:, None]
    segment = {
        "type": "fourier", "duration": duration, "fundamental": fundamental, "fade": 1.0,
        "sine": shape[0].tolist(), "cosine": shape[1].tolist(),
    }  # fmt: skip
    return _experiment(name, [segment])


def sweeps(name: str, speed: float, signs: int) -> Experiment:
    """Joints 1, 2, 3 one after the other out and back at a fraction of full speed, then the wrist."""
    reach = [0.8, 0.9, 0.9, 0.8, 0.6, 0.8]
    segments = []
    for joint in range(1, 7):
        by = signs * reach[joint - 1] * (-1 if joint in (3, 5) else 1)
        share = min(1.0, speed if joint <= 3 else 0.5 * speed)
        segments += [
            {"type": "drive", "joint": joint, "by": by, "speed": share},
            {"type": "drive", "joint": joint, "by": -by, "speed": share},
        ]
    return _experiment(name, segments)


def suite(seed: int) -> tuple[list[Experiment], list[Experiment]]:
    """(fit, held out) experiments."""
    fit = [
        fourier("fast", seed + 1, 0.12, 0.9),
        fourier("slow", seed + 2, 0.05, 0.6),
        sweeps("sweep", 0.35, 1),
        fourier("middle", seed + 3, 0.1, 1.0),
    ]
    held_out = [
        fourier("fast 2", seed + 11, 0.12, 0.9),
        fourier("slow 2", seed + 12, 0.06, 0.7),
        sweeps("sweep 2", 0.45, -1),
    ]
    return fit, held_out
