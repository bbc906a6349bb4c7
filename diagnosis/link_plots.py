"""Motor less link encoder, as a person should see it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from diagnosis.link_causes import LinkSide

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BEFORE, AFTER = "#c8501e", "#1f5fa8"
AGAINST = {
    "joint_compliance": ("load", "load, N m (N)"),
    "gear_ripple": ("q", "angle of the joint, rad (m)"),
    "encoder_ripple": ("q", "angle of the joint, rad (m)"),
    "joint_zero_offset": ("q", "angle of the joint, rad (m)"),
}
"""The variable that shows a cause best; velocity otherwise."""


def link_figure(link: LinkSide, effect: str, joint: int) -> tuple[Figure, str]:
    """Held-out difference of one joint's encoders over its angle (the loop) and over the telling variable, before and after all causes."""
    from matplotlib.figure import Figure

    k = int(np.flatnonzero(link.seen.joints == joint)[0])
    field, label = AGAINST.get(effect, ("v", "velocity, rad/s (m/s)"))
    panels = [("q", "angle of the joint, rad (m)"), *([(field, label)] if field != "q" else [])]
    figure = Figure(figsize=(10.5, 3.2), layout="constrained")
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for axis, (name, text) in zip(axes, panels):
        x = getattr(link.seen, name)[:, k]
        for values, colour, when in ((link.without, BEFORE, "before"), (link.left, AFTER, "after all causes")):
            axis.plot(x, values[:, k] * 1e3, ".", ms=1.6, color=colour, label=when)
        axis.set_xlabel(f"{text} of joint {joint}")
        axis.grid(color="#e6eaef")
    axes[0].set_ylabel(f"motor less link encoder\nof joint {joint}, mrad (mm)")
    axes[0].legend(loc="upper right", fontsize="small", markerscale=5)
    return figure, f"motor less link encoder of joint {joint} against {panels[-1][1]}"
