"""Ripples: torques that repeat with the angle of a joint, found in what a regression leaves, and fitted beside it."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from identification.ripples.model import with_found, without_ripples
    from identification.ripples.result import Ripple
    from identification.ripples.scan import CLOSE, LEAST_CYCLES, orders_of, wave_sums, wide
    from identification.ripples.search import FINER, find_ripples
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "CLOSE",
    "FINER",
    "LEAST_CYCLES",
    "Ripple",
    "find_ripples",
    "orders_of",
    "wave_sums",
    "wide",
    "with_found",
    "without_ripples",
]
