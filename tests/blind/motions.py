"""The motions of a hidden-effect case.

Seven recordings of about 15 s, four to fit and three held out, as laboratories make them.

Three sets, none made for the finder: ``singles`` is the thesis's (one joint at a time, forwards and back, two speeds,
joints 2 and 3 through the vertical), with moves of the whole arm to judge by; ``moves`` goes from point to point as a
robot at work does, with reversals and chirps; ``mixed`` are excitation trajectories and sweeps.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from experiment import Experiment

FULL_SPEED = [1.43, 1.29, 2.13, 3.98, 4.21, 3.98]
FULL_ACCELERATION = [6.0, 5.0, 8.0, 15.0, 15.0, 15.0]
HOME = [0.0, -0.4, -0.9, 0.0, 0.5, 0.0]


LOW = np.array([-1.2, -1.0, -1.8, -1.2, -1.0, -1.5])
HIGH = np.array([1.2, 2.2, 0.9, 1.2, 1.0, 1.5])
"""rad: the room in which moves of the whole arm go; joint 2 is upright at 1.57, joint 3 where q2 + q3 is 0."""

Suite = tuple[list[Experiment], list[Experiment]]


def _experiment(name: str, segments: list[dict[str, Any]]) -> Experiment:
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
    """Random finite Fourier series in all six joints, five harmonics.

    Scaled to ``size`` of each joint's comfortable range.
    """
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
        "type": "fourier",
        "duration": duration,
        "fundamental": fundamental,
        "fade": 1.0,
        "sine": shape[0].tolist(),
        "cosine": shape[1].tolist(),
    }
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


def _there_and_back(joint: int, by: float, speed: float) -> list[dict[str, Any]]:
    """One joint out, a short stand, and back."""
    out = {"type": "drive", "joint": joint, "by": by, "speed": speed}
    return [out, {"type": "hold", "duration": 0.2}, {**out, "by": -by}, {"type": "hold", "duration": 0.2}]


def _moves(name: str, rng: np.random.Generator, slowest: float, fastest: float, duration: float = 14.0) -> Experiment:
    """The whole arm from point to point at speeds drawn from a range, with stands of a quarter second."""
    segments: list[dict[str, Any]] = []
    at, spent = np.array(HOME), 0.0
    while spent < duration:
        target, speed = rng.uniform(LOW, HIGH), float(rng.uniform(slowest, fastest))
        took = float(np.max(np.abs(target - at) / (speed * np.array(FULL_SPEED)))) + speed * 0.3 + 0.25
        if spent + took > duration + 1.5:
            break
        segments += [
            {"type": "move", "to": [round(float(x), 4) for x in target], "speed": speed},
            {"type": "hold", "duration": 0.25},
        ]
        at, spent = target, spent + took
    return _experiment(name, segments)


def _reversals(name: str, rng: np.random.Generator) -> Experiment:
    """Each of joints 1-3 a little back and forth, several times, from a pose of its own; then the wrist."""
    segments: list[dict[str, Any]] = [{"type": "move", "to": list(rng.uniform(LOW, HIGH).round(3)), "speed": 0.8}]
    for joint in range(1, 7):
        by, speed = float(rng.uniform(0.15, 0.3)) * float(rng.choice([-1, 1])), float(rng.uniform(0.2, 0.5))
        once = _there_and_back(joint, by, speed)
        segments += [{"type": "repeat", "times": 2 if joint <= 3 else 1, "segment": [once[0], once[2]]}]
    return _experiment(name, segments)


def _chirps(name: str, rng: np.random.Generator) -> Experiment:
    """Joints 1-3 one after the other, from slow to quick."""
    segments: list[dict[str, Any]] = []
    for joint in (1, 2, 3):
        chirp = {"type": "chirp", "joint": joint, "amplitude": float(rng.uniform(0.12, 0.2)), "frequency": 0.3}
        segments.append({**chirp, "to_frequency": float(rng.uniform(1.0, 1.5)), "duration": 4.0})
    return _experiment(name, segments)


def singles(seed: int) -> Suite:
    """One joint at a time, as in the thesis; judged on single joints at another speed and on moves of the whole arm."""
    rng = np.random.default_rng([seed, 1])
    half, full = float(rng.uniform(0.4, 0.55)), float(rng.uniform(0.9, 1.0))
    far = {1: float(rng.uniform(0.9, 1.2)), 2: float(rng.uniform(2.2, 2.6)), 3: float(rng.uniform(1.6, 2.0))}
    both = lambda joint, share: [  # noqa: E731
        *_there_and_back(joint, share * far[joint], half),
        *_there_and_back(joint, share * far[joint], full),
    ]
    fit = [
        _experiment("joints 1 and 3", [*both(1, 1.0), *both(3, 1.0)]),
        _experiment("joint 2", both(2, 1.0)),
        sweeps("slow sweep", 0.35, 1),
        fourier("excitation", seed + 3, 0.1, 1.0),
    ]
    between = float(rng.uniform(0.6, 0.8))
    one_each = [part for joint in (1, 2, 3) for part in _there_and_back(joint, 0.9 * far[joint], between)]
    held_out = [
        _experiment("joints 1 to 3", one_each),
        _moves("cube", rng, 0.5, 1.0),
        fourier("excitation 2", seed + 12, 0.08, 0.9),
    ]
    return fit, held_out


def moves(seed: int) -> Suite:
    """A robot at work: point to point, fast and slow, reversals and chirps."""
    rng = np.random.default_rng([seed, 2])
    fit = [
        _moves("fast moves", rng, 0.7, 1.0),
        _moves("slow moves", rng, 0.2, 0.4),
        _reversals("reversals", rng),
        _chirps("chirps", rng),
    ]
    held_out = [_moves("moves", rng, 0.3, 1.0), _moves("moves 2", rng, 0.2, 0.7), _reversals("reversals 2", rng)]
    return fit, held_out


def mixed(seed: int) -> Suite:
    """Excitation trajectories and sweeps."""
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


SETS: dict[str, Callable[[int], Suite]] = {"singles": singles, "moves": moves, "mixed": mixed}
"""(fit, held out) experiments by the name of the set, drawn from a seed."""
