"""Three recordings of some 15 s, two to fit and one held out, with slow and fast parts and reversals."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from experiment import Experiment

SPEEDS = [1.4, 1.25, 2.0, 3.0, 3.0, 3.5]
HOME = [0.0, -0.4, -0.9, 0.0, 0.5, 0.0]
MIDDLE = np.array([0.0, 0.6, -0.4, 0.0, 0.2, 0.0])
REACH = np.array([1.3, 1.6, 1.3, 1.2, 0.9, 1.5])
"""rad either side of ``MIDDLE``; joint 2 is upright at 1.57."""

Segments = list[dict[str, Any]]
Suite = tuple[list[Experiment], list[Experiment]]


def _experiment(name: str, segments: Segments) -> Experiment:
    return Experiment.model_validate(
        {
            "name": name,
            "start": HOME,
            "full_speed": SPEEDS,
            "full_acceleration": [3.5, 3.0, 6.0, 10.0, 10.0, 10.0],
            "segment": [{"type": "hold", "duration": 0.7}, *segments, {"type": "hold", "duration": 0.6}],
        }
    )


def _points(name: str, rng: np.random.Generator, slow: float, fast: float, duration: float = 11.0) -> Experiment:
    """From point to point, some joints at rest in each move."""
    at, spent, segments = np.array(HOME), 0.0, list[dict[str, Any]]()
    while spent < duration:
        go = np.where(rng.uniform(size=6) < 0.8, MIDDLE + REACH * rng.uniform(-1, 1, 6), at)
        speed = float(np.exp(rng.uniform(np.log(slow), np.log(fast))))
        segments += [
            {"type": "move", "to": [round(float(x), 4) for x in go], "speed": speed},
            {"type": "hold", "duration": 0.2},
        ]
        spent += float(np.max(np.abs(go - at) / (speed * np.array(SPEEDS)))) + 0.3 * speed + 0.2
        at = go
    return _experiment(name, segments)


def _swings(
    name: str, rng: np.random.Generator, joints: tuple[int, ...], share: float, speeds: list[float]
) -> Experiment:
    """Single joints out and back at several speeds, the slow ones over shorter ways, from the middle of their room."""
    segments = list[dict[str, Any]]([{"type": "move", "to": [0.0, 0.9, 0.1, 0.0, 0.3, 0.0], "speed": 0.8}])
    for joint in joints:
        way = float(share * REACH[joint - 1] * rng.uniform(0.9, 1.2)) * (-1.0 if joint in (3, 5) else 1.0)
        for speed in speeds:
            by = way * min(1.0, 3.0 * speed)
            segments += [
                {"type": "drive", "joint": joint, "by": by, "speed": speed},
                {"type": "drive", "joint": joint, "by": -by, "speed": speed},
            ]
    return _experiment(name, segments)


def _waves(name: str, rng: np.random.Generator, fundamental: float, duration: float = 11.0) -> Experiment:
    """Six joints at once, random sums of sines."""
    shape = rng.normal(size=(2, 6, 4)) / np.sqrt(np.arange(1, 5))
    shape *= (0.55 * REACH / np.abs(shape).sum(axis=(0, 2)))[:, None]
    w = 2 * np.pi * fundamental * np.arange(1, 5)
    phase = np.outer(np.linspace(0.0, 1.0 / fundamental, 400), w)
    speed = np.abs((np.cos(phase) * w) @ shape[0].T - (np.sin(phase) * w) @ shape[1].T).max(axis=0)
    hard = np.abs((np.sin(phase) * w**2) @ shape[0].T + (np.cos(phase) * w**2) @ shape[1].T).max(axis=0)
    shape *= np.minimum(1.0, np.minimum(0.9 * np.array(SPEEDS) / speed, 2.5 / hard))[:, None]
    start: dict[str, Any] = {"type": "move", "to": [0.0, 0.5, -0.4, 0.0, 0.2, 0.0], "speed": 0.7}
    wave = {"type": "fourier", "duration": duration, "fundamental": fundamental, "fade": 2.0}
    return _experiment(name, [start, {**wave, "sine": shape[0].tolist(), "cosine": shape[1].tolist()}])


def _moves(rng: np.random.Generator) -> Suite:
    fit = [_points("points", rng, 0.12, 1.0), _swings("swings", rng, (1, 2, 3), 0.5, [0.06, 0.8])]
    return fit, [_points("points held out", rng, 0.1, 0.9, 14.0)]


def _singles(rng: np.random.Generator) -> Suite:
    fit = [_swings("slow", rng, (1, 2, 3), 0.5, [0.07, 0.5]), _swings("fast", rng, (1, 2, 3, 4, 5, 6), 0.65, [0.9])]
    return fit, [_points("points held out", rng, 0.1, 0.9, 14.0)]


def _all_waves(rng: np.random.Generator) -> Suite:
    fit = [_waves("waves", rng, 0.13), _swings("swings", rng, (1, 2, 3), 0.5, [0.06, 0.6])]
    return fit, [_waves("waves held out", rng, 0.1, 14.0)]


SETS: dict[str, Callable[[np.random.Generator], Suite]] = {"moves": _moves, "singles": _singles, "waves": _all_waves}


def suite(name: str, seed: int) -> Suite:
    """(fit, held out) experiments of a set."""
    return SETS[name](np.random.default_rng([seed, 994]))
