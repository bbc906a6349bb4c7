"""Rigid torque, mass matrix and inverse dynamics along recordings by compiled code: equal to those by numpy."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_model import Arm, EffectTerm, read_model
from arm_model.rigid_body.numeric import drive_mass_matrix, drive_rigid_torque
from arm_model.symbolic.rows import rows_of
from arm_model.symbolic.tape import Tape, evaluate
from arm_model.system import along_motion, inverse, inverse_dynamics, mass_matrix_along, rigid_torque_along
from arm_model.tables.drive import FrictionCurve

ROWS = along_motion.FEW + 3
"""Not a multiple of the lanes."""
MODELS = ("puma560", "kr300", "emps", "scara", "gantry", "underwater")


def motion(arm: Arm) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    q, qd, qdd = np.random.default_rng(8).normal(size=(3, ROWS, len(arm)))
    return q, qd, qdd


@pytest.fixture(params=MODELS)
def arm(request: pytest.FixtureRequest, root: Path) -> Arm:
    return read_model(root / f"config/models/{request.param}.toml")


def same(found: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12 * np.abs(expected).max())


def test_torque_and_mass_matrix_are_those_of_numpy(arm: Arm) -> None:
    q, qd, qdd = motion(arm)
    same(rigid_torque_along(arm, q, qd, qdd), drive_rigid_torque(arm, q, qd, qdd))
    same(mass_matrix_along(arm, q), drive_mass_matrix(arm, q, rotors=False))


def test_another_arm_of_the_same_structure_takes_its_own_numbers(root: Path) -> None:
    puma = read_model(root / "config/models/puma560.toml")
    q, qd, qdd = motion(puma)
    before = rigid_torque_along(puma, q, qd, qdd)
    joint = puma.joints[1]
    for other in (replace(joint, a=1.01 * joint.a), replace(joint, mass=joint.mass + 1.0), replace(joint, alpha=0.01)):
        changed = replace(puma, joints=(puma.joints[0], other, *puma.joints[2:]))
        found = rigid_torque_along(changed, q, qd, qdd)
        same(found, drive_rigid_torque(changed, q, qd, qdd))
        assert np.abs(found - before).max() > 1e-6 * np.abs(before).max()
    same(rigid_torque_along(replace(puma, gravity=(1.0, 2.0, 3.0)), q, qd, qdd) - before, _by_gravity(puma, q))


def _by_gravity(arm: Arm, q: np.ndarray) -> np.ndarray:
    still = np.zeros_like(q)
    tilted, upright = (drive_rigid_torque(one, q, still, still) for one in (replace(arm, gravity=(1.0, 2.0, 3.0)), arm))
    return tilted - upright


EFFECTS = (
    EffectTerm("coulomb_friction", 2, {"coulomb": 8.0}),
    EffectTerm("load_friction", 3, {"mu": 0.05}),
    EffectTerm("gravity_spring", 2, {"stiffness": 5.0, "rest_angle": 0.3}),
    EffectTerm("joint_zero_offset", 2, {"offset": 0.03}),
    EffectTerm("base_tilt", None, {"roll": 0.02, "pitch": -0.01}),
    EffectTerm("payload", None, {"mass": 0.7, "x": 0.01, "y": 0.02, "z": 0.1}),
    EffectTerm("gear_ripple", 1, {"amplitude": 3e-4, "order": 3.0, "phase": 0.4}),
    EffectTerm("hydrodynamic_drag", 1, {"drag": 3.0}),
)
COUPLED = EffectTerm("wrist_coupling", None, {"c54": 0.02, "c64": -0.03, "c65": 0.1})


@pytest.mark.parametrize(
    "terms",
    [EFFECTS[:3], EFFECTS[3:6], EFFECTS[6:], EFFECTS, (*EFFECTS[3:], COUPLED)],
    ids=["drag", "links", "uneven", "all", "coupled"],
)
@pytest.mark.parametrize("name", ["puma560", "emps"])
def test_inverse_dynamics_with_effects_is_that_of_few_rows(
    root: Path, name: str, terms: tuple[EffectTerm, ...]
) -> None:
    arm = read_model(root / f"config/models/{name}.toml")
    mine = tuple(replace(one, joint=one.joint and min(one.joint, len(arm))) for one in terms)
    arm = replace(arm, effects=mine if len(arm) > 1 else mine[:1])
    q, qd, qdd = motion(arm)
    t = np.linspace(0.0, 5.0, ROWS)
    parts = [slice(k, k + 100) for k in range(0, ROWS, 100)]
    by_numpy = np.concatenate([inverse_dynamics(arm, q[p], qd[p], qdd[p], time=t[p]) for p in parts])
    same(inverse_dynamics(arm, q, qd, qdd, time=t), by_numpy)


@pytest.mark.parametrize("terms", [EFFECTS[:3], EFFECTS, (*EFFECTS[3:], COUPLED)], ids=["drag", "all", "coupled"])
def test_equations_that_are_asked_for_often_are_compiled(
    root: Path, terms: tuple[EffectTerm, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    speeds = tuple(np.geomspace(0.01, 2.0, 9).tolist())
    level = tuple(np.linspace(3.0, 1.0, 9).tolist())
    curve = FrictionCurve(speed=speeds, positive=level, negative=level)
    puma = replace(read_model(root / "config/models/puma560.toml"), effects=terms)
    puma = replace(puma, joints=(replace(puma.joints[0], friction_curve=curve), *puma.joints[1:]))
    rubbing = replace(puma.joints[1], coulomb=tuple(1.5 * c for c in puma.joints[1].coulomb))
    arms = puma, replace(puma, joints=(puma.joints[0], rubbing, *puma.joints[2:]))
    q, qd, qdd = motion(puma)
    t = np.linspace(0.0, 5.0, ROWS)
    by_numpy = [inverse_dynamics(arm, q, qd, qdd, time=t) for arm in arms]
    monkeypatch.setattr(inverse, "WORTH_COMPILING", 0.0)
    monkeypatch.setattr(inverse, "evaluate", None)
    for arm, expected in zip(arms, by_numpy):
        same(inverse_dynamics(arm, q, qd, qdd, time=t), expected)
    assert np.abs(by_numpy[1] - by_numpy[0]).max() > 1e-6 * np.abs(by_numpy[0]).max()


def test_arms_that_share_equations_take_their_own_numbers(root: Path) -> None:
    """Other bodies and frames leave the equations beside the links as they are; another gear ratio does not."""
    puma = replace(read_model(root / "config/models/puma560.toml"), effects=EFFECTS)
    q, qd, qdd = motion(puma)
    joint = puma.joints[1]
    others = (
        joint,
        replace(joint, mass=joint.mass + 1.0),
        replace(joint, a=1.01 * joint.a),
        replace(joint, gear=1.1 * joint.gear),
        replace(joint, coulomb=tuple(1.5 * c for c in joint.coulomb)),
    )
    found = []
    for other in others:
        changed = replace(puma, joints=(puma.joints[0], other, *puma.joints[2:]))
        parts = [slice(k, k + 100) for k in range(0, ROWS, 100)]
        found.append(inverse_dynamics(changed, q, qd, qdd))
        same(found[-1], np.concatenate([inverse_dynamics(changed, q[p], qd[p], qdd[p]) for p in parts]))
    assert all(np.abs(one - found[0]).max() > 1e-6 * np.abs(found[0]).max() for one in found[1:])


def test_expressions_by_rows_are_those_of_the_tape() -> None:
    tape = Tape()
    x, y, shared = (tape.input(name) for name in ("x", "y", "shared"))
    outputs = [x * shared + y.sin(), (x * y).exp().minimum(shared), tape.constant(2.0)]
    program = rows_of(tape, outputs, ["x", "y"], ["shared"])
    for count in (1, 7, 8, 17):
        rows = np.random.default_rng(count).normal(size=(count, 2))
        expected = evaluate(tape, outputs, {"x": rows[:, 0], "y": rows[:, 1], "shared": 0.7})
        found = program(np.array([0.7]), rows)
        assert found.shape == (count, 3)
        np.testing.assert_array_equal(program(np.array([0.7]), rows[:, :1], rows[:, 1:]), found)
        np.testing.assert_allclose(found, np.column_stack(np.broadcast_arrays(*expected)), rtol=1e-14, atol=1e-15)
