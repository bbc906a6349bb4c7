"""What a model predicts for recordings, without fitting anything: the measure by which identifications are judged."""

from __future__ import annotations

from collections.abc import Sequence

from arm_io.types import Progress
from arm_model import Arm
from daq.recording import Recording
from identification.conclusion.predictions import predictions_of
from identification.regression.equations import measured_rows, shown_rows
from identification.regression.problem import motions_of
from identification.result import Prediction


def predict(recordings: Sequence[Recording], arm: Arm, *, progress: Progress = lambda _: None) -> list[Prediction]:
    """Measured and predicted torque of each recording, reversals and all, N m (N) through the same filter.

    InputError where a recording does not belong to the arm.
    """
    _, motions, _ = motions_of([], recordings, arm, progress)
    progress("inverse dynamics")
    return predictions_of(measured_rows(motions), shown_rows(arm, arm, motions), recordings, True)
