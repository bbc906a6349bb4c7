"""From base parameters to an arm that could exist: every link's mass distribution real, friction that dissipates.

A rigid body exists if its pseudo-inertia P is positive definite (``arm_model.rigid_body.inertia``). Base parameters
leave many arms; the one nearest to a prior in Bregman's log-det divergence is taken (Lee, Wensing, Park, IEEE T-RO
36(3), 2020), which needs no units to be balanced:

    min  1/2 |K delta - beta|^2_S  +  regularisation * sum_links [ tr(P0^-1 P) - logdet(P) ]  +  barrier * sum [ g / g0
         - log(g) ]

over links and what must not be negative, g (the same divergence of one number: where no data speaks, the prior's own
value g0 is the nearest; else g0 is at least what the data say), with S the inverse covariance of beta. Friction is one
g per speed and direction: the total of a joint opposes its motion (``arm_model.effects.dissipation``), whatever the
sign of one coefficient. Convex and self-concordant: damped Newton steps reach it from the prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse
from scipy.sparse import csgraph

from arm_io.types import Array
from arm_model.effects import CATALOGUE
from arm_model.rigid_body import COEFFICIENTS, LINK_FRICTION
from arm_model.rigid_body.inertia import PARAMETERS, pseudo_inertia
from identification.regression.effect_columns import definition, is_effect

REGULARISATION = 1e-2
"""A divergence of 1 (a body 1.9 times as heavy as the prior's, of the same shape) weighs like 0.14 std of the data."""
BARRIER = 1e-3
"""Weight of the same divergence of single numbers: only keeps them positive."""
OF_ONE_SPEED = 0.04
"""Weight of the friction at one speed: the 25 of a direction weigh like one number."""
PATH = 10.0 ** (np.arange(12, -1, -1) / 2)
"""Weights of divergence and barrier along the path, over the last ones. In steps of 10, data that no arm explains leave
a minimum 4 to 16 % higher, as Newton's steps meet the boundary."""
ON_PATH = 0.1
"""Expected decrease, over the regularisation, at which a minimum on the way to the last one is near enough."""
SMALLEST = 1e-6
"""Share of the mean link's mass (size) that is given to a prior link without mass (size)."""
NEVER_NEGATIVE = ("rotor_inertia", "drag", *COEFFICIENTS, *LINK_FRICTION)
"""Parameters of a joint or of its link's cylinder that must not be negative, each for itself."""
BODY = 0.05
"""Mass, as a share of that of the arm's mean link, of a body that a link gets if the model has it without one."""
RADIUS = 0.05
"""m: radius of that body."""
EDGE = 1e-12
"""Least eigenvalue of a body's pseudo-inertia over the largest, as of one that is a micrometre thick: below it, whether
it is a body at all is rounding. Data that no body explains lead there."""
CONTRADICTED = 20.0
"""Squared deviations (of one covariance) by which a body for such a link must reduce the misfit: two per parameter."""
_UNITS = pseudo_inertia(np.eye(len(PARAMETERS)))
"""(10, 4, 4) derivatives of the pseudo-inertia by each parameter."""


@dataclass(frozen=True)
class BaseFit:
    """Base parameters as the data determine them.

    grouping     (b, p): they are grouping @ standard parameters
    values       (b,); information (b, b): inverse of their covariance, which weighs distances from them
    """

    grouping: Array
    values: Array
    information: Array


@dataclass(frozen=True)
class Prior:
    """Standard parameters where the data do not say.

    names, values  (p,)
    friction       (k, p) ``friction_rows``: their product with the parameters must not be negative; None: no such rows
    scale          (p,) of parameters that are neither of a link nor friction: how near they stay, 0: free; None: all
    """

    names: Sequence[str]
    values: Array
    friction: Array | None = None
    scale: Array | None = None


def consistent_parameters(fit: BaseFit, prior: Prior) -> Array:
    """(p,) physical standard parameters whose base parameters are near those of a fit.

    Links of the prior without mass or inertia get a small one, or where the data contradict that, begin from a body.
    Parameters that are neither of a link nor friction are free, held to the prior only where no base parameter speaks
    of them, or within its ``scale``; so are signed parameters of effects, while those that have no sign (an amplitude,
    a share) stay positive.
    """
    values = np.array(prior.values, float)
    priors = [values]
    if (embodied := _with_bodies(values, prior.names)) is not None:
        priors.append(embodied)
    found = [_nearest(_Problem(fit, replace(prior, values=one)), values) for one in priors]
    misfit = [float((off := fit.grouping @ delta - fit.values) @ fit.information @ off) for delta in found]
    return found[0] if misfit[0] < misfit[-1] + CONTRADICTED else found[-1]


def _nearest(problem: _Problem, prior: Array) -> Array:
    """(p,) the minimum of a problem; what no base parameter speaks of is the ``prior``'s (p,)."""
    delta = problem.centre
    # An interior-point path: from inside the cone of possible bodies towards its boundary.
    for factor in PATH:
        enough = ON_PATH * REGULARISATION * factor if factor > 1.0 else 0.0
        delta = _newton(problem, delta, REGULARISATION * factor, BARRIER * factor, enough)
    # A parameter that is in none of these sums keeps the prior's value exactly, unless friction would drive a joint.
    untold = np.setdiff1d(np.flatnonzero(~np.any(problem.grouping != 0, axis=0)), problem.inertial)
    while True:
        kept = delta.copy()
        kept[untold] = prior[untold]
        impossible = problem.rows[problem.rows @ kept < 0.0]
        needed = np.any(impossible[:, untold] != 0.0, axis=0)
        if not needed.any():
            return kept
        untold = untold[~needed]


class _Problem:
    """The convex function of the module's docstring, with its first and second derivatives."""

    def __init__(self, fit: BaseFit, prior: Prior) -> None:
        names, centre = prior.names, prior.values.copy()
        scale = np.zeros(len(names)) if prior.scale is None else prior.scale
        friction = np.empty((0, len(names))) if prior.friction is None else prior.friction
        self.grouping = fit.grouping
        of_effects = np.array([is_effect(name) for name in names], bool)
        links = [k for k, name in enumerate(names) if name.endswith(".mass") and not of_effects[k]]
        self.of_link = np.array(links, np.intp)[:, None] + np.arange(len(PARAMETERS))
        single = np.array([k for k, name in enumerate(names) if _never_negative(name)], np.intp)
        _fill_bodies(centre, links)
        least = np.where(of_effects[single], 1e-6, 1e-3)
        centre[single] = np.maximum(np.abs(centre[single]), least)
        _fill_friction(centre, friction, names)
        self.centre = centre
        # what must not be negative: rows (k, p) of the parameters, the prior's values (k,), and the weight of each
        self.rows = np.concatenate([np.eye(len(names))[single], friction])
        self.blocks = _blocks(self.rows)
        # a model without friction, as from URDF, has a thousandth here, which would draw 100 N m towards it
        told = np.linalg.lstsq(fit.grouping, fit.values, rcond=None)[0]
        self.prior = np.maximum(self.rows @ centre, self.rows @ told)
        self.weight = np.concatenate([np.ones(len(single)), np.full(len(friction), OF_ONE_SPEED)])
        self.inverse = np.linalg.inv(self._bodies(centre))
        self.quadratic = fit.grouping.T @ fit.information @ fit.grouping
        self.linear = fit.grouping.T @ fit.information @ fit.values
        self.constant = float(fit.values @ fit.information @ fit.values)
        self.inertial = self.of_link.ravel()
        rubbing = np.flatnonzero(np.any(friction != 0, axis=0) & ~of_effects)
        free = np.setdiff1d(np.arange(len(names)), np.concatenate([self.inertial, single, rubbing]))
        self.ridge = np.zeros(len(names))
        self.ridge[free] = 1e-6 / np.maximum(np.abs(centre[free]), 1.0) ** 2
        self.ridge[scale > 0] = REGULARISATION / scale[scale > 0] ** 2
        for k in np.flatnonzero(of_effects).tolist():  # may be like a drive's own friction
            self.ridge[k] = REGULARISATION / max(abs(centre[k]), definition(names[k]).typical[0]) ** 2

    def _bodies(self, delta: Array) -> Array:
        """(l, 4, 4) pseudo-inertias of the links."""
        return pseudo_inertia(delta[self.of_link])

    def cost(self, delta: Array, regularisation: float, barrier: float) -> float:
        """Infinite outside the cone of bodies, and on its edge."""
        margin = self.rows @ delta
        if margin.size and np.min(margin) <= 0:
            return np.inf
        total = 0.5 * float(delta @ self.quadratic @ delta - 2 * self.linear @ delta + self.constant)
        total += 0.5 * float(self.ridge @ (delta - self.centre) ** 2)
        bodies = self._bodies(delta)
        values = np.linalg.eigvalsh(bodies)
        if np.any(values[:, 0] <= EDGE * values[:, -1]):
            return np.inf
        total += regularisation * float(np.sum(self.inverse * bodies) - np.sum(np.log(values)))
        return total + barrier * float(self.weight @ (margin / self.prior - np.log(margin)))

    def derivatives(self, delta: Array, regularisation: float, barrier: float) -> tuple[Array, Array]:
        """Gradient (p,) and Hessian (p, p)."""
        gradient = self.quadratic @ delta - self.linear + self.ridge * (delta - self.centre)
        hessian = self.quadratic + np.diag(self.ridge)
        values, axes = np.linalg.eigh(self._bodies(delta))
        root = (axes / np.sqrt(values)[:, None, :])[:, None]  # P^-1 = root root^T
        turned = np.swapaxes(root, -1, -2) @ _UNITS @ root
        towards = np.tensordot(self.inverse, _UNITS, ((1, 2), (1, 2)))
        gradient[self.of_link] += regularisation * (towards - np.trace(turned, axis1=-2, axis2=-1))
        blocks = self.of_link[:, :, None], self.of_link[:, None, :]
        hessian[blocks] += regularisation * np.einsum("laxy,lbxy->lab", turned, turned)
        margin = self.rows @ delta
        slope = barrier * self.weight * (1 / self.prior - 1 / margin)
        root = np.sqrt(barrier * self.weight) / margin
        for columns, own in self.blocks:
            rows = self.rows[np.ix_(own, columns)]
            weighted = root[own, None] * rows
            gradient[columns] += slope[own] @ rows
            hessian[np.ix_(columns, columns)] += weighted.T @ weighted
        return gradient, hessian


def _newton(problem: _Problem, delta: Array, regularisation: float, barrier: float, enough: float) -> Array:
    """Damped Newton steps until the expected decrease is negligible, or below ``enough``."""
    value = problem.cost(delta, regularisation, barrier)
    for _ in range(60):
        gradient, hessian = problem.derivatives(delta, regularisation, barrier)
        scale = 1 / np.sqrt(np.diag(hessian))
        step = -scale * _solved(hessian * scale[:, None] * scale, scale * gradient)
        decrement = -float(gradient @ step)
        if decrement < max(enough, 1e-9 * max(1.0, abs(value))):
            break
        length = 1.0
        while (
            trial := problem.cost(delta + length * step, regularisation, barrier)
        ) > value - 1e-4 * length * decrement:
            length /= 2
            if length < 1e-9:
                return delta
        delta, value = delta + length * step, trial
    return delta


def _blocks(rows: Array) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Columns of rows (k, p) that stand in rows together, with these rows: friction of one joint knows no other."""
    there = sparse.csr_array(rows != 0, dtype=float)
    _, block = csgraph.connected_components(there.T @ there, directed=False)
    first = np.argmax(rows != 0, axis=1)
    return [(np.flatnonzero(block == one), np.flatnonzero(block[first] == one)) for one in np.unique(block[first])]


def _solved(matrix: Array, right: Array) -> Array:
    """(p,) solution of a positive definite system, by least squares where rounding leaves it indefinite."""
    try:
        return np.asarray(linalg.cho_solve(linalg.cho_factor(matrix, lower=True), right))
    except linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(matrix, right, rcond=1e-14)[0])


def _never_negative(name: str) -> bool:
    """Whether a parameter must not be negative for itself; friction must not as a whole."""
    if not is_effect(name):
        return name.split(".")[-1] in NEVER_NEGATIVE
    return not (definition(name).signed or CATALOGUE[name.split(".")[-2]].friction)


def _fill_friction(parameters: Array, rows: Array, names: Sequence[str]) -> None:
    """Gives every joint (in place) as much Coulomb friction as its total needs to oppose the motion at every speed."""
    for k, name in enumerate(names):
        if ".coulomb" in name and not is_effect(name):
            opposing = rows[rows[:, k] > 0]
            short = 1e-3 - (opposing @ parameters).min(initial=np.inf)
            parameters[k] += max(float(short), 0.0)


def _with_bodies(parameters: Array, names: Sequence[str]) -> Array | None:
    """The parameters with a body of BODY of the mean mass in every link without mass; None where all have some."""
    links = [k for k, name in enumerate(names) if name.endswith(".mass") and not is_effect(name)]
    massless = [k for k in links if parameters[k] <= 0.0]
    if not massless:
        return None
    masses = parameters[links]
    mass = BODY * (float(masses[masses > 0].mean()) if (masses > 0).any() else 1.0)
    filled = parameters.copy()
    for k in massless:
        filled[k] = mass
        filled[[k + PARAMETERS.index(name) for name in ("ixx", "iyy", "izz")]] = 2.0 * mass * RADIUS**2
    return filled


def _fill_bodies(parameters: Array, links: Sequence[int]) -> None:
    """Gives every link (in place) a positive definite pseudo-inertia, changing only what cannot be a body."""
    masses = parameters[list(links)]
    mass = float(masses[masses > 0].mean()) if (masses > 0).any() else 1.0
    for k in links:
        p = pseudo_inertia(parameters[k : k + 10])
        least = SMALLEST * mass
        if np.linalg.eigvalsh(p)[0] < least:
            values, vectors = np.linalg.eigh(p)
            p = (vectors * np.maximum(values, least)) @ vectors.T
            parameters[k] = p[3, 3]
            parameters[k + 1 : k + 4] = p[:3, 3]
            inertia = np.trace(p[:3, :3]) * np.eye(3) - p[:3, :3]
            parameters[k + 4 : k + 10] = inertia[np.triu_indices(3)]
