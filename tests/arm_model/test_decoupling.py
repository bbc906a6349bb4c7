"""The thesis's disturbance-decoupling controller, against sympy, closed-form equations, and its own arm in water."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sympy
from scipy.integrate import solve_ivp
from scipy.signal import lsim

from arm_io import InputError
from arm_model.control.compensator import Compensator
from arm_model.control.computed_torque import Reference
from arm_model.control.decoupling import DecouplingLoop, DisturbanceDecoupling
from arm_model.control.linear_model import LinearModel, second_order
from arm_model.control.torque_control import controlled
from arm_model.model_file import read_model
from arm_model.symbolic.reading import read_formula
from arm_model.symbolic.tape import Tape, evaluate
from examples.decoupling import FIRST, NONE, TIGHT, in_water, loops, smooth, step

PENDULUM = {"x": "v", "v": "-4*v - v^3 - 2*sin(x) + (0.5 + 0.1*cos(x))*u"}
THIRD = {"x": "v + 0.1*x^2", "v": "w - sin(x)*v", "w": "-3*w - x/(2 + v^2) + 0.2*exp(-x)*u"}


@pytest.mark.parametrize(("rates", "output"), [(PENDULUM, "x + 0.1*x^3"), (THIRD, "x"), (PENDULUM, "v")])
def test_lie_derivatives_are_sympys(rates: dict[str, str], output: str) -> None:
    if output == "v":
        rates = {"v": "-4*v - v^3 + 0.5*u"}
    made = Compensator(rates, output)
    states, u = sympy.symbols(list(rates)), sympy.Symbol("u")
    changes = sympy.Matrix([sympy.sympify(text.replace("^", "**")) for text in rates.values()])
    drift, gain = changes.subs(u, 0), changes.diff(u)
    lies = [sympy.sympify(output.replace("^", "**"))]
    through = sympy.Integer(0)
    while sympy.simplify(through) == 0:
        row = sympy.Matrix([lies[-1]]).jacobian(states)
        through = (row * gain)[0]
        lies.append((row * drift)[0])
    assert made.relative_degree == len(lies) - 1
    for x in np.random.default_rng(3).uniform(-1, 1, (20, len(rates))):
        wanted = [float(one.subs(dict(zip(states, x)))) for one in (*lies, through)]
        np.testing.assert_allclose(made.lie(*x), wanted, rtol=1e-12, atol=1e-13)


def test_extended_output_obeys_its_equation_whatever_the_plant_does() -> None:
    """p(s) y_E = 0 in continuous time, with a plant that is not the compensator, pushed from outside."""
    loop = DecouplingLoop(second_order(4.0, 3.0), Compensator(PENDULUM, "x"), second_order(30.0, 9.0), gains=(6.0, 5.0))

    def slopes(t: float, s: np.ndarray) -> np.ndarray:
        x_t, x_m, x_r, plant = s[:2], s[2:4], s[4:6], s[6:]
        z = np.sin(2 * t)
        u = loop.law(x_t, x_m, x_r, z, plant[0])
        return np.concatenate(
            [
                loop.tracking.a @ x_t + loop.tracking.b * z,
                loop.compensator.slope(*x_m, u),
                loop.regulation.a @ x_r + loop.regulation.b * (plant[0] - x_m[0]),
                [plant[1], -np.tanh(5 * plant[1]) + 0.3 * u + np.cos(7 * t)],
            ]
        )

    t = np.linspace(0.0, 2.0, 41)
    done = solve_ivp(slopes, (0.0, 2.0), [0.3, 0.2, 0.0, 0.0, 0.0, 0.1, 0.1, 0.0], t_eval=t, rtol=1e-10, atol=1e-12)
    extended = done.y[0] - done.y[2] - done.y[4]
    rate = 0.2 - 0.0 - 0.1
    wanted = (3 * extended[0] + rate) * np.exp(-2 * t) - (2 * extended[0] + rate) * np.exp(-3 * t)  # (s + 2)(s + 3)
    np.testing.assert_allclose(extended, wanted, atol=1e-7)


def test_loops_of_the_thesis_move_its_arm_without_interaction() -> None:
    """Started at rest, each joint's error is the mismatch less its filtered self, and dies."""
    arm = limited(NONE)
    mismatch: list[list[float]] = []

    class Watched(DisturbanceDecoupling):
        def torque(self, q, qd, reference):  # type: ignore[no-untyped-def]
            mismatch.append([float(y - state.x_m[0]) for y, state in zip(q, self._states)])
            return super().torque(q, qd, reference)

    controller = Watched(loops(), period=0.002, start=np.zeros(2))
    run = controlled(arm, controller, step, duration=8.0, period=0.002, start=np.zeros(2))
    path = smooth(run.t).q
    np.testing.assert_allclose(controller.tracked, path, atol=1e-9)
    error = path - run.q
    # 9 % of joint 1's path is still ahead: its tracking model has both poles at 0.5 rad/s
    assert np.degrees(np.abs(error[-1])).max() < 0.8
    assert np.degrees(np.abs(error)).max() < 4.0
    for j, (a0, a1) in enumerate([(25.0, 10.0), (36.0, 12.0)]):
        eps = np.array(mismatch)[:, j]
        filtered = lsim(([a0], [1.0, a1, a0]), eps, run.t)[1]
        assert np.abs(error[:, j] - (filtered - eps)).max() < 0.05 * np.abs(error[:, j]).max()


def test_moved_joint_disturbs_the_resting_one_little() -> None:
    """Joint 1 moves by 45 degrees; without its loop's help, joint 2 swings by tens of degrees."""

    class FirstOnly(DisturbanceDecoupling):
        def torque(self, q, qd, reference):  # type: ignore[no-untyped-def]
            return super().torque(q, qd, reference) * [1.0, 0.0]

    largest = []
    for kind in (DisturbanceDecoupling, FirstOnly):
        controller = kind(loops(), period=0.002, start=np.zeros(2))

        def first(t: float) -> Reference:
            return Reference(np.radians([45.0, 0.0]), np.zeros(2), np.zeros(2))

        run = controlled(limited(FIRST), controller, first, duration=4.0, period=0.002, start=np.zeros(2))
        largest.append(float(np.degrees(np.abs(run.q[:, 1])).max()))
    assert largest[0] < 1.5 and largest[1] > 10 * largest[0], largest


def test_tighter_limits_change_the_beginning_only() -> None:
    runs = [
        controlled(
            limited(limits),
            DisturbanceDecoupling(loops(), period=0.002, start=np.zeros(2)),
            step,
            duration=8.0,
            period=0.002,
            start=np.zeros(2),
        )
        for limits in (NONE, TIGHT)
    ]
    torque, angle = (np.abs(getattr(runs[0], name) - getattr(runs[1], name)) for name in ("torque", "q"))
    early, late = runs[0].t < 4.0, runs[0].t > 6.0
    assert (np.abs(runs[1].torque).max(axis=0) == TIGHT).all()
    assert (torque[early].max(axis=0) > 1.0).all() and (torque[late] < 0.05).all()
    assert (angle[late] < np.radians(0.05)).all() and np.degrees(angle.max()) > 0.1


def test_water_that_is_off_by_30_percent_is_borne() -> None:
    for share in (0.7, 1.3):
        controller = DisturbanceDecoupling(loops(), period=0.002, start=np.zeros(2))
        arm = in_water(limited(FIRST), share)
        run = controlled(arm, controller, step, duration=8.0, period=0.002, start=np.zeros(2))
        error = np.degrees(np.abs(smooth(run.t).q - run.q))
        assert error.max() < 5.0 and error[-1].max() < 0.8


def limited(limits: tuple[float, float]):  # type: ignore[no-untyped-def]
    arm = read_model(Path(__file__).resolve().parents[2] / "config/models/underwater.toml")
    return replace(arm, joints=tuple(replace(joint, torque_limit=limit) for joint, limit in zip(arm.joints, limits)))


def test_what_cannot_be_decoupled_is_refused() -> None:
    fine = Compensator(PENDULUM, "x")
    slow = LinearModel(np.array([[-1.0]]), np.array([1.0]), np.array([1.0]))
    two = second_order(25.0, 10.0)
    with pytest.raises(
        InputError, match="tracking model: has relative degree 1; expected at least the compensator's 2"
    ):
        DecouplingLoop(slow, fine, two, (1.0, 2.0))
    with pytest.raises(InputError, match="regulation filter: has relative degree 1"):
        DecouplingLoop(two, fine, slow, (1.0, 2.0))
    with pytest.raises(InputError, match="Hurwitz"):
        DecouplingLoop(two, fine, two, (1.0, -2.0))
    with pytest.raises(InputError, match="expected 2 that make"):
        DecouplingLoop(two, fine, two, (1.0,))
    with pytest.raises(InputError, match="gain 0.5 at rest; expected 1"):
        DecouplingLoop(two, fine, replace(two, b=two.b / 2), (1.0, 2.0))
    with pytest.raises(InputError, match="not affine in u"):
        Compensator({"x": "v", "v": "-v + u^2"}, "x")
    with pytest.raises(InputError, match="does not pass u"):
        Compensator({"x": "-x", "v": "-v + u"}, "x")
    with pytest.raises(InputError, match="not minimum phase: it has a zero at 1 1/s"):
        Compensator({"x": "v", "v": "-2*v - x + u"}, "x - v")
    with pytest.raises(InputError, match="are 1 for 2 joints"):
        DisturbanceDecoupling(loops()[:1], period=0.01, start=np.zeros(2))


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("x +", "is not a formula"),
        ("y + 1", "names y; expected one of x"),
        ("x ** 0.5", "has 'x ** 0.5'"),
        ("__import__('os')", "has"),
        ("x / 0", "divides by zero"),
        ("sin(2)", "sin of a number"),
        ("x if x else 1", "has"),
        ("True", "has 'True'"),
    ],
)
def test_formulas_that_cannot_be_read(text: str, complaint: str) -> None:
    tape = Tape()
    with pytest.raises(InputError, match=complaint.replace("*", r"\*")):
        read_formula(text, tape, {"x": tape.input("x")})


def test_formula_has_pythons_value() -> None:
    tape = Tape()
    x = tape.input("x")
    text = "-(x - 2)^3 / (1 + x^2) + sqrt(x)*exp(-x) - cos(x)*+2"
    value = evaluate(tape, [read_formula(text, tape, {"x": x})], {"x": 0.7})[0]
    assert value == pytest.approx(-((0.7 - 2) ** 3) / (1 + 0.49) + np.sqrt(0.7) * np.exp(-0.7) - 2 * np.cos(0.7))


@pytest.mark.slow
def test_example_draws_and_reports(root: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "examples.decoupling", "--out", str(tmp_path)],
        cwd=root,
        capture_output=True,
        text=True,
        check=True,
    )
    printed = json.loads(done.stdout[: done.stdout.rindex("}") + 1])
    assert {path.name for path in tmp_path.iterdir()} == {"tracking.png", "limits.png"}
    assert max(printed["first_limits"]["decoupling"]["last_deg"]) < 0.1
    assert max(printed["angles_apart_by_the_tighter_limits_deg"]["last"]) < 0.01
