"""Recordings little longer than the shortest that is not refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armscope
from arm_io import InputError
from arm_model import Arm
from daq.recording import Recording
from diagnosis.screening.cleaned import screened
from diagnosis.screening.residuals import residuals_of
from diagnosis.selection import regression


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return armscope.read_model(root / "config/starters/csv/model.toml")


@pytest.mark.parametrize("seconds", np.arange(2.6, 5.0, 0.2))
def test_dropped_triggers_are_looked_for_in_a_run_of_any_length(
    arm: Arm, root: Path, tmp_path: Path, seconds: float
) -> None:
    motion = armscope.read_experiment(root / "config/starters/csv/fit.toml")
    pause, series = motion.segment[:2]
    short = motion.model_copy(update={"segment": [pause, series.model_copy(update={"duration": seconds, "fade": 0.4})]})
    recording = armscope.simulate(arm, short).write(tmp_path / "short.mcap")
    assert len(residuals_of(arm, screened(arm, [recording])).runs) == 1


def _loaded(arm: Arm, root: Path, tmp_path: Path, name: str, seconds: float, mass: float = 3.0) -> Recording:
    """A run with a mass that the model does not have, and noise."""
    motion = armscope.read_experiment(root / f"config/starters/csv/{name}.toml")
    pause, series = motion.segment[:2]
    part = motion.model_copy(update={"segment": [pause, series.model_copy(update={"duration": seconds, "fade": 0.4})]})
    real = arm.with_effect("payload", mass=mass, x=0.05, y=0.0, z=0.1)
    path = tmp_path / f"{name}_{seconds}.mcap"
    recording = armscope.simulate(real, part, rate=500.0).write(path)
    noise = 0.01 * np.random.default_rng(1).normal(size=recording.i.shape)
    return replace(recording, i=recording.i + noise)


def test_a_large_payload_shows_in_few_seconds(arm: Arm, root: Path, tmp_path: Path) -> None:
    """By the instants at which it acts, where the signs of so few blocks tell nothing."""
    fit, held_out = (_loaded(arm, root, tmp_path, *run) for run in (("fit", 8.0), ("held_out", 2.5)))
    found = armscope.diagnose(fit, arm, held_out=held_out)
    (cause,) = found.causes
    assert found.verdict == "explained" and found.too_short is None and cause.effect == "payload"
    assert cause.parameters[0].value == pytest.approx(3.0, abs=2.0 * cause.parameters[0].std)


def test_a_recording_too_short_to_be_split_is_said_at_its_own_length(arm: Arm, root: Path, tmp_path: Path) -> None:
    recording = _loaded(arm, root, tmp_path, "fit", 4.0)
    long = len(recording) * recording.dt
    with pytest.raises(InputError, match=rf"is {long:.1f} s long; .*--held-out OTHER.mcap, or record at least 11 s"):
        armscope.diagnose(recording, arm)


@pytest.mark.parametrize("seconds", [2.5, pytest.param(3.5, marks=pytest.mark.slow)])
def test_too_few_seconds_are_no_unexplained_structure(
    arm: Arm, root: Path, tmp_path: Path, seconds: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of an effect that acts all the time, so that its instants do not decide either."""
    monkeypatch.setattr(regression, "LARGE", 1e9)
    monkeypatch.setattr(regression, "LARGEST", np.inf)
    fit, held_out = (_loaded(arm, root, tmp_path, *run) for run in (("fit", 8.0), ("held_out", seconds)))
    short = armscope.diagnose(fit, arm, held_out=held_out)
    table = short.to_json()
    assert short.verdict != "unexplained" and not table["unexplained"] and not short.causes
    assert str(short).startswith(f"Too short to judge: {table['seconds_needed']:.0f} s more are needed")
    assert table["too_short"] == [short.too_short] and "Consistent" not in str(short)
    enough = _loaded(arm, root, tmp_path, "held_out", seconds + table["seconds_needed"])
    found = armscope.diagnose(fit, arm, held_out=enough)
    assert [(cause.effect, found.too_short) for cause in found.causes] == [("payload", None)]


def test_what_no_effect_explains_stays_unexplained(arm: Arm, root: Path, tmp_path: Path) -> None:
    fit, held_out = (_loaded(arm, root, tmp_path, *run, mass=1e-9) for run in (("fit", 8.0), ("held_out", 3.5)))
    steps = np.random.default_rng(3).normal(size=(60, 2))
    strange = [replace(r, i=r.i + 2.0 * steps[(5.0 * r.t).astype(int)]) for r in (fit, held_out)]
    result = armscope.diagnose(strange[0], arm, held_out=strange[1])
    assert result.verdict == "unexplained" and result.too_short is None
