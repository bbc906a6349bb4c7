"""An arm whose controller shows coupled angles goes through identification, diagnosis and comparison.

Its recordings come from virtual work over absolute angles (``tests.foreign.palletiser``).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_model.rigid_body import drive_mass_matrix, drive_rigid_torque
from arm_model.system import inverse_dynamics
from diagnosis.measurements.link_encoders.rows import behind
from diagnosis.measurements.tracker.causes import tracked_causes
from tests.foreign.palletiser import HEALTHY, Palletiser, model, motion, recorded

DIGITS = {"rtol": 1e-9, "atol": 1e-9}


def changed(name: str, joint: int, by: float) -> Palletiser:
    values = getattr(HEALTHY, name).copy()
    values[joint - 1] += by
    return replace(HEALTHY, **{name: values})


def test_torques_at_the_drives_are_those_of_virtual_work() -> None:
    _, m, rate, second = motion(1)
    np.testing.assert_allclose(inverse_dynamics(model(), m, rate, second), HEALTHY.torque(m, rate, second), **DIGITS)
    smooth = replace(HEALTHY, coulomb=np.zeros(3), viscous=np.zeros(3))
    np.testing.assert_allclose(drive_rigid_torque(model(), m, rate, second), smooth.torque(m, rate, second), **DIGITS)
    columns = [smooth.torque(m, 0 * m, one) - smooth.torque(m, 0 * m, 0 * m) for one in np.eye(3)[:, None] + 0 * m]
    np.testing.assert_allclose(drive_mass_matrix(model(), m, rotors=False), np.stack(columns, axis=-1), **DIGITS)


def test_a_missing_link_encoder_is_missing_at_the_motors_that_depend_on_it() -> None:
    arm, links = model(), np.array([[1.0, -0.2, 0.3], [1.0, np.nan, 0.3], [1.0, -0.2, np.nan]])
    expected = [[1.0, 0.8, 1.1], [1.0, np.nan, np.nan], [1.0, 0.8, np.nan]]
    np.testing.assert_allclose(arm.reported_angles(links), expected)
    np.testing.assert_allclose(arm.link_angles(np.array(expected[0])), links[0])


CHANGES = {
    "coulomb": (changed("coulomb", 2, 5.0), ("coulomb_friction", 2), "coulomb", 5.0),
    "zero": (changed("zero", 2, 0.02), ("joint_zero_offset", 2), "offset", 0.02),
}


@pytest.mark.parametrize("kind", CHANGES)
def test_what_is_wrong_is_named(kind: str, tmp_path: Path) -> None:
    real, key, parameter, true = CHANGES[kind]
    fit, held_out = (recorded(real, tmp_path / f"{seed}.mcap", seed) for seed in (1, 2))
    found = armscope.diagnose(fit, model(), held_out=held_out)
    assert [cause.key for cause in found.causes] == [key]
    assert found.verdict == "explained"
    (p,) = (one for one in found.causes[0].parameters if one.name == parameter)
    assert abs(p.value - true) < 3 * p.std


def test_nothing_wrong_is_consistent(tmp_path: Path) -> None:
    fit, held_out = (recorded(HEALTHY, tmp_path / f"{seed}.mcap", seed, links=True) for seed in (1, 2))
    found = armscope.diagnose(fit, model(), held_out=held_out)
    assert (found.verdict, found.causes) == ("consistent", [])


def test_link_encoders_are_compared_as_motors(tmp_path: Path) -> None:
    run = recorded(HEALTHY, tmp_path / "run.mcap", 1, links=True)
    np.testing.assert_allclose(behind(run, model()), run.q, atol=5e-5)


def test_a_tracker_shows_the_zero_of_a_motor_that_moves_two_links(tmp_path: Path) -> None:
    real = changed("zero", 2, 0.004)
    fit, held_out = (recorded(real, tmp_path / f"{seed}.mcap", seed, tracker=True) for seed in (1, 2))
    (cause,) = tracked_causes(model(), [fit], [held_out]).causes
    assert cause.key == ("joint_zero_offset", 2)
    (p,) = cause.parameters
    assert abs(p.value - 0.004) < 3 * p.std


@pytest.mark.parametrize("method", ["wls", "sequence", "motor-link"])
def test_every_method_identifies_it(method: str, tmp_path: Path) -> None:
    fit, held_out = (recorded(HEALTHY, tmp_path / f"{seed}.mcap", seed) for seed in (1, 2))
    found = armscope.identify(fit, model(), held_out=held_out, method=method)
    if method == "motor-link":
        assert any("joint 1 moves links 1, 2" in text for text in found.warnings)
    else:
        assert found.to_json()["relative_error"]["held_out"] < 0.02


def test_what_changed_between_two_days_is_told(tmp_path: Path) -> None:
    before = [recorded(HEALTHY, tmp_path / f"before{seed}.mcap", seed) for seed in (1, 2)]
    after = [recorded(changed("coulomb", 2, 5.0), tmp_path / f"after{seed}.mcap", seed) for seed in (3, 4)]
    told = armscope.compare(before, after, model())
    assert "joint 2" in str(told)
