"""A motion before it runs: joint positions, the way of the tool in three views, and the least distance over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from arm_clearance.chain import Chain
from arm_clearance.pairs import pairs_of
from arm_clearance.space import Space
from arm_io.types import Array
from experiment import Demand

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ROWS = 1500
"""Instants that are drawn."""
POSES = 9
"""Of the arm that are drawn."""
VIEWS = (("x", "y", "from above"), ("x", "z", "from the side (-y)"), ("y", "z", "from the front (+x)"))
TOOL, LINKS, BOX, LIMIT = "C0", "0.55", "C3", "0.3"


def picture(demand: Demand, chain: Chain, space: Space | None, limits: Array | None = None) -> Figure:
    """A figure of a motion.

    limits  (n, 2) rad (m) of position that are drawn beside the joint positions; None: the model's
    """
    from matplotlib.figure import Figure

    t = np.linspace(0.0, demand.duration, ROWS)
    q = demand(t)
    figure = Figure(figsize=(13, 10), layout="constrained")
    rows = figure.subplots(3, 1, height_ratios=(3, 4, 2), subplot_kw={"visible": False})
    grid = rows[0].get_gridspec()
    for axis in rows:
        axis.remove()
    _joints(figure.add_subplot(grid[0]), t, q, chain.limits if limits is None else limits)
    views = grid[1].subgridspec(1, len(VIEWS))
    for number, view in enumerate(VIEWS):
        _view(figure.add_subplot(views[number]), q, chain, space, view)
    _distance(figure.add_subplot(grid[2]), t, q, chain, space)
    return figure


def _joints(axis: Axes, t: Array, q: Array, limits: Array) -> None:
    """Each joint's share of its range: all of them fit on one scale, and a limit is the edge."""
    low, high = limits.T
    shares = 100 * (q - low) / (high - low)
    for joint, share in enumerate(shares.T, 1):
        axis.plot(t, share, lw=1, label=f"joint {joint}")
    for edge in (0, 100):
        axis.axhline(edge, color=LIMIT, ls="--", lw=1)
    axis.set(xlabel="t [s]", ylabel="position\n[% of its range]", xlim=(t[0], t[-1]))
    if axis.get_legend_handles_labels()[0]:  # a joint alone has nothing to keep clear of
        axis.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5))
    axis.grid(alpha=0.3)


def _view(axis: Axes, q: Array, chain: Chain, space: Space | None, view: tuple[str, str, str]) -> None:
    from matplotlib.patches import Rectangle

    across, up, name = view
    k = ["xyz".index(across), "xyz".index(up)]
    count = len(chain.bodies)
    points = chain.points(q)[:, :, k]
    for pose in points[:: max(1, len(q) // POSES)]:
        for body in range(count):
            axis.plot(*pose[[body, count + body]].T, color=LINKS, lw=2, alpha=0.4, solid_capstyle="round")
    axis.plot(*points[:, -1].T, color=TOOL, lw=1)
    axis.plot(*points[0, -1], "o", color=TOOL, ms=5)
    for box in space.box if space else ():
        low, high = np.array(box.low)[k], np.array(box.high)[k]
        axis.add_patch(Rectangle((low[0], low[1]), *(high - low), fc=BOX, ec=BOX, alpha=0.25))
        axis.annotate(box.name, (low + high) / 2, ha="center", va="center", fontsize="small")
    if space is not None and space.low is not None and space.high is not None:
        low, high = np.array(space.low)[k], np.array(space.high)[k]
        axis.add_patch(Rectangle((low[0], low[1]), *(high - low), fill=False, ec=LIMIT, ls="--"))
    axis.autoscale_view()
    if space is not None and space.floor is not None and up == "z":
        bottom = min(axis.get_ylim()[0], space.floor - 0.05)
        axis.axhspan(bottom, space.floor, color=BOX, alpha=0.25, lw=0)
    axis.set(xlabel=f"{across} [m]", ylabel=f"{up} [m]", title=name, aspect="equal")
    axis.set_adjustable("datalim")
    axis.grid(alpha=0.3)


def _distance(axis: Axes, t: Array, q: Array, chain: Chain, space: Space | None) -> None:
    """Of each kind of obstacle the least; without a space, of the links from each other and how high the lowest is."""
    pairs = pairs_of(chain, space or Space(floor=0.0))
    clearance = pairs.clearance(q)
    kinds: dict[str, list[int]] = {}
    for number, (_, other) in enumerate(pairs.names()):
        kinds.setdefault("another link" if other.startswith("link") else other, []).append(number)
    for other, columns in kinds.items():
        label = "height above z = 0" if space is None and other == "the floor" else f"from {other}"
        axis.plot(t, clearance[:, columns].min(axis=1), lw=1, label=label)
    if space is not None:
        axis.axhline(space.margin, color=LIMIT, ls="--", lw=1, label="margin")
    axis.set(xlabel="t [s]", ylabel="least distance [m]", xlim=(t[0], t[-1]))
    if axis.get_legend_handles_labels()[0]:  # a joint alone has nothing to keep clear of
        axis.legend(fontsize="small", loc="center left", bbox_to_anchor=(1.0, 0.5))
    axis.grid(alpha=0.3)
