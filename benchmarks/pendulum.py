"""Table 3.1 of the thesis.

    python -m benchmarks.pendulum [--json]

5 s of a cart with a double pendulum under its own weight, ours beside what else computes it.

The equations of the peers come from sympy's Lagrange method, not from our generator.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from arm_io.types import Array
from arm_model.description import Arm
from arm_model.model_file import read_model
from arm_model.simulation.simulation import simulate_at
from benchmarks.report import report

MODEL = Path(__file__).resolve().parent.parent / "config/models/cart_double_pendulum.toml"
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


def by_scipy(rates: Callable[[Array], Array]) -> Array:
    from scipy.integrate import solve_ivp

    x = np.concatenate([START, np.zeros(3)])
    found: Any = solve_ivp(lambda t, x: rates(x), (0, DURATION), x, method="DOP853", rtol=1e-9, atol=1e-10)
    return found.y[:3, -1]


def by_mujoco(arm: Arm) -> Callable[[], Array]:
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


def timed(work: Callable[[], Any], repeats: int = 5) -> tuple[float, Any]:
    """Shortest of ``repeats`` wall times, after one run that is not counted, and the result."""
    result = work()
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        result = work()
        times.append(time.perf_counter() - begin)
    return min(times), result


def double_pendulum(figures: dict[str, float]) -> None:
    """Table 3.1; the thesis had 84.9 s for AUTOLEV, 24.8 s for SD/FAST and 8.99 s for its own interface."""
    arm = read_model(MODEL)
    free = np.array([DURATION])

    def own() -> Array:
        nothing = lambda t: np.zeros((len(t), 3))  # noqa: E731
        return simulate_at(arm, nothing, free, start=START).q[0]

    figures["double_pendulum_ours_s"], mine = timed(own)
    begin = time.perf_counter()
    rates = lagrange()
    figures["double_pendulum_sympy_generation_s"] = time.perf_counter() - begin
    runs: dict[str, Callable[[], Array]] = {
        "sympy_lambdify": lambda: runge_kutta(rates),
        "scipy": lambda: by_scipy(rates),
    }
    with contextlib.suppress(ImportError):
        runs["mujoco"] = by_mujoco(arm)
    for name, run in runs.items():
        seconds, end = timed(run, 1)
        figures[f"double_pendulum_{name}_s"] = seconds
        figures[f"double_pendulum_ours_vs_{name}"] = seconds / figures["double_pendulum_ours_s"]
        figures[f"double_pendulum_differs_{name}"] = float(np.abs(end - mine).max())


def main() -> None:
    figures: dict[str, float] = {}
    double_pendulum(figures)
    report(figures)


if __name__ == "__main__":
    main()
