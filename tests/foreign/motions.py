"""Motions of a foreign arm: targets per drive, by a controller that interpolates its setpoints linearly."""

from __future__ import annotations

import numpy as np

from tests.foreign.arms import ForeignArm
from tests.foreign.plant import STEP, Array

REST = 0.6
"""s at rest before and after."""


def targets(arm: ForeignArm, kind: str, seed: int, seconds: float, period: float) -> Array:
    """(m, n) per ``STEP``: a motion of this kind through setpoints of this period, s.

    waves   five harmonics per drive, as excitation trajectories have them
    moves   from point to point, all drives together, at speeds between a twentieth and all of the largest
    """
    rng = np.random.default_rng(seed)
    low, high = np.array([joint.reach for joint in arm.joints]).T
    speed = np.array([joint.speed for joint in arm.joints])
    coarse = np.arange(0.0, seconds + 2 * period, period)
    path = (_waves if kind == "waves" else _moves)(rng, coarse, (low, high), speed, seconds)
    fine = np.arange(0.0, seconds, STEP)
    return np.column_stack([np.interp(fine, coarse, column) for column in path.T])


def _waves(rng: np.random.Generator, t: Array, reach: tuple[Array, Array], speed: Array, seconds: float) -> Array:
    """Amplitudes as large as range and speed allow, faded in and out."""
    low, high = reach
    lasting = seconds - 2 * REST
    inside = np.clip(t - REST, 0.0, lasting)
    fade = np.sin(np.pi / 2 * np.clip(np.minimum(inside, lasting - inside) / 1.2, 0.0, 1.0)) ** 2
    phase = np.outer(inside, 2 * np.pi * 0.1 * np.arange(1, 6))
    shape = rng.normal(size=(2, len(low), 5)) / np.arange(1, 6) ** 0.7
    path = np.sin(phase) @ shape[0].T + (np.cos(phase) - 1.0) @ shape[1].T
    middle, half = (path.max(0) + path.min(0)) / 2, (path.max(0) - path.min(0)) / 2
    fastest = np.abs(np.diff(path * fade[:, None], axis=0)).max(0) / (t[1] - t[0])
    scale = np.minimum((high - low) / 2 / half, speed / fastest)
    free = np.maximum((high - low) / 2 - scale * half, 0.0)
    centre = (low + high) / 2 + rng.uniform(-1.0, 1.0, len(low)) * free
    # faded towards the centre of the range, so that the motion stays inside it
    return centre + scale * fade[:, None] * (path - middle)


def _moves(rng: np.random.Generator, t: Array, reach: tuple[Array, Array], speed: Array, seconds: float) -> Array:
    """Moves with bell-shaped speed to the far half of each range in turn, every third one slow."""
    low, high = reach
    at, place = REST, low + rng.uniform(0.1, 0.35, len(low)) * (high - low)
    times, places = [0.0, REST], [place, place]
    number = 0
    while True:
        upper = rng.uniform(size=len(low)) < 0.5 + 0.4 * np.sign((low + high) / 2 - place)
        goal = low + np.where(upper, rng.uniform(0.6, 1.0, len(low)), rng.uniform(0.0, 0.4, len(low))) * (high - low)
        share = rng.uniform(0.05, 0.2) if number % 3 == 1 else rng.uniform(0.5, 1.0)
        if number % 3 == 1:
            goal = place + 0.3 * (goal - place)
        lasting = max(float(np.max(1.6 * np.abs(goal - place) / (share * speed))), 0.3)
        if at + lasting > seconds - REST:
            break
        at, place, number = at + lasting, goal, number + 1
        times.append(at)
        places.append(place)
    return np.column_stack([_bells(t, np.array(times), np.array(column)) for column in np.array(places).T])


def _bells(t: Array, times: Array, places: Array) -> Array:
    """Quintic between successive places."""
    leg = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
    part = np.clip((t - times[leg]) / (times[leg + 1] - times[leg]), 0.0, 1.0)
    gone = part**3 * (10.0 - 15.0 * part + 6.0 * part**2)
    return places[leg] + gone * (places[leg + 1] - places[leg])
