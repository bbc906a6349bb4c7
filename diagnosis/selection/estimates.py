"""From coefficients of columns to the parameters of an effect, with standard deviations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_io.types import Array
from arm_model import Joint
from arm_model.effects import Parameter
from diagnosis.cause import Estimate
from diagnosis.selection.candidate import Candidate


def estimates(
    candidate: Candidate,
    coefficients: Sequence[float],
    covariance: Array,
    joint: Joint | None,
    systematic: float | None = None,
    nonlinear: Sequence[str] | None = None,
) -> list[Estimate]:
    """The parameters of a candidate with coefficients (k,), in the order of the catalogue.

    covariance  (k + s, k + s) of the coefficients, then of the nonlinear parameters that were estimated
    joint       in whose units the parameters are; None: SI
    systematic  relative std of the measurement model, in addition to that of the data; None: model error of the effect.
                Of a wave it is that of its sine and of its cosine, which turns its phase by as many rad
    nonlinear   names of the nonlinear parameters in ``covariance``; None: ``candidate.searched()``
    """
    c, effect = np.asarray(coefficients, float), candidate.definition
    by_coefficient = [_derivative(candidate, c, k) for k in range(len(c))]
    names = candidate.searched() if nonlinear is None else nonlinear
    by_parameter = [{name: 1.0} for name in names][: len(covariance) - len(c)]
    share = effect.model_error if systematic is None else systematic
    rows = []
    values = candidate.parameters(c.tolist())
    for parameter in effect.parameters:
        name, value = parameter.name, values.get(parameter.name)
        if value is None or parameter.fixed:
            continue
        slope = np.array([derivatives.get(name, 0.0) for derivatives in (*by_coefficient, *by_parameter)])
        std = float(np.sqrt(max(float(slope @ covariance @ slope), 0.0)))
        unit = joint.unit(parameter.unit, parameter.name) if joint else parameter.unit
        exact = parameter.whole or parameter.own or parameter.lasts
        std = float(np.hypot(std, 0.0 if exact else share * parameter.erring(value)))
        std = _between(parameter, value) if parameter.coarse else std
        rows.append(Estimate(name, value, std, unit))
    return rows


def _between(parameter: Parameter, value: float) -> float:
    """Half of the distance to the neighbouring search values: within it, the recordings were not asked."""
    distances = np.abs(np.array(parameter.search) - value)
    return float(np.min(distances[distances > 1e-9 * abs(value)], initial=abs(value))) / 2


def _derivative(candidate: Candidate, c: Array, k: int) -> dict[str, float]:
    """Derivative of every parameter by coefficient k, by central differences."""
    step = 1e-4 * max(float(np.max(np.abs(c))), 1e-9)
    up, down = c.copy(), c.copy()
    up[k] += step
    down[k] -= step
    after, before = candidate.parameters(up.tolist()), candidate.parameters(down.tolist())
    return {name: (after[name] - before[name]) / (2 * step) for name in after}
