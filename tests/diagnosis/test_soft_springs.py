"""Springs: so soft that a link swings for seconds and its load changes as it gives way, and of arms of any size."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from arm_model import Arm, EffectTerm, Joint
from diagnosis.measurements.currents.columns import candidates, columns
from diagnosis.measurements.currents.design_matrix import Library, dataset_of
from diagnosis.measurements.currents.refinement import refined
from diagnosis.residual.generation import residual_run
from diagnosis.residual.integration import spring_twist
from diagnosis.residual.other_effects import weighted_with
from diagnosis.residual.run import Run
from diagnosis.selection.candidate import Candidate
from diagnosis.selection.regression import best_of_each, fit_together
from identification.selection import Split

SPRING = {"stiffness": 640.0, "damping": 2.0}
"""N m/rad and N m s/rad."""


def test_a_soft_spring_gives_way_to_a_load_that_changes_as_it_does() -> None:
    """A pendulum that swings behind its spring, while it becomes longer and shorter, as other joints bend an arm.

    Gravity pulls less or more at a link that lags behind, and the momentum is that of a changing inertia. Without both,
    the twist was wrong by 39 % of what it varies.
    """
    step, mass, stiffness, damping = 0.008, 6.0, 640.0, 2.0
    t = np.arange(0.0, 12.0, step)
    waves = lambda x, n: sum(r * w**n * np.cos(w * x + n * np.pi / 2) for r, w in ((1.0, 1.1), (0.02, 17.0)))  # noqa: E731
    q, v, a = (partial(waves, n=n) for n in range(3))
    length = lambda x: 0.5 - 0.15 * np.cos(1.7 * x)  # noqa: E731
    longer = lambda x: 0.15 * 1.7 * np.sin(1.7 * x)  # noqa: E731
    inertia = mass * length(t) ** 2

    def needs(x: np.ndarray, angle: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """N m but for the acceleration: (m r^2)' v + m g r sin(angle from hanging)."""
        return mass * length(x) * (2.0 * longer(x) * speed + 9.81 * np.sin(angle))

    def rhs(x: float, y: np.ndarray) -> list[float]:
        torque = needs(x, q(x) - y[0], v(x) - y[1]) - stiffness * y[0] - damping * y[1]
        return [y[1], a(x) + torque / (mass * length(x) ** 2)]

    load, eased = inertia * a(t) + needs(t, q(t), v(t)), mass * length(t) * 9.81 * np.cos(q(t))
    start = [load[0] / (stiffness + eased[0]), 0.0]
    exact = solve_ivp(rhs, (0.0, 12.0), start, t_eval=t, rtol=1e-9, atol=1e-12).y
    twist, rate, _ = spring_twist(load, inertia, stiffness, damping, step, eased)
    assert np.std(twist - exact[0]) < 0.02 * np.std(exact[0])
    assert np.std(rate - exact[1]) < 0.02 * np.std(exact[1])


def _pendulum(swing: float, *effects: EffectTerm, heavier: float = 1.0) -> Run:
    """14 s of a pendulum of 6 kg behind that spring, all ``heavier`` by a factor, under a model with these effects.

    It is ``swing`` rad out of its place as the recording begins.
    """
    rate, length = 250.0, 0.5
    noise, mass, rotor, stiffness, damping = heavier * np.array([0.3, 6.0, 0.6, *SPRING.values()])
    joint = Joint(
        convention="placed",
        axis=(0.0, 1.0, 0.0),
        mass=mass,
        com=(length, 0.0, 0.0),
        rotor_inertia=rotor,
        torque_constant=1.0,
    )
    t = np.arange(0.0, 14.0, 1.0 / rate)
    waves = ((0.4, 0.7), (0.3, 1.9), (0.1, 4.4))
    motor = [sum(r * w**n * np.sin(w * t + n * np.pi / 2 - np.pi / 2) for r, w in waves) for n in range(3)]

    def rhs(x: float, y: np.ndarray) -> list[float]:
        q, _, a = (np.interp(x, t, one) for one in motor)
        load = mass * length**2 * a - mass * length * 9.81 * np.cos(q - y[0])
        return [y[1], (load - stiffness * y[0] - damping * y[1]) / (mass * length**2)]

    sag = -mass * length * 9.81 * np.cos(motor[0][0]) / stiffness
    twist = solve_ivp(rhs, (0.0, t[-1]), [sag + swing, 0.0], t_eval=t, rtol=1e-8, atol=1e-10, max_step=0.01).y
    torque = rotor * motor[2] + stiffness * twist[0] + damping * twist[1]
    i = torque + noise * np.random.default_rng(5).normal(size=len(t))
    arm = Arm("pendulum", (joint,), gravity=(0.0, 0.0, -9.81), effects=effects)
    return residual_run("pendulum", arm, t, motor[0][:, None], i[:, None])


def test_a_link_may_swing_as_a_recording_begins() -> None:
    """By 50 mrad: where its beginning was taken for rest, the true spring left more than none (41 times the noise)."""
    run, spring = _pendulum(0.05), EffectTerm("joint_compliance", 1, SPRING)
    rigid, elastic = (float(np.std(weighted_with(run, terms))) for terms in ([], [spring]))
    assert rigid > 10.0 and elastic < 1.3
    assert np.std(_pendulum(0.05, spring).whitened) < 1.3  # of a model that has it
    # and the columns of the search, of the first order
    (column,) = columns(Candidate("joint_compliance", 1, tuple(SPRING.items())), run).T
    assert np.std((run.residual[:, 0] - column[0]) / run.deviation[:, 0]) < 1.5


@pytest.mark.parametrize("heavier", [3.0, 1000.0])
def test_a_spring_is_found_in_an_arm_of_any_size(heavier: float) -> None:
    """It rings as long in all of them: damped by the same N m s/rad, that of a heavy arm would not stop."""
    run = _pendulum(0.05, heavier=heavier)
    data = Split(dataset_of([run]), dataset_of([run]))
    springs = [c for c in candidates(run.arm, run.inertia.mean(axis=0)) if c.effect == "joint_compliance"]
    library, fitted = Library(springs, data), fit_together(data, [])
    (best,) = best_of_each(springs, library.where_shown, fitted, set())
    found = dict(refined(best, fitted, data.fit).shape)
    assert found["stiffness"] == pytest.approx(heavier * SPRING["stiffness"], rel=0.02)
    assert found["damping"] == pytest.approx(heavier * SPRING["damping"], rel=0.2)
