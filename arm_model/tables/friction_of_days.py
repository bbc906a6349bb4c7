"""Variation of friction from day to day: the effect of temperature on a greased robot joint.

Recordings of a single day do not show it, so it is assumed, by the published law (Bittencourt, Gunnarsson, J. Dyn. Sys.
Meas. Control 134(5), 2012).
"""

from __future__ import annotations

import numpy as np

from arm_io.types import Array

UNRECORDED = 1.5
"""K, standard deviation of a difference of temperature that was not recorded."""
COULOMB = 0.005
"""Share by which Coulomb friction differs per K, as in ``arm_fleet.simulation.weather``; by the published law none."""
VISCOUS = 0.03
"""Share by which viscous friction differs per K: of the law's 1.29e-4 + 1.31e-3 exp(-T / 20.7), at T = 40 degC."""
NEAR_REST = 0.056
"""Friction near rest differs by this share of the Coulomb friction per K: 1.69e-3 of 3.04e-2 of the published law."""
HUMP, SHARPNESS = 15.0 / 280.0, 1.3
"""Width of what friction does near rest, over the fastest speed, and its exponent, by the published law at 40 degC."""


def near_rest(speed: Array | float) -> Array:
    """What friction does near rest, of its size there, at speeds (not negative) over the fastest."""
    return np.asarray(np.exp(-((np.asarray(speed) / HUMP) ** SHARPNESS)))
