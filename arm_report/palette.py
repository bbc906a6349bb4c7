"""The colours of reports and plots, by what they stand for."""

BEFORE, PALE_BEFORE = "#c8501e", "#f0cdbd"
"""The nominal model: without causes, before calibration; the residual. And the same behind something else."""
AFTER, PALE_AFTER = "#1f5fa8", "#bcd2ea"
"""The model as it became: extended, identified, calibrated."""
MEASURED = "#8fa1b3"
NOISE = "#e3e8ee"
"""The band that instruments alone explain."""
GRID, AXIS, EDGE = "#e6eaef", "#9aa7b5", "#b8c2cc"
"""Grid lines, the line at zero, the border between two recordings."""
SHADE = "#f3f6f9"
"""A range that is pointed out."""
JOINTS = ("#3b82c4", "#d9772b", "#2f9e6b", "#b05fc0", "#c2504d", "#8a8d2f", "#4aa5b5", "#8d6e55")
"""Joints in one plot, in their order; of more they begin again."""

DARK = {
    BEFORE: "#f08a58",
    PALE_BEFORE: "#6b4030",
    AFTER: "#6aa7ea",
    PALE_AFTER: "#2f4a6b",
    MEASURED: "#8496a8",
    NOISE: "#29333e",
    AXIS: "#65727f",
    EDGE: "#4d5966",
    SHADE: "#212a33",
}
"""The same on a dark page; what is not here serves both."""


def joint_colour(joint: int) -> str:
    """Of a joint (from 1) among others."""
    return JOINTS[(joint - 1) % len(JOINTS)]
