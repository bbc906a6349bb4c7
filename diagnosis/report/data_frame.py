"""The causes of a diagnosis as a table of pandas."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from arm_report.notebook import frame_of
from diagnosis.cause import Cause, in_words
from diagnosis.result import Diagnosis

if TYPE_CHECKING:
    import pandas

COLUMNS = (
    *("joint", "parameter", "value", "std", "unit", "confidence", "error_before", "error_after", "error_unit"),
    *("recording", "alternatives", "separate_by"),
)

TEXTS = ("parameter", "unit", "error_unit", "recording", "alternatives", "separate_by")


def causes_frame(result: Diagnosis) -> pandas.DataFrame:
    """By effect: a row per parameter of each cause, strongest cause first; without causes no rows.

    A cause whose parameters differ between recordings or joints has the rows of each.
    """
    rows = [row for cause in result.causes for row in _rows(cause)]
    attributes = {"arm": result.arm.name, "verdict": str(result.verdict)}
    return frame_of(rows, COLUMNS, "effect", attributes, whole=("joint",), texts=TEXTS)


def _rows(cause: Cause) -> Iterator[dict[str, Any]]:
    of_cause = {
        "effect": cause.effect,
        "confidence": cause.confidence,
        "error_before": cause.before,
        "error_after": cause.after,
        "error_unit": cause.unit,
        "alternatives": ", ".join(in_words(key) for key in cause.group[1:]),
        "separate_by": cause.separate_by,
    }
    sets = [
        *((cause.joint, recording, own) for recording, own in cause.of_recordings.items()),
        *((joint, None, own) for joint, own in cause.of_joints.items()),
    ]
    for joint, recording, own in sets or [(cause.joint, None, cause.parameters)]:
        for one in own:
            values = {"parameter": one.name, "value": one.value, "std": one.std, "unit": one.unit}
            yield {**of_cause, "joint": joint, "recording": recording, **values}
