"""How well the parameters of an identified arm are known: the covariance of its fit, in parameters of its model file.

Refits without one block of time each (``identification.regression.uncertainty``) give the deviation of every base
parameter, but of fewer directions than there are parameters: thirteen blocks say nothing of forty-eight of sixty. The
formula's covariance has all of them, and takes residuals for white. So the deviations are those of the blocks, and the
correlations a mean of both, weighted by how many directions each speaks of (shrinkage: Ledoit & Wolf, J. Multivariate
Analysis 88, 2004).
"""

from __future__ import annotations

import numpy as np

from arm_io.plain_data import LARGEST
from arm_io.types import Array
from arm_model import Arm
from arm_model.friction_split import departures
from arm_model.tables import Uncertainty, uncertainty_of
from identification.regression.model_parameters import curve_names
from identification.regression.problem import Problem
from identification.regression.uncertainty import FitUncertainty

FILE = "model_uncertainty.json"
SMALLEST = 1e-13
"""Least eigenvalue of an information matrix over its largest; below it are rounding errors."""


def known_to(problem: Problem, uncertainty: FitUncertainty) -> Uncertainty:
    """The uncertainty of the arm that a fit of ``problem`` makes; what these runs do not excite has none."""
    covariance = _shrunk(uncertainty)
    names = [problem.base.names[column] for column in problem.columns]
    parts = [_in_model(problem.arm, name) for name in names]
    every = list(dict.fromkeys(name for part in parts for name in part))
    spelled = np.zeros((len(every), len(names)))
    for k, part in enumerate(parts):
        for name, share in part.items():
            spelled[every.index(name), k] = share
    return uncertainty_of(FILE, tuple(every), writable(spelled @ covariance @ spelled.T))


def writable(covariance: Array) -> Array:
    """A covariance (p, p) whose entries a file may have (``arm_io.plain_data``), with the same correlations.

    Of what three seconds of a weightless arm do not determine, deviations may be beyond any number of physics.
    """
    largest = 0.99 * LARGEST
    share = np.sqrt(largest / np.maximum(np.diag(covariance), largest))
    return np.asarray(covariance * np.outer(share, share))


def _shrunk(uncertainty: FitUncertainty) -> Array:
    """(b, b) covariance of the fitted base parameters, of full rank."""
    count = len(uncertainty.std)
    blocks, formula = _correlations(uncertainty.covariance), _correlations_by(uncertainty.information)
    share = count / (count + max(uncertainty.blocks - 1, 1))
    return np.asarray(np.outer(uncertainty.std, uncertainty.std) * (share * formula + (1.0 - share) * blocks))


def _correlations_by(information: Array) -> Array:
    """(b, b) correlations of the inverse of an information matrix, positive semidefinite whatever its rounding errors.

    Of a micro arm's inertias some are 1e-9 of others: a matrix is scaled to a diagonal of 1 before eigenvalues are
    called small.
    """
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    return _correlations((vectors / np.maximum(values, SMALLEST * values[-1])) @ vectors.T)


def _correlations(covariance: Array) -> Array:
    std = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    return np.asarray(covariance / np.outer(std, std), float)


def _in_model(arm: Arm, name: str) -> dict[str, float]:
    """Changes of the parameters of a model file that a unit of one column's parameter stands for.

    The offset of a joint whose Coulomb friction differs by direction is such a difference; values of a curve that
    follow from others follow.
    """
    head, _, quantity = name.partition(".")
    if not (head.startswith("joint") and head.removeprefix("joint").isdigit()) or "." in quantity:
        return {name: 1.0}
    joint = arm.joints[(j := int(head.removeprefix("joint")) - 1)]
    if quantity == "offset" and joint.coulomb[0] != joint.coulomb[1]:
        return {f"{head}.coulomb_positive": 1.0, f"{head}.coulomb_negative": -1.0}
    if quantity.startswith("curve") and joint.friction_curve is not None:
        basis, kept = departures(joint.friction_curve.speed)
        _, joined, way = quantity.partition("_")
        points = curve_names(j, len(basis), joined + way)
        unit = basis[:, list(kept).index(points.index(name))]
        return {point: float(share) for point, share in zip(points, unit) if share != 0.0}
    return {name: 1.0}
