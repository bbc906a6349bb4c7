"""Whether there can be an arm with the parameters that causes have: sizes that a body may have."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model import Arm, EffectTerm, Joint
from arm_model.effects import described
from arm_model.rigid_body.inertia import barycentric, tensor
from diagnosis.cause import Cause, extend

DEVIATIONS = 3.0
"""std by which a size must miss what a body may have to be impossible."""


def exists(arm: Arm, terms: Iterable[EffectTerm]) -> bool:
    """Whether the arm can be described with these effects: no negative mass, no negative torque constant."""
    try:
        described(replace(arm, effects=(*arm.effects, *terms)))
    except InputError:
        return False
    return True


def impossible(arm: Arm, causes: Sequence[Cause]) -> int | None:
    """The first cause that no body has; None where all are possible.

    A link's second moments of mass about the axes of its frame, and its rotor's inertia, may not be negative by more
    than DEVIATIONS. A parameter that the data says nothing of has a std as large as typical values, and passes.
    """
    for index, cause in enumerate(causes):
        terms = extend(replace(arm, effects=()), [cause]).effects
        if not exists(arm, terms):
            return index
        if cause.joint is None:
            continue
        std = {p.name: p.std for p in cause.parameters}
        now = arm.joints[cause.joint - 1]
        changed = described(replace(arm, effects=(*arm.effects, *terms))).joints[cause.joint - 1]
        # a published set that no body has is not the fault of a cause
        least, doubt = np.minimum(_sizes(now), 0.0), _doubt(std)
        dust = 1e-9 * np.abs(_sizes(now)).max()
        if (_sizes(changed) < least - DEVIATIONS * doubt - dust).any():
            return index
    return None


def _sizes(joint: Joint) -> Array:
    """(4,) kg m2 that no body has below 0.

    int x^2 dm = (iyy + izz - ixx) / 2 in the link's frame, likewise y and z: the triangle inequality; and the rotor at
    the joint.
    """
    moments = np.diag(tensor(barycentric(joint.mass, joint.com, joint.inertia)[4:]))
    return np.append(np.sum(moments) / 2 - moments, joint.ratio**2 * joint.rotor_inertia)


def _doubt(std: dict[str, float]) -> Array:
    """(4,) std of ``_sizes``, of the parameters of a cause; those that it has not are known."""
    moments = np.linalg.norm([std.get(name, 0.0) for name in ("ixx", "iyy", "izz")]) / 2
    return np.array([moments, moments, moments, std.get("inertia", 0.0)])
