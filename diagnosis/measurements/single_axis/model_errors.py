"""What a single axis shows of the errors of its model, where the model says how well it is known.

The residual of an axis is not whitened: here it is in units of the noise that its encoder and its current leave in it.
What the model left over on the recordings that it was identified from hides nothing: at the full rate the laws of the
effects themselves distinguish it, and it is what such a model lacks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm_io.types import Array
from arm_model import Arm, parameter, with_parameters
from diagnosis.another_day import known_on_another_day
from diagnosis.measurements.single_axis.columns import COMPARE_BAND, ROWS_PER_SECOND, AxisSamples, Rows, rows_of
from diagnosis.residual.noise.channels import scatter
from diagnosis.selection.beyond_model import Evidence
from identification.selection import Split

Samples = Sequence[AxisSamples]


@dataclass(frozen=True)
class ModelErrors:
    """Errors of the model in the residuals of fitted and held-out rows.

    directions  (m, r) A: change of the residual for one standard deviation of each independent error
    noise       A: of a row
    """

    directions: Split[Array]
    noise: float

    def chance(self, x: Split[Array], free: Split[Array], rows: Split[Rows]) -> float:
        """p-value of columns x (m, k) A conditional on those of other causes."""
        return self.evidence(free, rows).chance(self._weighted(x))

    def evidence(self, free: Split[Array], rows: Split[Rows]) -> Evidence:
        """Residuals and the columns ``free`` (m, b) A of the other causes; rows at one place and speed are a block."""
        fit, held_out = (side.cells for side in rows)
        return Evidence(
            y=self._weighted(rows.map(lambda side: side.residual)),
            free=self._weighted(free),
            directions=self._weighted(self.directions),
            block=np.concatenate([fit, held_out + int(fit.max()) + 1]),
            alike=ROWS_PER_SECOND / (2.0 * COMPARE_BAND),
        )

    def exact(self) -> ModelErrors:
        """Of a model without any."""
        return replace(self, directions=self.directions.map(lambda own: own[:, :0]))

    def _weighted(self, values: Split[Array]) -> Array:
        return np.concatenate(list(values)) / self.noise


def model_errors(arm: Arm, samples: Split[Samples], rows: Split[Rows], block_seconds: float) -> ModelErrors | None:
    """Of an arm of one joint whose ``rows`` these samples are; None where nothing is stated."""
    uncertainty = known_on_another_day(arm)
    if uncertainty is None or not uncertainty.parameters:
        return None
    values = np.array([parameter(arm, name) for name in uncertainty.parameters])
    directions = []
    for step in uncertainty.directions.T:
        moved = with_parameters(arm, dict(zip(uncertainty.parameters, (values + step).tolist())))
        directions.append([rows_of(moved, side, block_seconds).residual for side in samples])
    changes = [
        np.column_stack(
            [np.empty((len(side.residual), 0)), *(direction[k] - side.residual for direction in directions)]
        )
        for k, side in enumerate(rows)
    ]
    noise = float(np.hypot(rows.fit.noise, _of_current(samples)))
    return ModelErrors(Split(changes[0], changes[1]), noise)


def _of_current(samples: Split[Samples]) -> float:
    """A: noise of the current in the band of comparison."""
    parts = [
        float(scatter(one.i)[0]) ** 2 * min(2.0 * COMPARE_BAND / (len(one.t) - 1) * float(one.t[-1] - one.t[0]), 1.0)
        for side in samples
        for one in side
    ]
    return float(np.sqrt(max(float(np.mean(parts)), 1e-24)))
