"""What is left at every joint with all causes in the model, in units of the noise: the size behind a verdict.

Along the measured motion and, where the controller of the model is that of the arm, in closed loop; in the fitted
recordings and in those held out. What is said of a residual is said by these figures.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from diagnosis.cause import Signal
from diagnosis.closed_loop.clear_errors import LIMITS as LOOP_LIMITS
from diagnosis.closed_loop.clear_errors import PARTS
from diagnosis.measurements.currents.limits import LIMITS
from diagnosis.remainder.against_noise import ratios
from diagnosis.remainder.of_identification import AllowedResidual
from diagnosis.residual.comparable_rows import noise_compared
from diagnosis.result import Diagnosis
from identification.selection import Split


@dataclass(frozen=True, kw_only=True)
class Remaining:
    """One joint (from 1): its verdict, and its residual current over the noise with all causes.

    along, in_loop  by "fit" and "held_out"; empty where there is nothing to compare
    known_to        times the noise that it may be in held-out recordings by the model's own uncertainty, and
                    known_to_fitted in fitted ones; None: the model states none
    remainder       of what is within that: on what it depends, and what the model left when it was identified
    """

    joint: int
    verdict: str
    along: dict[str, float] = field(default_factory=dict)
    in_loop: dict[str, float] = field(default_factory=dict)
    known_to: float | None = None
    known_to_fitted: float | None = None
    remainder: AllowedResidual | None = None

    @property
    def words(self) -> Iterator[str]:
        """``joint 2 at 1.7 times the noise in held-out recordings``, of everything above it."""
        for sizes, most, where, compared in (
            (self.along, LIMITS.noise, "", _compared(self.remainder)),
            (self.in_loop, LOOP_LIMITS.loop, " in closed loop", ""),
        ):
            above = {side: size for side, size in sizes.items() if size > most}
            if above:
                worst = max(above, key=lambda side: above[side])
                yield (
                    f"joint {self.joint}{where} at {above[worst]:.1f} times the noise in {PARTS[worst]} recordings"
                    f"{self._known_in(worst)}{compared}"
                )

    @property
    def by_lack(self) -> bool:
        """Whether what the model lacked when it was identified is half of what it is known to, in squares, or more."""
        return self.remainder is not None and 2 * self.remainder.before**2 >= (self.known_to or 0.0) ** 2

    def _known_in(self, side: str) -> str:
        known = self.known_to_fitted if side == "fit" else self.known_to
        return f", where the model is known to {known:.1f} times" if known else ""


def _compared(one: AllowedResidual | None) -> str:
    """`` (against position; 5.6 times, against position, when it was identified)``; empty where nothing is known."""
    if one is None:
        return ""
    now = f"against {one.against}; " if one.against else ""
    then = f", against {one.before_against}," if one.before_against else ""
    return f" ({now}{one.before:.1f} times{then} when it was identified)"


def remaining(result: Diagnosis) -> list[Remaining]:
    """Every joint; empty where no currents were judged."""
    if not result.judged:
        return []
    runs = Split(result.fit, result.held_out)
    along = {
        part: {one.joint: one.ratio for one in ratios(of_part, residual)}
        for (part, of_part), residual in zip(runs.items(), result.residual)
    }
    in_loop = {}
    for (part, of_part), pairs in zip(runs.items(), result.closed_loops) if result.in_closed_loop else ():
        noise = np.mean([noise_compared(run, run.loop_noise) for run in of_part], axis=0)
        errors = [after.error_rms("current") ** 2 for _, after in pairs]
        in_loop[part] = np.sqrt(np.mean(errors, axis=0)) / noise if errors else np.zeros(len(result.arm))
    return [
        Remaining(
            joint=joint,
            verdict=_verdict(result, joint),
            along={side: sizes[joint] for side, sizes in along.items() if joint in sizes},
            in_loop={side: float(sizes[joint - 1]) for side, sizes in in_loop.items()},
            known_to=None if result.known_to is None else float(result.known_to[joint - 1]),
            known_to_fitted=None if result.known_to_fitted is None else float(result.known_to_fitted[joint - 1]),
            remainder=next((remainder for remainder in result.allowed_residuals if remainder.joint == joint), None),
        )
        for joint in range(1, len(result.arm) + 1)
    ]


def _verdict(result: Diagnosis, joint: int) -> str:
    """As that of the whole, of the causes and structures at one joint."""
    if any(structure.joint == joint and structure.signal is not Signal.TRACKER for structure in result.unexplained):
        return "unexplained"
    has_cause = any(joint in (cause.joint, cause.felt_at) or joint in cause.of_joints for cause in result.causes)
    return "explained" if has_cause else "consistent"
