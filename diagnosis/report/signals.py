"""Errors of simulated signals, joint by joint, as diagnosis.json has them."""

from __future__ import annotations

from typing import Any

import numpy as np

from arm_io.parallel import in_parallel
from arm_io.types import Array
from diagnosis.measurements.currents.design_matrix import dataset_of
from diagnosis.remainder.against_noise import ratios
from diagnosis.remainder.predictable import predictable
from diagnosis.residual.comparable_rows import noise_compared
from diagnosis.result import Diagnosis
from identification.selection import Split

WHEN = ("before", "after")


def signal_rows(result: Diagnosis) -> list[dict[str, Any]]:
    """Errors of simulated signals with the noise of the instruments."""
    return [*_currents(result), *_positions(result), *_link_signals(result), *_tracker_signal(result)]


def _currents(result: Diagnosis) -> list[dict[str, Any]]:
    """In closed loop, or else along the measured motion; with the residual's ratio to the noise, and structure."""
    in_loop = result.in_closed_loop
    errors = _of_loop(result, "current") if in_loop else result.along_motion
    noise = np.mean([noise_compared(run, run.noise) for run in result.held_out], axis=0)
    rows = _of_joints(result, "current", "A", errors, noise, "demands" if in_loop else "measured motion")
    if not result.judged:
        return rows
    fit, held_out = dataset_of(result.fit), dataset_of(result.held_out)
    residuals = [Split(fit.y, held_out.y), result.residual]
    shares = in_parallel(lambda of: predictable(fit, held_out, of.fit, of.held_out, result.arm).round(4), residuals)
    before, after = ({one.joint: one for one in ratios(result.held_out, of.held_out)} for of in residuals)
    for row in rows:
        joint = row["joint"]
        row["noise_ratio"] = dict.fromkeys(WHEN)
        if joint in after:
            ratio = before[joint].ratio
            if ratio <= 1.0:
                # what repeats evenly looks like noise, unless causes show how little of it is
                ratio = max(ratio, before[joint].error / after[joint].floor)
            row["noise_ratio"] = dict(zip(WHEN, (ratio, after[joint].ratio)))
        row["predictable"] = dict(zip(WHEN, (float(share[joint - 1]) for share in shares)))
    return rows


def _positions(result: Diagnosis) -> list[dict[str, Any]]:
    return _of_joints(result, "position", "rad", _of_loop(result, "angle"), result.encoder_noise, "demands")


def _of_loop(result: Diagnosis, signal: str) -> Split[list[tuple[Array, Array]]]:
    """(n,) rms errors before and after of every recording, as ``closed_loop`` compares them."""
    return result.closed_loops.map(lambda pairs: [(b.error_rms(signal), a.error_rms(signal)) for b, a in pairs])


def _of_joints(
    result: Diagnosis,
    signal: str,
    unit: str,
    errors: Split[list[tuple[Array, Array]]],
    noise: Array,
    along: str,
) -> list[dict[str, Any]]:
    """A row per joint of a signal in ``unit``: its rms errors over all recordings of either side, and its noise."""
    compared = {part: pairs for part, pairs in errors.items() if pairs}
    return [
        {
            "signal": signal,
            "joint": j + 1,
            "unit": joint.unit(unit),
            "error_rms": {
                part: {
                    when: float(np.sqrt(np.mean([pair[k][j] ** 2 for pair in pairs]))) for k, when in enumerate(WHEN)
                }
                for part, pairs in compared.items()
            },
            "noise_rms": float(noise[j]),
            "along": along,
        }
        for j, joint in enumerate(result.arm.joints if compared else ())
    ]


def _link_signals(result: Diagnosis) -> list[dict[str, Any]]:
    """Motor minus link encoder without its constant, held out, without and with the causes."""
    if result.link is None:
        return []
    link, rows = result.link, []
    for k, joint in enumerate(int(j) for j in link.held_out.joints):
        before, after = (float(np.sqrt(np.mean(values[:, k] ** 2))) for values in (link.without, link.residual))
        unit = result.arm.joints[joint - 1].unit("rad")
        errors = {"held_out": {"before": before, "after": after}}
        rows.append(
            {
                "signal": "link angle",
                "joint": joint,
                "unit": unit,
                "error_rms": errors,
                "noise_rms": float(link.held_out.noise[k]),
            }
        )
    return rows


def _tracker_signal(result: Diagnosis) -> list[dict[str, Any]]:
    """Tracked points against the model at the measured angles, m rms per coordinate."""
    if result.tracked is None or not result.tracked.rms:
        return []
    errors = {side: {"before": before, "after": after} for side, (before, after) in result.tracked.rms.items()}
    return [{"signal": "position", "joint": None, "unit": "m", "error_rms": errors, "noise_rms": result.tracked.noise}]
