"""A body at the flange and the inertia of the link that carries it: which of the two a change of inertia is.

To the drives both are the same: a payload has the columns of the ten parameters of the last link. It is a payload where
what was added is a body by itself: its mass is clearly positive, and its inertia about its centre is one that a body
may have. A mass point has four of these columns, and is chosen first where they are enough.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from arm_model import Arm
from arm_model.effects import CATALOGUE
from arm_model.rigid_body.inertia import PARAMETERS, second_moments, tensor
from diagnosis.cause import Estimate
from diagnosis.selection.candidate import Candidate


def body_of(candidate: Candidate) -> Candidate | None:
    """The candidate with an inertia of its own; None where its effect has none."""
    return replace(candidate, body=True) if candidate.definition.body else None


def link_of(candidate: Candidate, arm: Arm) -> Candidate:
    """The change of the link that has the columns of a body."""
    return Candidate(candidate.definition.body, candidate.joint or len(arm))


def bodies_of_link(candidate: Candidate, arm: Arm) -> list[Candidate]:
    """The bodies that have the columns of a change of a link."""
    of_arm = [effect.name for effect in CATALOGUE.values() if effect.body == candidate.effect and not effect.per_joint]
    return [Candidate(name, None, body=True) for name in of_arm if candidate.joint == len(arm)]


def is_body(values: list[Estimate], deviations: float) -> bool:
    """Whether mass, centre and inertia about the centre (with std) may be those of a body.

    Its mass is positive by more than ``deviations``, its principal second moments of mass are not negative by more.
    """
    by_name = {p.name: p for p in values}
    mass, entries = by_name["mass"], [by_name[name] for name in PARAMETERS[4:]]
    if mass.value <= deviations * mass.std:
        return False
    principal = np.linalg.eigvalsh(second_moments(tensor(np.array([p.value for p in entries]))))
    return bool(principal.min() >= -deviations * np.linalg.norm([p.std for p in entries]))
