"""What no cause explains of the difference between the two encoders of a joint."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from diagnosis.cause import Signal, Structure
from diagnosis.cause.structure import NO_VARIABLE
from diagnosis.measurements.link_encoders.candidates import standing_orders, turns
from diagnosis.measurements.link_encoders.model import LIMITS, Chosen, LinkEncoders
from diagnosis.selection.binned_means import predicted_by_bins, predicted_share

BINS = 16
"""Bins of a variable, with equal numbers of rows."""
VARIABLES = {"position": "q", "velocity": "v", "load torque": "load"}
"""What may predict a residual, by its field of ``Rows``."""


def remarks(chosen: Chosen, model: LinkEncoders, arm: Arm) -> Iterator[str]:
    """Residuals above the scatter from row to row, with the order of a wave over motor angle that both sets show."""
    fit, held_out = model.rows
    residuals = [model.residual(chosen, side, side) for side in model.rows]
    for k, joint in enumerate(int(j) for j in fit.joints):
        rms = float(np.sqrt(np.mean(residuals[1][:, k] ** 2)))
        if rms < LIMITS.above_noise * fit.noise[k]:
            continue
        remark = (
            f"joint {joint}: the residual between its encoders is {1e3 * rms:.2g} m{arm.joints[joint - 1].unit('rad')} "
            f"rms, {rms / fit.noise[k]:.0f} times their scatter from row to row"
        )
        orders = [standing_orders(values[:, k], side, k, 1) for values, side in zip(residuals, (fit, held_out))]
        if all(orders) and abs(orders[0][0] - orders[1][0]) < 0.5 / turns(fit, k):
            remark += f"; part of it repeats {orders[0][0]:.3g} times per motor revolution"
        yield remark


def unexplained_by_link_encoders(chosen: Chosen, model: LinkEncoders) -> list[Structure]:
    """Unexplained structure at joints whose residual exceeds the noise and is predictable from a variable.

    If no variable predicts a residual above the noise, only its size is given.
    """
    fit, held_out = model.rows
    residual_fit, residual = (model.residual(chosen, fit, side) for side in model.rows)
    allowed = model.allowed(chosen, held_out)
    structures = []
    for k, joint in enumerate(int(j) for j in fit.joints):
        rms = float(np.sqrt(np.mean(residual[:, k] ** 2)))
        if rms < LIMITS.above_noise * fit.noise[k] * allowed[k]:
            continue
        shares = {
            name: _predicted_share(
                getattr(fit, field)[:, k], residual_fit[:, k], getattr(held_out, field)[:, k], residual[:, k]
            )
            for name, field in VARIABLES.items()
        }
        name = max(shares, key=lambda variable: shares[variable])
        if shares[name] > LIMITS.predicted:
            structures.append(Structure(Signal.LINK_ANGLE, joint, name, shares[name]))
        else:
            times = f"{rms / fit.noise[k]:.0f} times the noise"
            structures.append(Structure(Signal.LINK_ANGLE, joint, NO_VARIABLE, 0.0, times))
    return structures


def _predicted_share(x_fit: Array, y_fit: Array, x: Array, y: Array) -> float:
    """Share of the squares of y (m,) that averages of y_fit (f,) in BINS bins of x_fit (f,) predict at x (m,)."""
    return predicted_share(y, predicted_by_bins(x_fit, y_fit[:, None], x, BINS)[:, 0])
