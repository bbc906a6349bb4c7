"""Events in raw rows and checks for plausibility, before anything is fitted."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from diagnosis.screening.cleaned import screened
    from diagnosis.screening.residuals import residuals_of
    from diagnosis.screening.stretches import examined
    from diagnosis.screening.time_split import split
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "examined",
    "residuals_of",
    "screened",
    "split",
]
