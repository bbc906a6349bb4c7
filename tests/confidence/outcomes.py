"""What diagnoses stated of their names in cases that the bank has not, against how many of them were right.

Files are those that ``tests.blind --out`` and ``tests.foreign.proving_ground --out`` write. Nothing is fitted to them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from tests.confidence.cross_validation import chances

BANDS = (0.0, 0.6, 0.9, 0.955, 1.0)
"""Confidences between which names are counted together, as in docs/diagnosis-evidence.md."""
Array = np.ndarray


def stated(paths: Sequence[Path]) -> tuple[Array, Array]:
    """(n,) confidences of all names in these files, and 1.0 where the name was right; no ripples of healthy arms."""
    outcomes = [one for path in paths for one in json.loads(path.read_text(encoding="utf-8"))["outcomes"]]
    names = [name for outcome in outcomes for name in _names(outcome)]
    confidence, right = np.array(names, float).reshape(-1, 2).T
    return confidence, right


def _names(outcome: Mapping[str, Any]) -> list[tuple[float, bool]]:
    """Confidence of each name, and whether it was right."""
    if "protocol" not in outcome:  # of tests.blind
        return [(confidence, right) for confidence, right in outcome["confidence"]]
    named = zip(outcome["named"], outcome["owned"])
    return [(confidence, right) for (_, _, confidence, right), its_own in named if not its_own]


def counted(confidence: Array, right: Array) -> dict[str, float]:
    """Flat figures: names, right names and expected right names of each band that has a name, and of all.

    confidence, right: (n,)
    """
    figures: dict[str, float] = {}
    for least, most in pairwise(BANDS):
        band = (confidence >= least) & ((confidence < most) | (most == BANDS[-1]))
        if band.any():
            figures |= _figures(f"from_{least:g}_", confidence[band], right[band])
    few, many = chances(confidence, right)
    of_all = {"so_few_by_chance": round(few, 3), "so_many_by_chance": round(many, 3)}
    return figures | _figures("", confidence, right) | of_all


def _figures(label: str, confidence: Array, right: Array) -> dict[str, float]:
    expected = round(float(confidence.sum()), 1)
    return {f"{label}names": len(right), f"{label}right": int(right.sum()), f"{label}expected": expected}
