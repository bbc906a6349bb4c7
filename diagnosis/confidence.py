"""From the evidence for a cause to its stated confidence, by a table that was fitted to cases with known answers.

The p-value of a gain says how seldom chance alone gains as much. It does not say how often a name is wrong for another
reason: the arm has friction of another law, or two causes share one residual. That was counted on a bank of cases
(``tests/confidence``). The score is the logistic regression of "the name was right" on the features of a ``Support``;
``confidence.json`` has the weights, and per range of the score the share of right names, made monotone. Names beside
what stays unexplained are counted for themselves.
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
from diagnosis.cause import Cause, Signal, Support

TABLE = Path(__file__).with_name("confidence.json")
SIGNALS = (Signal.CURRENT, Signal.ANGLE, Signal.CLOSED_LOOP)
"""Of causes that the bank has cases of.

Confidence in what tracker and link encoders show is 1 - p, and no larger than the largest that was counted.
"""
LEFT = 2.0
"""Times the noise that may be left at a cause's joint; beyond, its name stands beside something unexplained."""
LARGEST = 1e3
"""Of a ratio: what is beyond says no more."""


def features(support: Support) -> tuple[float, ...]:
    """Of the regression, in the order of the table's weights."""
    ratios = support.gain, support.left, support.sureness
    gain, left, sureness = (math.log(min(max(ratio, 1.0), LARGEST)) for ratio in ratios)
    return gain, left, sureness, math.log(support.names), float(min(support.unexplained, 3))


def support_of(cause: Cause, left: Mapping[int, float], names: int, unexplained: int) -> Support:
    """The evidence for a cause among several; left: joint (from 1) -> rms of what remains over the noise."""
    return Support(
        significance=cause.confidence,
        gain=cause.before / cause.after if cause.after > 0 else LARGEST,
        left=left.get(cause.felt_at or 0, 1.0),
        sureness=max((abs(p.value) / p.std for p in cause.parameters if p.std > 0), default=LARGEST),
        names=names,
        unexplained=unexplained,
    )


def stated(causes: Sequence[Cause], left: Mapping[int, float], unexplained: int) -> list[Cause]:
    """The causes with the confidence that names with such evidence deserve: at most 1 - p of their gain.

    What no case of the bank shows is stated with no larger confidence than was counted anywhere.
    """
    found = []
    for cause in causes:
        if cause.signal in SIGNALS:
            support = support_of(cause, left, len(causes), unexplained)
            cause = replace(cause, confidence=min(support.significance, deserved(support)), support=support)
        else:
            cause = replace(cause, confidence=min(cause.confidence, _table()["steps"][-1]["confidence"]))
        found.append(cause)
    return found


def deserved(support: Support) -> float:
    """Share of the bank's names with such evidence that were right."""
    return counted(_table(), support)


def beside_unexplained(support: Support) -> bool:
    """Whether structure remains that no effect explains, or much more than noise is left at the joint."""
    return support.unexplained > 0 or support.left > LEFT


def counted(table: Mapping[str, Any], support: Support) -> float:
    """Of a table: what its steps state; beside what is unexplained, no more than the share of such names."""
    score = table["constant"] + float(np.dot(table["weights"], features(support)))
    steps = [step["confidence"] for step in table["steps"] if step["from"] <= score]
    stated = float(steps[-1] if steps else table["steps"][0]["confidence"])
    return min(stated, float(table["beside"]["confidence"])) if beside_unexplained(support) else stated


@cache
def _table() -> dict[str, Any]:
    content: dict[str, Any] = json.loads(read_text(TABLE))
    return content
