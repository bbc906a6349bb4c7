"""Water round two links in a plane, in closed form by cases (Abderrahim, thesis, Glasgow, section 7.3).

An oracle for the strips of ``arm_model.rigid_body.hydrodynamics``, which do this for any arm: what they are the limit
of, and where the flow turns round. Shapes: q, qd, qdd (N, 2) rad and per second; torques, N m, are what the drives must
give in addition.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm_io.types import Array


def reversal(lengths: tuple[float, float], q: Array, qd: Array) -> Array:
    """(N,) m from joint 2, where the flow across link 2 changes its sign: l0 = -q1' l1 cos q2 / (q1' + q2').

    Beyond 0..l2, or not finite, where it does not. lengths (l1, l2) m.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(-qd[:, 0] * lengths[0] * np.cos(q[:, 1]) / (qd[:, 0] + qd[:, 1]))


@dataclass(frozen=True)
class TwoLinks:
    """Two cylinders in a plane, revolute joints at right angles to it, q2 = 0 stretched; lengths m.

    Resistance rho C_d R, kg/m2; added mass rho C_a pi R^2, kg/m: the same for both.
    """

    lengths: tuple[float, float]
    resistance: float
    added: float

    def drag(self, q: Array, qd: Array) -> Array:
        """(N, 2) torque of the drag: of link 1 with its fourth power, of link 2 by cases.

        Across link 2 the velocity is v = a + w l, a = q1' l1 cos q2, w = q1' + q2'. Where it has one sign s, the
        integrals of |v| v and |v| v l are s P0(l2) and s P1(l2), P0 and P1 those of v^2 and v^2 l from 0; where it
        changes sign at l0, they are sign(a) P(l0) + sign(w) (P(l2) - P(l0)).
        """
        (l1, l2), k = self.lengths, self.resistance
        a, w = qd[:, 0] * l1 * np.cos(q[:, 1]), qd[:, 0] + qd[:, 1]
        l0 = reversal(self.lengths, q, qd)
        reverse = (l0 > 0) & (l0 < l2)
        # without reversal: all of the link at the sign that its middle has
        before, behind = (np.where(reverse, np.sign(x), np.sign(a + w * l2 / 2)) for x in (a, w))
        split = np.where(reverse, l0, l2)

        def integral(weighted: int) -> Array:
            def power(l: Array | float) -> Array:
                n = weighted + 1
                return np.asarray(l**n * (a * a / n + 2 * a * w * l / (n + 1) + w * w * l * l / (n + 2)))

            return np.asarray(before * power(split) + behind * (power(l2) - power(split)))

        second = k * integral(1)
        first = k * np.abs(qd[:, 0]) * qd[:, 0] * l1**4 / 4 + k * l1 * np.cos(q[:, 1]) * integral(0) + second
        return np.stack([first, second], axis=-1)

    def added_mass(self, q: Array, qd: Array, qdd: Array) -> Array:
        """(N, 2) torque of the added mass.

        Across link 2 the acceleration is A + W l with A = l1 (q1'' cos q2 + q1'^2 sin q2), W = q1'' + q2''.
        """
        (l1, l2), m = self.lengths, self.added
        c, s = np.cos(q[:, 1]), np.sin(q[:, 1])
        a, w = l1 * (qdd[:, 0] * c + qd[:, 0] ** 2 * s), qdd[:, 0] + qdd[:, 1]
        second = m * (a * l2**2 / 2 + w * l2**3 / 3)
        first = m * qdd[:, 0] * l1**3 / 3 + l1 * c * m * (a * l2 + w * l2**2 / 2) + second
        return np.stack([first, second], axis=-1)

    def torque(self, q: Array, qd: Array, qdd: Array) -> Array:
        """(N, 2) both."""
        return self.drag(q, qd) + self.added_mass(q, qd, qdd)
