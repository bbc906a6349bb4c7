"""Diagnosis of a floating base: which of its parameters, thrusters or the arm's reaction the recordings contradict."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from diagnosis.floating_base.diagnose import diagnose_base
    from diagnosis.floating_base.result import THRUSTER_HEAD, BaseDiagnosis
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "THRUSTER_HEAD",
    "BaseDiagnosis",
    "diagnose_base",
]
