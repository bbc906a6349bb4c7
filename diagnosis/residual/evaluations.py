"""Currents of one recording under its model with other effects, in the band of comparison.

Models that are evaluated one after the other differ in few effects. What the one before had alike is not filtered
again: the angles of motors whose encoders have the same errors, and currents of joints that are equal in every row.
That is to the last bit what would be filtered, and leaves two thirds of the time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from diagnosis.residual.expected_current import (
    COMPARE_BAND,
    MOTION_BAND,
    Term,
    low_pass,
    rate_of,
    reading,
    terms_of,
    true_angle,
    with_rates,
)


@dataclass
class Evaluations:
    """What the last evaluation of a recording of raw angles q (k, n) rad at times t (k,) s has computed.

    errors, angle      errors of encoders, and the smoothed true angles (k, n) of the motors
    shown, filtered    (k, n) A that the transducers showed, and the same in the band of comparison
    """

    t: Array
    q: Array
    powered: bool
    errors: list[Term] | None = None
    angle: Array | None = None
    shown: Array | None = None
    filtered: Array | None = None

    def expected(self, arm: Arm, rows: slice) -> Array:
        """(m, n) A: currents under ``arm``, whose joints and setup are those of all evaluations, at some ``rows``."""
        rate = rate_of(self.t)
        errors = [term for term in terms_of(arm) if term[0].angle is not None]
        if self.angle is None or errors != self.errors:
            self.errors, self.angle = errors, low_pass(true_angle(arm, self.q), MOTION_BAND, rate)
        shown = reading(arm, self.t, self.q, powered=self.powered, motion=with_rates(self.angle, rate))
        if self.shown is None or self.filtered is None:
            filtered = low_pass(shown, COMPARE_BAND, rate)[rows].copy()
        else:
            others = np.flatnonzero((shown != self.shown).any(axis=0))
            filtered = self.filtered.copy()
            if len(others):
                filtered[:, others] = low_pass(shown[:, others], COMPARE_BAND, rate)[rows]
        self.shown, self.filtered = shown, filtered
        return filtered
