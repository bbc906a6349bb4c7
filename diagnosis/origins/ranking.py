"""Origins ranked by the evidence for and against them: naive Bayes with priors and strengths of judgement.

Every origin is judged on its own against its absence: its prior odds, times the likelihood ratio of every sign that was
found (its sufficiency) and of every sign that was searched for and not found (its necessity), as in the rules of
PROSPECTOR (Duda, Hart, Nilsson, "Subjective Bayesian methods for rule-based inference systems", AFIPS 1976). Origins do
not exclude each other, so that likelihoods need not sum to 1. They order what to check first; they are no frequencies.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, prod

from arm_model.effects import CATALOGUE
from diagnosis.origins.evidence import Evidence, Finding
from diagnosis.origins.table import Origin, Table, read_table

JUDGEMENT = "likelihoods give the order of the checks; they are engineering judgement, not measured frequencies"
MOST = 5
"""Origins per place."""
LEAST = 0.05
"""Likelihood below which an origin is not worth a check, unless it is the first."""
SPEAKS = 0.8
"""Likelihood ratio below which a sign speaks against an origin."""
LARGEST = 0.99
"""Likelihood up to which one is stated: a table of judgement is no more certain."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Suspect:
    """An origin at a joint (from 1); None: of the arm and its rig.

    likelihood       of the origin; see ``JUDGEMENT``
    supported_by     named effects that speak for it
    contradicted_by  named effects that speak against it
    missing          signs of it that were searched for and not found
    sources          where the mechanism or the check is described
    """

    origin: Origin
    joint: int | None
    likelihood: float
    supported_by: tuple[str, ...]
    contradicted_by: tuple[str, ...]
    missing: tuple[str, ...]
    sources: tuple[str, ...]

    def __repr__(self) -> str:
        where = f"of joint {self.joint}" if self.joint else "of the arm"
        return f"<Suspect {where}: {self.origin.title}; likelihood {self.likelihood:.2f}>"


def suspects(places: Sequence[Evidence]) -> list[Suspect]:
    """The most likely origins, place by place; of each only those that a named cause supports."""
    table, found = read_table(), []
    for place in places:
        ranked = ranking(place, table)
        found += [one for k, one in enumerate(ranked[:MOST]) if k == 0 or one.likelihood >= LEAST]
    return found


def ranking(place: Evidence, table: Table) -> list[Suspect]:
    """Every origin of a place that a named cause supports, the most likely first."""
    scope = "arm" if place.joint is None else "joint"
    judged = [_judged(origin, place, table) for origin in table.origin if origin.scope == scope]
    return sorted((one for one in judged if one.supported_by), key=lambda one: (-one.likelihood, one.origin.name))


def likelihood(origin: Origin, place: Evidence, table: Table) -> float:
    """Probability of an origin by the evidence of a place, between 0 and 1."""
    prior = table.priors[origin.prior]
    odds = prior / (1.0 - prior) * prod(ratio(origin, finding, table) for finding in place.findings)
    # effects that no instrument can distinguish count once as missing
    missing: dict[frozenset[str], float] = {}
    for sign in sorted(place.absent):
        same = frozenset({sign, *CATALOGUE[sign].aliases})
        missing[same] = min(table.absent(origin, sign), missing.get(same, inf))
    odds *= prod(missing.values())
    return odds / (1.0 + odds)


def ratio(origin: Origin, finding: Finding, table: Table) -> float:
    """Likelihood ratio of a finding: of its ambiguity group the mean, for the part that its confidence gives it."""
    of_group = [_of_named(origin, finding, table), *(table.present(origin, effect) for effect in finding.effects[1:])]
    mean = (sum(of_group) + finding.elsewhere) / (len(of_group) + finding.elsewhere)
    return 1.0 + finding.confidence * (mean - 1.0)


def _of_named(origin: Origin, finding: Finding, table: Table) -> float:
    """Ratio of the named effect with its qualifiers."""
    effect = finding.effect
    with_it = prod(table.present(origin, f"{effect}:{name}") for name in sorted(finding.holds))
    without = prod(table.absent(origin, f"{effect}:{name}") for name in sorted(finding.fails))
    return table.present(origin, effect) * with_it * without


def _judged(origin: Origin, place: Evidence, table: Table) -> Suspect:
    by_finding = [(finding.effect, ratio(origin, finding, table)) for finding in place.findings]
    return Suspect(
        origin=origin,
        joint=place.joint,
        likelihood=min(likelihood(origin, place, table), LARGEST),
        supported_by=tuple(effect for effect, value in by_finding if value > 1.0),
        contradicted_by=tuple(effect for effect, value in by_finding if value < SPEAKS),
        missing=tuple(sign for sign in sorted(place.absent) if table.absent(origin, sign) < SPEAKS),
        sources=tuple(table.sources[key] for key in origin.source),
    )
