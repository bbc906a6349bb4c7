"""A body at the flange and the inertia of the link that carries it: which of the two a change of inertia is.

To the drives both are the same: a payload has the columns of the ten parameters of the last link. It is a payload where
what was added is a body by itself: its mass is clearly positive, and its inertia about its centre is one that a body
may have. A mass point has four of these columns, and is chosen first where they are enough.

The fitted rows determine a few of these parameters; the others follow from a prior, of mean zero and the largest
typical sizes. Where a body is a tenth of these, parameters that the rows hardly determine follow noise up to their
sizes, and predict other poses worse than no cause does. The rows say how large the prior is: its scale is that of the
largest marginal likelihood (empirical Bayes: Morris, J. American Statistical Association 78, 1983; MacKay, Neural
Computation 4, 1992).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from arm_model import Arm
from arm_model.effects import CATALOGUE
from arm_model.rigid_body.inertia import PARAMETERS, second_moments, tensor
from diagnosis.cause import Estimate
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.design import Columns
from diagnosis.selection.regression import Fitted, fit_gain

SHARES = (1 / 64, 1 / 16, 1 / 4, 1.0)
"""Of the largest typical sizes: those that are tried, the smallest first."""
ODDS = 3.0
"""Log of the likelihood by which a larger share must be likelier than a smaller one: 20 to 1."""


def body_of(candidate: Candidate) -> Candidate | None:
    """The candidate with an inertia of its own; None where its effect has none."""
    return replace(candidate, body=True) if candidate.definition.body else None


def link_of(candidate: Candidate, arm: Arm) -> Candidate:
    """The change of the link that has the columns of a body."""
    return Candidate(candidate.definition.body, candidate.joint or len(arm), expected=candidate.expected)


def bodies_of_link(candidate: Candidate, arm: Arm) -> list[Candidate]:
    """The bodies that have the columns of a change of a link."""
    of_arm = [effect.name for effect in CATALOGUE.values() if effect.body == candidate.effect and not effect.per_joint]
    found = (Candidate(name, None, body=True, expected=candidate.expected) for name in of_arm)
    return [body for body in found if candidate.joint == len(arm)]


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


def likely_share(columns: Columns, fitted: Fitted, alike: float) -> float:
    """The share of the largest typical sizes that the coefficients most likely have, conditional on those ``fitted``.

    Of shares that are as likely, the smallest, by which they determine the fewest coefficients.

    columns: of the fitted recordings, with the largest typical sizes ``known``; alike: rows that count as one.
    """
    inside = columns.dot(fitted.basis)

    def evidence(share: float) -> float:
        """Twice the log of the marginal likelihood, but for a constant, times ``alike``."""
        expecting = columns.expecting(share)
        assert expecting.known is not None
        size = np.sqrt(expecting.known)
        _, volume = np.linalg.slogdet((expecting.gram - inside @ inside.T) / np.outer(size, size))
        return fit_gain(expecting, fitted)[0] - alike * float(volume)

    found = {share: evidence(share) for share in SHARES}
    least = max(found.values()) - 2.0 * ODDS * alike
    return next(share for share, likely in found.items() if likely >= least)
