"""Kane's equations: active and inertia forces of the links projected on their partial velocities.

With the generalised speeds u = q': tau_r = sum_j f_j . dv_j/du_r + n_j . dw_j/du_r, where f_j and n_j are force and
moment about the origin of joint frame j that move link j against gravity (Kane and Levinson, "The use of Kane's
dynamical equations in robotics", IJRR 2(3), 1983). Partial velocities and accelerations are derivatives on the tape.
"""

from __future__ import annotations

import numpy as np

from arm_model.formulations.links import Link, Symbols, Vector, cross, links, tensor
from arm_model.symbolic.tape import Expr, derivative, rate


def torques(symbols: Symbols) -> list[Expr]:
    """(n,) joint torques (N m; N) of the rigid links, in q, qd, qdd."""
    tau = [symbols.tape.constant(0.0)] * len(symbols.q)
    for body, link in zip(symbols.bodies, links(symbols)):
        force, moment = _wrench(symbols, body, link)
        for r, speed in enumerate(symbols.qd):
            partial_speed, partial_spin = _partial(link.speed, speed), _partial(link.spin, speed)
            tau[r] = tau[r] + force @ partial_speed + moment @ partial_spin
    return tau


def _partial(velocity: Vector, speed: Expr) -> Vector:
    return np.array([derivative(component, speed) for component in velocity])


def _wrench(symbols: Symbols, body: tuple[Expr, ...], link: Link) -> tuple[Vector, Vector]:
    """f = m a + w' x m c + w x (w x m c), n = I w' + w x I w + m c x a.

    a is the origin's acceleration less gravity.
    """
    moving = [*zip(symbols.q, symbols.qd), *zip(symbols.qd, symbols.qdd)]
    mass, moment, inertia, w = body[0], np.array(body[1:4]), tensor(body), link.spin
    spin_rate = np.array([rate(component, moving) for component in w])
    a = np.array([rate(component, moving) for component in link.speed]) + cross(w, link.speed) - link.gravity
    force = np.array([mass * component for component in a]) + cross(spin_rate, moment) + cross(w, cross(w, moment))
    return force, inertia @ spin_rate + cross(w, inertia @ w) + cross(moment, a)
