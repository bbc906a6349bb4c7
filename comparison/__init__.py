"""What changed between two recordings, results, or groups of them, of one arm."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from comparison.change import Change, Estimate, Quantity
    from comparison.from_recordings import compare_recordings
    from comparison.outcome import Comparison, Threshold
    from comparison.significance import moderate
    from comparison.stored.from_results import Stored, compare_results, estimates_of, read_result
    from diagnosis import in_words
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "Change",
    "Comparison",
    "Estimate",
    "Quantity",
    "Stored",
    "Threshold",
    "compare_recordings",
    "compare_results",
    "estimates_of",
    "in_words",
    "moderate",
    "read_result",
]
