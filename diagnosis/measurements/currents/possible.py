"""Whether there can be an arm with the parameters that causes have: signs of effects, sizes that a body may have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from arm_io import InputError
from arm_io.types import Array
from arm_model import Arm, EffectTerm, Joint
from arm_model.effects import CATALOGUE, described
from arm_model.rigid_body.inertia import PARAMETERS, barycentric, pseudo_inertia
from diagnosis.cause import Cause, extend
from diagnosis.selection.candidate import Candidate

DEVIATIONS = 2.0
"""std by which a size must miss what a body may have to be impossible."""
ROUNDING = 1e-9
"""Relative rounding errors."""
UNIT_AMPLITUDE = 0.25, 4.0
"""Coefficients between which an effect without a linear parameter may be: the true one is 1, and between the values of
a search grid it may differ."""


def is_physical(candidate: Candidate, coefficients: Array) -> bool:
    """Whether the parameters have admissible signs and sizes: no negative mass, stiffness, gap or friction share."""
    if candidate.unit_amplitude and not UNIT_AMPLITUDE[0] < coefficients[0] < UNIT_AMPLITUDE[1]:
        return False
    if candidate.definition.body and not coefficients[0]:
        return False  # a single axis shows moments, and nothing of the mass that would be a body's
    values = candidate.parameters(coefficients.tolist())
    return all(candidate.definition.admits(name, value) for name, value in values.items())


def exists(arm: Arm, terms: Sequence[EffectTerm]) -> bool:
    """Whether the arm can be described with these effects: no negative mass, no negative torque constant.

    A parameter may be no larger than an effect has it, and a model file holds it.
    """
    if any(abs(value) > CATALOGUE[term.name][key].most for term in terms for key, value in term.parameters.items()):
        return False
    try:
        described(replace(arm, effects=(*arm.effects, *terms)))
    except InputError:
        return False
    return True


def impossible(arm: Arm, causes: Sequence[Cause]) -> int | None:
    """The first cause that no body has, or not together with those before it; None where all are possible.

    A link's pseudo-inertia (its mass, centre of mass and second moments of mass: Wensing, Kim, Slotine, IEEE RA-L 3(1),
    2018) is positive definite for every body, and its rotor's inertia positive; neither may miss that by more than
    DEVIATIONS. A parameter that the data says nothing of has a std as large as typical values, and passes.
    """
    for index, cause in enumerate(causes):
        terms = extend(replace(arm, effects=()), [cause]).effects
        if not exists(arm, terms) or not exists(arm, [term for one in causes[: index + 1] for term in one.terms]):
            return index
        if cause.joint is None:
            continue
        std = {p.name: p.std for p in cause.parameters}
        now = arm.joints[cause.joint - 1]
        changed = described(replace(arm, effects=(*arm.effects, *terms))).joints[cause.joint - 1]
        turns = changed.ratio**2 * changed.rotor_inertia
        if turns < -DEVIATIONS * std.get("inertia", 0.0) - ROUNDING or _misses(now, changed, std):
            return index
    return None


def _misses(now: Joint, changed: Joint, std: dict[str, float]) -> bool:
    """Whether the changed link misses a body by more than DEVIATIONS, and by more than the model's own link does.

    The smallest eigenvalue of its pseudo-inertia, with the std of that by the parameters of the cause.
    """
    before, after = (np.linalg.eigh(_pseudo_inertia(joint)) for joint in (now, changed))
    along = after.eigenvectors[:, 0]
    slopes = np.array([along @ unit @ along for unit in pseudo_inertia(np.eye(len(PARAMETERS)))])
    doubt = float(np.linalg.norm(slopes * [std.get(name, 0.0) for name in PARAMETERS]))
    least = min(float(before.eigenvalues[0]), 0.0)  # a published set that no body has is not the fault of a cause
    return bool(after.eigenvalues[0] < least - DEVIATIONS * doubt - ROUNDING * float(np.abs(before.eigenvalues).max()))


def _pseudo_inertia(link: Joint) -> Array:
    return pseudo_inertia(barycentric(link.mass, link.com, link.inertia))
