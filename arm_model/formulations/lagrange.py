"""Lagrange's equations: tau_i = d/dt dT/dq'_i - dT/dq_i + dV/dq_i, all derivatives taken on the tape."""

from __future__ import annotations

import numpy as np

from arm_model.formulations.links import Link, Symbols, cross, links, tensor
from arm_model.symbolic.tape import Expr, derivative, rate


def torques(symbols: Symbols) -> list[Expr]:
    """(n,) joint torques (N m; N) of the rigid links, in q, qd, qdd."""
    kinetic, potential = energies(symbols)
    moving = [*zip(symbols.q, symbols.qd), *zip(symbols.qd, symbols.qdd)]
    tau = []
    for q, qd in zip(symbols.q, symbols.qd):
        momentum = derivative(kinetic, qd)
        tau.append(rate(momentum, moving) - derivative(kinetic, q) + derivative(potential, q))
    return tau


def energies(symbols: Symbols) -> tuple[Expr, Expr]:
    """Kinetic and potential energy, J; the potential is zero where the base frame's origin is."""
    kinetic = potential = symbols.tape.constant(0.0)
    for body, link in zip(symbols.bodies, links(symbols)):
        kinetic = kinetic + _kinetic(body, link)
        potential = potential - body[0] * link.drop - np.array(body[1:4]) @ link.gravity
    return kinetic, potential


def _kinetic(body: tuple[Expr, ...], link: Link) -> Expr:
    """T = m v.v / 2 + v.(w x m c) + w.I w / 2, v and I of the frame's origin and about it, m c the first moment."""
    mass, moment = body[0], np.array(body[1:4])
    w, v = link.spin, link.speed
    return 0.5 * mass * (v @ v) + v @ cross(w, moment) + 0.5 * (w @ (tensor(body) @ w))
