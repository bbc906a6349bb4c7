"""Recordings that were mixed up are refused or warned of, rather than explained."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from arm_io import InputError
from arm_model.description import Arm, EffectTerm
from arm_model.model_file import read_model, write_model
from daq.recording import Attachments, Recording, open_recording, write_table
from diagnosis import check_recordings
from diagnosis.residual.run import Run
from diagnosis.screening.plausibility import check_motion, mixed_up, recorded_otherwise
from tests.diagnosis.runs import seen


@dataclass
class Angles:
    """The part of a Recording that is looked at."""

    path: Path
    q: np.ndarray


@pytest.fixture(scope="module")
def arm(root: Path) -> Arm:
    return read_model(root / "config/models/puma560.toml")


@pytest.fixture(scope="module")
def run(root: Path, arm: Arm) -> Run:
    wrong = [EffectTerm("torque_constant", 2, {"error": 0.3}), EffectTerm("viscous_friction", 1, {"viscous": 8.0})]
    return seen(root, arm, wrong).fit[0]


def test_a_wrong_model_is_no_mixup(run: Run) -> None:
    assert mixed_up([run]) == ()


@pytest.mark.parametrize(("factor", "word"), [(-1.0, "sign"), (1e3, "unit"), (-1e3, "sign"), (0.01, "unit")])
def test_currents_of_another_sign_or_unit(run: Run, factor: float, word: str) -> None:
    (said,) = mixed_up([replace(run, current=factor * run.current, noise=abs(factor) * run.noise)])
    assert word in said and run.name in said


def test_large_currents_that_do_not_follow_the_expected_ones_are_of_no_other_unit(run: Run) -> None:
    """Ten times as large, a quarter of a second late at 1 Hz: another error, which the unit would not mend."""
    wave = 2 * np.pi * run.t[:, None]
    sine, cosine = np.sin(wave) + 0.0 * run.current, np.cos(wave) + 0.0 * run.current
    size = 20.0 * run.noise
    assert "unit" in mixed_up([replace(run, expected=size * sine, current=10.0 * size * sine)])[0]
    assert mixed_up([replace(run, expected=size * sine, current=10.0 * size * cosine)]) == ()


def _recording(q: np.ndarray) -> Recording:
    return cast(Recording, Angles(Path("run.mcap"), q))


def test_angles_in_degrees_and_arms_at_rest_are_refused(run: Run, arm: Arm) -> None:
    check_motion(arm, [_recording(run.q), _recording(0.0 * run.q)], "fitted")
    with pytest.raises(InputError, match="degrees"):
        check_motion(arm, [_recording(np.degrees(run.q))], "fitted")
    with pytest.raises(InputError, match="no joint moves in the held-out"):
        check_motion(arm, [_recording(0.0 * run.q)], "held-out")


def test_a_recording_made_with_other_drives(arm: Arm, tmp_path: Path) -> None:
    """Refused where they are other ones, as ``identify`` and ``compare`` do; a smaller difference is told."""
    t = np.arange(2000) / 500
    q = 0.3 * np.sin(2 * np.pi * 0.5 * t)[:, None] * np.ones(6)

    def recorded(factor: float, **provenance: str) -> Recording:
        third = replace(arm.joints[2], torque_constant=factor * arm.joints[2].torque_constant)
        own = replace(arm, joints=(*arm.joints[:2], third, *arm.joints[3:]))
        write_model(tmp_path / "own.toml", own)
        carried = Attachments(model=(tmp_path / "own.toml").read_text(), provenance={"kind": "measured", **provenance})
        write_table(tmp_path / "run.mcap", t, {"q": q, "i": 1.0 + q}, carried)
        return open_recording(tmp_path / "run.mcap")

    constant = arm.joints[2].drive_constant
    for factor, said in ((1.0, []), (0.8, [f"{0.8 * constant:.4g} N m/A at joint 3", f"has {constant:.4g},"])):
        check_recordings(arm, [found := recorded(factor)])
        told = recorded_otherwise(arm, [found, found])
        assert len(told) == bool(said) and all(one in told[0] for one in said)
    with pytest.raises(InputError, match=rf"{2 * constant:.4g} N m/A at joint 3.*has {constant:.4g}"):
        check_recordings(arm, [recorded(2.0)])
    needed = 1 / abs(arm.joints[0].gear)
    said = rf"has the torque of joint 1 \(N m\).*takes currents.*torque_constant is 1 over the gear, {needed:.4g};"
    with pytest.raises(InputError, match=said):
        check_recordings(arm, [recorded(1.0, current_unit="N m")])
