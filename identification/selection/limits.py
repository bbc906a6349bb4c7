"""Thresholds: one instance per measurement model, written into diagnosis.json (a calibration's: kinematics.json)."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Thresholds:
    """Thresholds of one measurement model.

    systematic  relative std of a parameter from the measurement model itself (first-order columns, filters), in
                addition to that of the data
    """

    systematic: float = 0.02

    def to_json(self) -> dict[str, Any]:
        """The thresholds that are applied, by name."""
        return {name: value for name, value in asdict(self).items() if value is not None}


@dataclass(frozen=True, kw_only=True)
class Limits(Thresholds):
    """What a cause must satisfy; None: not applied by this measurement model.

    max_causes    causes, and rounds of the search, at most
    fdr           false-discovery rate at which a candidate may enter, over all candidates of its round that
                  extend a chosen one, or over all others (Benjamini & Hochberg)
    final_fdr     ... at which it may stay, conditional on all others, once nothing more enters
    min_gain      least gain that matters, as a share of the model's reference energy (see the model)
    kept_gain     the same for a cause that is chosen already: below it, it is eliminated; None: no backward elimination
    tie           candidates whose gains differ by less than this share are equal: the one with the fewest coefficients
                  enters
    ambiguity     share of the gain of a chosen cause from which on another candidate may be in its ambiguity group
    attempts      candidates that are tried in one round, if those before them turn out not to be admissible once
                  refitted
    block_seconds s: length of the blocks whose gains are taken for independent: several times the longest correlation
                  of the residual
    independent   singular value below which columns of unit length count as dependent
    """

    max_causes: int
    fdr: float | None = 0.05
    final_fdr: float | None = None
    min_gain: float
    kept_gain: float | None
    tie: float = 0.0
    ambiguity: float = 1.0
    attempts: int = 1
    block_seconds: float = 1.0
    independent: float = 1e-5
