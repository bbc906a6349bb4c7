"""An arm as estimated so far, and what was known of it beforehand: every step of a calibration makes the next one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from identification.kinematics.circle_points.circle_points import CirclePoints
from identification.kinematics.data.measured import Measured
from identification.kinematics.data.points import Points
from identification.kinematics.data.recordings import Gravity
from identification.kinematics.estimation.cross_validation import Trial
from identification.kinematics.estimation.extensions import Extension
from identification.kinematics.estimation.map_estimation import Fit
from identification.kinematics.estimation.observability import RESTING
from identification.kinematics.models.chain import Chain
from identification.kinematics.models.parameters import Parameters, Target, Trust

IMPOSSIBLE_NOISE = 1e-3
"""m per coordinate: no tracker of points is worse."""
_MORE = 1.5
"""Noise over the stated one that a coarse statement allows."""


@dataclass(frozen=True)
class Settings:
    """What is known beforehand, and what is tried.

    frame_known  whether positions are stated to be given in the base frame of the model
    trust        prior standard deviations
    gravity      joint torques that hold the arm, for sag; None: sag is not tried
    extend       whether couplings, sag, encoder errors and delay are tried
    point_std    m, stated standard deviation of a coordinate of a point: of the tracker, and of an arm that does not
                 return to a pose exactly; 0: estimated
    last_link    (4, 4) pose of the last link of the user's model in the last link of the arm, for messages
    """

    frame_known: bool
    trust: Trust = field(default_factory=Trust)
    gravity: Gravity | None = None
    extend: bool = True
    point_std: float = 0.0
    last_link: Array = field(default_factory=lambda: np.eye(4))

    @property
    def most_noise(self) -> float:
        """m per coordinate: what is left above it is the model's error."""
        return max(IMPOSSIBLE_NOISE, _MORE * self.point_std)


@dataclass(frozen=True, kw_only=True)
class Estimated:
    """Parameters fitted to points.

    arm, settings  what was known beforehand
    targets, frame_known  as they are taken: where points refute what was stated, it is estimated
    measured      what is fitted to; points: those fitted, with the deflections of ``extensions``
    first         where the estimation began, in the estimated tracker frame if that was unknown
    circles       of single-joint sweeps
    parameters, fit  what is free, and the estimate
    coupling_std  standard deviations of the entries of ``Measured.coupling`` that were estimated
    extensions    joint extensions that were accepted; trials: all that were tried
    """

    arm: Arm
    settings: Settings
    targets: tuple[Target, ...]
    frame_known: bool
    measured: Measured
    first: Chain
    circles: CirclePoints
    parameters: Parameters
    points: Points
    fit: Fit
    coupling_std: Mapping[tuple[int, int], float] = field(default_factory=dict)
    extensions: tuple[Extension, ...] = ()
    trials: tuple[Trial, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def chain(self) -> Chain:
        """The chain at its estimated values."""
        return self.parameters.chain.at(self.fit.values)

    @property
    def moving(self) -> list[int]:
        """Joints (from 1) that move."""
        return [j + 1 for j in range(len(self.arm)) if np.ptp(self.points.q[:, j]) >= RESTING]
