"""Servos hold their currents: how far from its mean a row shows a current is no time skew."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_model import Arm
from daq.recording import Recording
from diagnosis.verification.held_currents import instants_apart, largest_delay

HOLD = 0.005
"""s: servos of a slow bus."""


@pytest.mark.parametrize(("hold", "lag"), [(1e-3, 0.0), (1e-3, 4e-4), (1e-3, 8e-4), (2e-3, 1e-4)])
def test_the_largest_delay_is_that_of_a_ramp(hold: float, lag: float) -> None:
    steps, holds = 400, 60
    t = hold / steps * np.arange(steps * holds)
    command, shown = np.floor(t / hold + 1e-9) * hold, np.zeros(len(t))
    keep = np.exp(-hold / steps / lag) if lag else 0.0
    for k in range(1, len(t)):
        shown[k] = command[k] + (shown[k - 1] - command[k]) * keep
    behind = (t - shown)[-steps:]
    assert largest_delay(hold, lag) == pytest.approx(np.abs(behind - behind.mean()).max(), rel=0.02)


@pytest.mark.parametrize(
    ("rate", "apart"), [(500.0, 2e-3), (100.0, 2e-3), (200.0, 1e-3), (1000.0, 1e-3), (250.0, 2e-3), (313.1, 0.0)]
)
def test_rows_show_a_hold_at_so_many_instants(rate: float, apart: float) -> None:
    assert instants_apart(2e-3, rate) == pytest.approx(apart)


@pytest.fixture
def recorded(root: Path, tmp_path: Path) -> tuple[Arm, list[Recording]]:
    """The starter project with servos that hold for HOLD and no current loop, one row per hold."""
    arm = armscope.read_model(root / "config/starters/csv/model.toml")
    assert arm.controller is not None
    slow = replace(arm.controller, servo_period=HOLD, setpoint_period=HOLD, current_lag=0.0)
    arm, found = replace(arm, controller=slow), []
    for seed, name in enumerate(("fit", "held_out")):
        motion = armscope.read_experiment(root / f"config/starters/csv/{name}.toml")
        r = armscope.simulate(arm, motion, rate=1.0 / HOLD).write(tmp_path / f"{name}.mcap")
        noise = 2e-3 * np.random.default_rng(seed).standard_normal(r.i.shape)
        found.append(replace(r, i=r.i + noise))
    return arm, found


@pytest.mark.parametrize("stated", [True, False])
def test_currents_that_are_shown_when_they_are_set_are_not_early(
    recorded: tuple[Arm, list[Recording]], stated: bool
) -> None:
    arm, (fit, held_out) = recorded
    result = armscope.diagnose(fit, arm if stated else replace(arm, controller=None), held_out=held_out)
    assert result.verdict == "consistent" and not result.causes
    assert any("before the angles" in warning for warning in result.details.warnings)


@pytest.mark.parametrize("rows", [1, 4])
def test_currents_that_are_earlier_are(recorded: tuple[Arm, list[Recording]], rows: int) -> None:
    """By 7.5 ms and by 22.5 ms, which is far beyond a first-order change of a current at 20 Hz."""
    arm, runs = recorded
    late = [replace(r, i=np.vstack([r.i[rows:], np.repeat(r.i[-1:], rows, axis=0)])) for r in runs]
    (cause,) = armscope.diagnose(late[0], arm, held_out=late[1]).causes
    assert cause.effect == "time_skew"
    (delay,) = cause.parameters
    assert abs(delay.value + (rows + 0.5) * HOLD) < 3 * delay.std
