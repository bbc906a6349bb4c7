"""Standard deviations of normal errors from medians, which outliers hardly move."""

MAD_TO_STD = 1.4826
"""Std of normal errors over their median absolute value: 1 / Phi^-1(3/4)."""
MEDIAN_OF_NORM = 1.5382
"""Median length of a standard normal vector in three dimensions: root of the median of chi-squared with 3 degrees."""
