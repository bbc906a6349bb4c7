"""What servos do at setpoints, where sampling puts it into the band of a residual.

Every setpoint causes a transient of the current, in proportion to the acceleration. The model of a current along the
measured motion does not have it: it would take the motion within the transient. Between setpoints and rows it is a sum
of lines; some of them are seen at 0 Hz, where they are an inertia that is not there, or at some Hz beside, where they
are an oscillation without a cause. How large these may be follows from the lines that are seen elsewhere
(``identification.preprocessing.setpoint_ripple``).
"""

from __future__ import annotations

import numpy as np

from arm_io.types import Array
from arm_model import Arm
from diagnosis.residual.filters import COMPARE_BAND, low_pass, rate_of
from identification.preprocessing import Driven, Setpoints, drifting, folded_along, lines_beside_zero
from identification.preprocessing.folding import folding_line, unbounded

LOW_LINE = 10
"""Line of the setpoints up to which what sampling folds counts, however small it is."""
FOLDED = 0.5
"""Share of the noise above which what sampling folds of higher lines counts."""
AHEAD = 0.02
"""s by which setpoints are ahead of the motion: the delay of a servo with a bandwidth of 8 Hz."""
DIRECTIONS = 6
"""Of lines beside 0 Hz: a cosine and a sine of each of three."""


def folded_onto(arm: Arm, q: Array, driven: Driven, a: Array, kept: slice) -> Array:
    """(m, n) A: one std of what sampling may have put into currents unseen.

    q (k, n) rad (m): angles of the rows of ``driven``; a: (m, n) the acceleration in the band of comparison; kept: the
    rows m of the k. Of one row or two per known setpoint, it is all of the acceleration times 1 kg m2 (kg).
    """
    constant = arm.joint_array("drive_constant")
    if unbounded(driven.setpoints, rate_of(driven.t)):
        return a / constant
    torque = folded_along(q, driven)
    if torque is None:
        return np.zeros_like(a)
    return np.asarray(torque[kept] / constant)


def that_counts(folded: Array, noise: Array, setpoints: Setpoints, rate: float) -> Array:
    """(m, n) A: ``folded`` (m, n) A at ``rate`` rows/s of joints where a residual counts less along it.

    noise: (n,) A. A high line is far below what those that are seen allow.
    """
    low = folding_line(setpoints, rate) <= LOW_LINE
    return np.asarray(folded * (low | (np.sqrt(np.mean(folded**2, axis=0)) > FOLDED * noise)))


def ripple_beside(arm: Arm, q: Array, driven: Driven, noise: Array, kept: slice) -> Array:
    """(m, n, DIRECTIONS) A: one std of spectral lines of the setpoints that appear beside 0 Hz by aliasing.

    noise: (n,) A; other arguments as of ``folded_onto``.
    """
    t, constant = driven.t, arm.joint_array("drive_constant")
    rate = rate_of(t)
    columns = np.zeros((len(t[kept]), len(arm), DIRECTIONS))
    for k, (hz, torque) in enumerate(lines_beside_zero(q, driven)):
        angle = 2 * np.pi * hz * (t - t[0])[:, None]
        for part, wave in enumerate((np.cos(angle), np.sin(angle))):
            one = low_pass(wave * torque / constant, COMPARE_BAND, rate)[kept]
            columns[..., 2 * k + part] = one * (np.sqrt(np.mean(one**2, axis=0)) > FOLDED * noise)
    return columns


def unseen_directions(folded: Array, ahead: Array, beside: Array, t: Array) -> tuple[Array, Array]:
    """Orthonormal directions (m, r) in which a residual over its std counts less, and the shares (r,) by which.

    folded (m,), ahead (m,), beside (m, d): of one joint, over the std of the residual, at t (m,) s of a recording from
    0; ahead: of ``folded``, what its lead against the motion adds (``lead_of``). Along one std of what may be there
    more is no evidence: the inverse root of the covariance 1 + f f^T.
    """
    columns = [drifting(folded, t), ahead[:, None]]
    if beside.any():
        lines = beside[:, beside.any(axis=0)]
        columns.append(drifting(lines, t).reshape(len(t), -1))
    basis, size, _ = np.linalg.svd(np.column_stack(columns), full_matrices=False)
    return basis, 1.0 - 1.0 / np.sqrt(1.0 + size**2)


def lead_of(folded: Array, per_second: float) -> Array:
    """(m,) A: what ``folded`` (m,) A has more if it leads the motion by AHEAD s: the motion follows the setpoints.

    An inertia of 2 % that leads by 20 ms looks like a time skew of 0.4 ms.
    """
    return np.asarray(AHEAD * per_second * np.gradient(folded))
