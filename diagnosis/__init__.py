"""Measured against simulated -> causes -> extended model -> gain; the report."""

from diagnosis.cause import Cause, in_words
from diagnosis.diagnose import Diagnosis, diagnose

__all__ = [
    "Cause",
    "Diagnosis",
    "diagnose",
    "in_words",
]
