"""From the evidence for a cause to its stated confidence, by a table that was fitted to cases with known answers.

The p-value of a gain says how seldom chance alone gains as much. It does not say how often a name is wrong for another
reason: the arm has friction of another law, or two causes share one residual. That was counted on the bank, a table of
cases with known answers (``tests/confidence/bank.json``): the confidence is the logistic regression of "the name, or
another of its group, was right" on the features of a ``Support``, with the weights of ``confidence.json``.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from arm_io import read_text
from arm_model.effects import CATALOGUE
from diagnosis.cause import Cause, Signal, Support

TABLE = Path(__file__).with_name("confidence.json")
SIGNALS = (Signal.CURRENT, Signal.ANGLE, Signal.CLOSED_LOOP)
"""Signals of the causes in the bank.

The confidence in causes that a tracker or link encoders show is 1 - p, at most the largest success rate of the bank.
"""
LARGEST = 1e3
"""Largest gain, and ratio of a parameter to its std, that is distinguished from a larger one."""
DETERMINED = 3.0, 50.0
"""Ratios of a parameter to its std between which the confidence depends on them: below, the parameter may be 0; above,
it is known to 2 %, and the error of its law is as large."""
NOISE_RATIOS = 1.0, 5.0
"""Residuals over the noise between which the confidence depends on them: no case of the bank has a larger one."""
UNCOUNTED = 0.5
"""Largest confidence where the residual over the noise is larger than in any case of the bank."""


def features(support: Support) -> tuple[float, ...]:
    """The features of the logistic regression, in the order of the table's weights: logarithms of ratios.

    A cause that explains little beside a large one may be an error of the law of that one. The number of named causes
    is no feature: in the bank it identifies the arms with one hidden effect.
    """
    gain, largest = _between(support.gain, (1.0, LARGEST)), _between(support.largest, (1.0, LARGEST))
    return gain, largest - gain, _between(support.determined, DETERMINED), _between(support.left, NOISE_RATIOS)


def _between(ratio: float, limits: tuple[float, float]) -> float:
    """Logarithm of a ratio, or of the nearest limit."""
    return math.log(min(max(ratio, limits[0]), limits[1]))


def support_of(cause: Cause, largest: float, noise_ratios: Mapping[int, float], unexplained: int) -> Support:
    """The evidence for a cause.

    largest: gain of any cause; noise_ratios: joint (from 1) -> rms residual over the noise
    """
    return Support(
        significance=cause.confidence,
        gain=gain_of(cause),
        largest=largest,
        determined=determined(cause),
        left=noise_ratios.get(cause.felt_at or 0, 1.0),
        unexplained=unexplained,
    )


def gain_of(cause: Cause) -> float:
    """Rms residual without the cause over that with it."""
    return cause.before / cause.after if cause.after > 0 else LARGEST


def determined(cause: Cause) -> float:
    """Largest of the parameters of a cause over the std that chance alone gives them.

    The stated std also has the relative error of the effect's law, however well the recordings determine a value.
    """
    effect = CATALOGUE[cause.effect]
    erring = {p.name: p.erring for p in effect.parameters if not (p.whole or p.own or p.lasts or p.coarse)}
    ratios = []
    for p in cause.parameters:
        if p.std > 0:
            of_law = effect.model_error * erring[p.name](p.value) if p.name in erring else 0.0
            by_chance = p.std**2 - of_law**2
            ratios.append(abs(p.value) / math.sqrt(by_chance) if by_chance > (p.value / LARGEST) ** 2 else LARGEST)
    return max(ratios, default=LARGEST)


def with_confidence(causes: Sequence[Cause], noise_ratios: Mapping[int, float], unexplained: int) -> list[Cause]:
    """The causes with their calibrated confidence, at most 1 - p of their gain.

    For signals without cases in the bank it is at most the largest success rate in it.
    """
    rated = []
    largest = max((gain_of(cause) for cause in causes if cause.signal in SIGNALS), default=1.0)
    for cause in causes:
        if cause.signal in SIGNALS:
            support = support_of(cause, largest, noise_ratios, unexplained)
            cause = replace(
                cause, confidence=min(support.significance, calibrated_confidence(support)), support=support
            )
        else:
            cause = replace(cause, confidence=min(cause.confidence, _table()["most"]))
        rated.append(cause)
    return rated


def calibrated_confidence(support: Support) -> float:
    """Share of correct names among the bank's cases with similar evidence."""
    return success_rate(_table(), support)


def success_rate(table: Mapping[str, Any], support: Support) -> float:
    """The success rate by a table: the logistic curve of the score, limited to what other cases confirmed."""
    score = table["constant"] + float(np.dot(table["weights"], features(support)))
    most = float(table["most"]) if support.left <= NOISE_RATIOS[1] else UNCOUNTED
    return round(min(1.0 / (1.0 + math.exp(-score)), most), 3)


@cache
def _table() -> dict[str, Any]:
    content: dict[str, Any] = json.loads(read_text(TABLE))
    return content
