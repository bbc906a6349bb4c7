"""Newton-Euler, Lagrange and Kane agree; sympy.physics.mechanics, which knows nothing of ours, agrees with them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm_model.description import Arm, EffectTerm
from arm_model.effects import described
from arm_model.formulations import kane, lagrange, oracles
from arm_model.formulations.comparison import compare
from arm_model.formulations.links import symbols_of
from arm_model.model_file import read_model
from arm_model.rigid_body.kinematics import link_frames
from arm_model.simulation.simulation import system_of
from arm_model.symbolic import latex
from arm_model.symbolic.tape import derivative, evaluate, rate
from armscope.cli import run
from tests.arm_model.pumas import three_links
from tests.arm_model.random_arms import random_arm, random_states

MODELS = sorted(path.name for path in (Path(__file__).resolve().parents[2] / "config/models").glob("*.toml"))


@pytest.mark.parametrize("name", MODELS)
def test_three_formulations_of_every_model(root: Path, name: str) -> None:
    rows = compare(read_model(root / "config/models" / name), with_sympy=False)
    assert [row.name for row in rows] == ["Newton-Euler", "Lagrange", "Kane"]
    assert max(row.difference for row in rows) < 1e-9
    assert rows[0].torque_operations <= min(row.torque_operations for row in rows[1:])


@pytest.mark.parametrize("seed", range(6))
def test_three_formulations_of_random_arms(seed: int) -> None:
    rows = compare(random_arm(seed, joints=4), with_sympy=False, seed=seed)
    assert max(row.difference for row in rows) < 1e-9


@pytest.mark.parametrize(("seed", "joints"), [(0, 2), (3, 2)])
def test_against_sympy(seed: int, joints: int) -> None:
    rows = compare(random_arm(seed, joints=joints), with_sympy=True, seed=seed)
    assert [row.name for row in rows[3:]] == ["sympy LagrangesMethod", "sympy KanesMethod"]
    assert max(row.difference for row in rows) < 1e-9


def test_sympy_on_the_three_links_of_the_thesis(root: Path) -> None:
    arm = read_model(root / "config/models/puma560_thesis.toml")
    kanes = oracles.kane(arm)
    states = random_states(0, 3)
    found = kanes.torque()(*states)
    symbols = symbols_of(arm)
    moving = {f"{n}{j}": x[:, j] for n, x in zip(("q", "qd", "qdd"), states) for j in range(3)}
    for ours in (lagrange, kane):
        tau = evaluate(symbols.tape, ours.torques(symbols), {**symbols.values, **moving})
        np.testing.assert_allclose(np.stack(tau, axis=-1), found, rtol=1e-9, atol=1e-9)


def test_potential_energy_falls_with_the_centres_of_mass() -> None:
    arm = random_arm(2)
    q, _, _ = random_states(2, 4)
    symbols = symbols_of(arm)
    _, potential = lagrange.energies(symbols)
    (found,) = evaluate(symbols.tape, [potential], {**symbols.values, **{f"q{j}": q[:, j] for j in range(4)}})
    centres = [
        link_frames(arm, q)[:, j + 1] @ np.array([*joint.com, 1.0]) * joint.mass for j, joint in enumerate(arm.joints)
    ]
    wanted = -sum(centres)[:, :3] @ np.array(arm.gravity)
    np.testing.assert_allclose(np.diff(found), np.diff(wanted), rtol=1e-9, atol=1e-9)


def test_a_payload_is_seen(root: Path) -> None:
    arm = read_model(root / "config/models/puma560_thesis.toml")
    loaded = replace(arm, effects=(EffectTerm("payload", None, {"mass": 2.0, "x": 0.1}),))
    assert described(loaded) != replace(loaded, effects=())
    assert max(row.difference for row in compare(loaded, with_sympy=False)) < 1e-9


def test_rate_is_the_derivative_along_a_motion() -> None:
    symbols = symbols_of(random_arm(1, joints=2))
    q, qd = symbols.q, symbols.qd
    expression = q[0].sin() * q[1] / (1.0 + q[0] * q[0])
    along = rate(expression, list(zip(q, qd)))
    chained = sum((derivative(expression, a) * b for a, b in zip(q, qd)), symbols.tape.constant(0.0))
    values = {"q0": 0.3, "q1": -1.2, "qd0": 0.7, "qd1": 2.0}
    assert evaluate(symbols.tape, [along], values) == pytest.approx(evaluate(symbols.tape, [chained], values))


def test_command(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = str(root / "config/models/puma560.toml")
    assert run(["model", model, "--formulations", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["formulations"]
    assert [row["name"] for row in rows] == ["Newton-Euler", "Lagrange", "Kane"]
    assert all(row["difference"] < 1e-9 and row["seconds"] > 0 for row in rows)
    assert run(["model", model, "--formulations"]) == 0
    assert "Newton-Euler" in capsys.readouterr().out


def _readable(equations: str, every: int = 1) -> int:
    """The number of lines of an align*; matplotlib's own TeX reader understands them (ValueError if not), slowly."""
    from matplotlib.mathtext import MathTextParser

    equations, _, _ = equations.partition("\n\n")
    head, *lines, tail = equations.strip().split("\n")
    assert (head, tail) == (r"\begin{align*}", r"\end{align*}")
    for line in lines[::-every]:
        MathTextParser("path").parse("$" + line.removesuffix(r" \\").replace("&=", "=") + "$")
    return len(lines)


def _commented(printed: str) -> dict[str, float]:
    """Name -> value of the comments below an align*, which TeX passes over."""
    _, _, below = printed.partition("\n\n")
    title, *lines = below.strip().split("\n")
    assert title.startswith("% with the values of the model")
    assert all(line.startswith("% ") for line in lines)
    pairs = [line.removeprefix("% ").split(" = ") for line in lines]
    return {name: float(value) for name, value in pairs}


def test_latex(root: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["model", str(root / "config/models/underwater.toml"), "--equations", "latex"]) == 0
    printed = capsys.readouterr().out
    assert r"\ddot\theta_{2} &= " in printed and r"\dot\theta_{1} + \dot\theta_{2}" in printed
    assert _readable(printed) > 8
    # the viscous friction of both joints as the model file states it
    values = _commented(printed)
    assert values["viscous_mean1"] == values["viscous_mean2"] == 0.3


@pytest.mark.parametrize("by", ["newton-euler", "lagrange", "kane"])
def test_torques_as_source(root: Path, tmp_path: Path, by: str, capsys: pytest.CaptureFixture[str]) -> None:
    """The printed Python, run: the torques of the two-link arm as every textbook has them."""
    model = str(root / "config/models/underwater.toml")
    assert run(["model", model, "--equations", "python", "--by", by]) == 0
    space: dict[str, Any] = {"sin": np.sin, "cos": np.cos}
    exec(capsys.readouterr().out, space)
    torques = space["torques"]
    inertia, moment = 0.167 + 2 * 0.25, 2 * 0.5  # of each link about its own joint
    q2, u1, u2, a1, a2 = 0.4, 0.3, -0.8, 1.1, 0.7
    known = dict(body1_izz=inertia + 2.0, body2_mx=moment, body2_izz=inertia)  # link 1 carries the mass of link 2
    moving = dict(q2=q2, qd1=u1, qd2=u2, qdd1=a1, qdd2=a2)
    wanted = torques.__code__.co_varnames[: torques.__code__.co_argcount]
    c, s = moment * np.cos(q2), moment * np.sin(q2)
    np.testing.assert_allclose(
        torques(**{name: (known | moving)[name] for name in wanted}),
        [
            (2 * inertia + 2.0 + 2 * c) * a1 + (inertia + c) * a2 - s * (2 * u1 * u2 + u2**2),
            (inertia + c) * a1 + inertia * a2 + s * u1**2,
        ],
    )
    assert run(["model", model, "--equations", "latex", "--by", by]) == 0
    printed = capsys.readouterr().out
    assert r"\tau_{2} &= " in printed and r"\ddot q_{1}" in printed
    _readable(printed, every=3)
    assert {name.replace(".", "_"): value for name, value in _commented(printed).items()} == pytest.approx(known)
    assert space["VALUES"] == pytest.approx(known)
    copy = tmp_path / "copy.toml"
    assert run(["model", model, "--by", by, "--out", str(copy)]) == 2
    assert "--equations" in capsys.readouterr().err and not copy.exists()


def test_latex_of_effects(puma: Arm) -> None:
    terms = (
        EffectTerm("stribeck_friction", 1, {"breakaway": 3.0, "stribeck_velocity": 0.05}),
        EffectTerm("backlash", 2, {"half_gap": 0.001}),
        EffectTerm("presliding_friction", 3, {"stiffness": 1e4, "damping": 10.0}),
    )
    system = system_of(replace(three_links(puma), effects=terms))
    names = [latex.output_symbol(f"d {name}/dt") for name in system.states]
    assert _readable(latex.equations(system.tape, dict(zip(names, system.rates))), every=7) > 50
