"""Friction of an axis whose encoder counts milliradians, found by position errors in closed loop.

Plant, servo and friction are explicit steps that share no code with the finder.
"""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm_io.parallel import CORES
from arm_model import Arm, Controller
from arm_model.motion import Motion
from arm_model.simulation import simulate_batch
from daq.recording import Attachments, Recording, open_recording, write_table
from diagnosis.cause import Cause, Estimate, Signal
from diagnosis.closed_loop.friction import FrictionLimits, friction_in_loop, with_estimates_of
from diagnosis.diagnose import diagnose
from tests.diagnosis.one_axis import vertical_joint

ROTOR, VISCOUS, COULOMB, NOISE, COUNT = 2.0, 5.0, 10.0, 0.1, 1e-3
GAINS = 3000.0, 3000.0, 240.0
"""A/rad, A/(rad s), A s/rad; a torque constant of 1."""
TICK, FINE, SECONDS, LOW_PASS = 1e-3, 10, 8.0, 300.0

Hidden = tuple[float, float, float, bool]
"""Bristles N m/rad (0: none) and their damping N m s/rad, a hump N m at 0.05 rad/s, whether the axis sticks."""


def _axis() -> Arm:
    joint = vertical_joint(ROTOR, COULOMB, VISCOUS, 0.01)
    servo = Controller(
        kind="gains",
        setpoint_period=TICK,
        servo_period=TICK,
        position_gain=GAINS[:1],
        integral_gain=GAINS[1:2],
        velocity_gain=GAINS[2:],
        velocity_bandwidth=LOW_PASS,
    )
    return Arm("axis", (joint,), controller=servo)


@cache
def _demand(seed: int, creeping: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng, t = np.random.default_rng(seed), np.arange(0.0, SECONDS, TICK)
    rates, sizes = ([0.09, 0.21], [0.03, 0.012]) if creeping else ([0.31, 0.53, 0.83], [0.3, 0.15, 0.1])
    rates = 2 * np.pi * np.array(rates) * rng.uniform(0.9, 1.1, len(rates))
    begun = np.clip(t - 0.5, 0.0, 1.0)
    begun = begun**3 * (10 - 15 * begun + 6 * begun**2)
    r = begun * (np.sin(np.outer(t, rates) + rng.uniform(0, 6, len(rates))) @ sizes)
    return t, r, np.gradient(r, t)


def _recorded(path: Path, seed: int, hidden: Hidden, creeping: bool) -> Recording:
    """500 rows/s of counts, currents and demands."""
    stiffness, damping, hump, sticks = hidden
    t, r, rate = _demand(seed, creeping)
    q, i, step = np.empty_like(r), np.empty_like(r), TICK / FINE
    x = v = z = total = slow = last = 0.0
    keep = math.exp(-LOW_PASS * TICK)
    for k, (wanted, speed) in enumerate(zip(r.tolist(), rate.tolist())):
        counted = round(x / COUNT) * COUNT
        slow, last = keep * slow + (1 - keep) * (counted - last) / TICK, counted
        total += GAINS[1] * (wanted - counted) * TICK
        u = GAINS[0] * (wanted - counted) + total + GAINS[2] * (speed - slow)
        q[k], i[k] = counted, u
        for _ in range(FINE):
            level = COULOMB + hump * math.exp(-((v / 0.05) ** 2))
            if stiffness > 0.0:
                bends = v - stiffness * abs(v) * z / level
                v += step * (u - VISCOUS * v - stiffness * z - damping * bends) / ROTOR
                z += step * bends
            elif not sticks:
                v += step * (u - VISCOUS * v - level * v / math.hypot(v, 0.01)) / ROTOR
            elif v != 0.0 or abs(u) > level:
                against = math.copysign(level, v if v != 0.0 else u)
                then = v + step * (u - VISCOUS * v - against) / ROTOR
                v = 0.0 if then * v < 0.0 else then
            x += step * v
    i += NOISE * np.random.default_rng(seed + 9).normal(size=len(i))
    write_table(path, t[::2], {"q": q[::2, None], "i": i[::2, None], "qref": r[::2, None]}, Attachments())
    return open_recording(path)


def _recordings(folder: Path, hidden: Hidden, *, creeping: bool = False) -> list[Recording]:
    return [_recorded(folder / f"{seed}.mcap", seed, hidden, creeping) for seed in (1, 2, 3)]


@pytest.mark.parametrize("stiffness", [500.0, 5000.0])
def test_friction_that_builds_up_over_a_few_counts_is_named_with_its_stiffness(
    stiffness: float, tmp_path: Path
) -> None:
    (cause,) = friction_in_loop(_axis(), _recordings(tmp_path, (stiffness, 20.0, 0.0, False)), [1], ())
    found = {p.name: p for p in cause.parameters}
    assert cause.key == ("presliding_friction", 1)
    for name, true in (("stiffness", stiffness), ("damping", 20.0)):
        assert abs(found[name].value - true) < 2 * found[name].std, name
    # the axis takes the speed of its demand half a tick before the servo of the model: 7 % of stiffness if not free
    assert found["stiffness"].value == pytest.approx(stiffness, rel=0.04)
    assert found["stiffness"].std < 0.15 * stiffness
    assert cause.after < 0.4 * cause.before


def test_what_currents_name_at_a_coarse_encoder_is_estimated_by_position_errors_too(tmp_path: Path) -> None:
    *fit, held_out = _recordings(tmp_path, (500.0, 0.0, 0.0, False))
    (cause,) = diagnose(_axis(), fit, [held_out]).causes
    found = {p.name: p for p in cause.parameters}
    assert cause.key == ("presliding_friction", 1) and cause.signal is Signal.ANGLE
    assert abs(found["stiffness"].value - 500.0) < 2 * found["stiffness"].std
    # the damping that currents assume is 10; positions show it
    assert found["damping"].value + 2 * found["damping"].std < 10.0


@pytest.mark.parametrize(("other", "value", "std"), [(520.0, 510.0, 20.0 / 2**0.5), (600.0, 550.0, 50.0)])
def test_two_estimates_are_weighted_and_their_disagreement_is_in_the_deviation(
    other: float, value: float, std: float
) -> None:
    by_loop, by_current = (_named([Estimate("stiffness", at, 20.0, "N m/rad")]) for at in (500.0, other))
    (mean,) = with_estimates_of(by_loop, by_current).parameters
    assert mean.value == pytest.approx(value)
    assert mean.std == pytest.approx(std)


def _named(parameters: list[Estimate]) -> Cause:
    key = "presliding_friction", 1
    return Cause(
        effect=key[0],
        joint=key[1],
        parameters=parameters,
        confidence=0.9,
        before=1.0,
        after=0.1,
        group=(key,),
        evidence="",
        felt_at=1,
        unit="rad",
    )


@pytest.mark.parametrize(
    ("hidden", "creeping"),
    [
        ((0.0, 0.0, 0.0, False), False),
        ((0.0, 0.0, 0.0, True), False),
        ((0.0, 0.0, 0.0, True), True),
        ((0.0, 0.0, 4.0, True), True),
    ],
)
def test_friction_that_turns_at_once_is_none_whether_it_sticks_or_not(
    hidden: Hidden, creeping: bool, tmp_path: Path
) -> None:
    assert friction_in_loop(_axis(), _recordings(tmp_path, hidden, creeping=creeping), [1], ()) == []


def test_bristles_as_stiff_as_any_that_were_tried_are_friction_that_sticks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They fit best, within the grid, where the stiffest build up within a hundredth of an encoder step."""
    monkeypatch.setattr("tests.diagnosis.test_friction_in_loop.COUNT", 1e-4)
    monkeypatch.setattr("diagnosis.closed_loop.friction.RESOLVED", 0.05)
    runs = _recordings(tmp_path, (0.0, 0.0, 0.0, True), creeping=True)
    assert friction_in_loop(_axis(), runs, [1], ()) == []
    monkeypatch.setattr("diagnosis.closed_loop.friction.LIMITS", FrictionLimits(sticks=np.inf))
    assert [cause.key for cause in friction_in_loop(_axis(), runs, [1], ())] == [("presliding_friction", 1)]


def test_one_recording_refutes_what_no_lane_of_it_allows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    simulated = list[int]()

    def counted(*args: Any, parameters: dict[str, np.ndarray]) -> Motion:
        simulated.append(len(next(iter(parameters.values()))))
        return simulate_batch(*args, parameters=parameters)

    monkeypatch.setattr("diagnosis.closed_loop.lanes.simulate_batch", counted)
    monkeypatch.setenv(CORES, "1")
    assert friction_in_loop(_axis(), _recordings(tmp_path, (0.0, 0.0, 0.0, False)), [1], ()) == []
    assert simulated == [8, 8, 8, 40]
