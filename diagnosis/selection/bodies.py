"""A body at the flange and the inertia of the link that carries it: which of the two a change of inertia is.

To the drives both are the same: a payload has the columns of the ten parameters of the last link. It is a payload where
what was added is a body by itself: its mass is clearly positive, and its inertia about its centre is one that a body
may have. A mass point has four of these columns, and is chosen first where they are enough.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import CATALOGUE
from arm_model.rigid_body.inertia import tensor
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
    of, std = ({p.name: number for p, number in zip(values, several)} for several in _numbers(values))
    if of["mass"] <= deviations * std["mass"]:
        return False
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    moments, doubt = _second_moments(np.array([of[name] for name in names])), np.linalg.norm([std[n] for n in names])
    return bool(moments.min() >= -deviations * doubt)


def _numbers(values: list[Estimate]) -> tuple[list[float], list[float]]:
    return [p.value for p in values], [p.std for p in values]


def _second_moments(entries: Array) -> Array:
    """(3,) kg m2: principal values of the second moments int r r^T dm, of an inertia xx, xy, xz, yy, yz, zz (6,)."""
    inertia = tensor(entries)
    return np.asarray(np.linalg.eigvalsh(np.trace(inertia) / 2 * np.eye(3) - inertia))
