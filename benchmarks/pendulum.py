"""Table 3.1 of the thesis.

5 s of a cart with a double pendulum under its own weight, ours beside what else computes it.

The equations of the peers come from sympy's Lagrange method, not from our generator.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm

START = np.array([0.0, 0.3, -0.2])
STEP, DURATION = 0.001, 5.0


def lagrange() -> Callable[[Array], Array]:
    """x (6,) -> rates, lambdified; the numbers of config/models/cart_double_pendulum.toml."""
    import sympy as sp
    from sympy.physics.mechanics import dynamicsymbols

    t = sp.Symbol("t")
    y, a, b = dynamicsymbols("y a b")
    m, rod, reach, inertia, cart, g = 0.3, 0.5, 0.25, 0.00625, 1.0, 9.80665
    first = (y + reach * sp.sin(a), reach * sp.cos(a))
    elbow = (y + rod * sp.sin(a), rod * sp.cos(a))
    second = (elbow[0] + reach * sp.sin(a + b), elbow[1] + reach * sp.cos(a + b))
    kinetic = cart * y.diff(t) ** 2 / 2 + inertia * (a.diff(t) ** 2 + (a + b).diff(t) ** 2) / 2
    for point in (first, second):
        kinetic += m * sum(c.diff(t) ** 2 for c in point) / 2
    lagrangian = kinetic - m * g * (first[1] + second[1])
    q = [y, a, b]
    equations = [lagrangian.diff(c.diff(t)).diff(t) - lagrangian.diff(c) for c in q]
    accelerations = [c.diff(t, 2) for c in q]
    mass = sp.Matrix(equations).jacobian(accelerations)
    rest = sp.Matrix(equations).subs(dict.fromkeys(accelerations, 0))
    symbols = sp.symbols("q0:6")
    plain = {c.diff(t): s for c, s in zip(q, symbols[3:])}
    replaced = [e.subs(plain).subs(dict(zip(q, symbols[:3]))) for e in (mass, rest)]
    evaluate = sp.lambdify(symbols, replaced, "numpy", cse=True)

    def rates(x: Array) -> Array:
        mass, rest = evaluate(*x)
        return np.concatenate([x[3:], np.linalg.solve(mass, -rest[:, 0])])

    return rates


def runge_kutta(rates: Callable[[Array], Array]) -> Array:
    """(3,) positions at the end, by the same steps as ours, in Python."""
    x, h = np.concatenate([START, np.zeros(3)]), STEP
    for _ in range(round(DURATION / h)):
        k1 = rates(x)
        k2 = rates(x + h / 2 * k1)
        k3 = rates(x + h / 2 * k2)
        k4 = rates(x + h * k3)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x[:3]


def scipy(rates: Callable[[Array], Array]) -> Array:
    from scipy.integrate import solve_ivp

    x = np.concatenate([START, np.zeros(3)])
    found: Any = solve_ivp(lambda t, x: rates(x), (0, DURATION), x, method="DOP853", rtol=1e-9, atol=1e-10)
    return found.y[:3, -1]


def mujoco(arm: Arm) -> Callable[[], Array]:
    import mujoco as mj

    from benchmarks.simulation_peers import mujoco_model

    model = mujoco_model(arm, STEP)
    model.opt.integrator = mj.mjtIntegrator.mjINT_RK4
    data = mj.MjData(model)

    def run() -> Array:
        mj.mj_resetData(model, data)
        data.qpos = START
        for _ in range(round(DURATION / STEP)):
            mj.mj_step(model, data)
        return data.qpos.copy()

    return run
