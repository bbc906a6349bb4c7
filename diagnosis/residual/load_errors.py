"""What is not known of the loads on the transmissions, where the model says how well it is known.

Link encoders and trackers are compared with the model by the load alone: torque of its masses, friction apart.
"""

from __future__ import annotations

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import described
from arm_model.rigid_body.regressor import regressor


def load_errors(arm: Arm, q: Array, v: Array, a: Array) -> Array:
    """(m, n, r) N m (N): change of the load by each independent error of the masses, of one standard deviation.

    q, v, a (m, n) rad (m) and per second; r = 0 where the model states nothing of its masses.
    """
    uncertainty = arm.uncertainty
    names_known = uncertainty.parameters if uncertainty is not None else ()
    masses = [k for k, name in enumerate(names_known) if name.startswith("link")]
    if uncertainty is None or not masses:
        return np.empty((*q.shape, 0))
    columns, names = regressor(described(arm), q, v, a)
    of_masses = [list(names).index(uncertainty.parameters[k]) for k in masses]
    root = uncertainty.directions[masses]
    return np.asarray(columns[..., of_masses] @ root[:, np.any(root != 0.0, axis=0)])
