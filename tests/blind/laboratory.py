"""Whose arm it is: motions, controller, noise and how the recordings reach the finder.

Drawn from a seed as laboratories differ.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Laboratory:
    """What two laboratories with the same arm would not have in common.

    motions        which set of seven motions (``motions.SETS``)
    route          "rig": through counters, transducers and converter to MCAP; "table": CSV by ``armscope import``
    rate           Hz
    rest_velocity  rad/s: width over which friction changes its sign
    colour         A rms: noise of the currents that is correlated over ``correlation`` s, in addition to the white
    gains          of the position loops over those of the model's file
    """

    motions: str
    route: str = "rig"
    rate: float = 1000.0
    rest_velocity: float = 0.005
    colour: float = 0.0
    correlation: float = 0.05
    gains: float = 1.0


WHITE = 0.0066
"""A rms: noise of the joint currents 1-3 from transducer (3 mV) and converter (12 bit), both routes alike."""


def laboratory(seed: int) -> Laboratory:
    """One of them."""
    rng = np.random.default_rng([seed, 77])
    table = rng.uniform() < 0.3
    return Laboratory(
        motions=str(rng.choice(["singles", "moves", "mixed"])),
        route="table" if table else "rig",
        rate=float(rng.choice([1000.0, 500.0, 500.0])) if table else 1000.0,
        rest_velocity=float(np.exp(rng.uniform(np.log(0.002), np.log(0.02)))),
        colour=float(rng.choice([0.0, 0.0, 0.5, 1.0])) * WHITE,
        correlation=float(rng.uniform(0.03, 0.15)),
        gains=float(rng.choice([1.0, 1.0, 1.0, 0.6, 1.5])),
    )
