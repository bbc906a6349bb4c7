"""How parameters moved over many results of one arm: since when, how fast, and when they will reach a limit."""

from typing import TYPE_CHECKING

from arm_io import lazy

if TYPE_CHECKING:
    from comparison.trend.forecast import Reach, State
    from comparison.trend.limits import Limit, limits_from
    from comparison.trend.movement import Movement
    from comparison.trend.outcome import Trend
    from comparison.trend.plots import histories_chart
    from comparison.trend.text import limit_sentence, sentence
    from comparison.trend.trend import trend_of
else:
    __getattr__ = lazy(__name__)

__all__ = [
    "Limit",
    "Movement",
    "Reach",
    "State",
    "Trend",
    "histories_chart",
    "limit_sentence",
    "limits_from",
    "sentence",
    "trend_of",
]
