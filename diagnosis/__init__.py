"""Measured against simulated -> causes -> extended model -> gain; the report."""

from diagnosis.cause import Cause, Structure, Undetectable, in_words
from diagnosis.diagnose import check_recordings, diagnose
from diagnosis.remainder.against_noise import against_noise
from diagnosis.remainder.of_identification import left_over
from diagnosis.result import Diagnosis

__all__ = [
    "Cause",
    "Diagnosis",
    "Structure",
    "Undetectable",
    "against_noise",
    "check_recordings",
    "diagnose",
    "in_words",
    "left_over",
]
