"""The compiled simulation against a plant that shares no code with it (tests/blind): the same effects, other numerics.

Compared is what an effect does while the arm moves: the change of motor angle and current that it brings. Dry friction
differs near standstill (a hyperbolic tangent there, v / sqrt(v^2 + w^2) here), so that tolerances are shares of that
change, not rounding errors.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_model.description import Arm, EffectTerm
from arm_model.simulation.simulation import simulate_at
from tests.arm_model.pumas import swing

pytest.importorskip("numba")
from tests.blind.hide import Hidden, hide_in_plant
from tests.blind.plant import run
from tests.blind.record import nominal_plant

pytestmark = pytest.mark.slow
DURATION = 1.2
SETTLING = 6.0
"""s at the start; ours starts in equilibrium, the other has only gravity in its integrators."""
MOVING = slice(round(0.15 / 0.000875), round(0.95 / 0.000875))
ROTOR_2 = 107.815**2 * 200e-6  # kg m2; the other plant takes its teeth's damping from it
CASES: list[tuple[str, int | None, dict[str, float]]] = [
    ("viscous_friction", 2, {"viscous": 4.0}),
    ("coulomb_friction", 2, {"coulomb": 4.0}),
    ("friction_asymmetry", 1, {"positive": 3.0, "negative": -2.0}),
    ("stribeck_friction", 2, {"breakaway": 4.0, "stribeck_velocity": 0.1}),
    ("load_friction", 2, {"mu": 0.1}),
    ("friction_drift", 1, {"fraction": 0.3, "time_constant": 1.0}),
    ("gravity_spring", 2, {"stiffness": 20.0, "rest_angle": 0.1}),
    ("cogging", 1, {"amplitude": 2.0, "pole_pairs": 1.0, "phase": 0.3}),
    ("gear_ripple", 1, {"amplitude": 5e-4, "order": 1.0, "phase": 0.3}),
    ("backlash", 2, {"half_gap": 1e-3}),
    ("joint_compliance", 2, {"stiffness": 2e4, "damping": 20.0}),
    ("payload", None, {"mass": 2.0, "x": 0.05, "y": 0.0, "z": 0.1}),
    ("base_tilt", None, {"roll": 0.03, "pitch": -0.02}),
    ("torque_constant", 2, {"error": 0.1}),
    ("wrist_coupling", None, {"c54": 0.1, "c64": -0.05, "c65": 0.2}),
    ("hydrodynamic_drag", 2, {"drag": 3.0}),
]


def _theirs(model: Path, hidden: tuple[Hidden, ...]) -> tuple[np.ndarray, np.ndarray]:
    plant = hide_in_plant(nominal_plant(model), hidden)
    servo = np.arange(round(DURATION / plant.servo_period)) * plant.servo_period
    knots = np.arange(0.0, DURATION + 0.056, 0.028)
    targets = swing(6)(knots)
    wanted = np.column_stack([np.interp(servo, knots, column) for column in targets.T])
    angle, current, _ = run(plant, wanted, round(SETTLING / plant.servo_period), 8)
    return angle, current


def _ours(arm: Arm) -> tuple[np.ndarray, np.ndarray]:
    assert arm.controller is not None
    times = np.arange(round(DURATION / arm.controller.servo_period)) * arm.controller.servo_period
    motion = simulate_at(arm, swing(6), times, substeps=8)
    return motion.qm, motion.current


@pytest.mark.parametrize(("name", "joint", "values"), CASES, ids=[case[0] for case in CASES])
def test_an_effect_does_the_same(root: Path, puma: Arm, name: str, joint: int | None, values: dict[str, float]) -> None:
    arm = replace(puma, joints=tuple(replace(j, sign_velocity=0.005) for j in puma.joints))
    model = root / "config/models/puma560.toml"
    bare, bare_theirs = _ours(arm), _theirs(model, ())
    teeth = {"contact_stiffness": 2e5, "contact_damping": 0.2 * np.sqrt(2e5 * ROTOR_2)} if name == "backlash" else {}
    bent = _ours(replace(arm, effects=(EffectTerm(name, joint, {**values, **teeth}),)))
    bent_theirs = _theirs(model, (Hidden(name, joint, values),))
    for k in range(2):
        change, expected = (bent[k] - bare[k])[MOVING], (bent_theirs[k] - bare_theirs[k])[MOVING]
        assert np.linalg.norm(change - expected) < 0.02 * np.linalg.norm(expected), ("angle", "current")[k]


def test_bristles_add_no_difference_of_their_own(root: Path, puma: Arm) -> None:
    """What a bristle changes is the friction near standstill in which the bare plants differ.

    The whole motion is compared.
    """
    values = {"stiffness": 1e4, "damping": 50.0}
    arm = replace(puma, joints=tuple(replace(j, sign_velocity=0.005) for j in puma.joints))
    model = root / "config/models/puma560.toml"
    bare, bare_theirs = _ours(arm), _theirs(model, ())
    bent = _ours(replace(arm, effects=(EffectTerm("presliding_friction", 2, values),)))
    bent_theirs = _theirs(model, (Hidden("presliding_friction", 2, values),))
    for k in range(2):
        plain = np.abs(bare[k] - bare_theirs[k])[MOVING].max()
        assert np.abs(bent[k] - bent_theirs[k])[MOVING].max() < 1.1 * plain
        assert plain < (2e-5, 0.01)[k]
