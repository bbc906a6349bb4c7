"""The reliability diagram: stated confidence against the share of names that were right, each by the other cases."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import beta

from arm_report.picture_file import save_picture

Array = np.ndarray


def draw(path: Path, rows: Sequence[tuple[str, str, list[tuple[float, int, int]]]]) -> None:
    """rows: label, colour and (stated, names, right names) per range of confidence."""
    figure = Figure(figsize=(5.2, 4.6), layout="constrained")
    axes = figure.add_subplot()
    axes.plot([0, 1], [0, 1], color="0.7", linewidth=1, zorder=0)
    least = 1.0
    for label, colour, points in rows:
        stated, names, hits = (np.array(column) for column in zip(*points))
        right = hits / names
        low = np.nan_to_num(beta.ppf(0.025, hits, names - hits + 1), nan=0.0)
        high = np.where(hits == names, 1.0, beta.ppf(0.975, hits + 1, names - hits))
        bars = [right - low, high - right]
        axes.errorbar(stated, right, bars, fmt="o", color=colour, capsize=3, label=f"{label} ({names.sum()} names)")
        for at, (x, y, count) in enumerate(zip(stated, right, names)):
            away, align = (6, "left") if (len(points) - at) % 2 else (-6, "right")
            words = {"textcoords": "offset points", "ha": align, "fontsize": 7, "color": colour}
            axes.annotate(str(count), (x, y), (away, -10), **words)
        least = min(least, low.min(), stated.min())
    start = np.floor(10 * least) / 10
    axes.set(xlim=(start, 1.03), ylim=(start, 1.03))
    axes.set(xlabel="stated confidence", ylabel="share of names that were right")
    axes.legend(loc="upper left", frameon=False, fontsize=8)
    save_picture(figure, path)
