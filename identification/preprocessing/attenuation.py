"""Noise of the encoders in the regressors: how much too small least squares make an inertia for it.

Positions are noisy, and differencing them twice raises the noise with the fourth power of the frequency. In the
regressor of an inertia, noise that is a share s of what friction leaves of the acceleration's power draws the estimate
towards zero by that share (errors in variables: Soderstrom, Automatica 43 (2007) 939). No deviation that follows from
the residual shows it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import signal

from arm_io.types import Array
from identification.preprocessing.filtering import butterworth
from identification.preprocessing.signals import Motion, parallel_filter, parallel_taps

NOTABLE = 0.02
"""Share of noise from which a warning is given."""
GRID = 512
"""Frequencies at which the noise is integrated."""


def noise_in_acceleration(motion: Motion) -> Array:
    """(J,) share of white noise of the positions in the acceleration's power, in the band of the regression.

    Of the acceleration counts what the velocity and its sign leave: only that shows an inertia. Where gravity follows
    the motion, too, an inertia shows less, and the share is larger.
    """
    rate, band = 1.0 / motion.dt, motion.band
    f = np.linspace(0.0, 0.5 * rate, GRID)
    low_pass = butterworth(4, band.motion * motion.dt * 2)
    once = np.abs(signal.sosfreqz(low_pass, f, fs=rate)[1])
    passed = once**4 * np.abs(signal.freqz(parallel_taps(motion), 1.0, f, fs=rate)[1]) ** 2  # the first, both ways
    power = np.trapezoid((2 * np.pi * f) ** 4 * passed, f) * 2 * motion.dt * band.noise_rms**2
    total = np.array([_own_power(motion, j) for j in range(motion.q.shape[1])])
    return np.asarray(np.divide(power, total, out=np.zeros_like(total), where=total > 0))


def _own_power(motion: Motion, j: int) -> float:
    """(rad/s2)^2: mean square of joint j's acceleration without what follows its velocity."""
    qd, qdd = motion.qd[:, j], motion.qdd[:, j]
    filtered = parallel_filter(motion, np.stack([qdd, qd, np.sign(qd)], axis=1))
    residual = filtered[:, 0] - filtered[:, 1:] @ np.linalg.lstsq(filtered[:, 1:], filtered[:, 0], rcond=None)[0]
    return float(np.mean(residual**2))


def attenuation_warnings(motions: Sequence[Motion]) -> list[str]:
    """A sentence on the joints whose inertias least squares make notably too small."""
    share = np.mean([noise_in_acceleration(motion) for motion in motions], axis=0)
    moved = [any(motion.moves(j) for motion in motions) for j in range(len(share))]
    hit = [f"joint {j + 1} {share[j]:.0%}" for j in np.argsort(-share) if moved[j] and share[j] > NOTABLE]
    if not hit:
        return []
    return [
        "encoder noise is a part of the acceleration by which least squares underestimates inertias, beyond the "
        f"stated standard deviations: {', '.join(hit)}; move faster, or use --method iv (for a model that has its "
        "controller)"
    ]
