"""Arms like the model, with other numbers: what its structure shows, not the values that it is assumed to have.

The columns of effects depend on the other parameters: a wrist coupling is felt by what the coupled links weigh, so that
in front of a link that the model has as massless its column is zero, though the real arm's is not. Whether a parameter
can be identified at all is decided on the model and on such arms together.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from arm_model import Arm, Joint, parameter, with_parameters
from identification.regression.effect_columns import definition, effect_parameters

COUNT = 2
"""Arms beside the model: a dependence between columns that holds on all of them is one of structure."""
SIZE = 0.1
"""m: centres of mass are this far off, radii of gyration this large."""


def generic_arms(arm: Arm, random: np.random.Generator) -> Iterator[Arm]:
    """The arm itself; of one with effects, COUNT more with bodies and effects of other sizes."""
    yield arm
    for _ in range(COUNT if arm.effects else 0):
        mean = float(np.mean(arm.joint_array("mass"))) or 1.0
        other = replace(arm, joints=tuple(_other_body(joint, mean, random) for joint in arm.joints))
        sizes = {
            name: parameter(arm, name) + random.uniform(0.3, 1.0) * definition(name).typical[1]
            for name in effect_parameters(arm)
        }
        yield with_parameters(other, sizes)


def _other_body(joint: Joint, mean: float, random: np.random.Generator) -> Joint:
    """A joint with a body of some ``mean`` kg behind it."""
    mass = mean * random.uniform(0.5, 1.5)
    x, y, z = (random.uniform(0.5, 1.0, 3) * mass * SIZE**2).tolist()
    com = tuple((np.array(joint.com) + SIZE * random.uniform(-1.0, 1.0, 3)).tolist())
    # triangle inequality of principal inertias: sums of two halves each
    return replace(joint, mass=mass, com=com, inertia=(y + z, x + z, x + y, 0.0, 0.0, 0.0))
