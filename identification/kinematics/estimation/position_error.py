"""How far measured points are from predicted ones: over all points, and beside it without those left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from identification.kinematics.estimation.map_estimation import REJECT
from identification.kinematics.models.chain import Index, Mask
from identification.selection import MEDIAN_OF_NORM

_EXACT = 1e-8
"""m: noise-free points that are this near are not outliers, however near the others are."""


@dataclass(frozen=True)
class PositionError:
    """Error of predicted positions over points.

    rms            m, per coordinate, over ALL points: sqrt(mean(r^2)) over all coordinates, so that a perfect model
                   shows the tracker's own noise
    mean, largest  m, distance in space, over ALL points
    points         number of points
    outliers       how many of them are further off than ``REJECT`` robust deviations, or were left out of the fit
    rms_inliers    m, per coordinate, without these
    """

    rms: float
    mean: float
    largest: float
    points: int
    outliers: int
    rms_inliers: float


@dataclass(frozen=True)
class LeftOut:
    """Points of one run that the model does not fit.

    part   "fit": they were left out of the fit; "held_out": they are far off by the robust scale of the others. Every
           rms but ``PositionError.rms_inliers`` counts them.
    rows   (k,) rows of the run, from 1
    distance  (k,) from the calibrated model: m, or rad of orientations
    oriented  whether they are orientations of a target
    """

    part: str
    run: str
    rows: Index
    distance: Array
    oriented: bool = False

    @property
    def why(self) -> str:
        """The criterion, as a person reads it."""
        if self.part == "fit":
            return f"left out of the fit: more than {REJECT:g} standard deviations from the model of the other points"
        return f"more than {REJECT:g} standard deviations (of the other points and of the prediction) from the model"


def far(residual: Array, std: float = 0.0) -> Mask:
    """(N,) bool: residuals (N, 3) m beyond ``REJECT`` deviations, robust ones or, if more, stated ones (``std`` m)."""
    length = np.linalg.norm(residual, axis=1)
    if not len(length):
        return np.zeros(0, bool)
    deviation = max(float(np.median(length)) / MEDIAN_OF_NORM, std)
    return np.asarray(length > max(REJECT * deviation, _EXACT), bool)


def position_error(residual: Array, outlier: Mask | None = None) -> PositionError:
    """The error of residuals (N, 3) m; ``outlier`` (N,) bool: which are counted as such (default: those ``far``)."""
    length = np.linalg.norm(residual, axis=1)
    outlier = far(residual) if outlier is None else outlier
    if not len(length):
        return PositionError(float("nan"), float("nan"), float("nan"), 0, 0, float("nan"))
    return PositionError(
        rms=_rms(length),
        mean=float(length.mean()),
        largest=float(length.max()),
        points=len(length),
        outliers=int(outlier.sum()),
        rms_inliers=_rms(length[~outlier]),
    )


def _rms(length: Array) -> float:
    """Per coordinate."""
    return float(np.sqrt(np.mean(length**2) / 3.0)) if len(length) else float("nan")
