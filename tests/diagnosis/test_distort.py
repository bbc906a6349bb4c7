"""A parameter allowed to vary is seen to vary with what it was made to vary with.

It stays level where nothing is hidden.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy import linalg

from arm_io import InputError
from arm_model.description import Arm
from arm_model.model_file import read_model
from daq.recording import Recording
from diagnosis.distortion.distortion import Distortion, distort, named_parameter, sentence
from diagnosis.distortion.random_walk import smoothed
from diagnosis.distortion.report import write_distortion
from diagnosis.residual.run import Run
from tests.diagnosis.runs import seen

EXPERIMENTS = ("excitation", "excitation_held_out")


@pytest.fixture(scope="module")
def puma(root: Path) -> Arm:
    return read_model(root / "config/models/puma560.toml")


@pytest.fixture(scope="module")
def plain(root: Path, puma: Arm) -> tuple[Run, ...]:
    return seen(root, puma, [], EXPERIMENTS).fit


def _distorted(arm: Arm, name: str, runs: tuple[Run, ...]) -> Distortion:
    cold = cast(list[Recording], [SimpleNamespace(temp=None) for _ in runs])
    return distort(arm, name, runs, cold)


def _with_torque(run: Run, joint: int, torque: np.ndarray) -> Run:
    """The run as if joint (from 1) had needed a torque (m,) N m more for the motion it made."""
    current = run.current.copy()
    current[:, joint - 1] += torque / run.arm.joints[joint - 1].drive_constant
    return replace(run, current=current)


def test_friction_that_follows_position_is_seen_against_position(puma: Arm, plain: tuple[Run, ...]) -> None:
    def sticky(run: Run) -> np.ndarray:
        return np.asarray(4.0 * np.sin(2.0 * run.q[:, 1]) * run.v[:, 1])

    result = _distorted(puma, "link2.viscous", tuple(_with_torque(run, 2, sticky(run)) for run in plain))
    assert result.parameter == "joint2.viscous"
    assert result.varies and result.shares[0].against == "position" and result.shares[0].share > 0.6
    for path in result.paths:
        truth = result.model + 4.0 * np.sin(2.0 * path.against["position"])
        fast = path.seen & (path.against["speed"] > 0.4)  # where the parameter shows at all
        assert np.corrcoef(path.value[fast], truth[fast])[0, 1] > 0.95
    assert "position explains" in sentence(result)


def test_friction_that_drifts_is_seen_against_time(puma: Arm, plain: tuple[Run, ...]) -> None:
    def drifting(run: Run) -> np.ndarray:
        force = puma.joints[0].ratio * puma.joints[0].coulomb[0]
        return np.asarray(-0.3 * force * (1.0 - np.exp(-run.t / 6.0)) * np.sign(run.v[:, 0]))

    result = _distorted(puma, "joint1.coulomb", tuple(_with_torque(run, 1, drifting(run)) for run in plain))
    assert result.varies and result.shares[0].against == "time" and result.shares[0].share > 0.8
    for path in result.paths:
        truth = result.model * (1.0 - 0.3 * (1.0 - np.exp(-path.t / 6.0)))
        assert np.quantile(np.abs(path.value - truth)[path.seen], 0.9) < 0.04 * result.model


def test_friction_that_differs_by_direction_is_seen_against_direction(puma: Arm, plain: tuple[Run, ...]) -> None:
    result = _distorted(puma, "joint1.coulomb", tuple(_with_torque(run, 1, np.full(len(run.t), 3.0)) for run in plain))
    assert result.varies and result.shares[0].against == "direction" and result.shares[0].share > 0.8


@pytest.mark.parametrize("name", ["joint1.coulomb", "joint2.viscous", "joint1.torque_constant", "link3.mass"])
def test_with_nothing_hidden_it_stays_level_at_what_the_model_says(
    puma: Arm, plain: tuple[Run, ...], name: str
) -> None:
    result = _distorted(puma, name, plain)
    assert not result.varies
    for path in result.paths:
        assert np.all(np.abs(path.value - result.constant[0]) < 4 * path.std)
    value, _ = result.constant
    assert value == pytest.approx(result.model, rel=0.005)
    assert "does not vary" in sentence(result)


def test_the_smoother_is_least_squares_on_all_that_was_seen() -> None:
    """Against the joint normal equations of walk and measurements: tridiagonal, solved at once."""
    rng = np.random.default_rng(3)
    seen_, ratio = rng.uniform(0.0, 3.0, 60) * (rng.random(60) > 0.3), 0.2
    score = seen_ * rng.normal(size=60) + np.sqrt(seen_) * rng.normal(size=60)
    link = np.diff(np.eye(60), axis=0)
    information = np.diag(seen_) + link.T @ link / ratio
    x, variance = smoothed(score, seen_, ratio)
    np.testing.assert_allclose(x, linalg.solve(information, score, assume_a="pos"), atol=1e-9)
    np.testing.assert_allclose(variance, np.diag(np.linalg.inv(information)), rtol=1e-9)


def test_a_parameter_that_too_few_steps_show_is_refused(puma: Arm, plain: tuple[Run, ...]) -> None:
    """Of 0.2 s no step is predicted from another, and the noise of the walk was zero."""
    run = plain[0]
    shown = (run.t > 3.0) & (run.t < 3.2)
    hidden = replace(run, deviation=np.where(shown[:, None], run.deviation, 1e6 * run.deviation))
    with pytest.raises(InputError, match=r"joint2.viscous affects 0\.[23] s of these recordings, .* too short"):
        _distorted(puma, "link2.viscous", (hidden,))


def test_names_are_those_of_identify_and_the_issue(puma: Arm) -> None:
    assert named_parameter(puma, "link2.viscous") == ("joint2.viscous", 2)
    assert named_parameter(puma, "link3.mass") == ("link3.mass", 3)
    for wrong in ("viscous", "joint9.viscous", "link2.colour", "joint1.mass"):
        with pytest.raises(InputError):
            named_parameter(puma, wrong)


def test_what_is_written_is_one_file_that_needs_no_network(puma: Arm, plain: tuple[Run, ...], tmp_path: Path) -> None:
    table = write_distortion(tmp_path, _distorted(puma, "joint2.viscous", plain))
    read: dict[str, Any] = json.loads((tmp_path / "distortion.json").read_text())
    assert read == json.loads(json.dumps(table)) and read["schema"] == "armscope.distortion/1"
    page = (tmp_path / "distortion.html").read_text()
    assert "http" not in page and table["verdict"].split(":")[0] in page
