"""Experiments that discriminate between rival causes or make an effect detectable."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from diagnosis.experiments.discriminating import Separation, separations
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "Separation",
    "separations",
]
