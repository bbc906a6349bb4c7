"""Friction that is no straight line over speed, of an arm in MuJoCo: found, smoothed, judged, written as printed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_model import read_model
from armscope.cli import run
from identification.regression.friction_shape import _logarithm, _second_differences
from identification.report.friction import sentences
from tests.comparison import second_day
from tests.diagnosis.rubbing_arm import Law, humped, recording, stranger


def straight(v: np.ndarray) -> np.ndarray:
    return np.array([9.0, 10.0, 5.0]) + np.array([8.0, 9.0, 5.0]) * v


def _identified(folder: Path, law: Law, seconds: float = 16.0) -> armscope.Identification:
    fit, held_out = (recording(folder / f"{seed}.mcap", law, seed, seconds=seconds) for seed in (1, 3))
    return armscope.identify(fit, stranger(folder / "model.toml"), held_out=held_out)


@pytest.fixture(scope="module")
def curved(tmp_path_factory: pytest.TempPathFactory) -> tuple[armscope.Identification, Path]:
    folder = tmp_path_factory.mktemp("curved")
    result = _identified(folder, humped)
    result.write(folder / "out")
    return result, folder


def test_a_hump_and_a_power_are_found_within_their_deviations(curved: tuple[armscope.Identification, Path]) -> None:
    result, _ = curved
    assert [(band.joint, band.direction, band.curve) for band in result.friction_bands] == [
        (joint, 0, True) for joint in (1, 2, 3)
    ]
    off = []
    for band in result.friction_bands:
        truth = np.array([humped(np.full(3, v))[band.joint - 1] for v in band.speed])
        off += ((band.torque - truth) / band.std).tolist()
        known = band.std < 0.01 * truth
        assert known.mean() > 0.5
        np.testing.assert_allclose(band.torque[known], truth[known], rtol=0.01)
    assert np.mean(np.abs(off) < 2) > 0.85
    assert np.abs(off).max() < 5


def test_the_curve_makes_the_held_out_error_noise(curved: tuple[armscope.Identification, Path]) -> None:
    result, _ = curved
    trials = result.extra["friction_trials"]
    assert all(trial["stays"] and trial["curve"] < 0.5 * trial["straight"] for trial in trials)
    assert result.noise is not None
    assert max(one.ratio for one in result.noise) < 1.3


def test_recordings_shorter_than_a_stretch_are_cut_into_shorter_ones(tmp_path: Path) -> None:
    result = _identified(tmp_path, humped, seconds=4.0)
    assert all(trial["p"] < 1.0 for trial in result.extra["friction_trials"])


def test_what_is_written_is_what_was_printed(
    curved: tuple[armscope.Identification, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    result, folder = curved
    table = json.loads((folder / "out/identification.json").read_text())
    arm = read_model(folder / "out/model.toml")
    for entry in table["friction_curves"]:
        joint = arm.joints[entry["joint"] - 1]
        assert joint.friction_curve is not None
        assert joint.friction_curve.speed == pytest.approx(entry["speed"])
        total = joint.ratio * joint.coulomb[0] + joint.ratio**2 * joint.viscous[0] * np.array(entry["speed"])
        np.testing.assert_allclose(total + joint.friction_curve.positive, entry["torque"], rtol=1e-9)
    (again,) = armscope.predict(folder / "3.mcap", folder / "out/model.toml")
    assert again.relative_error == pytest.approx(table["relative_error"]["held_out"], rel=1e-6)
    assert "friction of joint 3: a curve of free shape through" in str(result)
    # friction of this arm turns within 2 mrad/s, that of the stranger's model within 10
    assert table["chosen_on_held_out"] == [
        f"{term} of joint {joint}" for term in ("sign velocity", "friction curve") for joint in (1, 2, 3)
    ]
    assert "Friction over speed" in (folder / "out/report.html").read_text()
    assert run(["model", str(folder / "out/model.toml")]) == 0
    assert "joint 2: friction curve beside them" in capsys.readouterr().out


def test_a_curve_in_the_model_is_identified_again_to_the_same(curved: tuple[armscope.Identification, Path]) -> None:
    result, folder = curved
    again = armscope.identify(folder / "1.mcap", folder / "out/model.toml", held_out=folder / "3.mcap")
    for band, other in zip(result.friction_bands, again.friction_bands):
        assert np.all(np.abs(band.torque - other.torque) < 0.5 * band.std + 1e-3 * band.torque)
    assert "as in the model" in str(again)


def test_a_joint_that_stands_has_no_curve_and_hinders_no_other(
    curved: tuple[armscope.Identification, Path],
) -> None:
    """It has no rows, and its curve is to be smooth with the noise of its rows."""
    _, folder = curved
    whole = armscope.open(folder / "1.mcap")
    q, i = whole.q.copy(), whole.i.copy()
    q[:, 2], i[:, 2] = q[0, 2], i[0, 2]
    found = armscope.identify(replace(whole, q=q, i=i, qref=None), folder / "out/model.toml", method="ols")
    assert [band.joint for band in found.friction_bands if band.curve] == [1, 2]


def test_straight_friction_stays_straight(tmp_path: Path) -> None:
    result = _identified(tmp_path, straight, seconds=12.0)
    assert not any(band.curve for band in result.friction_bands)
    assert all(joint.friction_curve is None for joint in result.arm.joints)
    assert "friction of joints 1, 2, 3: Coulomb and viscous (a curve is not justified" in str(result)
    assert result.chosen_on_held_out == [] and "were chosen by" not in str(result)
    result.write(tmp_path / "out")
    assert "friction of joint 1: Coulomb and viscous (a curve is not" in (tmp_path / "out/report.html").read_text()
    assert len(result.extra["friction_trials"]) == 3
    for trial in result.extra["friction_trials"]:
        assert bool(trial["why"]) == (trial["curve"] < 0.95 * trial["straight"])


def test_a_curve_that_halves_the_error_stays_though_few_seconds_are_held_out(
    curved: tuple[armscope.Identification, Path],
) -> None:
    """Their blocks alone are too few: the fitted recording, predicted in stretches, shows that it is no chance."""
    _, folder = curved
    held_out = recording(folder / "short.mcap", humped, 3, seconds=6.0)
    result = armscope.identify(folder / "1.mcap", folder / "model.toml", held_out=held_out)
    assert len(result.extra["friction_trials"]) == 3
    for trial in result.extra["friction_trials"]:
        assert trial["curve"] < 0.5 * trial["straight"]
        assert trial["p"] < 1e-4
        assert trial["stays"] and not trial["why"]


def test_any_speeds_of_a_curve_are_smoothed_and_a_line_over_their_logarithm_is_smooth() -> None:
    """Moves from point to point creep at their ends: several speeds below a thousandth of the fastest one."""
    speeds = (4e-4, 7e-4, 1.3e-3, 0.02, 0.4, 3.0)
    bends = _second_differences(_logarithm(speeds))
    assert np.isfinite(bends).all()
    np.testing.assert_allclose(bends @ (2.0 - 0.3 * np.log(speeds)), 0, atol=1e-10)
    assert np.abs(bends @ np.array(speeds)).max() > 0.01
    # a first speed of 0 has no logarithm
    for above in (2e-4, 0.5):
        assert np.isfinite(_second_differences(_logarithm((0.0, above, 1.0, 3.0)))).all()


def test_a_shape_is_refused_where_the_method_has_none(tmp_path: Path) -> None:
    fit = recording(tmp_path / "1.mcap", straight, 1, seconds=5.0)
    with pytest.raises(armscope.InputError, match="--shape: free is determined by ols, wls and irls"):
        armscope.identify(fit, stranger(tmp_path / "model.toml"), method="iv", shape="free")


def test_of_a_joint_that_rests_in_held_out_recordings_no_errors_are_compared(root: Path, tmp_path: Path) -> None:
    arm = second_day.puma(root)
    fit, held_out = (
        second_day.record(tmp_path / f"{k}.mcap", arm, k, seed=k, resting=resting)
        for k, resting in enumerate((None, 2))
    )
    said = sentences(armscope.identify(fit, arm, held_out=held_out))
    (of_joint,) = [one for one in said if one.startswith("friction of joint 3: ")]
    assert "slides on no held-out row" in of_joint and "->" not in of_joint
    assert any("->" in one for one in said)
