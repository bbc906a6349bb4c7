"""Friction over speed in words and as a picture: which joints have a curve, why, and how well it is known."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from arm_report import Chart, Panel, Series
from arm_report.palette import AFTER, BEFORE

if TYPE_CHECKING:
    from identification.regression.friction_band import FrictionBand
    from identification.result import Identification


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


def curves(result: Identification) -> Chart | None:
    """Friction of every joint over its speed, with its band and the nearest straight line; None without any."""
    joints = sorted({band.joint for band in result.friction_bands})
    if not joints:
        return None
    panels = []
    for joint in joints:
        bands = [band for band in result.friction_bands if band.joint == joint]
        speed = "rad/s" if result.arm.joints[joint - 1].revolute else "m/s"
        panels.append(
            Panel(
                series=tuple(line for band in bands for line in _lines(band)),
                title=f"joint {joint}",
                x=f"speed, {speed}",
                y=f"friction, {result.torque_unit(joint - 1)}",
                y_range=_range(bands),
                log_x=True,
                joint=joint,
            )
        )
    return Chart(
        name="friction",
        title="friction of each joint over its speed, with two standard deviations",
        panels=tuple(panels),
        columns=min(3, len(joints)),
    )


def _lines(band: FrictionBand) -> Iterator[Series]:
    colour = BEFORE if band.direction < 0 else AFTER
    name = {0: "both directions", 1: "positive", -1: "negative"}[band.direction]
    yield Series(
        x=band.speed,
        y=band.torque,
        spread=2 * band.std,
        kind="both" if band.curve else "line",
        colour=colour,
        label=name,
        width=1.4,
    )
    if band.curve:
        weight = np.sqrt(np.gradient(band.speed))
        line = np.polyval(np.polyfit(band.speed, band.torque, 1, w=weight), band.speed)
        yield Series(
            x=band.speed, y=np.asarray(line, float), colour=colour, label=f"{name}, nearest straight line", dashed=True
        )


def _range(bands: Sequence[FrictionBand]) -> tuple[float, float]:
    """From zero, or below it, to above the largest friction."""
    low = min(float(band.torque.min()) for band in bands)
    high = max(float((band.torque + np.nan_to_num(2 * band.std)).max()) for band in bands)
    high = min(high, 2.0 * max(float(band.torque.max()) for band in bands))
    return min(0.0, low), 1.1 * high if high > 0 else 1.0


def values(result: Identification) -> list[list[str]]:
    """A row per curve: its speeds, and friction there with two standard deviations."""
    rows = []
    for band in result.friction_bands:
        if band.curve:
            name = {0: "", 1: " +", -1: " -"}[band.direction]
            points = zip(band.speed, band.torque, band.std)
            known = [f"{v:.3g}: {torque:.4g} ± {2 * std:.2g}" for v, torque, std in points]
            rows.append([f"{band.joint}{name}", ", ".join(known)])
    return rows
