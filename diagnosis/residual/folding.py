"""Warnings where sampling may have put more into the currents unseen than their noise (``Run.folded``)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from diagnosis.residual.expected_current import rate_of
from diagnosis.residual.folded import FOLDED
from diagnosis.residual.run import Run
from identification.preprocessing import UNSEEN, folding_line, rate_beside


def folding_warnings(runs: Sequence[Run]) -> Iterator[str]:
    """One per sampling rate at which transients at setpoints fold onto the acceleration."""
    of_rate: dict[tuple[int, float], list[Run]] = {}
    for run in runs:
        if run.folded.any():
            rate = rate_of(run.raw[0])
            line = run.setpoint_rows or folding_line(run.setpoint_period, rate)
            of_rate.setdefault((line, round(run.setpoint_period, 5)), []).append(run)
    for (line, stated), alike in of_rate.items():
        noise = np.sqrt(np.mean([run.noise**2 for run in alike], axis=0))
        ratio = np.sqrt(np.mean(np.concatenate([run.folded**2 for run in alike]), axis=0)) / noise
        rate, hidden = rate_of(alike[0].raw[0]), line <= UNSEEN and stated > 0.0
        if not hidden and ratio.max() < FOLDED:
            continue
        far = f"two std of it are {2 * ratio.max():.1f} times the noise of joint {int(ratio.argmax()) + 1}"
        if hidden:
            far = "how far cannot be seen at so few rows per setpoint"
        period = alike[0].setpoint_period or line / rate
        yield (
            f"{', '.join(dict.fromkeys(run.name for run in alike))}: {rate:.5g} Hz is {rate * period:.3g} times the "
            f"rate of the controller's setpoints (every {period * 1e3:.3g} ms"
            f"{', as the currents show' * (stated == 0.0)}): "
            f"the servos' ripple is folded onto the acceleration; {far}, and errors of inertias up to there are "
            f"not named; at {rate_beside(period, rate):.5g} Hz, or with currents averaged over each row, they would "
            "be named"
        )
