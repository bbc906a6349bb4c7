"""Friction over speed in words and as a picture: which joints have a curve, why, and how well it is known."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from arm_report import table
from arm_report.palette import AFTER, BEFORE, GRID

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from identification.regression.friction_band import FrictionBand
    from identification.result import Identification

EXPLAINED = (
    "Friction against the motion over speed, as <i>model.toml</i> has it: viscous and Coulomb friction, and the curve "
    "of <code>[joint.friction_curve]</code> where the held-out data justify one. The band is two standard deviations. "
    "Dashed: the nearest straight line, which is Coulomb and viscous friction alone."
)


def sentences(result: Identification) -> list[str]:
    """Per joint whose friction is a curve or was tried as one: what was chosen, and by what held-out errors."""
    curved = {band.joint: band for band in result.friction_bands if band.curve}
    trials = {trial["joint"]: trial for trial in result.extra.get("friction_trials", [])}
    said = []
    for joint in sorted({*curved, *trials}):
        trial, unit = trials.get(joint), result.torque_unit(joint - 1)
        errors = "" if trial is None else f"{trial['straight']:.3g} -> {trial['curve']:.3g} {unit}"
        if joint not in curved:
            said.append(
                f"friction of joint {joint}: Coulomb and viscous (a curve is not justified: held-out error while it "
                f"slides {errors})"
            )
            continue
        speed = curved[joint].speed
        per = "rad/s" if result.arm.joints[joint - 1].revolute else "m/s"
        why = "as in the model" if trial is None else f"held-out error while it slides {errors}"
        said.append(
            f"friction of joint {joint}: a curve of free shape through {len(speed)} speeds from {speed[0]:.2g} to "
            f"{speed[-1]:.2g} {per} ({why})"
        )
    return said


def curves(result: Identification) -> Iterator[tuple[Figure, str]]:
    """Friction of every joint over its speed, with its band and the nearest straight line."""
    from matplotlib.figure import Figure

    joints = sorted({band.joint for band in result.friction_bands})
    if not joints:
        return
    rows = -(-len(joints) // 3)
    figure = Figure(figsize=(10.5, 0.4 + 2.6 * rows), layout="constrained")
    axes = figure.subplots(rows, min(3, len(joints)), squeeze=False).ravel()
    for axis, joint in zip(axes, joints):
        for band in result.friction_bands:
            if band.joint == joint:
                _draw(axis, band)
        speed = "rad/s" if result.arm.joints[joint - 1].revolute else "m/s"
        axis.set_title(f"joint {joint}", loc="left", fontsize="small")
        axis.set(xlabel=f"speed, {speed}", ylabel=f"friction, {result.torque_unit(joint - 1)}")
        axis.grid(color=GRID)
        axis.legend(fontsize="x-small")
    for axis in axes[len(joints) :]:
        axis.set_axis_off()
    yield figure, "friction of each joint over its speed, with two standard deviations"


def _draw(axis: Any, band: FrictionBand) -> None:
    colour = BEFORE if band.direction < 0 else AFTER
    name = {0: "both directions", 1: "positive", -1: "negative"}[band.direction]
    marks: dict[str, Any] = {"marker": "o", "ms": 3.0} if band.curve else {}
    axis.plot(band.speed, band.torque, color=colour, lw=1.4, label=name, **marks)
    axis.fill_between(
        band.speed, band.torque - 2 * band.std, band.torque + 2 * band.std, color=colour, alpha=0.25, lw=0
    )
    if band.curve:
        weight = np.sqrt(np.gradient(band.speed))
        line = np.polyval(np.polyfit(band.speed, band.torque, 1, w=weight), band.speed)
        axis.plot(band.speed, line, color=colour, lw=0.9, ls="--")
    axis.set_xscale("log")
    top = 1.2 * float(band.torque.max())
    axis.set_ylim(min(0.0, float(band.torque.min())), max(top, axis.get_ylim()[1]) if band.direction < 0 else top)


def values(result: Identification) -> str:
    """A table of every curve: its speeds, and friction there with two standard deviations."""
    rows = []
    for band in result.friction_bands:
        if band.curve:
            name = {0: "", 1: " +", -1: " -"}[band.direction]
            points = zip(band.speed, band.torque, band.std)
            known = [f"{v:.3g}: {torque:.4g} ± {2 * std:.2g}" for v, torque, std in points]
            rows.append([f"{band.joint}{name}", ", ".join(known)])
    return table(rows, ("joint", "speed: friction ± 2 std"), ()) if rows else ""
