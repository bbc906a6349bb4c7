"""Variation of a healthy simulated arm from night to night: temperature, and friction with it.

Half of the variance of a temperature is that of the hall, which all arms share and which is correlated with the
previous night; half is independent per arm. The viscosity of grease falls with temperature: viscous friction falls by
some per cent per kelvin, Coulomb friction by a fraction of that (Bittencourt, Gunnarsson, J. Dyn. Sys. Meas. Control
134(5), 051013, 2012, figure 4).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from arm_io.types import Array
from arm_model import Arm, parameter

REFERENCE = 35.0
"""degC to which the friction of the model refers."""
VISCOUS, COULOMB = 0.02, 0.005
"""Relative decrease of friction per K."""
FOLLOWS = 0.7
"""Correlation of the hall's temperature with that of the previous night."""


def temperatures(arms: int, nights: int, std: float, draw: np.random.Generator, *, season: float) -> Array:
    """(arms, nights) degC of all motors of an arm in every night.

    std: K, from night to night; half of the variance is that of the hall. season: K by which the last night is warmer.
    """
    hall = np.empty(nights)
    for night, step in enumerate(draw.standard_normal(nights)):
        hall[night] = step if night == 0 else FOLLOWS * hall[night - 1] + np.sqrt(1 - FOLLOWS**2) * step
    of_arm = draw.standard_normal((arms, nights))
    return np.asarray(REFERENCE + season * np.linspace(0, 1, nights) + std * np.sqrt(0.5) * (hall + of_arm))


def friction_at(arm: Arm, temperature: Array) -> Mapping[str, Array]:
    """Friction parameters of all joints (``arm_model.parameters``), (lanes,) each, at (lanes,) degC."""
    warmer = np.asarray(temperature) - REFERENCE
    shares = {"viscous": np.exp(-VISCOUS * warmer), "coulomb": np.exp(-COULOMB * warmer)}
    return {
        f"joint{j}.{name}": parameter(arm, f"joint{j}.{name}") * share
        for j in range(1, len(arm) + 1)
        for name, share in shares.items()
    }
