"""The band of the regression ends where setpoints do: what servos add to each of them is no motion of rigid links."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.ndimage import uniform_filter1d
from scipy.signal import bilinear, lfilter

import armscope
from arm_model import EffectTerm, read_model
from identification.preprocessing.spectrum import choose_band

RATE, PERIOD = 500.0, 0.012
"""rows/s; s between setpoints."""
SERVO, STEP = 400.0, 2 * np.pi / 2**22
"""rad/s: bandwidth of the servos; rad at the joint: step of the encoders."""
SPRING = {"stiffness": 8000.0, "damping": 3.0}
"""N m/rad and N m s/rad of the gear."""


def moves(seed: int, seconds: float, joints: int) -> np.ndarray:
    """(m, joints) rad at setpoints: from point to point, each move with a constant acceleration and deceleration."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, PERIOD)
    q, start, now = np.zeros((len(t), joints)), 0.6, np.zeros(joints)
    while start < seconds - 1.0:
        target = rng.uniform(-1.0, 1.0, joints)
        last, ramp = 0.4 + 0.7 * np.abs(target - now).max(), 0.2
        s = np.clip(t - start, 0.0, last)
        done = np.where(s < ramp, s**2 / (2 * ramp), s - ramp / 2)
        done = np.where(s > last - ramp, last - ramp - (last - s) ** 2 / (2 * ramp), done) / (last - ramp)
        q += done[:, None] * (target - now)
        start, now = start + last + rng.uniform(0.0, 0.3), target
    return q


def at_rows(setpoints: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """(n, J) rad at ``rate`` rows/s: straight lines between setpoints, and how a fast servo follows them."""
    t = np.arange(int((len(setpoints) - 1) * PERIOD * rate)) / rate
    lines = np.stack([np.interp(t, np.arange(len(setpoints)) * PERIOD, column) for column in setpoints.T], axis=1)
    keep = np.exp(-SERVO / rate)
    return lines, lfilter([1 - keep], [1, -keep], lines, axis=0)


def test_lines_of_setpoints_are_no_bandwidth_of_the_motion() -> None:
    """A fast servo follows moves from point to point."""
    _, followed = at_rows(moves(1, 20.0, 2), RATE)
    band = choose_band(np.round(followed / STEP) * STEP, 1 / RATE)
    assert band.parallel > 1 / PERIOD
    assert 3.0 < band.below(0.5 / PERIOD).parallel < 0.5 / PERIOD
    # demands that end above the band change nothing
    assert band.below(1.1 * band.parallel) is band


@pytest.fixture(scope="module")
def logs(root: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Of one link behind a soft gear, 27 Hz with its motor held, by an integration of its own.

    The link is the first of two, turns about a vertical axis, and its motor bears 5 N m of Coulomb friction.
    """
    folder, fine = tmp_path_factory.mktemp("logs"), 20 * RATE
    link, rotor, (stiffness, damping) = 0.27, 0.5, SPRING.values()
    found = []
    for seed in (1, 2):
        demanded, motor = (column[:, 0] for column in at_rows(moves(seed, 20.0, 1), fine))
        t = np.arange(len(motor)) / fine
        # the link follows the motor by link q'' = damping (motor' - q') + stiffness (motor - q)
        twist = motor - lfilter(*bilinear([damping, stiffness], [link, damping, stiffness], fine), motor)
        speed = np.gradient(motor, 1 / fine)
        torque = rotor * np.gradient(speed, 1 / fine) + 10.0 * speed + 5.0 * speed / np.hypot(speed, 0.01)
        torque += stiffness * twist + damping * np.gradient(twist, 1 / fine)
        noise = 2e-3 * np.random.default_rng(seed).standard_normal(len(t[::20]))
        # the instrument averages over each row
        columns = {"q1": np.round(motor / STEP) * STEP, "i1": uniform_filter1d(torque, 20) / 10.0, "qref1": demanded}
        table = pd.DataFrame({"t": t[::20]} | {name: column[::20] for name, column in columns.items()})
        table["i1"] += noise
        found.append(folder / f"{seed}.mcap")
        armscope.import_table(table, found[-1])
    return found


def test_a_soft_gear_does_not_spoil_what_is_identified_from_moves_from_point_to_point(
    root: Path, logs: list[Path]
) -> None:
    arm = read_model(root / "config/models/two_link.toml")
    spring = EffectTerm("joint_compliance", 1, SPRING)
    arm = replace(arm, joints=arm.joints[:1], controller=None, effects=(spring,))
    result = armscope.identify(logs[0], arm, held_out=logs[1])
    found = {one.name: (one.value, one.std) for one in [*result.parameters, *result.base] if one.std is not None}
    (inertia,) = [name for name in found if name.startswith("joint1.rotor_inertia")]
    for name, truth in ((inertia, 0.77), ("joint1.viscous", 10.0), ("joint1.coulomb", 5.0)):
        value, std = found[name]
        assert abs(value - truth) < 2 * std
    assert found["joint1.coulomb"][1] < 0.01
    assert result.predictions[-1].held_out and result.predictions[-1].relative_error < 0.005
