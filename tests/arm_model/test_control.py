"""Torque controllers of the underwater arm, in the compiled engine, against closed-form error equations."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm_io import InputError
from arm_model.control.computed_torque import ComputedTorque, Reference
from arm_model.control.momentum_observer import MomentumObserver
from arm_model.control.time_scaling import TimeScaling
from arm_model.control.torque_control import controlled
from arm_model.description import Arm
from arm_model.model_file import read_model
from arm_model.rigid_body.hydrodynamics import dry
from tests.arm_model.two_links import TwoLinks

POINT = np.array([0.5, -0.4])


@pytest.fixture(scope="module")
def arm() -> Arm:
    return read_model(Path(__file__).resolve().parents[2] / "config/models/underwater.toml")


def hold(t: float) -> Reference:
    return Reference(POINT, np.zeros(2), np.zeros(2))


def with_unknown(arm: Arm, *torque: float) -> Arm:
    """The arm with a constant torque on each joint that the drives have to overcome."""
    return replace(arm, joints=tuple(replace(joint, offset=value) for joint, value in zip(arm.joints, torque)))


def test_error_under_computed_torque_obeys_its_equation(arm: Arm) -> None:
    w = 5.0
    controller = ComputedTorque(arm, w)
    run = controlled(arm, controller, hold, duration=0.5, period=0.005, start=POINT + [0.2, -0.1])
    wanted = np.outer((1 + w * run.t) * np.exp(-w * run.t), [0.2, -0.1])  # critically damped from rest
    np.testing.assert_allclose(run.q - run.demand, wanted, atol=4e-3)


def test_unknown_torque_is_observed_at_the_bandwidth_and_cancelled(arm: Arm) -> None:
    unknown, bandwidth, period = np.array([1.5, -0.7]), 20.0, 0.01
    plain = ComputedTorque(arm, 6.0)
    left = controlled(with_unknown(arm, *unknown), plain, hold, duration=1.2, period=0.02)
    assert np.abs(left.q - left.demand)[-1].min() > 0.01

    seen: list[np.ndarray] = []
    decoupled = MomentumObserver(ComputedTorque(arm, 6.0), bandwidth=bandwidth, period=period)

    class Watched:
        def torque(self, q: np.ndarray, qd: np.ndarray, wanted: Reference) -> np.ndarray:
            tau = decoupled.torque(q, qd, wanted)
            seen.append(decoupled.disturbance.copy())
            return tau

        def observe(self, q: np.ndarray, qd: np.ndarray, applied: np.ndarray) -> None:
            decoupled.observe(q, qd, applied)

    run = controlled(with_unknown(arm, *unknown), Watched(), hold, duration=1.2, period=period)
    wanted = -np.outer(1 - (1 - bandwidth * period) ** np.arange(len(run.t)), unknown)  # the sampled low-pass
    np.testing.assert_allclose(seen, wanted, atol=0.05)
    assert np.abs(run.q - run.demand)[-1].max() < 1e-3


def test_limits_hold_and_do_not_wind_the_observer_up(arm: Arm) -> None:
    """Held away from its aim by drives too weak for it, the arm leaves as soon as the disturbance goes."""
    weak = limited(arm, 1.0, 1.0)
    controller = MomentumObserver(ComputedTorque(weak, 6.0), bandwidth=20.0, period=0.02)
    run = controlled(with_unknown(weak, 3.0, 3.0), controller, hold, duration=1.0, period=0.02)
    assert np.abs(run.torque).max() <= 1.0
    assert (run.torque[-10:] == 1.0).all()
    np.testing.assert_allclose(controller.disturbance, [-3.0, -3.0], atol=0.1)


@pytest.mark.parametrize(("limits", "saturated"), [((100.0, 100.0), False), ((4.0, 1.2), True)])
def test_the_water_is_observed_through_the_low_pass_saturated_or_not(
    arm: Arm, limits: tuple[float, float], saturated: bool
) -> None:
    """A controller that knows the dry arm only.

    What its observer finds is the sampled low-pass of the water's torque, which the closed form gives for the motion
    that came of it.
    """
    weak, bandwidth, period = limited(arm, *limits), 15.0, 0.003
    decoupled, seen = MomentumObserver(ComputedTorque(dry(weak), 4.0), bandwidth=bandwidth, period=period), []

    class Watched:
        def torque(self, q: np.ndarray, qd: np.ndarray, wanted: Reference) -> np.ndarray:
            tau = decoupled.torque(q, qd, wanted)
            seen.append(decoupled.disturbance.copy())
            return tau

        def observe(self, q: np.ndarray, qd: np.ndarray, applied: np.ndarray) -> None:
            decoupled.observe(q, qd, applied)

    run = controlled(weak, Watched(), sway, duration=3.9, period=period)
    share = (np.abs(run.torque) >= np.array(limits) - 1e-9).mean(axis=0)
    assert (share > 0.1).all() if saturated else (share == 0.0).all()
    water = TwoLinks((1.0, 1.0), 1025.0 * 0.025, 1025.0 * 2.0 * np.pi * 0.025**2)
    disturbance = -water.torque(run.q, run.qd, np.gradient(run.qd, run.t, axis=0))
    wanted, r = [], np.zeros(2)
    for d in disturbance:
        wanted.append(r)
        r = r + bandwidth * period * (d - r)
    np.testing.assert_allclose(seen, wanted, atol=0.01 * np.abs(disturbance).max())
    assert np.abs(run.q - run.demand)[-1].max() < 2e-3  # it arrives, and does not overshoot for having been held up
    overshoot = ((run.q - POINT) * np.sign(POINT)).max()
    assert overshoot < 5e-3


def sway(t: float) -> Reference:
    """To POINT in 3 s, from and to rest without a jump of the acceleration."""
    s = min(t / 3.0, 1.0)
    return Reference(
        POINT * (10 * s**3 - 15 * s**4 + 6 * s**5),
        POINT * (30 * s**2 - 60 * s**3 + 30 * s**4) / 3.0,
        POINT * (60 * s - 180 * s**2 + 120 * s**3) / 9.0,
    )


def limited(arm: Arm, *limits: float) -> Arm:
    return replace(arm, joints=tuple(replace(joint, torque_limit=limit) for joint, limit in zip(arm.joints, limits)))


@pytest.mark.parametrize(("limits", "slowed"), [((100.0, 100.0), False), ((4.0, 1.2), True)])
def test_time_scaling_keeps_to_the_path_within_the_limits(arm: Arm, limits: tuple[float, float], slowed: bool) -> None:
    weak, period = limited(arm, *limits), 0.02
    computed = ComputedTorque(weak, 6.0)
    scaling = TimeScaling(computed, sway, np.array(limits), period=period)
    run = controlled(weak, scaling, sway, duration=4.0, period=period)
    reference = np.array(scaling.reference)
    assert np.abs(run.q - reference).max() < 1e-3
    behind = np.abs(reference - run.demand).max()
    assert behind > 0.02 if slowed else behind < 1e-12
    if slowed:  # without scaling the same limits are hit, and the path is left
        plain = controlled(weak, computed, sway, duration=4.0, period=period)
        assert (np.abs(plain.torque) >= limits).any() and not (np.abs(run.torque) >= limits).any()
        assert np.abs(plain.q - plain.demand).max() > 5 * np.abs(run.q - reference).max()


def test_bad_period_and_unstable_sampling(arm: Arm) -> None:
    with pytest.raises(InputError, match="between 0 and 1"):
        MomentumObserver(ComputedTorque(arm, 5.0), bandwidth=50.0, period=0.02)
    with pytest.raises(InputError, match="whole number of steps"):
        controlled(arm, ComputedTorque(arm, 5.0), hold, duration=1.0, period=0.0125)
    with pytest.raises(InputError, match="must be positive"):
        TimeScaling(ComputedTorque(arm, 5.0), hold, np.array([1.0, 0.0]), period=0.1)
    stiff = ComputedTorque(arm, 500.0)
    with pytest.raises(InputError, match="runs away"), np.errstate(all="ignore"):
        controlled(arm, stiff, hold, duration=10.0, period=0.1, start=np.zeros(2))


@pytest.mark.slow
def test_example_draws_and_reports(root: Path, tmp_path: Path) -> None:
    import json
    import subprocess
    import sys

    done = subprocess.run(
        [sys.executable, "-m", "examples.underwater", "--out", str(tmp_path)],
        cwd=root,
        capture_output=True,
        text=True,
        check=True,
    )
    printed = json.loads(done.stdout[: done.stdout.rindex("}") + 1])
    assert {path.name for path in tmp_path.iterdir()} == {"free.png", "controlled.png", "limited.png"}
    ends = printed["free_end_deg"]
    assert abs(ends["drag and added mass"][1]) < abs(ends["in air"][1])
    rms = printed["controlled"]["rms_deg"]
    assert max(printed["limited"]["rms_deg"]["momentum observer and time scaling"]) < 0.5
    assert max(rms["with momentum observer"]) < 0.2 * max(rms["computed torque, dry model"])
