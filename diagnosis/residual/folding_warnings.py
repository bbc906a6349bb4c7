"""Warnings where sampling may have put more into the currents unseen than their noise (``Run.folded``)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from diagnosis.residual.filters import rate_of
from diagnosis.residual.run import Run
from diagnosis.residual.setpoint_ripple import FOLDED
from identification import recorded_signals
from identification.preprocessing.folding import folding_line, rate_instead, unbounded


def folding_warnings(runs: Sequence[Run]) -> Iterator[str]:
    """One per sampling rate at which transients at setpoints fold onto the acceleration."""
    of_rate: dict[tuple[int, float], list[Run]] = {}
    for run in runs:
        if run.folded.any():
            line = folding_line(run.setpoints, rate_of(run.raw[0]))
            of_rate.setdefault((line, round(run.setpoints.period, 5)), []).append(run)
    for alike in of_rate.values():
        noise = np.sqrt(np.mean([run.noise**2 for run in alike], axis=0))
        ratio = np.sqrt(np.mean(np.concatenate([run.folded**2 for run in alike]), axis=0)) / noise
        rate, setpoints = rate_of(alike[0].raw[0]), alike[0].setpoints
        signals = recorded_signals(alike[0].arm)
        far = (
            f"wrong inertias are not named if they change the {signals} by less than "
            f"{2 * ratio.max():.1f} times the noise (joint {int(ratio.argmax()) + 1})"
        )
        if unbounded(setpoints, rate):
            far = "so few rows per setpoint do not show how large this is, and wrong inertias are not named"
        elif ratio.max() < FOLDED:
            continue
        period = setpoints.period
        times = f"{rate * period:.3g} times "
        yield (
            f"{', '.join(dict.fromkeys(run.name for run in alike))}: {rate:.5g} Hz is "
            f"{'' if times == '1 times ' else times}the rate of the controller's setpoints (every {period * 1e3:.3g} "
            f"ms{setpoints.as_shown(signals)}): the response of the servos to each setpoint looks like an inertia; "
            f"{far}; record at {rate_instead(period, rate):.5g} Hz, or average the {signals} over each row, to "
            "detect them"
        )
