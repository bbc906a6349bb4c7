"""What the noise of encoders makes of the held-out gain of an effect.

Residual and effect follow from the same recorded angles. Their noise is in both, twice differentiated in the residual:
an effect that smooths it gains where the arm has no such effect (errors in variables; Fuller, "Measurement Error
Models", 1987). Noise of the same size, added once more, shows by how much (Cook & Stefanski, JASA 89, 1994).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm_model import EffectTerm
from diagnosis.residual.filters import rate_of
from diagnosis.residual.noise.channels import angle_noise
from diagnosis.residual.noise.instruments import smoothed
from diagnosis.residual.other_effects import as_encoders_read, residual_under
from diagnosis.residual.run import Run


def gain_from_encoder_noise(
    runs: Sequence[Run], without: Sequence[Sequence[EffectTerm]], full: Sequence[Sequence[EffectTerm]]
) -> float:
    """Squares by which effects ``full`` lessen the noise of encoders in whitened residuals; 0 where they do not.

    Compared with the effects ``without`` the one that is judged; each a sequence per run. The noise is taken for white,
    and is the same at every call.
    """
    generator, gain = np.random.default_rng(0), 0.0
    for run, lacking, complete in zip(runs, without, full, strict=True):
        t, q = run.raw
        noise = angle_noise(q, run.steps) * generator.standard_normal(q.shape)
        noisier = as_encoders_read(run, q + smoothed(noise, rate_of(t), run.angle_band))
        for sign, effects in ((1.0, lacking), (-1.0, complete)):
            noise = run.whiten(residual_under(noisier, effects) - residual_under(run, effects))
            gain += sign * float(np.sum(noise**2))
    return max(gain, 0.0)
