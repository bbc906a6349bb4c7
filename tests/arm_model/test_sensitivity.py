"""Derivatives of simulated motions against closed forms and against simulations of other arms."""

from __future__ import annotations

import numpy as np
import pytest

from arm_io import InputError
from arm_model.description import Arm, Joint
from arm_model.parameters import parameter, with_parameters
from arm_model.simulation.sensitivity import sensitivities
from arm_model.simulation.servo_references import row_times
from arm_model.simulation.simulation import simulate
from tests.arm_model.pumas import swing, three_links


def test_a_braked_wheel_by_its_brake_and_inertia() -> None:
    """w = T/B (1 - exp(-B t/J)): dw/dB and dw/dJ by hand."""
    torque, brake, inertia = 3.0, 0.8, 1.5
    wheel = Joint(mass=1.0, inertia=(inertia, inertia, inertia, 0, 0, 0), viscous=(brake, brake))
    arm = Arm(name="wheel", joints=(wheel,))
    motion, slopes = sensitivities(
        arm,
        lambda t: np.full((len(t), 1), torque),
        {"joint1.viscous": 1e-3, "link1.izz": 1e-3},
        row_times(2.0, 10.0),
        start=np.zeros(1),
    )
    t = motion.t
    decay = np.exp(-brake * t / inertia)
    np.testing.assert_allclose(motion.qd[:, 0], torque / brake * (1 - decay), atol=1e-9)
    by_brake = -torque / brake**2 * (1 - decay) + torque * t / (brake * inertia) * decay
    np.testing.assert_allclose(slopes.qd[0, :, 0], by_brake, atol=2e-6)
    np.testing.assert_allclose(slopes.qd[1, :, 0], -torque * t / inertia**2 * decay, atol=2e-6)


def test_lanes_are_differences_of_single_simulations(puma: Arm) -> None:
    arm, name, step = three_links(puma), "link3.mass", 0.05
    _, slopes = sensitivities(arm, swing(3), {"joint1.viscous": 0.1, name: step}, row_times(0.5, 100))
    ends = [
        simulate(with_parameters(arm, {name: parameter(arm, name) + nudge}), swing(3), duration=0.5, rate=100)
        for nudge in (step, -step)
    ]
    np.testing.assert_allclose(slopes.current[1], (ends[0].current - ends[1].current) / (2 * step), atol=1e-6)
    with pytest.raises(InputError, match="expected a positive one"):
        sensitivities(arm, swing(3), {name: 0.0}, row_times(0.5, 100))
