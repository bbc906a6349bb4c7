"""Friction over speed in words and as a picture: which joints have a curve, why, and how well it is known."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from arm_report import Chart, Panel, Series
from arm_report.numbers import with_two_std
from arm_report.palette import AFTER, BEFORE

if TYPE_CHECKING:
    from identification.friction_band import FrictionBand
    from identification.result import Identification


def sentences(result: Identification) -> list[str]:
    """Per joint what law its friction has over speed, load and temperature, and by what held-out errors."""
    return [*_signs(result), *_over_speed(result).values(), *(_depends(result, one) for one in _dependences(result))]


def in_short(result: Identification) -> list[str]:
    """``sentences``, but joints whose friction the held-out data leave as it is are named together."""
    of_joint, plain = _over_speed(result), _plain(result)
    lines = _signs_in_short(result)
    lines += [sentence for joint, sentence in of_joint.items() if joint not in plain or len(plain) == 1]
    if len(plain) > 1:
        joints = ", ".join(map(str, plain))
        lines.append(
            f"friction of joints {joints}: Coulomb and viscous (a curve is not justified by the held-out rows)"
        )
    lines += [_depends(result, one) for one in _dependences(result) if one["stays"]]
    for on in dict.fromkeys(one["on"] for one in _dependences(result)):
        absent = [one for one in _dependences(result) if one["on"] == on and not one["stays"]]
        if len(absent) == 1:
            lines.append(_depends(result, absent[0]))
        elif absent:
            joints = ", ".join(str(one["joint"]) for one in absent)
            lines.append(
                f"friction of joints {joints} over {on}: not in the model (not justified by the held-out rows)"
            )
    return lines


def _signs(result: Identification) -> list[str]:
    """Joints whose friction seems to change its sign more sharply than the model said, and by what held-out errors."""
    lines = []
    for one in result.extra.get("sign_velocities", []):
        revolute, unit = result.arm.joints[one["joint"] - 1].revolute, result.torque_unit(one["joint"] - 1)
        lines.append(
            f"friction of joint {one['joint']} {'changes' if one['stays'] else 'may change'} its sign over "
            f"{1e3 * one['found']:.2g} {'mrad/s' if revolute else 'mm/s'}, {1e3 * one['model']:.2g} in the model"
            f"{'' if one['stays'] else '; not changed there, the standard deviations allow for it'} (held-out error "
            f"while it slides {one['before']:.3g} -> {one['after']:.3g} {unit})"
        )
    return lines


def _signs_in_short(result: Identification) -> list[str]:
    """``_signs``, but joints at which it was not changed are named together."""
    found = list(zip(result.extra.get("sign_velocities", []), _signs(result), strict=True))
    left = [one["joint"] for one, _ in found if not one["stays"]]
    lines = [sentence for one, sentence in found if one["stays"] or len(left) == 1]
    if len(left) > 1:
        lines.append(
            f"friction of joints {', '.join(map(str, left))} may change its sign more sharply than in the model: not "
            "changed there, the standard deviations allow for it"
        )
    return lines


def _dependences(result: Identification) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = result.extra.get("friction_dependence", [])
    return found


def _plain(result: Identification) -> list[int]:
    """Joints for which a curve was tried and not kept."""
    curved = {band.joint for band in result.friction_bands if band.curve}
    return sorted({trial["joint"] for trial in result.extra.get("friction_trials", [])} - curved)


def _over_speed(result: Identification) -> dict[int, str]:
    """Joint -> what law its friction has over speed, and by what held-out errors."""
    curved = {band.joint: band for band in result.friction_bands if band.curve}
    trials = {trial["joint"]: trial for trial in result.extra.get("friction_trials", [])}
    sentences = {}
    for joint in sorted({*curved, *trials}):
        trial, unit = trials.get(joint), result.torque_unit(joint - 1)
        errors = ""
        if trial is not None and trial["straight"] is not None:
            errors = f"held-out error while it slides {trial['straight']:.3g} -> {trial['curve']:.3g} {unit}"
        why = "" if trial is None else trial["why"]
        if joint not in curved:
            sentences[joint] = (
                f"friction of joint {joint}: Coulomb and viscous (a curve is not justified: "
                f"{', '.join(filter(None, (errors, why)))})"
            )
            continue
        speed = curved[joint].speed
        per = "rad/s" if result.arm.joints[joint - 1].revolute else "m/s"
        source = errors or "as in the model"
        sentences[joint] = (
            f"friction of joint {joint}: a curve of free shape through {len(speed)} speeds from {speed[0]:.2g} to "
            f"{speed[-1]:.2g} {per} ({source})"
        )
    return sentences


def _depends(result: Identification, one: Mapping[str, Any]) -> str:
    """What friction of a joint does over its load or its temperature, or why nothing is said about it."""
    joint, on = one["joint"], one["on"]
    if not one["stays"]:
        return f"friction of joint {joint} over {on}: not in the model ({one['why']})"
    parts = [_size(result, f"joint{joint}.{name}", given) for name, given in one["parameters"].items()]
    at = f"; the rest holds at {one['temperature']:g} degC" if "temperature" in one else ""
    return f"friction of joint {joint} over {on}: {', '.join(parts)} ({one['why']}{at})"


def _size(result: Identification, name: str, given: Mapping[str, float]) -> str:
    """'mu 0.0498 +- 0.0004', of an effect's parameter, with two standard deviations and its unit."""
    unit = next(value.unit for value in result.parameters if value.name == name)
    size = f"{name.rpartition('.')[2]} {with_two_std(given['value'], given['std'])}"
    return size if unit == "1" else f"{size} {unit}"


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
        two_std=2 * band.std,
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
            known = [f"{v:.3g}: {with_two_std(torque, std, mark='±')}" for v, torque, std in points]
            rows.append([f"{band.joint}{name}", ", ".join(known)])
    return rows
