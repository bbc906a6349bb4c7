"""Thresholds of the selection from currents, and what matters by them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from diagnosis.selection.beyond_model import BEYOND_MODEL
from diagnosis.selection.design import Dataset
from diagnosis.selection.regression import INDEPENDENT, Fitted
from identification.selection import Limits


@dataclass(frozen=True, kw_only=True)
class CurrentLimits(Limits):
    """Gains are shares of one joint's noise energy.

    coefficients             the least gain holds for every so many coefficients: many coefficients follow something
    leakage                  share of what is explained at a joint that columns of the first order may leave for every
                             coefficient of another effect: 0.3 % of an effect, a tenth of its second order
    leakage_of_corrected     ... and share of what an exact model had to correct there
    tie_floor                share of the noise energy by which equals may differ whatever they gain
    ambiguity_p              probability of the difference of two gains above which the blocks do not distinguish them
    group_correlation        canonical correlation above which two effects are one to this data
    corrections              evaluations of the exact model per round: the second-order part of a strong effect is a
                             tenth of it, that of the rest a hundredth
    worse                    times the first-order residual: an exact model that leaves more is outside of its range
    pair_share               share of the residual energy of a joint that two effects must explain to enter together
    many, many_causes        causes of a joint with so many coefficients together, or so many of them, imitate one
                             function of one variable ...
    many_leave               ... if that leaves at most this share more than they do
    superfluous              share of its gain that a cause must keep conditional on unexplained structure, or it was a
                             name for part of that
    significant_sizes        std that the linear parameter of a cause must be from zero; of several, one, by so many
                             more that it is as unlikely by chance
    body_deviations          std by which the mass of a body must be positive, and its second moments may be negative
    searched_again           refuted causes in whose place another is searched; what has no better name by then is
                             unexplained
    family                   share of its gain by which a term of an effect that is chosen may gain less than another
                             effect and still come first: harmonics and directions belong to one cause
    swapped                  share of what is left to which it must fall for a rival to take the place of a cause, or
                             for a likely variable that of structures which leave a residual above the noise
    follows                  share of what no effect explains that more coefficients of friction may follow: two
                             directions that differ by less are equal
    dominant                 share of the excess over the noise at its joint, in fitted and held-out recordings, from
                             which a cause keeps its name beside unexplained structure: of effects outside the catalogue
                             the nearest effect explains 50 to 94 %
    structure_gain           share of a joint's noise energy that unexplained structure must explain ...
    structure_share          ... and share of what the causes explain there: a law that is right to a seventh of its
                             amplitude is the right law
    structure_p              its probability by chance: nothing tests a structure again, as a cause is tested
    structures               structures searched for at one joint
    above_noise              residual-to-noise ratio above which a residual is not noise, whatever it depends on: noise
                             correlated over longer than the initial standstill is underestimated by a factor of two
    noise                    ratio up to which a residual is noise where an effect acts, so that there is no effect: the
                             noise is known no better (the verdict's limit along the motion)
    far_above_noise          ratio that underestimated noise does not reach
    beyond_model             probability that a cause or a structure looks as it does while only parameters of the model
                             move, within what is known of them: the strongest of some hundred candidates is by chance
                             below a hundredth
    likely_p, likely_share   of a residual above the noise: p-value below which a variable is reported, and share that
                             its function must explain
    """

    coefficients: int = 8
    leakage: float = 1e-5
    leakage_of_corrected: float = 0.01
    tie_floor: float = 0.02
    ambiguity_p: float = 0.01
    group_correlation: float = 0.98
    corrections: int = 2
    worse: float = 1.1
    pair_share: float = 0.5
    many: int = 6
    many_causes: int = 5
    many_leave: float = 0.2
    superfluous: float = 0.5
    significant_sizes: float = 2.0
    body_deviations: float = 3.0
    searched_again: int = 2
    family: float = 0.05
    swapped: float = 0.5
    follows: float = 0.25
    dominant: float = 0.95
    structure_gain: float = 0.15
    structure_share: float = 0.02
    structure_p: float = 5e-3
    structures: int = 3
    above_noise: float = 2.5
    noise: float = 1.3
    far_above_noise: float = 6.0
    beyond_model: float = BEYOND_MODEL
    likely_p: float = 0.05
    likely_share: float = 0.5


LIMITS = CurrentLimits(
    max_causes=8,
    # the effect is then a third of the noise, and the noise is known no better
    min_gain=0.1,
    kept_gain=0.1,
    # per coefficient
    tie=0.005,
    ambiguity=0.8,
    independent=INDEPENDENT,
)


def leakage(held_out: Dataset, fitted: Fitted) -> Array:
    """(n,) leakage allowance.

    Squared held-out residual of each joint that the chosen causes may have left for every coefficient of another.
    """
    explained = held_out.by_joint(held_out.y**2 - fitted.residual.held_out**2)
    return LIMITS.leakage * explained + LIMITS.leakage_of_corrected * held_out.corrected


def matters(gain: Array, coefficients: int, allowance: Array, held_out: Dataset) -> bool:
    """Whether held-out gains (n,) of the joints are large against the noise, above the ``leakage`` allowance (n,).

    An effect with k coefficients is given the allowance k times: it has k ways to follow what leaked.
    """
    above = np.maximum(gain - coefficients * allowance, 0.0)
    least = LIMITS.min_gain * max(1.0, coefficients / LIMITS.coefficients) * held_out.rows
    return bool(min(above.sum(), gain.sum()) > least)
