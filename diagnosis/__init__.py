"""Measured against simulated -> causes -> extended model -> gain; the report."""

from diagnosis.against_noise import against_noise, left_over
from diagnosis.cause import Cause, in_words
from diagnosis.diagnose import Diagnosis, check_recordings, diagnose

__all__ = [
    "Cause",
    "Diagnosis",
    "against_noise",
    "check_recordings",
    "diagnose",
    "in_words",
    "left_over",
]
