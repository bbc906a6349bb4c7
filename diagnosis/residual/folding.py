"""Warnings where sampling may have put more into the currents unseen than their noise (``Run.folded``)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from diagnosis.residual.expected_current import rate_of
from diagnosis.residual.run import FOLDED, Run
from identification.preprocessing import UNSEEN, rate_beside, rows_a_setpoint


def folding_warnings(runs: Sequence[Run]) -> Iterator[str]:
    """One per sampling rate at which transients at setpoints fold onto the acceleration."""
    of_rate: dict[int, list[Run]] = {}
    for run in runs:
        if run.folded.any():
            of_rate.setdefault(rows_a_setpoint(run.arm, 1 / rate_of(run.raw[0])), []).append(run)
    for rows, alike in of_rate.items():
        noise = np.sqrt(np.mean([run.noise**2 for run in alike], axis=0))
        ratio = np.sqrt(np.mean(np.concatenate([run.folded**2 for run in alike]), axis=0)) / noise
        if rows > UNSEEN and ratio.max() < FOLDED:
            continue
        arm, rate = alike[0].arm, rate_of(alike[0].raw[0])
        far = f"two std of it are {2 * ratio.max():.1f} times the noise of joint {int(ratio.argmax()) + 1}"
        if rows <= UNSEEN:
            far = "how far cannot be seen at so few rows per setpoint"
        assert arm.controller is not None
        yield (
            f"{', '.join(dict.fromkeys(run.name for run in alike))}: {rate:.5g} Hz is {rows} times the rate of the "
            f"controller's setpoints (every {arm.controller.setpoint_period * 1e3:.3g} ms): the servos' ripple is "
            f"folded onto the acceleration; {far}, and errors of inertias up to there are not named; at "
            f"{rate_beside(arm, rate):.5g} Hz, or with currents averaged over each row, they would be"
        )
