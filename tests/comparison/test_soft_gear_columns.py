"""The twist of a soft gear, by which two sides are compared, is made by the motion and not by noise of the encoders."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_model import Arm
from arm_model.rigid_body.numeric import mass_matrix, rigid_torque
from comparison.joint_fit.effect_columns import EffectColumns
from comparison.joint_fit.effects import SKEW, Added, always
from identification.preprocessing.signals import Motion, equation_rows, equation_weight, parallel_filter, smooth_motion
from identification.preprocessing.spectrum import choose_band
from identification.ripples import wide
from tests.comparison.second_day import motion, puma

SOFT = 1e3
"""N m/rad: the softest gear that is tried."""


def compliance(root: Path, seed: int, speed: float, noise: float, true: float) -> float:
    """Compliance of joint 1 over 1 / SOFT that explains what the rigid torque of a measured motion lacks.

    noise: rad, of the encoders. true: compliance of the arm that was measured; its torques are those of the links, and
    its encoders, at the motors, lead by the twist.
    """
    arm = puma(root, 2)
    t = np.arange(int(16.0 * 250.0)) / 250.0
    q, qd, qdd = motion(t, 2, seed, speed)
    torque = rigid_torque(arm, q, qd, qdd)
    measured = q + noise * np.random.default_rng(seed).standard_normal(q.shape)
    measured[:, 0] += true * torque[:, 0]
    for j, joint in enumerate(arm.joints):
        lead = true * np.gradient(np.gradient(torque[:, 0], t), t) if j == 0 else 0.0
        torque[:, j] += joint.ratio**2 * joint.rotor_inertia * (qdd[:, j] + lead)
    # as where a servo shakes the arm now and then: what is above a slow motion is not cut off
    band = replace(choose_band(measured, float(t[1])), motion=40.0, parallel=3.0)
    seen = wide(smooth_motion(t, measured, torque, band=band))
    asked = rigid_torque(arm, seen.q, seen.qd, seen.qdd)
    for j, joint in enumerate(arm.joints):
        asked[:, j] += joint.ratio**2 * joint.rotor_inertia * seen.qdd[:, j]
    place, row = np.nonzero(equation_rows(seen)[1].T)
    left = parallel_filter(seen, (seen.torque - asked) * equation_weight(seen))[row, place]
    soft = Added("joint_compliance", 1, {"stiffness": SOFT, "damping": 80.0})
    (column,) = EffectColumns(arm, seen).of([soft], seen.torque).T
    return float(column @ left / (column @ column))


@pytest.mark.parametrize("noise", [0.0, 1e-5, 3e-5])
@pytest.mark.parametrize("true", [0.0, 0.2])
def test_noise_of_the_encoders_is_no_soft_gear(root: Path, true: float, noise: float) -> None:
    """As if the link did not follow it, noise of 30 urad looks like 1.5 / SOFT, whatever the gear."""
    found = [compliance(root, seed, 1.0, noise, true / SOFT) for seed in range(2)]
    assert found == pytest.approx([true, true], abs=0.05)


def smooth(root: Path, noise: float = 0.0) -> Motion:
    """Two links of the Puma without friction, and noise (N m) of their torques."""
    arm = puma(root, 2)
    t = np.arange(int(12.0 * 250.0)) / 250.0
    q, qd, qdd = motion(t, 2, 0, 2.0)
    torque = rigid_torque(arm, q, qd, qdd) + noise * np.random.default_rng(1).standard_normal(q.shape)
    return smooth_motion(t, q, torque)


def test_every_soft_gear_is_as_little_damped(root: Path) -> None:
    """One of 1000 N m/rad with the damping of a stiff one would twist 80 ms late, as currents read at another time."""
    arm, seen = puma(root, 2), smooth(root)
    rotors = [joint.ratio**2 * joint.rotor_inertia for joint in arm.joints]
    inertia = mass_matrix(arm, seen.q).diagonal(axis1=1, axis2=2).mean(axis=0) - rotors
    gears = [one for one in always(arm, [seen]) if one.elastic]
    gears += [one.stiffer(by) for one in gears for by in (0.5, 3.0)]
    assert len(gears) == 24
    for one in gears:
        assert one.joint is not None
        critical = 2.0 * np.sqrt(one.held["stiffness"] * inertia[one.joint - 1])
        assert one.held["damping"] == pytest.approx(0.1 * critical, rel=1e-6)


def heavy(root: Path, times: float) -> tuple[Arm, Motion]:
    """Two links of the Puma, ``times`` as heavy, and their motion, which begins and ends at rest."""
    arm, t = puma(root, 2), np.arange(int(12.0 * 250.0)) / 250.0
    joints = [replace(j, mass=times * j.mass, inertia=tuple(times * i for i in j.inertia)) for j in arm.joints]
    arm = replace(arm, joints=tuple(joints))
    q = motion(t, 2, 0, 6.0)[0] * (np.sin(np.pi * t / 12.0) ** 2)[:, None]
    qd = np.gradient(q, t, axis=0)
    return arm, smooth_motion(t, q, rigid_torque(arm, q, qd, np.gradient(qd, t, axis=0)))


@pytest.mark.parametrize("resonance", [5.0, 8.0, 13.0])
def test_a_gear_of_a_heavy_link_is_near_one_that_is_tried(root: Path, resonance: float) -> None:
    """At 200 kN m/rad such a link swings at 3 Hz, and what that does is 0.74 to 0.8 of what these gears do."""
    arm, seen = heavy(root, 600.0)
    inertia = mass_matrix(arm, seen.q).diagonal(axis1=1, axis2=2).mean(axis=0)[1]
    stiffness = float((2 * np.pi * resonance) ** 2 * inertia)
    true = Added("joint_compliance", 2, {"stiffness": stiffness, "damping": 0.2 * float(np.sqrt(stiffness * inertia))})
    tried = [one for one in always(arm, [seen]) if one.elastic and one.joint == 2]
    column, *others = EffectColumns(arm, wide(seen)).of([true, *tried], seen.torque).T
    alike = [(one @ column) ** 2 / (one @ one) / (column @ column) for one in others]
    assert max(alike) > 0.9


def test_noise_of_the_torques_is_in_no_column_of_a_delay(root: Path) -> None:
    """Any delay would be found in it, by which the same torques are put back."""
    arm = puma(root, 2)
    seen = [wide(smooth(root, noise)) for noise in (0.0, 1.0)]
    clean, noisy = (EffectColumns(arm, one).of([SKEW], one.torque) for one in seen)
    assert clean.shape == noisy.shape
    assert np.sqrt(np.mean((noisy - clean) ** 2)) < 0.02 * np.sqrt(np.mean(clean**2))


def test_columns_that_are_kept_are_those_of_new_torques_too(root: Path) -> None:
    """Torques that are put back by a delay change the column of a delay alone."""
    arm, seen = puma(root, 2), wide(smooth(root))
    late = replace(seen, torque=np.roll(seen.torque, 3, axis=0))
    effects = [one for one in always(arm, [seen]) if one.joint in (None, 1)]
    kept = EffectColumns(arm, seen)
    kept.of(effects, seen.torque)
    again, new = kept.of(effects, late.torque), EffectColumns(arm, late).of(effects, late.torque)
    np.testing.assert_array_equal(again, new)
    assert np.abs(kept.of([SKEW], seen.torque) - kept.of([SKEW], late.torque)).max() > 0.0
