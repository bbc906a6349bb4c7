"""Currents of one recording under its model with other effects, in the band of comparison.

Models that are evaluated one after the other differ in few effects. What the one before had alike is not filtered
again: the angles of motors whose encoders have the same errors, and currents of joints that are equal in every row.
Neither are loads and inertias of links that are the same, which wind up springs. That is to the last bit what would be
computed, and leaves half of the time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from arm_model.effects import described
from diagnosis.residual.expected_current import Links, Term, predicted_current, terms_of, true_angle
from diagnosis.residual.filters import COMPARE_BAND, MOTION_BAND, Motion, low_pass, motion_of, rate_of


@dataclass
class Evaluations:
    """Cached results of the last evaluation of a recording with raw angles q (k, n) rad at times t (k,) s.

    errors, motion     errors of encoders, and the smoothed true motion (k, n) of the motors
    links              ... as the links carry it
    shown, filtered    (k, n) A that the transducers showed, and the same in the band of comparison
    """

    t: Array
    q: Array
    powered: bool
    errors: list[Term] | None = None
    motion: Motion | None = None
    links: Links | None = None
    shown: Array | None = None
    filtered: Array | None = None

    def expected(self, arm: Arm, rows: slice) -> Array:
        """(m, n) A: currents under ``arm``, whose joints and setup are those of all evaluations, at some ``rows``."""
        rate = rate_of(self.t)
        errors = [term for term in terms_of(arm) if term[0].angle is not None]
        if self.motion is None or errors != self.errors:
            self.errors, self.motion = errors, motion_of(true_angle(arm, self.q), MOTION_BAND, rate)
            self.links = None
        bodies = replace(described(arm), effects=())
        if self.links is None or bodies != self.links.arm:
            self.links = Links(bodies, true_angle(arm, self.q), rate)
        shown = predicted_current(arm, self.t, self.q, powered=self.powered, motion=self.motion, links=self.links)
        if self.shown is None or self.filtered is None:
            filtered = low_pass(shown, COMPARE_BAND, rate)[rows].copy()
        else:
            changed = np.flatnonzero((shown != self.shown).any(axis=0))
            filtered = self.filtered.copy()
            if len(changed):
                filtered[:, changed] = low_pass(shown[:, changed], COMPARE_BAND, rate)[rows]
        self.shown, self.filtered = shown, filtered
        return filtered
