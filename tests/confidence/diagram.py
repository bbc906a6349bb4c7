"""The reliability diagram: stated confidence against the share of names that were right, on the half not fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import beta

Array = np.ndarray


def draw(path: Path, rows: Sequence[tuple[str, str, list[tuple[float, float, int]]]]) -> None:
    """rows: label, colour and (stated, right, names) per range of confidence."""
    figure = Figure(figsize=(5.2, 4.6), layout="constrained")
    axes = figure.add_subplot()
    axes.plot([0, 1], [0, 1], color="0.7", linewidth=1, zorder=0)
    for label, colour, points in rows:
        stated, right, names = (np.array(column) for column in zip(*points))
        hits = np.rint(right * names)
        low, high = beta.ppf(0.025, hits, names - hits + 1), beta.ppf(0.975, hits + 1, names - hits)
        bars = np.abs(np.nan_to_num([low, high], nan=0.0) - right)
        bars[1, hits == names] = 0.0
        axes.errorbar(stated, right, bars, fmt="o", color=colour, capsize=3, label=f"{label} ({names.sum()} names)")
        for x, y, count in zip(stated, right, names):
            axes.annotate(str(count), (x, y), (6, -10), textcoords="offset points", fontsize=7, color=colour)
    axes.set(xlim=(0, 1.06), ylim=(-0.06, 1.03), xlabel="stated confidence", ylabel="share of names that were right")
    axes.legend(loc="upper left", frameon=False, fontsize=8)
    figure.savefig(path, metadata={"Date": None})
