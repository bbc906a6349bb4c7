"""What changed between two recordings, results, or groups of them, of one arm."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from comparison.change import Change, Quantity
    from comparison.diagnosed_causes import cause_in_words
    from comparison.from_recordings import compare_recordings
    from comparison.from_results import Stored, compare_results, read_result
    from comparison.outcome import Comparison, Threshold
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "Change",
    "Comparison",
    "Quantity",
    "Stored",
    "Threshold",
    "cause_in_words",
    "compare_recordings",
    "compare_results",
    "read_result",
]
